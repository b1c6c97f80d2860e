"""A static finger over an FMU, and its coupling with any hood of the port.

The unit answers an affine load with its equilibrium, which is all that `cosim.coupling.equilibrium`
asks of a finger within a round; so the rounds here are the same, between what need not be more than
two FMUs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.coupling.accelerators import Accelerator, accelerated, begun
from cosim.coupling.equilibrium import AT_REST, LOOSE
from cosim.coupling.finger_equilibrium import MOST_TURN
from cosim.fmu.hood import SHORT
from cosim.fmu.kinematics import OPTIONAL, Kinematics, Pose
from cosim.fmu.mapping import places
from cosim.fmu.quantity import Quantity, finger_quantities
from cosim.fmu.unit import Saved, Unit
from cosim.port import (
    STATIC,
    Array,
    ConvergenceError,
    Hood,
    HoodJacobian,
    InputError,
    Motion,
    Progress,
    Response,
    State,
    quiet,
)

STILL = 1e-10
"""rad: the rounds end where no joint turns further."""
MOST_ROUNDS = 50


@dataclass(frozen=True)
class FingerAt:
    """A finger's equilibrium, or a state on the way there."""

    saved: Saved
    angles: Array
    """(nq,) rad."""
    pose: Pose
    tip_force: Array
    """(3,) N, of the fingertip on the world."""

    @property
    def motion(self) -> Motion:
        return self.pose.motion


class FmuFinger:
    """A static finger; a state may be stepped from any number of times.

    `names` maps quantities of `finger_quantities` (see `mapping.places`).
    Raises InputError for an FMU that cannot be opened or does not map."""

    def __init__(
        self,
        path: Path,
        bodies: tuple[str, ...],
        joints: tuple[str, ...],
        tendons: tuple[str, ...],
        names: Mapping[str, str] | None = None,
        *,
        assume_si: bool = False,
    ) -> None:
        self.bodies, self.joints, self.tendons = bodies, joints, tendons
        self.unit = Unit(path)
        quantities: tuple[Quantity, ...] = finger_quantities(bodies, joints, tendons)
        optional = (*OPTIONAL, "load_motion")
        self._place = places(self.unit.opened, quantities, names or {}, optional, assume_si)
        self.kinematics = Kinematics(self.unit, self._place, bodies)
        self._begin = self._seen()

    def start(self) -> FingerAt:
        """The unit as it was initialised."""
        return self._begin

    def step(self, state: FingerAt, wrench: Array, by_motion: Array, tension: Array) -> FingerAt:
        """The equilibrium under a load whose wrench (nb, 6) at the poses of `state` changes with
        the bodies' twists by `by_motion` (6 nb, 6 nb), and the tendons' tensions (nt,) N.

        Raises InputError and ConvergenceError."""
        n = 6 * len(self.bodies)
        given = {"force": wrench[:, :3], "moment": wrench[:, 3:], "load_motion": by_motion}
        shapes = {"force": (n // 6, 3), "moment": (n // 6, 3), "load_motion": (n, n)}
        for name, shape in shapes.items():
            if given[name].shape != shape:
                raise InputError(f"{name}: expected shape {shape}, got {given[name].shape}")
        if by_motion.any() and "load_motion" not in self._place:
            raise InputError(
                f"{self.unit.opened.path}: this FMU takes held loads only (it has no load_motion), "
                'and this scheme gives it one that follows; write coupling.scheme = "implicit"'
            )
        self.unit.restore(state.saved)
        for name, value in {**given, "tension": tension}.items():
            if name in self._place:
                self.unit.set(self._place[name], value)
        self.unit.step(SHORT)
        return self._seen()

    def _seen(self) -> FingerAt:
        angles = self.unit.get(self._place["angle"])
        pose, force = self.kinematics.reached(angles), self.unit.get(self._place["tip_force"])
        return FingerAt(self.unit.save(), angles, pose, force)


@dataclass(frozen=True)
class Met:
    """A coupled equilibrium."""

    finger: FingerAt
    motion: Motion
    """The poses that the hood answered last; the finger stands there to within `turn`."""
    response: Response
    jacobian: HoodJacobian
    tension: tuple[Array, Array]
    """N, of the hood's tendons and of the finger's own."""
    turn: float
    """rad, the most that a joint turned in the last round."""
    rounds: int


def met(
    finger: FmuFinger,
    hood: Hood,
    hood_tension: Array,
    finger_tension: Array,
    at: FingerAt | None = None,
    progress: Progress = quiet,
) -> Met:
    """The finger and the hood in equilibrium, from the finger's state `at` or its start: the rounds
    of `cosim.coupling.equilibrium.equilibrium`, ended by the finger's standing still.

    Raises ConvergenceError."""
    at = finger.start() if at is None else at
    state, exact, turn = hood.start(at.motion), False, np.inf
    for rounds in range(1, MOST_ROUNDS + 1):
        solver = hood if exact else hood.loosely(LOOSE)
        response = solver.advance(state, at.motion, hood_tension, STATIC)
        jacobian = solver.jacobian(response.state)
        load = response.load.total()
        aim = finger.step(at, load, jacobian.load_motion, finger_tension)
        turn = float(np.abs(aim.angles - at.angles).max())
        progress(f"coupling round {rounds}: a joint turns by {turn:.1e} rad")
        if exact and turn <= STILL:
            pulls = hood_tension, finger_tension
            return Met(aim, at.motion, response, jacobian, pulls, turn, rounds)
        exact, at, state = turn <= AT_REST, aim, response.state
    raise _apart(MOST_ROUNDS, turn, STILL)


def met_held(
    finger: FmuFinger,
    hood: Hood,
    hood_tension: Array,
    finger_tension: Array,
    accelerator: Accelerator,
    tolerance: float,
    most_rounds: int,
    at: FingerAt | None = None,
    progress: Progress = quiet,
) -> Met:
    """The same by an accelerated fixed point in the joint angles, as `cosim.coupling.fixed_point`:
    no derivative is asked for on the way.  It ends where no joint turns further than `tolerance`
    rad.

    Raises ConvergenceError, and InputError for a unit without `kinematics`."""
    at = finger.start() if at is None else at
    n, angles, history = 6 * len(finger.bodies), at.angles, begun(accelerator, len(finger.joints))
    state: State = hood.start(at.motion)
    for rounds in range(1, most_rounds + 1):
        motion = finger.kinematics.at(angles).motion
        response = hood.advance(state, motion, hood_tension, STATIC)
        at = finger.step(at, response.load.total(), np.zeros((n, n)), finger_tension)
        turn = float(np.abs(at.angles - angles).max())
        progress(f"fixed point, round {rounds}: a joint turns by {turn:.1e} rad")
        if turn <= tolerance:
            pulls, jacobian = (hood_tension, finger_tension), hood.jacobian(response.state)
            return Met(at, motion, response, jacobian, pulls, turn, rounds)
        aim, history = accelerated(accelerator, history, angles, at.angles)
        step = aim - angles
        angles = angles + step * min(1.0, MOST_TURN / (np.abs(step).max() or 1.0))
        state = response.state
    raise _apart(most_rounds, turn, tolerance)


def _apart(rounds: int, turn: float, allowed: float) -> ConvergenceError:
    return ConvergenceError(
        f"hood and finger did not agree in {rounds} rounds: a joint still turns by {turn:.1e} rad, "
        f"expected at most {allowed:.0e}. Try a smaller tension, a stiffer passive joint, or "
        'another coupling.scheme ("newton", "implicit")'
    )
