"""Whether the fit of excursions finds the parameters that made them: many draws of one noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cases.papers.models.networks.excursion_fit import (
    EXTENSOR,
    Identified,
    JointCoupling,
    MeasuredKinematics,
    identify,
)
from cases.papers.models.networks.robotic_finger import MUSCLES, SLIP_OF, robotic_finger
from cosim.port import Array
from rigid.hoods.network import Network
from rigid.hoods.two_band import JOINTS, coupled_dip

POSES, NOISE = 700, 1.5e-3
"""As many and as noisy (m) as the paper's."""
OBSERVED, ANGLE_NOISE = 100, np.radians(0.1)
"""Points on the coupling curve, and rad of both their angles; assumptions."""
LIMITS = np.array([[-0.3, 0.0, 0.0], [1.4, 1.75, 1.2]])
"""rad, of random postures: MCP, PIP, DIP."""
NORMAL_95 = 1.959964


class Draws(NamedTuple):
    """The results of many fits, p parameters each."""

    names: tuple[str, ...]
    miss: Array
    """(draws, p) value less truth, over its standard deviation."""
    deviation: Array
    """(draws, p) standard deviations, m and m/rad."""
    distance: Array
    """(draws,) squared distance from the truth by the covariance: chi-square of p."""

    @property
    def coverage(self) -> float:
        """Part of all 95 % intervals that hold the truth."""
        return float((np.abs(self.miss) < NORMAL_95).mean())


def true_parameters(network: Network) -> dict[str, float]:
    """What a fit of the network's excursions should find, m and m/rad."""
    truth = {f"{muscle} length": 0.0 for muscle in MUSCLES}
    for i, muscle in enumerate(MUSCLES):
        for j, joint in enumerate(JOINTS):
            ways = [network.direct, network.connecting][: 1 + (muscle not in SLIP_OF)]
            truth[f"{muscle} {joint}"] = sum(float(a.constant[j, i]) for a in ways)
            truth[f"{muscle} {joint} slope"] = sum(float(a.slope[j, i]) for a in ways)
    slip = SLIP_OF["EDC"]
    arms, rest = network.connecting, network.rest
    shared = (
        arms.constant[1, slip],
        arms.constant[1, slip + 1],
        arms.slope[1, slip + 1],
        arms.constant[2, slip + 1],
        rest[slip + 1] - rest[slip],
    )
    return truth | dict(zip(EXTENSOR, map(float, shared), strict=True))


def draw_samples(seed: int) -> tuple[MeasuredKinematics, JointCoupling]:
    """What would be measured on a robotic finger without friction."""
    network, rng = robotic_finger(), np.random.default_rng(seed)
    angle = rng.uniform(LIMITS[0], LIMITS[1], (POSES, 3))
    excursion = network.excursion(angle, np.full((POSES, len(MUSCLES)), 1e-6))
    pip = rng.uniform(0.1, LIMITS[1, 1], OBSERVED)
    curve = np.stack([np.zeros_like(pip), pip, coupled_dip(pip)], axis=1)
    curve = curve + rng.normal(0.0, ANGLE_NOISE, curve.shape)
    noisy = excursion + rng.normal(0.0, NOISE, excursion.shape)
    return MeasuredKinematics(angle, noisy, NOISE), JointCoupling(curve, ANGLE_NOISE)


def repeat(draws: int) -> tuple[Draws, Draws]:
    """Fits without and with the coupling's rows, of the same draws."""
    fits: tuple[list[Identified], list[Identified]] = ([], [])
    for seed in range(draws):
        poses, curve = draw_samples(seed)
        fits[0].append(identify(poses))
        fits[1].append(identify(poses, curve))
    return _sums(fits[0]), _sums(fits[1])


def _sums(fits: list[Identified]) -> Draws:
    names, by_name = fits[0].names, true_parameters(robotic_finger())
    off = np.array([fit.value for fit in fits]) - np.array([by_name[name] for name in names])
    deviation = np.array([fit.deviation for fit in fits])
    far = [
        float(miss @ np.linalg.solve(fit.covariance, miss))
        for miss, fit in zip(off, fits, strict=True)
    ]
    return Draws(names, off / deviation, deviation, np.array(far))
