"""The motion of a finger alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from cosim.build.motion import TendonPulls, tip_device
from cosim.case.schema import Case, Forward
from cosim.fingers.kinds import live_finger
from cosim.port import Array

if TYPE_CHECKING:
    from rigid.mujoco.finger import MujocoFinger
    from rigid.mujoco.forward import Simulation


@dataclass(frozen=True)
class Moved:
    """A finger, its motion, and what its muscles' fibres did at the end."""

    finger: MujocoFinger
    simulation: Simulation
    normalised_length: dict[str, float]
    cylinders: tuple[str, ...]
    drive: Array
    """(n + 1, nc, 2) of each cylinder: V commanded, Pa above the atmosphere."""


def simulated(case: Case, forward: Forward) -> Moved:
    """The motion of a case.

    Raises InputError for a case that has none, ConvergenceError where a step does not converge or
    the finger is not at rest at the end although the case wants that."""
    from rigid.mujoco.dynamics import FingerDynamics
    from rigid.mujoco.finger import MujocoFinger
    from rigid.mujoco.forward import came_to_rest, simulate

    stated = case.native_finger()
    # what goes with a split
    finger = cast(MujocoFinger, live_finger(stated, case.hood.left_to_finger))
    muscles = TendonPulls(case, finger.tendons)
    start = finger.start(stated.posture.angles())
    dynamics = FingerDynamics(finger, start, muscles, tip_device(case))
    simulation = simulate(dynamics, forward.duration, forward.step)
    if forward.must_rest:
        came_to_rest(simulation)
    drive = [muscles.told(*at) for at in zip(simulation.muscles, simulation.time, strict=True)]
    lengths = muscles.lengths(simulation.last.muscles)
    return Moved(finger, simulation, lengths, muscles.cylinders, np.array(drive))
