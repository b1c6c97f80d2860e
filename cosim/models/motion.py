"""The models of a case in motion.  One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from cosim.case.schema import Case, ForwardConfig
from cosim.coupling.events import GivingHood
from cosim.coupling.excursion import PrescribedExcursions
from cosim.coupling.give_way import GivingMotion
from cosim.coupling.motion import CoupledMotion, RecordedFinger
from cosim.coupling.schemes import Alone
from cosim.coupling.state import CoupledState
from cosim.coupling.state_arrays import Special
from cosim.errors import InputError
from cosim.fingers.common import CageTipConfig, ShellTipConfig
from cosim.fingers.kinds import joint_ranges, unit
from cosim.hoods.kind import BuiltHood, Slips
from cosim.models.build import build_any, build_hood, relaxing, scheme_of, site_of
from cosim.models.fit import check_tendons
from cosim.port import Array, Hood, Motion, State, Triangles
from cosim.stopwatch import timed
from cosim.tendons.air import cylinders, initial_air, step_cylinders
from cosim.tendons.motor import MotorState, motors
from cosim.tendons.muscles import fibres
from cosim.tendons.signals import factor_of
from cosim.tendons.table import TendonConfig, stretch_of

if TYPE_CHECKING:
    from rigid.air.plant import AirState
    from rigid.mujoco.dynamics import DynamicPull
    from rigid.mujoco.finger import MujocoFinger
    from rigid.mujoco.moving_finger import MovingMujoco, Splint
    from rigid.mujoco.tip_device import Device
    from rigid.muscle.dynamics import MuscleState
    from rigid.muscle.parameters import Muscles


MOST_SWING = 1.5
"""rad, of the finger's swing on an elastic tendon in one step; at 2 a step is unstable."""


