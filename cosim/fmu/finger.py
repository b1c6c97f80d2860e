"""A finger over an FMU: at rest, behind `cosim.port.Finger`, and in motion, as
`cosim.coupling.motion.RecordedFinger` as far as a unit reports it.

A unit reports the poses of its bodies and the force at its fingertip.  Neither torques by source
nor the forces in its joints are known, so its ledger does not close.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

import numpy as np

from cosim.errors import InputError
from cosim.fmu.hood import SHORT
from cosim.fmu.kinematics import OPTIONAL, POSE, QUERY_ANGLE, FmuKinematics, FmuPose
from cosim.fmu.mapping import places
from cosim.fmu.quantity import KINEMATICS, Quantity, finger_quantities, moving_quantities
from cosim.fmu.table import APART, Loading
from cosim.fmu.unit import SavedState, Unit
from cosim.port import AffineLoad, Array, Hand, Load, Motion

AFFINE_LOAD = ("load_motion", "load_position", "load_rotation")
"""Quantities of a load that follows the bodies."""


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


FingerState = TypeVar("FingerState", FmuFingerState, FmuMovingState)


class _UnitFinger(ABC, Generic[FingerState]):
    """A finger whose unit has the quantities QUANTITIES, of which it may lack those of MAY_LACK.

    `names` maps them (see `mapping.places`), `hand` is the one in whose frame it speaks.
    Raises InputError for an FMU that cannot be opened or does not map."""

    QUANTITIES: ClassVar[Callable[..., tuple[Quantity, ...]]]
    MAY_LACK: ClassVar[tuple[str, ...]]
    ANSWERS: ClassVar[tuple[str, ...]]
    """What is read after each step."""

    def __init__(
        self,
        path: Path,
        bodies: tuple[str, ...],
        joints: tuple[str, ...],
        tendons: tuple[str, ...],
        names: Mapping[str, str] | None = None,
        *,
        assume_si: bool = False,
        loading: Loading = APART,
        hand: Hand = "right",
    ) -> None:
        self.bodies, self.joints, self.tendons = bodies, joints, tendons
        self.unit, quantities = Unit(path, loading), type(self).QUANTITIES(bodies, joints, tendons)
        self._place = places(
            self.unit.opened, quantities, names or {}, self.MAY_LACK, assume_si, hand
        )
        self.kinematics = FmuKinematics(self.unit, self._place, bodies)
        values = self.unit.values(self._place, self.ANSWERS)
        self._begin: FingerState = self._state(values)
        self._first_motion = self.kinematics.at(self._begin.angles).motion

    @property
    def is_alive(self) -> bool:
        """Whether the unit can be stepped: false once its process has ended."""
        return self.unit.is_alive

    def rest(self) -> Motion:
        """The poses at zero angles; those of the start where the unit does not tell others."""
        if self.kinematics.tells_any:
            return self.kinematics.at(np.zeros(len(self.joints))).motion
        return self._first_motion

    def angles(self, state: FingerState) -> Array:
        return state.angles

    @abstractmethod
    def _state(self, values: Mapping[str, Array]) -> FingerState:
        """The state that the unit is in, by the values of ANSWERS there."""

    def _step(self, saved: SavedState, given: Mapping[str, Array], dt: float) -> FingerState:
        return self._state(self.unit.step_from(saved, self._place, given, dt, self.ANSWERS))

    def _fingertip(self, pose: FmuPose, wrench: Array) -> dict[str, Array]:
        """The ledger of what the world does to the fingertip, which does `wrench` (6,) to it about
        its point; none where that point is not known: a unit reports no other force."""
        if pose.tip is None:
            return {}
        out = np.zeros((len(self.bodies), 6))
        out[-1] = -wrench
        out[-1, 3:] -= np.cross(pose.tip - pose.motion.position[-1], wrench[:3])
        return {"fingertip": out}


class FmuFinger(_UnitFinger[FmuFingerState]):
    """A static finger; a state may be stepped from any number of times."""

    QUANTITIES = staticmethod(finger_quantities)
    MAY_LACK = (*OPTIONAL, "load_motion")
    ANSWERS = ("angle", *POSE, "tip_force")

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Infinite: an FMU states no ranges."""
        return dict.fromkeys(self.joints, (-np.inf, np.inf))

    def start(self, posture: Mapping[str, float]) -> FmuFingerState:
        """The unit as it was initialised, in its own posture."""
        return self._begin

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
        """The state a part of the way to another.  Raises InputError for a unit that does not tell
        its poses at any angles."""
        return self.with_angles(aim, state.angles + part * (aim.angles - state.angles))

    def with_angles(self, state: FmuFingerState, angles: Array) -> FmuFingerState:
        """The state at other joint angles.  Raises InputError for a unit that does not tell its
        poses at any angles."""
        return replace(state, angles=angles, pose=self.kinematics.at(angles))

    def tip(self, state: FmuFingerState) -> Array | None:
        return state.pose.tip

    def tip_force(self, state: FmuFingerState) -> Array:
        return state.tip_force

    def jacobian(self, state: FmuFingerState) -> Array | None:
        """The Jacobian by differences; None where the unit knows its poses at no other angles."""
        return self.kinematics.jacobian(state.angles) if self.kinematics.tells_any else None

    def ledger(self, state: FmuFingerState, load: Load, tension: Array) -> dict[str, Array]:
        """The fingertip's alone."""
        return self._fingertip(state.pose, np.concatenate([state.tip_force, np.zeros(3)]))

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
                f"{self.unit.opened.path}: this FMU takes constant loads only (no load_motion), "
                'and this scheme needs one that follows; write coupling.scheme = "implicit"'
            )
        return self._step(state.saved, {**given, "tension": tension}, SHORT)

    def _state(self, values: Mapping[str, Array]) -> FmuFingerState:
        angles = values["angle"]
        pose = self.kinematics.keep(angles, values)
        return FmuFingerState(self.unit.save(), angles, pose, values["tip_force"])


