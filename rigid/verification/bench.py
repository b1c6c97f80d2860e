"""How fast the finger alone is: a static solve, and a forward simulation against OpenSim's."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import process_time

from rigid.mujoco.dynamics import ConstantTension, FingerDynamics
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tip_device import Cage
from rigid.verification.forward import simulate
from rigid.verification.thesis_twin import POSTURE, TENSIONS, tensions, twin_law, twin_model

REPEATS = 5


def bench_opensim(repeats: int = REPEATS) -> dict[str, float]:
    """CPU seconds of 2 s of forward simulation of the twin in its cage, all muscles one by one: in
    OpenSim by Runge-Kutta-Merson at 1e-5, here in steps of 1 ms (median of `repeats`, compiled),
    in this process, and their ratio.

    Needs the package `opensim`."""
    from rigid.verification.opensim_twin import twin

    theirs = sum(twin(muscle, caged=True).cpu for muscle in TENSIONS)
    ours = sum(_forward_cpu(muscle, repeats) for muscle in TENSIONS)
    return {"opensim_cpu_s": theirs, "ours_cpu_s": ours, "ratio": theirs / ours}


def cpu_seconds(work: Callable[[], object], repeats: int) -> list[float]:
    """CPU seconds of this process, of each of `repeats` runs after one that is not counted."""
    work()
    out = []
    for _ in range(repeats):
        begin = process_time()
        work()
        out.append(process_time() - begin)
    return out


def _forward_cpu(muscle: str, repeats: int) -> float:
    finger = MujocoFinger(twin_model(), law=twin_law())
    pull = ConstantTension(tensions(finger.tendons, muscle))
    dynamics = FingerDynamics(finger, finger.start(POSTURE), pull, Cage())
    return median(cpu_seconds(lambda: simulate(dynamics), repeats))
