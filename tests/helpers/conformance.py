"""What every hood behind `cosim.port` must keep, as functions that raise AssertionError.

Each takes a hood, motions of its bodies and tensions (nt,) N; the hood is brought to static
equilibrium at the first motion, then at the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.port import STATIC, Array, Hood, Load, Motion, Response, rotation_matrix
from meshes.skeleton import BODIES, index_finger

TWIST_SCALE = np.array([1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.1])
"""m and rad: twists of a size that moves a finger's points by a millimetre or so."""

POSTURES = (
    {},
    {"MCP": 0.25, "MCP_abduction": 0.05, "PIP": 0.4, "DIP": 0.1},
    {"MCP": 0.5, "MCP_abduction": -0.1, "PIP": 0.8, "DIP": 0.3},
)


def index_motions() -> list[Motion]:
    """The index finger straight, bent and bent more."""
    return [Motion(BODIES, *index_finger().pose(posture)) for posture in POSTURES]


def settle(hood: Hood, motions: Sequence[Motion], tension: Array) -> Response:
    """The static response at the last of the motions, reached through all of them."""
    state = hood.start(motions[0])
    for motion in motions:
        response = hood.advance(state, motion, tension, STATIC)
        state = response.state
    return response


def same_bits(a: Response, b: Response) -> bool:
    return (
        np.array_equal(a.load.wrench, b.load.wrench)
        and np.array_equal(a.load.pull, b.load.pull)
        and np.array_equal(a.excursion, b.excursion)
    )


def assert_close(value: Array, expected: Array, tolerance: float, what: str) -> None:
    """Largest difference over the largest expected magnitude."""
    scale = np.abs(expected).max(initial=0.0) or 1.0
    error = np.abs(value - expected).max(initial=0.0) / scale
    assert error < tolerance, f"{what}: relative error {error:.2e}, allowed {tolerance:.0e}"


def check_shapes(hood: Hood, motions: Sequence[Motion], tension: Array) -> None:
    response = settle(hood, motions, tension)
    nb, nt = len(hood.bodies), len(hood.tendons)
    assert response.load.bodies == hood.bodies
    assert response.load.sources == hood.sources
    assert len(set(hood.bodies)) == nb
    assert len(set(hood.tendons)) == nt
    assert response.load.pull.shape == (nt, 6)
    assert response.excursion.shape == (nt,)
    assert np.isfinite(response.load.wrench).all()
    assert np.isfinite(response.excursion).all()
    jacobian = hood.jacobian(response.state)
    shapes = [np.shape(part) for part in vars(jacobian).values()]
    assert shapes == [(6 * nb, 6 * nb), (6 * nb, nt), (nt, 6 * nb), (nt, nt)]


def check_errors(hood: Hood, motion: Motion, tension: Array) -> None:
    """A wrong input is refused by a message that names what was expected; the state survives."""
    state = hood.start(motion)
    before = hood.advance(state, motion, tension, STATIC)
    with pytest.raises(InputError, match=hood.tendons[0]):
        hood.advance(state, motion, np.append(tension, 1.0), STATIC)
    with pytest.raises(InputError, match=hood.tendons[0]):
        hood.advance(state, motion, np.full(len(tension), np.nan), STATIC)
    stranger = replace(motion, bodies=("elsewhere", *motion.bodies[1:]))
    with pytest.raises(InputError, match="elsewhere"):
        hood.advance(state, stranger, tension, STATIC)
    with pytest.raises(InputError, match="elsewhere"):
        hood.start(stranger)
    assert same_bits(before, hood.advance(state, motion, tension, STATIC))


def check_repeatable(hood: Hood, motions: Sequence[Motion], tension: Array) -> None:
    """A step repeated from the same state gives the same bits, whatever happened in between."""
    state = settle(hood, motions[:1], tension).state
    first = hood.advance(state, motions[-1], tension, STATIC)
    hood.jacobian(first.state)
    hood.advance(first.state, motions[0], 0.5 * tension, STATIC)
    assert same_bits(first, hood.advance(state, motions[-1], tension, STATIC))


def transform_load(load: Load, rotation: Array, translation: Array) -> Load:
    """The load that the hand must feel after `Motion.transform(rotation, translation)`."""
    blocks = np.stack([load.wrench[..., :3], load.wrench[..., 3:]]) @ rotation.T
    force, moment = load.pull[:, :3] @ rotation.T, load.pull[:, 3:] @ rotation.T
    pull = np.hstack([force, moment + np.cross(translation, force)])
    return replace(load, wrench=np.concatenate(blocks, axis=-1), pull=pull)


