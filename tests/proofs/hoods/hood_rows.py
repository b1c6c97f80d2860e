"""The hoods in lumped form against their own springs and closed forms."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import numpy as np
from scipy.optimize import brentq

from cases.papers.models.networks.human_network import OPERATING_FORCE, TENDONS, human_finger
from cosim.port import STATIC, Array, Motion
from meshes.skeleton import BODIES, index_finger
from rigid.fingers.index import finger_model
from rigid.hoods.joint_angles import flexion_joints
from rigid.hoods.network import Network
from rigid.hoods.network_hood import NetworkHood
from rigid.hoods.two_band import (
    ELASTICITY,
    band_forces,
    coupled_dip,
    lateral_band,
    middle_band,
    shift_difference,
    two_band,
)
from tests.helpers.rows import Row

NETWORKS = (
    "Development and Validation of Modeling Framework for Interconnected Tendon Networks in "
    "Robotic and Human Fingers, equations 1-11, section III; arms of Buchner et al. 1988"
)
BANDS = "Buchner, Hines and Hemami 1988, J Biomech 21, equations 3-6, 15-17, table 1"
MAXWELL = "Maxwell's reciprocity: d torque / d tension = d excursion / d angle"
DEMAND = "what real-time use asks: 10^5 posture-load evaluations a second"
EDC, LUM, UI = range(3)
LIMITS = np.array([[-0.5, 0.0, 0.0], [1.6, 1.9, 1.3]])
"""rad, of random postures: MCP, PIP, DIP."""


def network_rows() -> Iterator[Row]:
    """The human finger's network."""
    network, name = human_finger(), "network"
    posture, force = _states(network, 1000)
    apart = max(_difference(network, q, f) for q, f in zip(posture, force, strict=True))
    what = "tensions apart from the springs' root, over the force, 1000 postures"
    yield Row(name, what, 1e-10, apart, 0.0, NETWORKS, "bound")
    yield Row(name, "s for 10^5 evaluations", 1.0, _seconds(network), 0.0, DEMAND, "shown")
    yield from _arm_rows(network, name, (EDC, LUM, UI))
    yield Row(
        name,
        "coupling curve apart, rad",
        1e-9,
        _curve(network, TENDONS.index("EDC slip")),
        0.0,
        NETWORKS,
        "bound",
    )
    for law, operating in (("", None), (", constant-force shares", OPERATING_FORCE)):
        gap = _reciprocity(network, operating)
        yield Row(name + law, "reciprocity", 1e-8, gap, 0.0, MAXWELL, "bound")
    yield Row(name, "excursions, eq. 11 apart, m", 1e-9, _integral(network), 0.0, NETWORKS, "bound")


def two_band_rows() -> Iterator[Row]:
    """The finger of two bands."""
    network, name = two_band(), "two bands"
    posture, force = _states(network, 1000)
    difference = shift_difference(posture[:, 1], posture[:, 2])
    known = np.stack(band_forces(force[:, 0], difference, ELASTICITY, 0.5), axis=1)
    apart = float(np.abs(network.solve(posture, force)[1] - known).max())
    yield Row(name, "bands apart from eq. 16, N", 1e-10, apart, 0.0, BANDS, "bound")
    yield from _arm_rows(network, name, (EDC,), force=0.1)
    yield Row(name, "coupling curve apart, rad", 1e-9, _curve(network, 0), 0.0, BANDS, "bound")
    yield Row(name, "reciprocity", 1e-8, _reciprocity(network, None), 0.0, MAXWELL, "bound")
    shift = _larger_shift(network, posture)
    yield Row(name, "unloaded shift apart from eq. 5, m", 1e-15, shift, 0.0, BANDS, "bound")


