"""Forward, inverse and circle on the virtual testbed: the interconnected and the static model.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, sections IV-B to IV-E.  Both models know the finger as it was identified on the
testbed, friction unknown to them; a seed draws the sensors' noise, the poses and the muscle forces,
the same for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases.papers.models.networks.excursion_fit import Identified, JointCoupling, identify
from cases.papers.models.networks.robotic_finger import LENGTH, MUSCLES
from cases.papers.models.networks.share_models import (
    ForcePrediction,
    Inverse,
    ShareFinger,
    best_share,
    forward,
    inverse,
    with_shares,
)
from cases.papers.models.networks.testbed_runs import (
    ANGLE_SPREAD,
    EDC,
    FRICTION,
    HOLD,
    LUM,
    POSTURE,
    PRETENSION,
    STEP,
    SensorReadings,
    coupled_motion,
    measure,
    pattern,
    poses,
    virtual_bed,
)
from cases.papers.models.printed import printed_values
from cosim.port import Array

RAMP_STEPS, CIRCLE_STEPS = 20, 100
STRAYED = np.radians(10.0)
"""rad from its posture: farther off a finger has left the coupling curve."""
REPORTED_ERRORS = printed_values("networks")
"""N, RMSE of the interconnected and the static model in figures 7, 8 and 9 of the paper."""


@dataclass(frozen=True)
class Predictions:
    """What both models, interconnected and static, make of a run."""

    measured: SensorReadings
    tip: tuple[ForcePrediction, ForcePrediction]

    @property
    def errors(self) -> Array:
        """The errors (2,) N, RMS over time and both components."""
        return _rms([model.force - self.measured.tip_force for model in self.tip])


class SeedTrial(NamedTuple):
    """All of one seed."""

    posture: Array
    """(3,) rad."""
    identified: Identified
    shares: Array
    """(m,), the static model's."""
    pattern: Predictions
    muscles: tuple[Inverse, Inverse]
    """Inverses from the pattern's fingertip forces, interconnected and static; estimates in (13)
    are the load cells' forces, as in the paper."""
    circle: Predictions

    @property
    def errors(self) -> dict[str, Array]:
        """The errors, (2,) N each, interconnected and static."""
        known = self.pattern.measured.force
        backwards = _rms([model.muscles - known for model in self.muscles])
        each = self.pattern.errors, backwards, self.circle.errors
        return dict(zip(REPORTED_ERRORS, each, strict=True))


def trials(
    count: int = 10, friction: float = FRICTION, posture: Array = POSTURE
) -> tuple[SeedTrial, ...]:
    """Seeds 0 to `count` - 1 in a posture (3,) rad; what was found once is kept."""
    return _trials(count, friction, tuple(map(float, posture)))


@lru_cache(maxsize=7)
def _trials(count: int, friction: float, angles: tuple[float, ...]) -> tuple[SeedTrial, ...]:
    bed, seeds, posture = virtual_bed(friction), range(count), np.array(angles)
    motion = coupled_motion(bed)
    known = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 0])
        seen = motion + rng.normal(0.0, ANGLE_SPREAD, motion.shape)
        known.append(identify(poses(bed.network, rng), JointCoupling(seen, ANGLE_SPREAD)))
    fingers = [found.finger(LENGTH) for found in known]
    forces = [pattern(finger, posture, seed) for finger, seed in zip(fingers, seeds, strict=True)]
    circles = [circle(finger, posture) for finger in fingers]
    runs, turns = (measure(bed, posture, np.array(each), STEP, seeds) for each in (forces, circles))
    turns = [SensorReadings(*(seen[RAMP_STEPS:] for seen in turn)) for turn in turns]
    found = []
    for identified, finger, run, turn in zip(known, fingers, runs, turns, strict=True):
        shares = static_shares(finger, run)
        given = finger, run.angle, run.tip_force, run.force
        muscles = inverse(*given), inverse(*given, share=shares)
        ahead = predict(finger, shares, run), predict(finger, shares, turn)
        found.append(SeedTrial(posture, identified, shares, ahead[0], muscles, ahead[1]))
    return tuple(found)


def errors(found: Sequence[SeedTrial]) -> dict[str, Array]:
    """The errors (seeds, 2) N of each experiment."""
    return {name: np.array([t.errors[name] for t in found]) for name in REPORTED_ERRORS}


def constrain_to_curve(found: Sequence[SeedTrial]) -> NDArray[np.bool_]:
    """Whether (seeds,) the finger stays by its posture all along the circle.  The forces ask for
    shares up to 0 and 1, and a finger known with errors can be asked for more; then one way goes
    slack, and nothing but friction holds it."""
    off = [np.abs(trial.circle.measured.angle - trial.posture).max() for trial in found]
    return np.array(off) < STRAYED


def static_shares(finger: ShareFinger, run: SensorReadings) -> Array:
    """The shares (m,) with which EDC alone (the first HOLD s of a run) and LUM alone (the last)
    come out as measured."""
    held_for = round(HOLD / STEP)
    shares = np.zeros(len(MUSCLES))
    for muscle, when in ((EDC, slice(held_for)), (LUM, slice(-held_for, None))):
        shares[muscle] = best_share(finger, *(seen[when] for seen in run))
    return shares


def predict(finger: ShareFinger, shares: Array, run: SensorReadings) -> Predictions:
    """Both models' fingertip forces in a run."""
    given = finger, run.angle, run.force
    return Predictions(run, (forward(*given), with_shares(*given, shares)))


def circle(finger: ShareFinger, posture: Array) -> Array:
    """The least forces (n, m) N for a circle of 1 N, open loop (section IV-E), after a ramp; all
    pull with PRETENSION at least, the share is between 0 and 1 as in (13)."""
    turn = np.linspace(0.0, 2 * np.pi, CIRCLE_STEPS + 1)
    wanted = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    angle = np.broadcast_to(posture, (len(turn), 3))
    none = np.zeros((len(turn), len(MUSCLES)))
    found = inverse(finger, angle, wanted, none, least=PRETENSION).muscles
    ramp = np.linspace(0.0, 1.0, RAMP_STEPS)[:, None]
    return np.concatenate([PRETENSION + ramp * (found[0] - PRETENSION), found])


def _rms(errors: list[Array]) -> Array:
    return np.array([np.sqrt((e**2).mean()) for e in errors])