@dataclass(frozen=True)
class MovingModels:
    """A finger and a hood ready to move, what pulls on them, and what pictures need."""

    moves: CoupledMotion
    pulls: CaseTendonDrive
    posture: Mapping[str, float]
    """rad, to begin in; none of a unit, which has its own."""
    bones: Mapping[str, Triangles]
    lines: Callable[[Motion], Mapping[str, Array]]
    built: BuiltHood
    """The hood, and what there is to know of its states."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """rad by joint, the ranges of motion; none of a finger in an FMU."""
    relaxes: bool = False
    """Whether the hood relaxes."""

    @property
    def giving_parts(self) -> Sequence[Any]:
        """The parts that give way or begin, as of `cosim.hoods.giving.Unit`, then the splints."""
        splints = [Worn(f"splint_{s.joint}") for s in getattr(self.finger, "splints", ())]
        return [*getattr(self.moves.giving, "units", ()), *splints]

    def slips(self, at: CoupledState) -> Slips:
        """N in the slips, by name; none of a hood and finger without."""
        return self.built.slip_forces(at.hood, self.finger.tendons, at.tension[1])

    @property
    def finger(self) -> RecordedFinger:
        """The finger in time, behind the port."""
        return self.moves.finger

    @property
    def hood(self) -> Hood:
        """The hood behind the port."""
        return self.moves.hood

    @cached_property
    def initial_state(self) -> State:
        """The finger at rest in the posture."""
        return self.finger.begin(self.posture)

    def first_tensions(self) -> Array:
        """The tensions (nt,) N at t = 0, of the hood's tendons, then the finger's own."""
        return self.moves.first_pull(self.initial_state)[1]


class Worn(NamedTuple):
    """A splint among what gives way or begins."""

    part: str
    place: tuple[int, int] = (1, 1)

    @property
    def name(self) -> str:
        return self.part


def timed_splints(case: Case) -> tuple[Splint, ...]:
    """The splints that are put on or taken off in a motion."""
    from rigid.mujoco.moving_finger import Splint

    return tuple(
        Splint(joint, s.range, s.stiffness, s.begins or 0.0, np.inf if s.ends is None else s.ends)
        for joint, s in case.native_finger().splint.items()
        if s.has_times
    )


@timed("models")
def moving_models(
    case: Case, forward: ForwardConfig, step_key: str = "forward.step"
) -> MovingModels:
    """The models of a coupled motion; `step_key` names in messages what states the step.  Raises
    InputError."""
    if not case.finger.is_native:
        return _with_unit(case, forward)
    from rigid.mujoco.moving_finger import MovingMujoco

    models = build_any(case, in_time=True)  # of a finger that check_fit lets move
    live = cast("MujocoFinger", models.finger)
    splints = timed_splints(case)
    finger = MovingMujoco(live, tip_device(case), relaxing(case).joints, splints)
    pulls = CaseTendonDrive(case, (*models.hood.tendons, *finger.tendons))
    driven = _prescribed_excursions(case, pulls.tendons)
    scheme = scheme_of(case.coupling) if case.hood.is_coupled else Alone()
    _check_step(case, finger, pulls, models.posture, step_key)
    giving = cast("GivingHood", models.hood) if case.gives_way is not None else None
    moves = (CoupledMotion if giving is None else GivingMotion)(
        scheme,
        finger,
        models.hood,
        pulls,
        forward.step,
        driven,
        models.built.points.positions,
        giving,
        finger if splints else None,
    )
    return MovingModels(
        moves,
        pulls,
        models.posture,
        models.bones,
        models.lines,
        models.built,
        joint_ranges(models.finger),
        relaxing(case).hood is not None,
    )


def _with_unit(case: Case, forward: ForwardConfig) -> MovingModels:
    """A finger in an FMU, with a hood that is no shell."""
    finger = unit(case.finger).in_motion()
    built = build_hood(case, site_of(case, finger.rest()))
    tendons = (*built.hood.tendons, *finger.tendons)
    check_tendons(case, tendons)
    pulls = CaseTendonDrive(case, tendons)
    driven = _prescribed_excursions(case, tendons)
    scheme = scheme_of(case.coupling)
    moves = CoupledMotion(scheme, finger, built.hood, pulls, forward.step, driven)
    return MovingModels(moves, pulls, {}, {}, case.hood.lines, built)


def _check_step(
    case: Case,
    finger: MovingMujoco,
    pulls: CaseTendonDrive,
    posture: Mapping[str, float],
    step_key: str,
) -> None:
    """Check that steps are short beside the swing of the finger on its motors' tendons, whose
    tensions follow a step late.  Raises InputError."""
    assert case.forward is not None
    own = slice(len(pulls.tendons) - len(finger.tendons), None)
    stiffness = pulls.motor_stiffness()[own]
    if not stiffness.any():
        return
    longest = MOST_SWING / finger.fastest_rate(finger.begin(posture), stiffness)
    if case.forward.step > longest:
        stiffest = finger.tendons[int(np.argmax(stiffness))]
        raise InputError(
            f"{step_key}: {case.forward.step:g} s is too long for a finger on the elastic "
            f"tendons of its motors; write {0.95 * longest:.2g} s or less, or a smaller "
            f"tendons.{stiffest}.elastic.stiffness"
        )


def _prescribed_excursions(case: Case, tendons: tuple[str, ...]) -> PrescribedExcursions:
    """The tendons whose ends are displaced, each by its excursion times its signal."""
    names = tuple(n for n in tendons if n in case.tendons and case.tendons[n].excursion is not None)
    most = np.array([case.tendons[n].excursion for n in names], dtype=float)
    signals = [factor_of(case.tendons[n].signal) for n in names]
    index = np.array([tendons.index(n) for n in names], dtype=int)
    give, slack = stretch_of([case.tendons[n] for n in names])
    return PrescribedExcursions(
        names,
        index,
        lambda time: most * [signal(time) for signal in signals],
        give,
        slack,
        relaxing(case).tendons,
    )


def tip_device(case: Case) -> Device | None:
    """The device that the fingertip presses in; None where there is none. Raises InputError for a
    finger in an FMU."""
    from rigid.mujoco.tip_device import Cage, Shell, TipContact

    tip = case.native_finger().tip
    if not isinstance(tip, CageTipConfig | ShellTipConfig):
        return None
    contact = TipContact(
        tip.sphere / 2,
        tip.stiffness,
        tip.dissipation,
        tip.static_friction,
        tip.dynamic_friction,
        tip.viscous_friction,
        tip.transition_velocity,
    )
    return (Cage if isinstance(tip, CageTipConfig) else Shell)(contact, tip.width)


class MuscleGroup(NamedTuple):
    """Muscles whose tendons are all elastic or all rigid, and where they stand among the finger's
    tendons."""

    muscles: Muscles
    activation: Array
    home: Array
    """(n,) m, path lengths in the posture."""
    where: Array


class DriveState(NamedTuple):
    """The state of what pulls: of the fibres by group, and of the air in the cylinders."""

    fibres: list[MuscleState]
    begun: Array
    """(nt,) m, of the paths at the start, from which shortening counts."""
    air: AirState | None
    home: Array
    """(nc,) m, of the paths with which the pistons stand where they started."""
    motors: MotorState | None = None


class CaseTendonDrive:
    """Stated tensions, fibres that begin in equilibrium at their first excitation, and cylinders
    and motors at rest under their first command, each times the factor of its signal; the resting
    tension of tendons whose ends are displaced."""

    def __init__(self, case: Case, tendons: tuple[str, ...]) -> None:
        self.tendons = tendons
        self._stated = np.array([case.tension(name) for name in tendons])
        pulled = [case.tendons.get(name, TendonConfig()) for name in tendons]
        signals = [t.signal if t.excursion is None else None for t in pulled]
        self._factors = [factor_of(signal) for signal in signals]
        self._groups = [
            MuscleGroup(
                muscles, activation, home, np.array([tendons.index(n) for n in muscles.names])
            )
            for muscles, activation, home in fibres(case.tendons)
        ]
        self._air, self._motors = cylinders(case.tendons, tendons), motors(case.tendons, tendons)

    @property
    def cylinders(self) -> tuple[str, ...]:
        """The tendons that air pulls."""
        return () if self._air is None else self._air.names

    @property
    def motors(self) -> tuple[str, ...]:
        """The tendons that motors wind."""
        return () if self._motors is None else self._motors.names

    def start(self, length: Array) -> State:
        """The drive's state where the tendons have lengths (nt,) m."""
        from rigid.muscle.dynamics import at_rest

        fibres = [at_rest(g.muscles, self._excitation(g, 0.0), g.home) for g in self._groups]
        wound = None
        if self._motors is not None:
            wound = self._motors.initial(length[self._motors.where])
        if self._air is None:
            return DriveState(fibres, length.copy(), None, np.zeros(0), wound)
        air = initial_air(self._air)
        return DriveState(fibres, length.copy(), air, length[self._air.where], wound)

    def settle_at(self, state: State, length: Array) -> State:
        """The state of the start with pistons and motors where they start at paths of `length`
        (nt,) m."""
        if self._motors is not None:
            state = state._replace(motors=state.motors._replace(home=length[self._motors.where]))
        return state if self._air is None else state._replace(home=length[self._air.where])

    def motor_stiffness(self) -> Array:
        """The stiffness (nt,) N/m of the tendons that motors wind; zero of the others."""
        out = np.zeros(len(self.tendons))
        if self._motors is not None:
            out[self._motors.where] = self._motors.stiffness
        return out

    def motor_signals(self, state: State, time: float) -> Array:
        """How far each motor has drawn its tendon's end, m, and its torque, N m, (nm, 2)."""
        if self._motors is None:
            return np.zeros((0, 2))
        return self._motors.signals(state.motors, time)

    def cylinder_signals(self, state: State, time: float) -> Array:
        """Signals (nc, 2) of each cylinder: V commanded, Pa above the atmosphere."""
        from rigid.air.plant import ATMOSPHERE

        if self._air is None:
            return np.zeros((0, 2))
        pressure = state.air.pressure - ATMOSPHERE
        return np.stack([self._air.command(float(time)), pressure], axis=1)

    def _excitation(self, group: MuscleGroup, time: float) -> Array:
        """The excitation (n,) at a time in s."""
        factors = [self._factors[i](time) for i in group.where]
        return np.clip(group.activation * factors, 0.0, 1.0)

    def pull(self, state: State, time: float, length: Array, dt: float) -> DynamicPull:
        """Tension, its stiffness and the state, `dt` s after `state`."""
        from rigid.mujoco.dynamics import DynamicPull
        from rigid.muscle.dynamics import step
        from rigid.muscle.millard import equilibrium

        tension = self._stated * [factor(time) for factor in self._factors]
        stiffness, after = np.zeros(len(tension)), []
        for group, at in zip(self._groups, state.fibres, strict=True):
            path = group.home + (length - state.begun)[group.where]
            excited = self._excitation(group, time)
            if dt == 0.0:
                rest = equilibrium(group.muscles, excited, path)
                tension[group.where] = rest.force
                after.append(at)
                continue
            done = step(group.muscles, at, excited, path, dt)
            tension[group.where] = done.force
            stiffness[group.where] = np.maximum(done.stiffness, 0.0)
            after.append(done.state)
        air = state.air
        if self._air is not None:
            where = self._air.where
            drawn = step_cylinders(self._air, air, time, state.home - length[where], dt)
            tension[where], stiffness[where], air = drawn
        wound = state.motors
        if self._motors is not None:
            where = self._motors.where
            tension[where], stiffness[where], wound = self._motors.step(
                wound, time, length[where], dt
            )
        return DynamicPull(tension, stiffness, state._replace(fibres=after, air=air, motors=wound))

    def lengths(self, state: State) -> dict[str, float]:
        """Normalised fibre lengths in a state, by muscle."""
        return {
            name: float(length / optimum)
            for group, at in zip(self._groups, state.fibres, strict=True)
            for name, length, optimum in zip(
                group.muscles.names,
                at.fibre_length,
                group.muscles.optimal_fibre_length,
                strict=True,
            )
        }


