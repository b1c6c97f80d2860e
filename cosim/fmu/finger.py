"""A static finger over an FMU, and its coupling with any hood of the port.

The unit answers an affine load with its equilibrium, which is all that `cosim.couple` asks of a
finger within a round; so the rounds here are the same, between what need not be more than two FMUs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.couple import AT_REST, LOOSE
from cosim.fmu.mapping import places
from cosim.fmu.participant import SHORT
from cosim.fmu.quantity import Quantity, finger_quantities
from cosim.fmu.unit import Saved, Unit
from cosim.port import STATIC, Array, ConvergenceError, Hood, InputError, Motion, Response

STILL = 1e-10
"""rad: the rounds end where no joint turns further."""
MOST_ROUNDS = 50


@dataclass(frozen=True)
class FingerAt:
    """A finger's equilibrium, or a state on the way there."""

    saved: Saved
    angles: Array
    """(nq,) rad."""
    motion: Motion
    tip_force: Array
    """(3,) N, of the fingertip on the world."""


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
        optional = ("tip", "path")
        self._place = places(self.unit.opened, quantities, names or {}, optional, assume_si)
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
        if len(self.tendons):
            given["tension"] = tension
        self.unit.restore(state.saved)
        for name, value in given.items():
            self.unit.set(self._place[name], value)
        self.unit.step(SHORT)
        return self._seen()

    def _seen(self) -> FingerAt:
        out = {
            name: self.unit.get(self._place[name])
            for name in ("angle", "tip_force", "position", "rotation")
        }
        motion = Motion(self.bodies, out["position"], out["rotation"])
        return FingerAt(self.unit.save(), out["angle"], motion, out["tip_force"])


@dataclass(frozen=True)
class Met:
    """A coupled equilibrium."""

    finger: FingerAt
    response: Response
    rounds: int


def met(finger: FmuFinger, hood: Hood, hood_tension: Array, finger_tension: Array) -> Met:
    """The finger and the hood in equilibrium, from the finger's start: the rounds of
    `cosim.couple.equilibrium`, ended by the finger's standing still.

    Raises ConvergenceError."""
    at = finger.start()
    state, exact, turn = hood.start(at.motion), False, np.inf
    for rounds in range(1, MOST_ROUNDS + 1):
        solver = hood if exact else hood.loosely(LOOSE)
        response = solver.advance(state, at.motion, hood_tension, STATIC)
        slope = solver.jacobian(response.state).load_motion
        aim = finger.step(at, response.load.total(), slope, finger_tension)
        turn = float(np.abs(aim.angles - at.angles).max())
        if exact and turn <= STILL:
            return Met(aim, response, rounds)
        exact, at, state = turn <= AT_REST, aim, response.state
    raise ConvergenceError(
        f"hood and finger did not agree in {MOST_ROUNDS} rounds: a joint still turns by {turn:.1e} "
        f"rad, expected at most {STILL:.0e}. Try a smaller tension or a stiffer passive joint."
    )
