"""Item by item, what `cosim verify robot` and the pictures show: each computed once and kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from cases.papers.models.xu2012 import paths
from cases.papers.models.xu2012.actuators import Actuator, Lag
from cases.papers.models.xu2012.air import Air
from cases.papers.models.xu2012.control import AIR_GAINS, JOINT_GAINS, Gains
from cases.papers.models.xu2012.excursions import (
    Found,
    Truth,
    World,
    analyse,
    recalibrate,
    record_excursions,
)
from cases.papers.models.xu2012.fan import Reach, reach
from cases.papers.models.xu2012.tracking import Bench, StepResponse, poses
from cosim.port import Array
from rigid.fingers.anatomy import RANGES
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import JOINTS, TABLE_III
from rigid.model import FingerModel
from rigid.mujoco.finger import MujocoFinger

SMALLEST = 0.1
"""mm: an entry of table III below this is a zero, whose sign means nothing."""

COUNTS = (13, 8, 12, 8)
"""Postures of each joint over table II."""
SWEEP = 400
"""Postures of a sweep of one joint, in which lengths must go as the arms say."""
POSES = 50
"""Random ones that steps go through."""
TUNED_AT = np.radians([30.0, 0.0, 45.0, 20.0])
TUNED_STEP = np.radians([10.0, 5.0, 10.0, 5.0])
CANDIDATES = tuple((p, i) for p in (30.0, 60.0, 100.0, 150.0, 200.0) for i in (5.0, 10.0, 20.0))
"""N/m and 1/s, of tendon-space gains; the differential one is 10 ms of the proportional."""
AIR_CANDIDATES = tuple((p, i) for p in (30.0, 40.0, 60.0, 80.0) for i in (5.0, 10.0, 20.0))
"""N/m and 1/s, of tendon-space gains on the air."""


def table_iii(model: FingerModel) -> Array:
    """The arms of table III, (nq, nt) mm/rad: lengthening with all angles zero."""
    return np.asarray(-1e3 * MujocoFinger(model).moment_arms(np.zeros(len(JOINTS))).T)


def workspace(counts: tuple[int, ...] = COUNTS) -> Array:
    """Postures (n, nq) rad of the workspace: a grid over table II with its corners."""
    axes = [np.linspace(*RANGES[j], n) for j, n in zip(JOINTS, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(JOINTS))


def least_arms(model: FingerModel, posture: Array) -> Array:
    """The least arms (nq, nt) mm over the postures (n, nq): of each arm of table III in the
    direction that it has there (negative where its sign flips); infinite where the table has
    none."""
    finger = MujocoFinger(model)
    sign = np.where(np.abs(TABLE_III) > SMALLEST, np.sign(TABLE_III), np.nan)
    count = TABLE_III.shape[1]
    least = np.full(TABLE_III.shape, np.inf)
    for q in posture:
        least = np.fmin(least, -1e3 * finger.moment_arms(q).T[:, :count] * sign)
    return least


def difference(model: FingerModel, posture: Array, step: float = 1e-5) -> float:
    """mm/rad, the largest of ten_J less central differences of the length, over the postures."""
    finger, worst = MujocoFinger(model), 0.0
    for q in posture:
        arms = finger.moment_arms(q)
        for i, e in enumerate(step * np.eye(len(q))):
            slope = (finger.tendon_lengths(q + e) - finger.tendon_lengths(q - e)) / (2 * step)
            worst = max(worst, float(np.abs(slope + arms[:, i]).max()))
    return 1e3 * worst


def jump(model: FingerModel, start: Array, samples: int = SWEEP) -> float:
    """The largest step, mm, of a length that its arms do not explain (by the trapezoidal rule),
    while each joint in turn passes its range from the postures (n, nq)."""
    finger, worst = MujocoFinger(model), 0.0
    for q in start:
        for i, name in enumerate(JOINTS):
            sweep = np.tile(q, (samples, 1))
            sweep[:, i] = np.linspace(*RANGES[name], samples)
            length = np.array([finger.tendon_lengths(x) for x in sweep])
            slope = np.array([-finger.moment_arms(x)[:, i] for x in sweep])
            turn = sweep[1, i] - sweep[0, i]
            told = np.array([(a + b) / 2 * turn for a, b in pairwise(slope)])
            worst = max(worst, float(np.abs(np.diff(length, axis=0) - told).max()))
    return 1e3 * worst


def closed_form_errors(model: FingerModel, posture: Array) -> tuple[float, float]:
    """The largest differences, m and m/rad, of MuJoCo's lengths and arms from our own."""
    finger = MujocoFinger(model)
    length = [paths.tendon_lengths(model, q) - finger.tendon_lengths(q) for q in posture]
    arms = [paths.lengthening(model, q) + finger.moment_arms(q) for q in posture]
    return float(np.abs(length).max()), float(np.abs(arms).max())


