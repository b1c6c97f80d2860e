"""The poses of a finger in an FMU: at the angles that it has reached, and at others."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.fmu.hood import SHORT
from cosim.fmu.mapping import VariablePlace
from cosim.fmu.quantity import KINEMATICS
from cosim.fmu.unit import Unit
from cosim.port import Array, Motion

QUERY_ANGLE = "asked_angle"
POSE = ("position", "rotation", "tip", "path")
"""Quantities of a pose."""
OPTIONAL = ("tip", "path", QUERY_ANGLE, KINEMATICS.name)
"""Quantities that a unit of a finger may lack."""
MOST_KEPT = 64
TURN = 1e-5
"""rad, of differences: truncation and rounding of a twist both near 1e-11 of it."""


class FmuPose(NamedTuple):
    """A finger at some joint angles."""

    motion: Motion
    tip: Array | None
    """(3,) m; None where the unit does not tell it."""
    path: Array
    """(nt,) m, of its own tendons; empty where the unit does not tell them."""

    @property
    def line(self) -> Array:
        """A line (k, 3) m through the bodies' origins to the fingertip, for pictures."""
        points = self.motion.position
        return points if self.tip is None else np.vstack([points, self.tip])


class FmuKinematics:
    """Poses by joint angles, the last ones kept.

    A unit with the switch `kinematics` tells them at any angles; one without at those alone that
    it has reached."""

    def __init__(
        self, unit: Unit, place: Mapping[str, VariablePlace], bodies: tuple[str, ...]
    ) -> None:
        self._unit, self._place, self._bodies = unit, place, bodies
        self._begin = unit.save()
        self._kept: OrderedDict[bytes, FmuPose] = OrderedDict()

    @property
    def tells_any(self) -> bool:
        """Whether other angles may be asked for than those reached."""
        switched = KINEMATICS.name in self._place and QUERY_ANGLE in self._place
        return switched and self._unit.opened.rolls_back

    def keep(self, angles: Array, values: Mapping[str, Array]) -> FmuPose:
        """The pose that the unit put out by its quantities POSE, at its angles (nq,) rad; it is
        kept for the next question."""
        motion = Motion(self._bodies, values["position"], values["rotation"])
        pose = FmuPose(motion, values.get("tip"), values.get("path", np.zeros(0)))
        self._kept[np.asarray(angles).tobytes()] = pose
        if len(self._kept) > MOST_KEPT:
            self._kept.popitem(last=False)
        return pose

    def at(self, angles: Array) -> FmuPose:
        """The unit's pose at joint angles.  Raises InputError for angles not reached of a unit that
        does not tell others."""
        kept = self._kept.get(np.asarray(angles).tobytes())
        return self._query(angles) if kept is None else kept

    def jacobian(self, angles: Array) -> Array:
        """Twists (6 nb, nq) of the bodies per joint rate, by central differences."""
        ends = [
            [self.at(angles + sign * step).motion for sign in (-1, 1)]
            for step in TURN * np.eye(len(angles))
        ]
        columns = [before.twist_to(after).ravel() / (2 * TURN) for before, after in ends]
        return np.stack(columns, axis=1)

    def _query(self, angles: Array) -> FmuPose:
        if not self.tells_any:
            raise InputError(
                f"{self._unit.opened.path}: this FMU gives no poses at joint angles that it has "
                f"not reached: that needs the quantities {KINEMATICS.name} and "
                f"{QUERY_ANGLE}, and a unit whose state can be restored (canGetAndSetFMUstate). "
                "Without them: the scheme explicit of a motion, linear or newton of an equilibrium"
            )
        asked: dict[str, Array | float] = {QUERY_ANGLE: angles, KINEMATICS.name: 1.0}
        values = self._unit.step_from(self._begin, self._place, asked, SHORT, POSE, keep=False)
        return self.keep(angles, values)
