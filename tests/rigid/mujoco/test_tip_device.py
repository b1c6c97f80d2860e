"""Fingertip devices: closed forms, friction, energy, exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from cosim.port import Array
from rigid.mujoco.implicit_step import friction
from rigid.mujoco.tip_device import Cage, Device, Nothing, Shell, TipContact
from tests.proofs.fingers.dynamics_rows import wrench

STILL = np.zeros(6)
DEVICES = (Cage(), Shell())
IDS = ("cage", "shell")


def touching(device: Device, seed: int) -> tuple[Array, Array]:
    """A place some um deep in one to three walls, and a twist with rolling and slip."""
    rng = np.random.default_rng(seed)
    twist = rng.normal(size=6) * [0.01, 0.01, 0.01, 2.0, 2.0, 2.0]
    if isinstance(device, Shell):
        way = rng.normal(size=3)
        return (device.gap + 1e-5) * way / np.linalg.norm(way), twist
    depth = rng.permutation([1e-6, 3e-6, -2e-4])
    return np.sign(rng.normal(size=3)) * (device.gap + depth), twist


def test_hertz_force_of_a_wall() -> None:
    contact = TipContact(stiffness=1e6, radius=0.01)
    cage, depth = Cage(contact, width=0.03), 2e-4
    place = np.array([0.0, -(cage.gap + depth), 0.0])
    # Simbody: k = (E^(2/3) / 2), f = 4/3 k x sqrt(R k x).
    k = 1e6 ** (2 / 3) / 2
    expected = [0.0, 4 / 3 * k * depth * np.sqrt(0.01 * k * depth), 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(wrench(cage, place, STILL).wrench, expected, rtol=1e-12)


def test_springs_of_a_shell() -> None:
    """A closed form against a sum over points of the sphere, spring by spring as Simbody has it."""
    shell = Shell(TipContact(stiffness=3e9), width=0.0092)
    place = np.array([4e-4, -3e-4, 4e-4])
    way = place / np.linalg.norm(place)
    u, phi = np.meshgrid((np.arange(2000) + 0.5) / 2000, np.pi * (np.arange(64) + 0.5) / 32)
    cos = 1 - 0.1 * u  # the cap in which all touching springs lie
    sin = np.sqrt(1 - cos**2)
    across = np.linalg.svd(way[None])[2][1:]
    points = 0.0046 * (
        cos[..., None] * way
        + (sin * np.cos(phi))[..., None] * across[0]
        + (sin * np.sin(phi))[..., None] * across[1]
    )
    apart = points - place
    distance = np.linalg.norm(apart, axis=2)
    depth = np.maximum(shell.contact.radius - distance, 0.0)
    area = 2 * np.pi * 0.0046**2 * 0.1 / cos.size
    force = -(3e9 * area * depth / distance)[..., None] * apart
    assert (depth[:, -1] == 0.0).all()
    expected = force.sum(axis=(0, 1))
    found = wrench(shell, place, STILL).wrench
    np.testing.assert_allclose(found[:3], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("device", DEVICES, ids=IDS)
@pytest.mark.parametrize("seed", range(4))
def test_derivatives(device: Device, seed: int) -> None:
    place, twist = touching(device, seed)
    at = wrench(device, place, twist)

    def change(dp: Array, dt: Array) -> Array:
        ahead, behind = (wrench(device, place + s * dp, twist + s * dt).wrench for s in (1, -1))
        return ahead - behind

    by_position = [change(e, STILL) / 2e-10 for e in 1e-10 * np.eye(3)]
    by_twist = [change(np.zeros(3), e) / 2e-6 for e in 1e-6 * np.eye(6)]
    assert np.abs(at.wrench[3:]).max() > 0
    for exact, differences in ((at.by_position, by_position), (at.by_twist, by_twist)):
        for rows in (slice(3), slice(3, 6)):  # of the force, and of the far smaller moment
            scale, found = np.abs(exact[rows]).max(), np.transpose(differences)[rows]
            np.testing.assert_allclose(exact[rows], found, atol=1e-6 * scale)


@pytest.mark.parametrize("device", DEVICES, ids=IDS)
def test_elastic_force_is_the_slope_of_the_energy(device: Device) -> None:
    place, _ = touching(device, 3)
    slope = [(device.energy(place + e) - device.energy(place - e)) / 2e-9 for e in 1e-9 * np.eye(3)]
    force = wrench(device, place, STILL).wrench
    np.testing.assert_allclose(-force[:3], slope, atol=1e-6 * np.abs(force).max())
    assert np.abs(force[3:]).max() < 1e-15


@pytest.mark.parametrize("device", DEVICES, ids=IDS)
@pytest.mark.parametrize("seed", range(20))
def test_damping_and_friction_only_take_energy(device: Device, seed: int) -> None:
    place, twist = touching(device, seed)
    resting, moving = wrench(device, place, STILL).wrench, wrench(device, place, twist).wrench
    assert (moving - resting) @ twist < 0.0


@pytest.mark.parametrize("device", DEVICES, ids=IDS)
def test_nothing_within_the_gap_and_no_pull(device: Device) -> None:
    assert not wrench(device, np.full(3, 1e-4), np.ones(6)).wrench.any()
    place, _ = touching(device, 1)
    leaving = np.concatenate([-place / np.linalg.norm(place) * 50.0, np.zeros(3)])
    assert not wrench(device, place, leaving).wrench.any()


def test_friction_coefficient() -> None:
    """Simbody's curve: none at rest, static at the transition velocity, dynamic and viscous far
    beyond."""
    contact = TipContact(static_friction=0.5, dynamic_friction=0.2, viscous_friction=0.7)
    surface = Cage(contact).surface
    speed = contact.transition_velocity
    assert friction(surface, 0.0)[0] == 0.0
    assert friction(surface, speed)[0] == pytest.approx(0.5 + 0.7 * speed)
    assert friction(surface, 100.0)[0] == pytest.approx(0.2 + 70.0, rel=1e-6)
    half = 0.5 * (0.2 + 2 * 0.3 / 1.25) + 0.7 * speed / 2
    assert friction(surface, speed / 2)[0] == pytest.approx(half)


@given(st.floats(1e-6, 0.5).filter(lambda v: abs(v - 0.01) > 1e-5))
def test_friction_slope(speed: float) -> None:
    surface, d = Cage().surface, 1e-4 * speed
    differences = (friction(surface, speed + d)[0] - friction(surface, speed - d)[0]) / (2 * d)
    assert friction(surface, speed)[1] == pytest.approx(differences, rel=1e-3, abs=1e-4)


def test_slip_along_a_wall() -> None:
    """Sliding feels the coefficient's share of the normal force, against the slip, at the wall."""
    cage = Cage(TipContact(dissipation=0.0))
    place = np.array([cage.gap + 2e-6, 0.0, 0.0])
    found = wrench(cage, place, np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])).wrench
    pressed = -found[0]
    assert -found[1] / pressed == pytest.approx(friction(cage.surface, 0.3)[0])
    arm = cage.contact.radius - 1e-6
    np.testing.assert_allclose(found[3:], np.cross([arm, 0, 0], found[:3]), atol=1e-12)


def test_rolling_does_not_slip() -> None:
    cage = Cage(TipContact(dissipation=0.0))
    place, arm = np.array([cage.gap + 2e-6, 0.0, 0.0]), cage.contact.radius - 1e-6
    spin = 3.0
    found = wrench(cage, place, np.array([0.0, -spin * arm, 0.0, 0.0, 0.0, spin])).wrench
    assert abs(found[1]) < 1e-12 * abs(found[0])


def test_no_device_does_nothing() -> None:
    assert not wrench(Nothing(), np.ones(3), np.ones(6)).wrench.any()
    assert Nothing().energy(np.ones(3)) == 0.0


def test_faults() -> None:
    with pytest.raises(InputError, match="wider"):
        Cage(TipContact(radius=0.0045), width=0.009)
    with pytest.raises(InputError, match="wider"):
        Shell(TipContact(radius=0.005))
    with pytest.raises(InputError, match="positive"):
        TipContact(transition_velocity=0.0)
    with pytest.raises(InputError, match="negative"):
        TipContact(dynamic_friction=-0.1)
    with pytest.raises(InputError, match="finite"):
        TipContact(stiffness=float("nan"))
