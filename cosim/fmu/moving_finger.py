"""A finger in motion over an FMU: `cosim.coupling.motion.WatchedFinger`, so far as a unit tells
it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.fmu.kinematics import QUERY_ANGLE, FmuKinematics
from cosim.fmu.mapping import places
from cosim.fmu.quantity import KINEMATICS, moving_quantities
from cosim.fmu.unit import SavedState, Unit
from cosim.port import AffineLoad, Array, Motion

AFFINE_LOAD = ("load_motion", "load_position", "load_rotation")
"""Quantities of a load that follows the bodies."""
OPTIONAL = (*AFFINE_LOAD, "tip", "tip_moment", QUERY_ANGLE, KINEMATICS.name)


@dataclass(frozen=True)
class FmuMovingState:
    """A finger in motion at one time."""

    saved: SavedState
    angles: Array
    """(nq,) rad."""
    rates: Array
    """(nq,) rad/s."""
    tip: Array
    """(6,) N and N m, of the fingertip on the world; no moment where the unit tells none."""
    energy: float
    """J."""
    dissipation: float
    """W."""


class FmuMovingFinger:
    """A finger in motion; a state may be stepped from any number of times.

    `names` maps quantities of `moving_quantities` (see `mapping.places`).
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
        self.unit, quantities = Unit(path), moving_quantities(bodies, joints, tendons)
        self._place = places(self.unit.opened, quantities, names or {}, OPTIONAL, assume_si)
        self.kinematics = FmuKinematics(self.unit, self._place, bodies)
        self._follows = all(name in self._place for name in AFFINE_LOAD)
        # As the native finger's: no load has been given when a motion begins.
        self._begin = replace(self._read_state(), tip=np.zeros(6))

    def begin(self, posture: Mapping[str, float]) -> FmuMovingState:
        """The unit as it was initialised, in its own posture; raises InputError for another."""
        if posture:
            raise InputError(f"{self.unit.opened.path}: this FMU begins in a posture of its own")
        return self._begin

    def rest(self) -> Motion:
        """The poses at zero angles; those of the start where the unit does not tell others."""
        if self.kinematics.tells_any:
            return self.motion(np.zeros(len(self.joints)))
        return self.motion(self._begin.angles)

    def angles(self, state: FmuMovingState) -> Array:
        return state.angles

    def rates(self, state: FmuMovingState) -> Array:
        return state.rates

    def energy(self, state: FmuMovingState) -> float:
        return state.energy

    def dissipation(self, state: FmuMovingState) -> float:
        """W, of the damping of joints and limits."""
        return state.dissipation

    def device_loss(self, state: FmuMovingState) -> float:
        """Zero: an FMU reports none."""
        return 0.0

    def stored_energy(self, state: FmuMovingState) -> dict[str, float]:
        """Empty: an FMU reports their sum alone."""
        return {}

    def tip_wrench(self, state: FmuMovingState) -> Array:
        """(6,) N, and N m about the fingertip, of it on the world, world frame."""
        return state.tip

    def motion(self, angles: Array) -> Motion:
        """Raises InputError for angles not reached of a unit that does not tell others."""
        return self.kinematics.at(angles).motion

    def jacobian(self, angles: Array) -> Array:
        return self.kinematics.jacobian(angles)

    def path_lengths(self, angles: Array) -> Array:
        return self.kinematics.at(angles).path

    def tip(self, angles: Array) -> Array | None:
        """(3,) m, where the unit tells it."""
        return self.kinematics.at(angles).tip

    def lines(self, angles: Array) -> dict[str, Array]:
        """(k, 3) m, a line through the bodies' origins."""
        return {"bones": self.kinematics.at(angles).line}

    def step(
        self, state: FmuMovingState, load: AffineLoad, tension: Array, dt: float
    ) -> FmuMovingState:
        """Raises InputError for a load on other bodies, or one that follows them where the unit
        takes held loads only; ConvergenceError."""
        if load.at.bodies != self.bodies:
            raise InputError(f"load on bodies {load.at.bodies}: the finger's are {self.bodies}")
        given = {"force": load.wrench[:, :3], "moment": load.wrench[:, 3:], "tension": tension}
        if self._follows:
            poses = {"load_position": load.at.position, "load_rotation": load.at.rotation}
            given |= {"load_motion": load.by_motion, **poses}
        elif load.by_motion.any():
            raise InputError(
                f"{self.unit.opened.path}: this FMU takes loads that are held over a step (it has "
                f"no {', '.join(AFFINE_LOAD)}), and the schemes linear and newton give it one that "
                'follows; write coupling.scheme = "explicit" or "implicit"'
            )
        self.unit.restore(state.saved)
        for name, value in given.items():
            if name in self._place:
                self.unit.set(self._place[name], value)
        self.unit.step(dt)
        return self._read_state()

    def ledger(
        self,
        before: tuple[Array, Array],
        now: tuple[Array, Array],
        dt: float,
        hood: Array,
        tension: Array,
        tip: Array,
    ) -> dict[str, Array]:
        """The fingertip's, where its point is known: a unit tells no other force."""
        pose = self.kinematics.at(now[0])
        if pose.tip is None:
            return {}
        fingertip = np.zeros_like(hood)
        lever = pose.tip - pose.motion.position[-1]
        fingertip[-1] = -tip
        fingertip[-1, 3:] -= np.cross(lever, tip[:3])
        return {"fingertip": fingertip}

    def _read_state(self) -> FmuMovingState:
        told = {
            name: self.unit.get(self._place[name])
            for name in ("angle", "rate", "tip_force", "tip_moment", "energy", "dissipation")
            if name in self._place
        }
        self.kinematics.read_pose(told["angle"])
        tip = np.concatenate([told["tip_force"], told.get("tip_moment", np.zeros(3))])
        power = float(told["energy"]), float(told["dissipation"])
        return FmuMovingState(self.unit.save(), told["angle"], told["rate"], tip, *power)