class FmuMovingFinger(_UnitFinger[FmuMovingState]):
    """A finger in motion; a state may be stepped from any number of times."""

    QUANTITIES = staticmethod(moving_quantities)
    MAY_LACK = (*AFFINE_LOAD, "tip", "tip_moment", QUERY_ANGLE, KINEMATICS.name)
    ANSWERS = ("angle", "rate", "tip_force", "tip_moment", "energy", "dissipation", *POSE)

    def begin(self, posture: Mapping[str, float]) -> FmuMovingState:
        """The unit as it was initialised, in its own posture; raises InputError for another."""
        if posture:
            raise InputError(f"{self.unit.opened.path}: this FMU begins in a posture of its own")
        # As the native finger's: no load has been given when a motion begins.
        return replace(self._begin, tip=np.zeros(6))

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

    def with_tension(self, state: FmuMovingState, tension: Array) -> FmuMovingState:
        """The state as it is: an FMU reports no tendon's stretch."""
        return state

    def joint_torques(self, state: FmuMovingState) -> Array:
        """Zeros (3, nq): a unit does not tell them."""
        return np.zeros((3, len(self.joints)))

    def friction_work(self, state: FmuMovingState) -> Array:
        """Zeros (3,): an FMU reports none."""
        return np.zeros(3)

    def grip(self, state: FmuMovingState) -> Array:
        """None (0,): an FMU reports no guides of tendons."""
        return np.zeros(0)

    def at_insertions(self, angles: Array, tension: Array, grip: Array) -> Array:
        """The tensions (nt,) N as they are given."""
        return tension

    def stored_energy(self, state: FmuMovingState) -> dict[str, float]:
        """Empty: an FMU reports their sum alone."""
        return {}

    def tip_wrench(self, state: FmuMovingState) -> Array:
        """The wrench (6,) of the fingertip on the world: N, and N m about the fingertip, world
        frame."""
        return state.tip

    def motion(self, angles: Array) -> Motion:
        """The poses at joint angles.  Raises InputError for angles not reached of a unit that does
        not tell others."""
        return self.kinematics.at(angles).motion

    def jacobian(self, angles: Array) -> Array:
        return self.kinematics.jacobian(angles)

    def path_lengths(self, angles: Array) -> Array:
        return self.kinematics.at(angles).path

    def tip(self, angles: Array) -> Array | None:
        """The fingertip (3,) m, where the unit tells it."""
        return self.kinematics.at(angles).tip

    def lines(self, angles: Array) -> dict[str, Array]:
        """A line (k, 3) m through the bodies' origins."""
        return {"bones": self.kinematics.at(angles).line}

    def step(
        self, state: FmuMovingState, load: AffineLoad, tension: Array, dt: float
    ) -> FmuMovingState:
        """Step the unit.  Raises InputError for a load on other bodies, or one that follows them
        where the unit takes held loads only; ConvergenceError."""
        if load.at.bodies != self.bodies:
            raise InputError(f"load on bodies {load.at.bodies}: the finger's are {self.bodies}")
        given = {"force": load.wrench[:, :3], "moment": load.wrench[:, 3:], "tension": tension}
        if all(name in self._place for name in AFFINE_LOAD):
            poses = {"load_position": load.at.position, "load_rotation": load.at.rotation}
            given |= {"load_motion": load.by_motion, **poses}
        elif load.by_motion.any():
            raise InputError(
                f"{self.unit.opened.path}: this FMU takes loads that are held over a step (it has "
                f"no {', '.join(AFFINE_LOAD)}), and the schemes linear and newton need one that "
                'follows; write coupling.scheme = "explicit" or "implicit"'
            )
        return self._step(state.saved, given, dt)

    def ledger(
        self,
        before: tuple[Array, Array],
        now: tuple[Array, Array],
        dt: float,
        hood: Array,
        tension: Array,
        tip: Array,
        grip: Array,
        joints: Array,
    ) -> dict[str, Array]:
        """The fingertip's alone."""
        return self._fingertip(self.kinematics.at(now[0]), tip)

    def _state(self, values: Mapping[str, Array]) -> FmuMovingState:
        self.kinematics.keep(values["angle"], values)
        tip = np.concatenate([values["tip_force"], values.get("tip_moment", np.zeros(3))])
        power = float(values["energy"]), float(values["dissipation"])
        return FmuMovingState(self.unit.save(), values["angle"], values["rate"], tip, *power)
