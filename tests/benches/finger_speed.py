"""How fast the finger alone is: a static solve, a forward simulation against OpenSim's, and the
control loop of Xu et al. 2012, part by part, beside the paper's 2 ms and 0.02 ms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter, process_time

import mujoco
import numpy as np
import typer

from cases.papers.models.xu2012.control import (
    JOINT_GAINS,
    forces_for_torques,
    joint_forces,
    remember,
)
from cases.papers.models.xu2012.tracking import MARKERS, NOISE, poses
from cosim.analyses.mjcf_hood import hood_file
from cosim.case.file import load_case
from cosim.commands.terminal import stages
from cosim.extras import require
from cosim.models.build import mjcf_of
from cosim.port import Array
from rigid.chain.pose import estimate
from rigid.fingers.robot import robot_finger
from rigid.mjcf.hood import steps_per_second
from rigid.mujoco.dynamics import ConstantTension, FingerDynamics
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tip_device import Cage
from tests.helpers.fingers import at_rest
from tests.proofs.fingers.dynamics_rows import ALONE, pull_of, settling_index_finger
from tests.proofs.fingers.dynamics_rows import POSTURE as HELD
from tests.proofs.fingers.forward import simulate
from tests.proofs.fingers.thesis_twin import POSTURE, TENSIONS, tensions, twin_law, twin_model

HOODED = "network_edc"
REPEATS = 5
SOLVES = 1000
PAPER_LOOP, PAPER_QP = 2e-3, 2e-5
"""s: section VII, "around 2 msec" and "about 0.02 msec"."""
COUNT = 400
NEAR = 0.02
"""rad: how far the last estimate, where the search starts, is from the pose."""


def opensim_figures(repeats: int = REPEATS) -> dict[str, float]:
    """CPU seconds of 2 s of forward simulation of the twin in its cage, all muscles one by one: in
    OpenSim by Runge-Kutta-Merson at 1e-5, here in steps of 1 ms (median of `repeats`, compiled),
    in this process, and their ratio.

    Needs the package `opensim`."""
    from tests.proofs.fingers.opensim_twin import twin

    theirs = sum(twin(muscle, caged=True).cpu for muscle in TENSIONS)
    ours = sum(_forward_cpu(muscle, repeats) for muscle in TENSIONS)
    return {"opensim_cpu_s": theirs, "ours_cpu_s": ours, "ratio": theirs / ours}


def robot_figures(count: int = COUNT, second_extensor: bool = True) -> dict[str, float]:
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
        times["qp_s"].append(_seconds(partial(forces_for_torques, torque, arms)))
    return {name: median(each) for name, each in times.items()}


def cpu_seconds(work: Callable[[], object], repeats: int) -> list[float]:
    """CPU seconds of this process, of each of `repeats` runs after one that is not counted."""
    work()
    out = []
    for _ in range(repeats):
        begin = process_time()
        work()
        out.append(process_time() - begin)
    return out


def time_static_solve() -> dict[str, float]:
    """CPU milliseconds in this process, medians: a static solve, of 1000 over the seven single
    muscles, MuJoCo's forward dynamics of the same model alone, and their ratio."""
    finger = settling_index_finger()
    start, data = finger.start(HELD), mujoco.MjData(finger.model)
    spent: list[float] = []
    for muscles in ALONE.values():
        solve = partial(at_rest, finger, start, pull_of(finger, muscles))
        spent += cpu_seconds(solve, -(-SOLVES // len(ALONE)))
    floor = cpu_seconds(lambda: mujoco.mj_forward(finger.model, data), SOLVES)
    solve_ms, floor_ms = 1e3 * median(spent), 1e3 * median(floor)
    return {"static_solve_ms": solve_ms, "mj_forward_ms": floor_ms, "ratio": solve_ms / floor_ms}


def _forward_cpu(muscle: str, repeats: int) -> float:
    finger = MujocoFinger(twin_model(), law=twin_law())
    pull = ConstantTension(tensions(finger.tendons, muscle))
    dynamics = FingerDynamics(finger, finger.start(POSTURE), pull, Cage())
    return median(cpu_seconds(lambda: simulate(dynamics), repeats))


def _loop(finger: MujocoFinger, seen: Array, guess: Array, goal: Array) -> None:
    found = estimate(finger, MARKERS, seen, guess).angle
    joint_forces(JOINT_GAINS, remember(guess), found, goal, finger.moment_arms(found))


def _seconds(work: Callable[[], object]) -> float:
    begin = perf_counter()
    work()
    return perf_counter() - begin


def bench_mjcf() -> dict[str, float]:
    """Print how many steps of 2 ms plain MuJoCo makes in a second, without and with a hood; what a
    step with it takes over one without."""
    case = load_case(HOODED)
    with stages("bench") as shown:
        shown.say("stepping the finger in plain MuJoCo")
        bare = steps_per_second(mjcf_of(case))
        hooded = hood_file(case, "network", states=3).rate
    figures = {"steps_per_s_bare": bare, "steps_per_s_hood": hooded, "ratio": bare / hooded}
    return _print_figures(figures, "step with the hood / without")


def bench_fingers() -> dict[str, float]:
    """Print what the static solve of the finger alone costs; its ratio."""
    with stages("bench") as shown:
        shown.say("solving the finger many times")
        return _print_figures(time_static_solve(), "static solve / mj_forward")


def bench_opensim() -> dict[str, float]:
    """Print what the finger's motion costs here and in OpenSim; their ratio.  Raises InputError
    where OpenSim is not installed."""
    require("the bench beside OpenSim", "opensim")
    with stages("bench") as shown:
        shown.say("moving the finger here and in OpenSim")
        return _print_figures(opensim_figures(), "OpenSim / ours")


def bench_robotic_finger() -> dict[str, float]:
    """Print what the robotic finger's control loop costs, beside the paper's figures; its parts
    over the loop."""
    paper = {"loop_s": PAPER_LOOP, "qp_s": PAPER_QP}
    with stages("bench") as shown:
        shown.say("running the control loop many times")
        figures = robot_figures()
    for name, value in figures.items():
        beside = f"   (paper: {paper[name]:.4g})" if name in paper else ""
        typer.echo(f"{name:<20} {value:.4g}{beside}")
    return {f"{name} / loop_s": value / figures["loop_s"] for name, value in figures.items()}


def _print_figures(figures: dict[str, float], ratio: str) -> dict[str, float]:
    """Print figures; the ratio among them, by the name of what it is."""
    for name, value in figures.items():
        typer.echo(f"{name:<20} {value:.4g}")
    return {ratio: figures["ratio"]}
