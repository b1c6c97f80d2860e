"""What is done on the virtual testbed: friction sized, a finger moved and pulled, sensors read.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, section IV, remade on `virtual_testbed`, since its measurements are not published.
From the paper: hysteresis of the fingertip force of up to +-0.5 N with EDC and LUM at 5 N, mostly
along x; 700 points with excursions off by 1.54 mm (RMS); a circle of 1 N; one share for EDC and
LUM; shares of the static model that match EDC and LUM pulled alone.  Not printed, and taken here:
see `robotic_finger`, the constants below, and the muscle forces, which are drawn at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cases.papers.models.networks.excursion_fit import MeasuredKinematics
from cases.papers.models.networks.robotic_finger import LENGTH, MUSCLES, robotic_finger
from cases.papers.models.networks.share_models import ShareFinger, forward
from cases.papers.models.networks.virtual_testbed import Bed, Course, hold_posture, simulate
from cases.papers.models.printed import printed_values
from cosim.port import Array
from rigid.hoods.network import Network
from rigid.hoods.two_band import coupled_dip


def on_curve(mcp: float, pip: float) -> Array:
    """A posture (3,) rad on the coupling curve, MCP and PIP at so many deg."""
    turned = np.radians(pip)
    return np.array([np.radians(mcp), turned, float(coupled_dip(turned))])


POSTURE = on_curve(-24.0, 30.0)
"""The paper's is not printed.  Shares leave the MCP's torque alone, so that what they change points
from the tip to the MCP: here along x, as the paper's hysteresis mostly does."""
FRICTION = 0.116
"""mu of the routing points, sized by `hysteresis` to REPORTED."""
ELSEWHERE, FRICTION_ELSEWHERE = on_curve(10.0, 30.0), 0.164
"""Where the hysteresis is far off x, and mu sized there: what the posture decides."""
(REPORTED,) = printed_values("networks", "input")["hysteresis"]
"""N, either way."""
JOINT_FRICTION = 1e-3
"""N m; assumption."""
TIP_STIFFNESS = 5e4
"""N/m, of adapter and transducer; assumption."""
PRETENSION = 0.2
"""N, so that no tendon is ever slack; assumption."""
TIP_SPREAD, CELL_SPREAD, ANGLE_SPREAD = 0.02, 0.02, np.radians(0.1)
"""N, N and rad: standard deviations of transducer, load cells and angle sensors; assumptions, the
paper names the sensors and no noise."""
EXCURSION_SPREAD, POSES = 1.54e-3, 700
TURNS, HAND, REST = np.radians([0.5, 1.0, 2.0, 3.0]), 50.0, 5
"""rad by which a hand disturbs a joint, N m/rad of the hand, and the steps that a finger is given
to come to rest; assumptions."""
FDP, FDS, EDC, LUM = range(4)
STEP, RAMP, HOLD, STAGES = 0.1, 1.0, 3.0, 10
"""s, s, s and how many, of a forward run."""
SHARES = (0.1, 0.9)
"""Shares of the slip: nearer to 0 or 1 one way is slack and the finger leaves the coupling
curve."""
TAUT = 5.0
"""N, of EDC and LUM where friction is sized and coupling observed."""
FLEXED = 1.0
"""N, of FDP, which bends the DIP until the lateral bands are taut."""


def virtual_bed(friction: float = FRICTION, joint_friction: float = JOINT_FRICTION) -> Bed:
    """The robotic finger on the testbed; `friction` is mu of the routing points, `joint_friction`
    in N m."""
    return Bed(robotic_finger(), LENGTH, friction, joint_friction)


class Hysteresis(NamedTuple):
    """Fingertip forces at rest after disturbances."""

    force: Array
    """(k, 2) N, the first undisturbed."""
    half: float
    """N, half of the largest distance between two of them."""
    direction: Array
    """(2,), of that distance."""

    @property
    def angle_from_x(self) -> float:
        """The angle, deg, between that direction and x."""
        across, along = np.abs(self.direction[::-1])
        return float(np.degrees(np.arctan2(across, along)))


