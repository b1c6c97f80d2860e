"""The studies of the network paper: switch, identification, inverse prediction, virtual testbed.

The testbed is virtual throughout: its measurements are not published
(`cases/papers/models/networks/testbed_runs.py` says what was taken instead).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from cases.papers.models.networks.arm_switch import predict, switch
from cases.papers.models.networks.excursion_fit import identify
from cases.papers.models.networks.excursion_fit_check import draw_samples, repeat
from cases.papers.models.networks.human_network import MUSCLES, OPERATING_FORCE, human_finger
from cases.papers.models.networks.robotic_finger import LENGTH
from cases.papers.models.networks.share_models import (
    MOMENT_ARM,
    Inverse,
    ShareFinger,
    forward,
    inverse,
    with_shares,
)
from cases.papers.models.networks.testbed_runs import (
    ELSEWHERE,
    FRICTION_ELSEWHERE,
    POSTURE,
    REPORTED,
    hysteresis,
    virtual_bed,
)
from cases.papers.models.networks.testbed_study import (
    REPORTED_ERRORS,
    SeedTrial,
    constrain_to_curve,
    errors,
    trials,
)
from cosim.port import Array
from tests.helpers.rows import Row

PAPER = (
    "Development and Validation of Modeling Framework for Interconnected Tendon Networks in "
    "Robotic and Human Fingers, section "
)
PRINTED = (
    "0.68, 0.67, 0.47: the paper's ratios of RMSE, figures 7, 8, 9; virtual testbed, no measurement"
)
RATIOS = {"forward": 0.68, "inverse": 0.67, "circle": 0.47}
DIP = np.radians(45.0)
LITTLE = 1e-4
"""N."""
DRAWS, SEEDS = 100, 10


def switch_rows() -> Iterator[Row]:
    """Figure 3: where the effective arms switch."""
    network, name = human_finger(), "switch at DIP 45 deg"
    source = PAPER + "III-A; equations 6 and 7"
    pairs = [(m, f) for m in range(3) for f in (0.01, 1.0, OPERATING_FORCE, 100.0)]
    ends = [np.array(switch(network, m, DIP, f)) - predict(network, m, DIP, f) for m, f in pairs]
    worst = float(np.abs(ends).max())
    yield Row(name, "ends apart from their closed form, rad", 1e-12, worst, 0.0, source, "bound")
    width = {f: switch(network, 0, DIP, f).width for f in (LITTLE, 100 * LITTLE, OPERATING_FORCE)}
    limit = width[LITTLE] / LITTLE
    slope = width[100 * LITTLE] / (100 * LITTLE)
    yield Row(name, "width over f_m0 as f_m0 -> 0, rad/N", limit, slope, 1e-4, source)
    stiff = replace(network, stiffness=2 * network.stiffness)
    halved = switch(stiff, 0, DIP, 2 * OPERATING_FORCE).width
    what = "EDC's width at twice stiffness and force, rad"
    yield Row(name, what, width[OPERATING_FORCE], halved, 1e-12, source)
    softer = width[OPERATING_FORCE] / switch(network, MUSCLES.index("LUM"), DIP, 10.0).width
    yield Row(name, "EDC's width over LUM's", 1.0, softer, 0.0, source, "bound")


def identification_rows() -> Iterator[Row]:
    """700 poses with 1.5 mm of noise, over and over."""
    name, source = "identification", PAPER + "IV-B: 700 poses, RMS 1.54 mm; robotic_finger.py"
    alone, joined = repeat(DRAWS)
    for words, draws in (("excursions alone", alone), ("with the coupling curve", joined)):
        yield Row(
            name,
            f"95 % intervals that hold the truth, {words}",
            0.95,
            draws.coverage,
            0.01,
            source,
            "absolute",
        )
        far = float(draws.distance.mean()) / len(draws.names)
        what = f"squared distance from the truth over its expectation, {words}"
        yield Row(name, what, 1.0, far, 0.1, source)
    narrower = (joined.deviation / alone.deviation).mean(axis=0)
    what = "interval with the curve over without, "
    for parameter in ("slip PIP", "lateral PIP", "lateral PIP slope", "terminal DIP", "slack"):
        ratio = float(narrower[alone.names.index(parameter)])
        yield Row(name, what + parameter, 1.0, ratio, 0.0, source, "bound")


def inverse_rows() -> Iterator[Row]:
    """Equation 13 where its answer is known: fingertip forces of the model's own."""
    name, source = "inverse prediction", PAPER + "IV-D, equation 13"
    finger = identify(*draw_samples(0)).finger(LENGTH)
    rng = np.random.default_rng(1)
    count = 40
    angle = POSTURE + rng.normal(0.0, 0.1, (count, 3))
    estimate = rng.uniform([0, 0, 1, 1], [4, 4, 6, 6], (count, 4))
    tip_force = with_shares(finger, angle, estimate, np.full(4, 0.5)).force
    found = inverse(finger, angle, tip_force, estimate)
    yield Row(name, "constraint missed by, N", 1e-5, float(found.miss.max()), 0.0, source, "bound")
    cost = ((found.muscles - estimate) ** 2).sum(axis=1)
    beaten = [c - _other(finger, angle[k], tip_force[k], estimate[k]) for k, c in enumerate(cost)]
    what = "cost above that of sequential quadratic programming, N^2"
    yield Row(name, what, 1e-5, float(max(beaten)), 0.0, source, "bound")
    yield from _recover(finger, angle, estimate)