def special_states(hood: Hood, finger: RecordedFinger | None = None) -> Special:
    """How the states that hold more than arrays are written: a shell hood's is its shape, from
    which its tangent is made anew; an FMU's is what it writes itself.

    Raises InputError for a hood or a unit whose states cannot be."""
    from cosim.fmu.finger import FmuMovingFinger
    from cosim.fmu.hood import FmuHood
    from cosim.fmu.unit import state_serialisers
    from cosim.hoods.giving import GivingFeHood, GivingState
    from cosim.hoods.relaxing import RelaxingFeHood, RelaxingState
    from fe_solver.hood.shell_hood import HoodState, ShellHood

    units = [part.unit for part in (hood, finger) if isinstance(part, FmuHood | FmuMovingFinger)]
    kept = state_serialisers(units) if units else {}
    if not isinstance(hood, ShellHood | GivingFeHood | RelaxingFeHood):
        return kept
    if getattr(hood, "augment", None) is not None:
        raise InputError(
            "forward.checkpoint: a hood whose contact is augmented (hood.contact.penetration or "
            "friction) has no checkpoints; leave one of the two out"
        )

    def read(template: State, arrays: dict[str, Any]) -> State:
        return hood.from_arrays(arrays)

    of_hoods = HoodState, GivingState, RelaxingState
    return {**kept, **dict.fromkeys(of_hoods, (hood.to_arrays, read))}