@dataclass(frozen=True)
class Tuned:
    """The tendon-space gains that do best at one pose, and what they do there: there and back."""

    gains: Gains
    steps: list[StepResponse]


def bench(second_extensor: bool, air: bool) -> Bench:
    """The finger on air, or on its stand-in of first order."""
    model = robot_finger(second_extensor)
    drive: Actuator[Any] = Air(longest(model)) if air else Lag()
    return Bench(model, drive)


def longest(model: FingerModel) -> Array:
    """The greatest lengths (nt,) m of the tendons over table II."""
    finger = MujocoFinger(model)
    return np.asarray(np.max([finger.tendon_lengths(q) for q in workspace((5, 3, 5, 3))], axis=0))


@lru_cache(maxsize=4)
def tune(second_extensor: bool, air: bool) -> Tuned:
    """Choose among the candidates the stable ones whose steps at `TUNED_AT` are nearest to their
    goals."""
    on = bench(second_extensor, air)
    goals = [TUNED_AT, TUNED_AT + TUNED_STEP, TUNED_AT]
    tried: list[tuple[bool, float, int, Tuned]] = []
    for p, i in AIR_CANDIDATES if air else CANDIDATES:
        gains = Gains(p, p * i, 0.01 * p)
        steps = on.in_tendon_space(goals, gains)[1:]
        unstable, miss = any(s.unstable for s in steps), max(s.miss for s in steps)
        tried.append((unstable, miss, len(tried), Tuned(gains, steps)))
    return min(tried)[-1]


@lru_cache(maxsize=4)
def joint_steps(second_extensor: bool, air: bool, seed: int = 0) -> list[StepResponse]:
    """From each of the random poses to the next one, joint space; a minute on air."""
    gains = AIR_GAINS if air else JOINT_GAINS
    return bench(second_extensor, air).in_joint_space(list(poses(POSES, seed)), gains)


@lru_cache(maxsize=4)
def tendon_steps(second_extensor: bool, air: bool) -> list[StepResponse]:
    """Return the responses to all steps by the control in tendon space, with the gains tuned at one
    pose."""
    gains = tune(second_extensor, air).gains
    return bench(second_extensor, air).in_tendon_space(list(poses(POSES)), gains)


@lru_cache(maxsize=2)
def reach_targets(second_extensor: bool) -> Reach:
    """At the same random poses."""
    return reach(robot_finger(second_extensor), poses(POSES))


@dataclass(frozen=True)
class Quality:
    """Quality of steps from pose to pose, by joint (nq,): settling to 2 deg in s, of those that
    settle, and overshoot in deg; how many steps are unstable, and how many joints do not settle in
    a step."""

    unstable: int
    unsettled: int
    median_settling: Array
    longest_settling: Array
    median_overshoot: Array
    largest_overshoot: Array


def quality(steps: list[StepResponse]) -> Quality:
    """The quality of all but the first step, which starts at its goal; NaN where a joint never
    settles."""
    settling = np.array([s.settling for s in steps[1:]])
    past = np.degrees([s.overshoot for s in steps[1:]])
    settled = np.ma.masked_invalid(settling)
    return Quality(
        sum(s.unstable for s in steps),
        int(np.isinf(settling).sum()),
        np.ma.median(settled, axis=0).filled(np.nan),
        settled.max(axis=0).filled(np.nan),
        np.median(past, axis=0),
        past.max(axis=0),
    )


@dataclass(frozen=True)
class Excursions:
    """The virtual experiment: truth, section VI's analysis, the same after the markers' places were
    found, and where they were found (nm, 3) m."""

    truth: Truth
    meant: Found
    found: Found
    place: Array

    @property
    def marker_error(self) -> float:
        """The larger distance, m, of a marker from where it was found."""
        return float(np.linalg.norm(self.place - self.truth.markers.place, axis=1).max())


@lru_cache(maxsize=16)
def excursions(seed: int = 0) -> Excursions:
    """Excursions of one random world."""
    record, truth = record_excursions(World(seed=seed))
    meant = analyse(record)
    markers = recalibrate(meant).markers
    return Excursions(truth, meant, analyse(record, markers), markers.place)


def rms(found: Found) -> Array:
    """The root mean squares (5,) m of measured less predicted excursions."""
    off = found.measured_excursions - found.predicted_excursions(MujocoFinger(robot_finger()))
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)))
