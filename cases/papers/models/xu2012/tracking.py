"""Steps from pose to pose under either controller: the same plant, the same noise.

Joint space: markers seen with noise, angles estimated, arms at these angles, quadratic programme.
Tendon space: lengths seen with the same noise, references the lengths of the wanted pose.  Both
command the same actuators: the air, or a stand-in of first order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cases.papers.models.xu2012.actuators import PERIOD, Actuator
from cases.papers.models.xu2012.control import (
    PRELOAD,
    Gains,
    Memory,
    joint_forces,
    remember,
    tendon_forces,
)
from cases.papers.models.xu2012.plant import STEP, Plant
from cosim.port import Array
from rigid.chain.pose import BodyMarkers, estimate
from rigid.fingers.anatomy import RANGES
from rigid.fingers.robot_tables import JOINTS
from rigid.model import FingerModel
from rigid.mujoco.finger import MujocoFinger

NOISE = 1e-4
"""m, standard deviation of a marker's coordinate and of a tendon's length (assumption)."""
MARKERS = BodyMarkers(
    np.array([1, 2, 3]),
    np.array([[0.030, 0.0, 0.008], [0.020, 0.0, 0.006], [0.022, 0.0, -0.005]]),
)
"""One on each phalanx; places are ours."""
WITHIN = 0.8
"""Part of table II, about its middle, that poses are drawn from."""
SETTLED = float(np.radians(2.0))
"""rad: a joint has settled when it stays nearer than this to the reference."""
STEP_SECONDS = 1.5
"""s, from one goal to the next."""
TAIL = 0.3
"""s, at the end of a step: where a joint still swings by more than `UNSTABLE`, it is unstable."""
UNSTABLE = float(np.radians(5.0))

Controller = Callable[[Array, Array, np.random.Generator], Array]


@dataclass(frozen=True)
class StepResponse:
    """Angles (n, nq) over times (n,), forces (n, nt) N, from one pose to another (nq,)."""

    time: Array
    angle: Array
    force: Array
    start: Array
    goal: Array

    @property
    def settling(self) -> Array:
        """The times (nq,) s from which on each joint stays near the goal; inf where it does not."""
        off = np.abs(self.angle - self.goal) > SETTLED
        last = len(off) - np.argmax(off[::-1], axis=0)
        out = np.where(off.any(axis=0), self.time[np.minimum(last, len(off) - 1)], 0.0)
        return np.where(off[-1], np.inf, out)

    @property
    def overshoot(self) -> Array:
        """The overshoot (nq,) rad past the goal, seen from the start."""
        way = np.sign(self.goal - self.start)
        return np.asarray(((self.angle - self.goal) * way).max(axis=0).clip(0.0))

    @property
    def swing(self) -> float:
        """The swing, rad: most of the joints from peak to peak in the tail."""
        tail = self.angle[self.time > self.time[-1] - TAIL]
        return float(np.ptp(tail, axis=0).max())

    @property
    def error(self) -> float:
        """The largest mean distance, rad, of a joint from the goal in the tail."""
        tail = self.angle[self.time > self.time[-1] - TAIL]
        return float(np.abs(tail.mean(axis=0) - self.goal).max())

    @property
    def miss(self) -> float:
        """The mean distance, rad, of all joints from the goal over the whole step."""
        return float(np.abs(self.angle - self.goal).mean())

    @property
    def unstable(self) -> bool:
        """Whether the joints still swing at the end."""
        return self.swing > UNSTABLE


def poses(count: int, seed: int = 0) -> Array:
    """Postures (count, nq) rad at random amid table II."""
    low, high = np.array([RANGES[j] for j in JOINTS]).T
    middle, half = (low + high) / 2, WITHIN * (high - low) / 2
    rng = np.random.default_rng(seed)
    return np.asarray(middle + half * rng.uniform(-1.0, 1.0, (count, len(JOINTS))))


class Bench:
    """The finger, its actuators and both controllers; what it measures is of one noise."""

    def __init__(self, finger: FingerModel, actuator: Actuator[Any]) -> None:
        self.plant, self.actuator = Plant(finger), actuator
        self.model = MujocoFinger(finger)

    def in_joint_space(self, goals: Sequence[Array], gains: Gains) -> list[StepResponse]:
        """Steps to each goal in turn, from the first one's own rest."""
        memory: list[tuple[Memory, Array]] = []

        def forces(angle: Array, goal: Array, rng: np.random.Generator) -> Array:
            seen = MARKERS.at(self.model, angle)[0] + rng.normal(0.0, NOISE, (3, 3))
            guess = memory[-1][1] if memory else angle
            found = estimate(self.model, MARKERS, seen, guess).angle
            before = memory.pop()[0] if memory else remember(found)
            force, after = joint_forces(gains, before, found, goal, self.model.moment_arms(found))
            memory.append((after, found))
            return force

        return self._steps(goals, forces)

    def in_tendon_space(self, goals: Sequence[Array], gains: Gains) -> list[StepResponse]:
        """Return the responses to steps to all goals by the control in tendon space, with gains for
        all tendons."""
        memory: list[Memory] = []

        def forces(angle: Array, goal: Array, rng: np.random.Generator) -> Array:
            length = self.model.tendon_lengths(angle)
            seen = length + rng.normal(0.0, NOISE, len(length))
            before = memory.pop() if memory else remember(seen)
            force, after = tendon_forces(gains, before, seen, self.model.tendon_lengths(goal))
            memory.append(after)
            return force

        return self._steps(goals, forces)

    def _steps(
        self, goals: Sequence[Array], forces: Controller, seconds: float = STEP_SECONDS
    ) -> list[StepResponse]:
        rng = np.random.default_rng(1)
        start = np.array(goals[0], dtype=float)
        self.plant.reset(start)
        drive = self.actuator
        pull = drive.begin(np.full(len(self.model.tendons), PRELOAD), self.plant.instant().length)
        out = []
        for goal in goals:
            rows = []
            for k in range(round(seconds / PERIOD)):
                now = self.plant.instant()
                rows.append((k * PERIOD, now.angle, drive.force(pull)))
                pull = drive.command(pull, forces(now.angle, goal, rng))
                for _ in range(round(PERIOD / STEP)):
                    pull = drive.advance(pull, self.plant.instant().length, STEP)
                    self.plant.advance(drive.force(pull))
            time, angle, force = (np.array(x) for x in zip(*rows, strict=True))
            out.append(StepResponse(time, angle, force, start, goal))
            start = angle[-1]
        return out