def _states(network: Network, count: int) -> tuple[Array, Array]:
    """Postures (count, 3), half of them near the coupling curve, and forces (count, m)."""
    rng = np.random.default_rng(0)
    posture = rng.uniform(LIMITS[0], LIMITS[1], (count, 3))
    near = posture[: count // 2]
    near[:, 2] = coupled_dip(near[:, 1]) + rng.normal(0, 0.02, len(near))
    return posture, rng.uniform(0.01, 60.0, (count, len(network.muscles)))


def _difference(network: Network, angle: Array, force: Array) -> float:
    """Tensions against a root search on the sum of the springs' forces, over the muscle's force."""
    length, (_, tension) = network.lengths(angle), network.solve(angle, force)
    worst = 0.0
    for i, own in enumerate(network.connection.T.astype(bool)):
        if own.any():
            known = _bracket(length[own], network.stiffness[own], float(force[i]))
            worst = max(worst, float(np.abs(tension[own] - known).max() / force[i]))
    return worst


def _bracket(length: Array, stiffness: Array, force: float) -> Array:
    nearest = length - length.min()

    def excess(position: float) -> float:
        return float(stiffness @ np.maximum(position - nearest, 0.0) - force)

    most = float(nearest.max() + force / stiffness.min())
    root = brentq(excess, 0.0, most, xtol=1e-18, rtol=8.9e-16, maxiter=500)
    return stiffness * np.maximum(root - nearest, 0.0)


def _seconds(network: Network) -> float:
    posture, force = _states(network, 100_000)
    times = []
    for _ in range(3):
        start = perf_counter()
        network.torque(posture, force)
        times.append(perf_counter() - start)
    return min(times)


def _arm_rows(
    network: Network, name: str, muscles: tuple[int, ...], force: float = OPERATING_FORCE
) -> Iterator[Row]:
    """Effective arms at PIP and DIP far from the switch, relative to those of one tendon."""
    same = np.full(len(network.muscles), force)
    sides = {
        "r_LB, r_TE above": (np.array([0.0, 0.3, 1.2]), lateral_band()),
        "r_ES below": (np.array([0.0, 1.8, 0.0]), middle_band()),
    }
    for words, (angle, band) in sides.items():
        known = [c + s * q for (c, s), q in zip(_ends(band), angle[1:], strict=True)]
        found = network.effective_arms(angle, same)[1:, list(muscles)].T
        worst = float(np.abs(found / 5e-3 - np.array(known) / 5e-3).max())
        what = f"effective arms less {words} the curve, over 5 mm"
        yield Row(name, what, 1e-15, worst, 0.0, NETWORKS, "bound")


def _ends(band: dict[str, tuple[float, float]]) -> list[tuple[float, float]]:
    return [band.get(joint, (0.0, 0.0)) for joint in ("PIP", "DIP")]


def _curve(network: Network, slip: int) -> float:
    """rad: largest distance of the DIP angle at which EDC's tendons share by stiffness alone from
    the parabola (R' / R13) PIP^2."""
    force = np.full(len(network.muscles), OPERATING_FORCE)
    on_edc = network.connection[:, EDC] * network.stiffness
    even = on_edc[slip] / on_edc.sum()

    def excess(dip: float, pip: float) -> float:
        share = network.distribution(np.array([0.0, pip, dip]), force)
        return float(share[slip, EDC] - even)

    bent = np.linspace(0.05, 1.9, 20)
    found = [brentq(excess, -0.5, 2.0, args=(pip,), xtol=1e-13) for pip in bent]
    return float(np.abs(np.array(found) - coupled_dip(bent)).max())


def _reciprocity(network: Network, operating: float | None) -> float:
    """Largest relative difference of moment arms by force and by excursion, both by differences, at
    poses of the index finger by the coupling curve and for twists that no hinge allows."""
    skeleton, step = index_finger(), 1e-4
    rest, bent = (
        Motion(BODIES, *skeleton.pose(q)) for q in ({}, {"MCP": 0.5, "PIP": 0.8, "DIP": 0.23})
    )
    hinges = flexion_joints(finger_model(skeleton))
    hood = NetworkHood(network, hinges, rest, operating_force=operating)
    state, tension = hood.start(bent), np.linspace(10.0, 4.0, len(network.muscles))

    def load(change: Array) -> Array:
        return hood.advance(state, bent, tension + change, STATIC).load.total().ravel()

    def excursion(twist: Array) -> Array:
        return hood.advance(state, bent.displace(twist), tension, STATIC).excursion

    each = step * np.eye(len(tension))
    arms = np.array([(load(dt) - load(-dt)) / (2 * step) for dt in each])
    worst, rng = 0.0, np.random.default_rng(0)
    for _ in range(5):
        twist = rng.normal(size=(4, 6)) * 0.1
        twist[0] = 0.0  # the muscles' own body
        slope = (excursion(step * twist) - excursion(-step * twist)) / (2 * step)
        worst = max(worst, float(np.abs(arms @ twist.ravel() - slope).max() / np.abs(slope).max()))
    return worst


def _integral(network: Network) -> float:
    """m: excursions at the operating force less the arms' integral (midpoints) to a bent finger."""
    same, end = np.full(len(network.muscles), OPERATING_FORCE), np.array([0.4, 1.3, 0.9])
    t = np.linspace(0, 1, 20001)[:, None]
    middle = 0.5 * (t[1:] + t[:-1]) * end
    arms = network.effective_arms(middle, np.broadcast_to(same, (len(middle), len(same))))
    known = np.einsum("n,pnm->m", end / len(middle), arms)
    ends = [network.constant_force_excursion(q, same) for q in (np.zeros(3), end)]
    return float(np.abs(ends[1] - ends[0] - known).max())


def _larger_shift(network: Network, posture: Array) -> float:
    """m: ED's excursion without tension less -R11 phi1 and the larger shift (3a, 5)."""
    none = np.zeros((len(posture), len(network.muscles)))
    found = network.excursion(posture, none)[:, 0] - network.direct.lengths(posture)[:, 0]
    return float(np.abs(found - network.connecting.lengths(posture).min(axis=1)).max())
