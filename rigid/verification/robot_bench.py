"""What the control loop costs, part by part, beside the paper's 2 ms and 0.02 ms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter

import numpy as np

from cosim.port import Array
from rigid.fingers.robot import robot_finger
from rigid.mujoco.finger import MujocoFinger
from rigid.papers.xu2012.control import JOINT_GAINS, joint_forces, remember
from rigid.papers.xu2012.pose import estimate
from rigid.papers.xu2012.tensions import tensions
from rigid.papers.xu2012.tracking import MARKERS, NOISE, poses

PAPER_LOOP, PAPER_QP = 2e-3, 2e-5
"""s: section VII, "around 2 msec" and "about 0.02 msec"."""
COUNT = 400
NEAR = 0.02
"""rad: how far the last estimate, where the search starts, is from the pose."""


def bench_robot(count: int = COUNT, second_extensor: bool = True) -> dict[str, float]:
    """Medians over `count` poses in this process, s of wall clock: the loop from markers to tendon
    forces (estimation, moment arms, PID, quadratic programme), the estimation, the programme."""
    finger = MujocoFinger(robot_finger(second_extensor))
    rng = np.random.default_rng(0)
    times: dict[str, list[float]] = {"loop_s": [], "estimation_s": [], "qp_s": []}
    for goal in poses(count):
        seen = MARKERS.at(finger, goal)[0] + rng.normal(0.0, NOISE, (3, 3))
        guess = goal + NEAR * rng.uniform(-1.0, 1.0, len(goal))
        torque = 0.02 * rng.uniform(-1.0, 1.0, len(goal))

        arms = finger.moment_arms(goal)
        times["loop_s"].append(_seconds(partial(_loop, finger, seen, guess, goal)))
        times["estimation_s"].append(_seconds(partial(estimate, finger, MARKERS, seen, guess)))
        times["qp_s"].append(_seconds(partial(tensions, torque, arms)))
    return {name: median(each) for name, each in times.items()}


def _loop(finger: MujocoFinger, seen: Array, guess: Array, goal: Array) -> None:
    found = estimate(finger, MARKERS, seen, guess).angle
    joint_forces(JOINT_GAINS, remember(guess), found, goal, finger.moment_arms(found))


def _seconds(work: Callable[[], object]) -> float:
    begin = perf_counter()
    work()
    return perf_counter() - begin
