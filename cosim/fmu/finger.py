"""A static finger over an FMU, behind `cosim.port.Finger`.

A unit tells where its bodies are and what its fingertip does, not what it is made of: neither
torques by source nor the forces in its joints are known, and its ledger stays open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.fmu.hood import SHORT
from cosim.fmu.kinematics import OPTIONAL, FmuKinematics, FmuPose
from cosim.fmu.mapping import places
from cosim.fmu.quantity import Quantity, finger_quantities
from cosim.fmu.unit import SavedState, Unit
from cosim.port import Array, Load, Motion

OPEN = "the FMU's own: tendons, joints, limits"
"""What no ledger of a finger in an FMU holds."""


@dataclass(frozen=True)
class FmuFingerState:
    """A finger's equilibrium, or a state on the way there."""

    saved: SavedState
    angles: Array
    """(nq,) rad."""
    pose: FmuPose
    tip_force: Array
    """(3,) N, of the fingertip on the world."""

    @property
    def motion(self) -> Motion:
        """Poses of the shared bodies."""
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
        self.kinematics = FmuKinematics(self.unit, self._place, bodies)
        self._begin = self._read_state()

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Infinite: an FMU states no ranges."""
        return dict.fromkeys(self.joints, (-np.inf, np.inf))

    def start(self, posture: Mapping[str, float]) -> FmuFingerState:
        """The unit as it was initialised, in its own posture."""
        return self._begin

    def rest(self) -> Motion:
        """The poses at zero angles; those of the start where the unit does not tell others."""
        if self.kinematics.tells_any:
            return self.kinematics.at(np.zeros(len(self.joints))).motion
        return self._begin.motion

    def angles(self, state: FmuFingerState) -> Array:
        return state.angles

    def motion(self, state: FmuFingerState) -> Motion:
        return state.motion

    def settle(
        self, state: FmuFingerState, load: Load, by_motion: Array, tension: Array, tolerance: float
    ) -> tuple[FmuFingerState, float]:
        """See `cosim.port.Finger`; raises InputError too."""
        return self.step(state, load.total(), by_motion, tension), np.nan

    def balance(self, state: FmuFingerState, load: Load, tension: Array) -> None:
        """None: an FMU reports no forces."""

    def between(self, state: FmuFingerState, aim: FmuFingerState, part: float) -> FmuFingerState:
        """Raises InputError for a unit that does not tell its poses at any angles."""
        return self.with_angles(aim, state.angles + part * (aim.angles - state.angles))

    def with_angles(self, state: FmuFingerState, angles: Array) -> FmuFingerState:
        """Raises InputError for a unit that does not tell its poses at any angles."""
        return replace(state, angles=angles, pose=self.kinematics.at(angles))

    def tip(self, state: FmuFingerState) -> Array | None:
        return state.pose.tip

    def tip_force(self, state: FmuFingerState) -> Array:
        return state.tip_force

    def jacobian(self, state: FmuFingerState) -> Array | None:
        """The Jacobian by differences; None where the unit knows its poses at no other angles."""
        return self.kinematics.jacobian(state.angles) if self.kinematics.tells_any else None

    def ledger(self, state: FmuFingerState, load: Load, tension: Array) -> dict[str, Array]:
        """The fingertip's, where its point is known: a unit tells no other force."""
        if state.pose.tip is None:
            return {}
        out, held = np.zeros((len(self.bodies), 6)), -state.tip_force
        lever = state.pose.tip - state.motion.position[-1]
        out[-1] = np.concatenate([held, np.cross(lever, held)])
        return {"fingertip": out}

    def tendon_paths(self, state: FmuFingerState) -> dict[str, Array]:
        """A line through the bodies' origins."""
        return {"bones": state.pose.line}

    def step(
        self, state: FmuFingerState, wrench: Array, by_motion: Array, tension: Array
    ) -> FmuFingerState:
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
        return self._read_state()

    def _read_state(self) -> FmuFingerState:
        angles = self.unit.get(self._place["angle"])
        pose, force = self.kinematics.read_pose(angles), self.unit.get(self._place["tip_force"])
        return FmuFingerState(self.unit.save(), angles, pose, force)