def hysteresis(bed: Bed, posture: Array = POSTURE) -> Hysteresis:
    """EDC and LUM taut; a hand turns the PIP or the DIP by one of TURNS either way and lets go, one
    after the other (section IV-C)."""
    ramp = np.concatenate([np.linspace(0.0, 1.0, 11)[1:], np.full(REST, np.nan)])
    ways = [s * turn * way for turn in TURNS for way in np.eye(3)[1:] for s in (1.0, -1.0)]
    moved = np.concatenate([np.outer(ramp, way) for way in ways])
    moved = np.concatenate([np.full((REST, 3), np.nan), moved])
    hold = np.where(np.isnan(moved) | (moved == 0.0), 0.0, HAND)
    course = Course(_taut(len(moved)), STEP, TIP_STIFFNESS, hold, posture + np.nan_to_num(moved))
    rest = simulate(bed, posture, course).tip_force[0, REST - 1 :: len(ramp)]
    apart = rest[:, None] - rest[None]
    far = np.linalg.norm(apart, axis=-1)
    one = np.unravel_index(far.argmax(), far.shape)
    return Hysteresis(rest, float(far.max() / 2), apart[one] / far.max())


def coupled_motion(bed: Bed) -> Array:
    """A motion (n, 3) rad along the coupling curve: the PIP moved to and fro by hand with EDC and
    LUM taut, FDP bending the DIP."""
    pip = np.radians(10.0 + 80.0 * (1 - np.abs(np.linspace(-1.0, 1.0, 121))))
    target = np.stack([np.full_like(pip, POSTURE[0]), pip, np.zeros_like(pip)], axis=-1)
    force, hold = _taut(len(pip)), np.broadcast_to([HAND, HAND, 0.0], target.shape)
    force[..., FDP] = FLEXED
    start = np.array([POSTURE[0], pip[0], float(coupled_dip(pip[0]))])
    return simulate(bed, start, Course(force, STEP, 0.0, hold, target)).angle[0]


def _taut(steps: int) -> Array:
    """The forces (1, n, m) N in which EDC and LUM are taut and the others pretensioned."""
    force = np.full((1, steps, len(MUSCLES)), PRETENSION)
    force[..., [EDC, LUM]] = TAUT
    return force


def poses(network: Network, rng: np.random.Generator) -> MeasuredKinematics:
    """Excursions of nearly unloaded tendons over the joints' range."""
    angle = rng.uniform([-0.5, 0.0, 0.0], [1.4, 1.75, 1.2], (POSES, 3))
    unloaded = np.full((POSES, len(network.muscles)), 1e-6)
    excursion = network.excursion(angle, unloaded)
    noise = rng.normal(0.0, EXCURSION_SPREAD, excursion.shape)
    return MeasuredKinematics(angle, excursion + noise, EXCURSION_SPREAD)


class SensorReadings(NamedTuple):
    """What the sensors say over time."""

    angle: Array
    """(n, 3) rad."""
    force: Array
    """(n, m) N, of the load cells."""
    tip_force: Array
    """(n, 2) N."""


def measure(
    bed: Bed, posture: Array, force: Array, dt: float, seeds: Sequence[int]
) -> list[SensorReadings]:
    """Runs from a posture (3,) rad under muscle forces (b, n, m), each seen by sensors with a noise
    of its own."""
    record = simulate(bed, posture, hold_posture(force, dt, TIP_STIFFNESS))
    seen = []
    for k, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 2])
        true = record.angle[k], force[k], record.tip_force[k]
        spreads = ANGLE_SPREAD, CELL_SPREAD, TIP_SPREAD
        noisy = [x + rng.normal(0.0, s, x.shape) for x, s in zip(true, spreads, strict=True)]
        seen.append(SensorReadings(*noisy))
    return seen


def pattern(known: ShareFinger, posture: Array, seed: int) -> Array:
    """The forces of a run, (n, m) N at STEP: EDC alone, then all four at random, then LUM alone, as
    in figure 7; drawn anew where the predicted share is not within SHARES, beyond which the finger
    leaves the curve."""
    rng = np.random.default_rng([seed, 1])
    stages = [_alone(EDC)]
    while len(stages) < STAGES - 1:
        force = rng.uniform([PRETENSION, PRETENSION, 1.0, 1.0], [4.0, 4.0, 6.0, 6.0])
        share = forward(known, posture, force).share[0]
        if SHARES[0] <= share <= SHARES[1]:
            stages.append(force)
    return _hold_in_turn([*stages, _alone(LUM)])


def _alone(muscle: int) -> Array:
    force = np.full(len(MUSCLES), PRETENSION)
    force[muscle] = TAUT
    return force


def _hold_in_turn(stages: list[Array]) -> Array:
    """The stages one after the other, (n, m): each reached in RAMP s and held for HOLD s."""
    ramp = np.linspace(0.0, 1.0, round(RAMP / STEP) + 1)[1:, None]
    parts = [np.repeat(stages[:1], round(HOLD / STEP), axis=0)]
    for before, after in pairwise(stages):
        parts.append(before + ramp * (after - before))
        parts.append(np.repeat([after], round(HOLD / STEP), axis=0))
    return np.concatenate(parts)