def check_objective(
    hood: Hood, motions: Sequence[Motion], tension: Array, tolerance: float
) -> None:
    """Turning and moving the whole hand turns the load with it and leaves the excursions."""
    rotation, shift = rotation_matrix(np.array([0.7, -1.1, 0.4])), np.array([0.02, -0.03, 0.05])
    still = settle(hood, motions, tension)
    moved = settle(hood, [m.transform(rotation, shift) for m in motions], tension)
    expected = transform_load(still.load, rotation, shift)
    for part in (slice(0, 3), slice(3, 6)):
        wrench = moved.load.wrench[..., part], expected.wrench[..., part]
        assert_close(*wrench, tolerance, "load of the turned hand")
        assert_close(moved.load.pull[:, part], expected.pull[:, part], tolerance, "its pulls")
    assert_close(moved.excursion, still.excursion, tolerance, "excursion of the turned hand")


def check_balance(hood: Hood, motions: Sequence[Motion], tension: Array) -> None:
    """A massless hood hands on what the tendons pull: force and moment to 1e-9."""
    state = hood.start(motions[0])
    for motion in motions:
        state, load, _ = hood.advance(state, motion, tension, STATIC)
        assert np.abs(load.wrench).max() > 0
        assert max(load.imbalance(motion)) < 1e-9


def random_twists(hood: Hood, count: int, seed: int = 0) -> Array:
    """(count, 6 nb) twists of all bodies but the first: that one carries the muscles, so that its
    motion does work on the pulls too and conjugacy holds for the others."""
    twists = np.random.default_rng(seed).normal(size=(count, len(hood.bodies), 6)) * TWIST_SCALE
    twists[:, 0] = 0.0
    return twists.reshape(count, -1)


def check_reciprocity(
    hood: Hood, motions: Sequence[Motion], tension: Array, tolerance: float, step: float = 5e-5
) -> None:
    """Maxwell: d (load . twist) / dT = d x / d (twist), by differences over solves from one state.

    `step` is relative: to the tension, and to a twist of about 1 mm and 0.1 rad.
    """
    motion, state = motions[-1], settle(hood, motions, tension).state

    def load(t: Array) -> Array:
        return hood.advance(state, motion, t, STATIC).load.total().ravel()

    def excursion(twist: Array) -> Array:
        return hood.advance(state, motion.displace(twist), tension, STATIC).excursion

    change = step * np.abs(tension).max()
    moment_arm = [
        (load(tension + dt) - load(tension - dt)) / (2 * change)
        for dt in change * np.eye(len(tension))
    ]
    for twist in random_twists(hood, 3):
        slope = (excursion(step * twist) - excursion(-step * twist)) / (2 * step)
        assert_close(np.array(moment_arm) @ twist, slope, tolerance, "reciprocity")


def check_jacobian(
    hood: Hood, motions: Sequence[Motion], tension: Array, tolerance: float, step: float = 5e-5
) -> None:
    """`Hood.jacobian` against central differences over solves from one state."""
    motion, solved = motions[-1], settle(hood, motions, tension)
    jacobian = hood.jacobian(solved.state)

    def answer(twist: Array, change: Array) -> Array:
        r = hood.advance(solved.state, motion.displace(twist), tension + change, STATIC)
        return np.concatenate([r.load.total().ravel(), r.excursion])

    zero, none = np.zeros(6 * len(hood.bodies)), np.zeros(len(tension))
    by_motion = np.vstack([jacobian.load_motion, jacobian.excursion_motion])
    by_tension = np.vstack([jacobian.load_tension, jacobian.excursion_tension])
    everywhere = np.random.default_rng(1).normal(size=zero.size).reshape(-1, 6) * TWIST_SCALE
    for twist in [*random_twists(hood, 2), everywhere.ravel()]:
        slope = (answer(step * twist, none) - answer(-step * twist, none)) / (2 * step)
        _compare(hood, by_motion @ twist, slope, tolerance, "over the motion")
    for dt in np.abs(tension).max() * np.eye(len(tension)):
        slope = (answer(zero, step * dt) - answer(zero, -step * dt)) / (2 * step)
        _compare(hood, by_tension @ dt, slope, tolerance, "over the tension")


def _compare(hood: Hood, value: Array, slope: Array, tolerance: float, over: str) -> None:
    split = 6 * len(hood.bodies)
    loads = [part[:split].reshape(-1, 6) for part in (value, slope)]
    assert_close(loads[0][:, :3], loads[1][:, :3], tolerance, f"jacobian of the forces {over}")
    assert_close(loads[0][:, 3:], loads[1][:, 3:], tolerance, f"jacobian of the moments {over}")
    assert_close(value[split:], slope[split:], tolerance, f"jacobian of the excursion {over}")