def _recover(finger: ShareFinger, angle: Array, force: Array) -> Iterator[Row]:
    """Forces that leave no torque at the tip are their own nearest."""
    name, source = "inverse prediction", PAPER + "IV-D, equation 13"
    ahead = forward(finger, angle, force)
    borne = np.abs(ahead.torque) < 1e-12
    again: Inverse = inverse(finger, angle[borne], ahead.force[borne], force[borne])
    off = float(np.abs(again.muscles - force[borne]).max())
    what = f"forces apart from those of {int(borne.sum())} forward predictions, N"
    yield Row(name, what, 1e-4, off, 0.0, source, "bound")


def _other(finger: ShareFinger, angle: Array, tip_force: Array, estimate: Array) -> float:
    """N^2: the least cost of (13) that scipy's SLSQP finds, from several shares on."""

    def off(x: Array) -> Array:
        made = with_shares(finger, angle, x[:4], np.full(4, x[4]))
        return np.append(made.force - tip_force, made.torque / MOMENT_ARM)

    costs = []
    for share in (0.2, 0.5, 0.8):
        tried = minimize(
            lambda x: float(((x[:4] - estimate) ** 2).sum()),
            np.append(estimate, share),
            bounds=[(0.0, None)] * 4 + [(0.0, 1.0)],
            constraints={"type": "eq", "fun": off},
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 300},
        )
        if tried.success and np.abs(off(tried.x)).max() < 1e-8:
            costs.append(float(tried.fun))
    return min(costs, default=np.inf)


def testbed_rows() -> Iterator[Row]:
    """Forward, inverse and circle over ten seeds."""
    name = "virtual testbed"
    sized = hysteresis(virtual_bed())
    source = PAPER + "IV-C: hysteresis of up to +-0.5 N; friction is sized to it"
    yield Row(name, "hysteresis, +-N", REPORTED, sized.half, 0.01, source, "absolute")
    found = errors(trials(SEEDS))
    for experiment, each in found.items():
        mean = each.mean(axis=0)
        yield _ratio(
            name, f"{experiment}: interconnected over static, {SEEDS} seeds", each, experiment
        )
        for model, mine, theirs in zip(
            ("interconnected", "static"), mean, REPORTED_ERRORS[experiment], strict=True
        ):
            what = f"{experiment}: RMSE of the {model} model, N"
            about = PAPER + "IV, its own testbed's RMSE, without a spread"
            yield Row(name, what, theirs, float(mine), 0.0, about, "shown")
    without, elsewhere = trials(SEEDS, 0.0), trials(SEEDS, FRICTION_ELSEWHERE, ELSEWHERE)
    off = hysteresis(virtual_bed(FRICTION_ELSEWHERE), ELSEWHERE).angle_from_x
    yield _other_circle(name, "without friction at the routing points", without)
    there = f"in another posture, with the hysteresis {off:.0f} deg off x"
    yield _other_circle(name, there, elsewhere)


def _other_circle(name: str, how: str, found: Sequence[SeedTrial]) -> Row:
    """What friction and the posture, which is not printed, do to the circle."""
    kept = constrain_to_curve(found)
    what = (
        f"circle {how}: interconnected over static, the {kept.sum()} of {SEEDS} seeds that keep "
        "to the coupling curve"
    )
    return _ratio(name, what, errors(found)["circle"][kept], "circle")


def _ratio(name: str, what: str, each: Array, experiment: str) -> Row:
    """The ratio of both models' errors, (seeds, 2) N, with its terms beside the paper's: it can be
    small because one model is good or because the other is bad.  The spread over seeds of our own
    is no tolerance."""
    mean = each.mean(axis=0)
    spread = float((each[:, 0] / each[:, 1]).std(ddof=1))
    terms = " over ".join(
        f"{m:.2g} N for {t:g}" for m, t in zip(mean, REPORTED_ERRORS[experiment], strict=True)
    )
    words = f"{what} ({terms}; SD {spread:.2g})"
    return Row(name, words, RATIOS[experiment], float(mean[0] / mean[1]), 0.0, PRINTED, "shown")
