"""A coupled motion in a loop of the user's own: `reset`, `step(action)`, named observations."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np

from cosim.arguments import (
    by_name,
    by_name_or_in_order,
    case_from,
    quantity_in_si,
    real_number,
    whole_number,
)
from cosim.case.cache_key import address, code_version
from cosim.case.schema import Case
from cosim.content_key import UnknownContentError, content_key
from cosim.coupling.motion import MotionState
from cosim.errors import ConvergenceError, InputError, nearest_names, unexpected
from cosim.fingers.kinds import native_tendons, tip_support_kind, with_mass
from cosim.models.motion import moving_models
from cosim.port import AXES, Array, Load
from cosim.schema import units
from cosim.tendons.signals import LiveSignal, factor_of
from cosim.tendons.table import TendonConfig

if TYPE_CHECKING:
    from cosim.face import AnyCase

LONGEST_DELAY = 1.0
"""s, for which commands of drives with a dead time are kept."""
MOST_SUBSTEPS = 10_000
SHORTEST, LONGEST = 1e-6, 0.1
"""s, of a step of the motion, as `forward.step` has them."""
DRIVES = {
    "voltage": ("V", 0.0, 10.0),
    "pressure": ("Pa", 0.0, 2e6),
    "torque": ("N*m", 0.0, 100.0),
    "position": ("m", -0.1, 0.1),
}
"""The commands of cylinders and motors, with unit and bounds."""
LEAST_ACTIVATION = 0.01
"""What a muscle's fibre takes any smaller activation for."""
SPREAD = "5 deg"
"""By how much a joint begins off the posture at most where a seed is given."""
MOST_SEED = 2**64 - 1
Action = Mapping[str, float] | Sequence[float] | Array
Commands = tuple[tuple[float, tuple[float, ...]], ...]
"""s and, in the order of the actions, the commands from then on, the oldest first."""
Given = ParamSpec("Given")
Returned = TypeVar("Returned")


class Channel(NamedTuple):
    """An action or an observation."""

    unit: str
    meaning: str
    least: float = -np.inf
    most: float = np.inf
    start: float = 0.0
    """What acts at a reset, unless another action is given."""


@dataclass(frozen=True, eq=False)
class LoopState:
    """All that is needed to go on from a time: a value, which no step changes.

    Two are equal where their contents are, to the last bit.  They can be copied, pickled and put
    back into another loop of the same case, but not where an FMU keeps its part: that raises
    InputError."""

    motion: MotionState
    commands: Commands
    case: str
    """The address of the case and the program."""
    owner: object = None
    """The token of the one loop that can go on from it, where that has an FMU."""

    def __eq__(self, other: object) -> bool:
        return type(other) is LoopState and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def __reduce__(self) -> Any:
        if self.owner is not None:
            raise InputError(
                "state: its FMU keeps a part of it inside, so that it is not copied or pickled; "
                "keep it as it is, for the loop that gave it"
            )
        return LoopState, (self.motion, self.commands, self.case)

    @cached_property
    def _content(self) -> object:
        """The key of its content; the motion itself where that is not known."""
        try:
            motion: object = content_key(self.motion, ("cosim", "fe_solver", "rigid"))
        except UnknownContentError:
            motion = id(self.motion)
        return motion, self.commands, self.case, self.owner


@dataclass(frozen=True)
class Gain:
    """How the fingertip's force follows the tensions, at rest near a state."""

    tendons: tuple[str, ...]
    matrix: Array
    """(3, nt) N/N, of the force on the world along distal, radial and dorsal."""


def _in_turn(method: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """The method of a loop that waits until no other thread is in one."""

    @wraps(method)
    def waiting(*args: Given.args, **named: Given.kwargs) -> Returned:
        with cast(Loop, args[0])._turn:
            return method(*args, **named)

    return waiting


def _restored(
    cls: type[Loop], case: Case, step: float, substeps: int, states: tuple[Any, Any], own: Any
) -> Loop:
    """The copy of a loop: a new one of its case, in its state, with what a user hung on it."""
    loop = cls.__new__(cls)
    loop._build(case, step, substeps, states[0])
    vars(loop).update(own)
    loop.state = states[1]
    return loop


class Loop:
    """A finger and a hood that step when they are asked to, for a controller or a learner.

    `case`: as `load` takes it, of a finger with mass (index, middle, planar, robot, or an FMU's).
    `step`: s, or a text with its unit, between two observations; it is made of `substeps` equal
    steps of the motion.

    An action gives numbers by tendon, and those that are not named stay; or it is a list or an
    array of all, in the order of `actions`, which says their units and bounds: N of a tendon, 0 to
    1 of a muscle with a fibre, V or Pa of a pneumatic cylinder, N m or m of a motor, m of a tendon
    whose end is drawn.  Observations are numbers by name, always in the order of `observations`,
    which says their units: angles and rates of the joints, place of the fingertip and its force on
    the world, tensions, excursions, forces in the slips.

    >>> import cosim
    >>> loop = cosim.Loop("pulley_edc", step="2 ms")
    >>> loop.actions["EDC"].unit, loop.observations["tip_force.dorsal"].unit
    ('N', 'N')
    >>> seen = loop.reset()
    >>> for _ in range(5):
    ...     seen = loop.step({"EDC": 2.0})
    >>> round(seen["time"], 6), round(seen["tension.EDC"], 3)
    (0.01, 2.0)

    A copy (`copy.deepcopy`, `pickle`) is another loop of the case in the same state; one with an
    FMU cannot be copied.  Threads that share a loop take turns.

    Raises InputError for a case that cannot move, or whose motion chooses its own steps."""

    def __init__(self, case: AnyCase, step: float | str = "2 ms", *, substeps: int = 1) -> None:
        seconds = quantity_in_si("step", step, units.TIME, 1e-6)
        count = whole_number("substeps", substeps, 1, MOST_SUBSTEPS)
        self._build(case_from(case), seconds, count)

    def _build(
        self, case: Case, step: float, substeps: int, begun: MotionState | None = None
    ) -> None:
        """Set up the models, at `begun` where that is known."""
        self._turn = threading.RLock()
        self.dt, self._substeps = step, substeps
        self.case = _in_motion(case, self.dt / self._substeps)
        self._commands: Commands = ()
        commanded, actions = self._with_live_signals(self.case)
        self.actions: Mapping[str, Channel] = MappingProxyType(actions)
        assert commanded.forward is not None
        self._place = {name: k for k, name in enumerate(self.actions)}
        self._set_start(tuple(channel.start for channel in self.actions.values()))
        self.models = moving_models(commanded, commanded.forward, "step / substeps")
        self._has_delay = any(t.actuation is not None for t in self.case.tendons.values())
        self._straight = self._path_lengths(np.zeros(len(self.models.finger.joints)))
        self._begun = begun or self.models.moves.begin(self.models.initial_state)
        self._at = self._begun
        self._first = self._commands
        self.observations: Mapping[str, Channel] = MappingProxyType(dict(self._channels()))
        self._of = self._key()
        self._names = {"_names", *vars(self)}

    @_in_turn
    def __reduce__(self) -> Any:
        if self._of[1] is not None:
            raise InputError(
                f"loop of {self.case.name}: has an FMU, whose state only the FMU itself copies; "
                "make another loop: cosim.Loop(case)"
            )
        own = {name: value for name, value in vars(self).items() if name not in self._names}
        of = (self.case, self.dt, self._substeps, (self._begun, self.state), own)
        return _restored, (type(self), *of)

    def _key(self) -> tuple[str, object]:
        """What loops share that can go on from each other's states: case and owner."""
        has_unit = "fmu" in (self.case.finger.kind, self.case.hood.kind)
        of_case = address(self.case.model_copy(update={"forward": None}), code_version())
        return of_case, object() if has_unit else None

    @_in_turn
    def reset(
        self,
        posture: Mapping[str, float | str] | None = None,
        action: Action | None = None,
        *,
        seed: int | None = None,
        spread: float | str = SPREAD,
    ) -> dict[str, float]:
        """Put the finger at rest in the case's posture, or with the joints of `posture` (rad, or
        texts with a unit) elsewhere, the hood in equilibrium on it under the actions of the case,
        or `action`; return what is observed there.

        With a `seed` each joint begins at random, at most `spread` (rad, or a text with a unit) off
        that posture and within its range: the same seed, the same beginning.

        Raises InputError for a posture, an action or a seed that there is not, and
        ConvergenceError; the loop then stands where it stood."""
        before = self.state
        self._commands = self._first
        try:
            if action is not None:
                self._set_start(self._actions(action))
            if posture is None and action is None and seed is None:
                self._at = self._begun
            else:
                joints = self._posture({} if posture is None else posture)
                if seed is not None:
                    joints |= self._off_posture(joints, seed, spread)
                self._at = self.models.moves.begin(self.models.finger.begin(joints))
        except BaseException:
            self.state = before
            raise
        return self.observe()

    @_in_turn
    def step(self, action: Action | None = None) -> dict[str, float]:
        """Let `step` s pass under an action, and return what is observed at their end.

        Raises InputError for an action that there is not, and ConvergenceError where a step of the
        motion does not converge; the loop then stands where it stood before the step."""
        before, now = self.state, self._at.coupled.time
        at = before.motion
        asked = self._actions({} if action is None else action)
        self._commands = (*self._recent(now), (now, asked))
        try:
            for _ in range(self._substeps):
                at = self.models.moves.advance(at)
        except ConvergenceError as error:
            self.state = before
            raise ConvergenceError(
                f"the loop's step from t = {now:.6g} s: {error} The loop stands where it stood "
                "before: try another action, or a shorter step"
            ) from error
        except BaseException:
            self.state = before
            raise
        self._at = at
        return self.observe()

    @property
    @_in_turn
    def state(self) -> LoopState:
        """The state of now, to go back to: `loop.state = before`."""
        return LoopState(self._at, self._commands, *self._of)

    @state.setter
    @_in_turn
    def state(self, state: LoopState) -> None:
        if not isinstance(state, LoopState):
            raise unexpected("state", "a state of a loop of this case", state)
        if (state.case, state.owner) != self._of:
            raise InputError(
                "state: is of a loop of another case or another version of the program, or of "
                "another loop with an FMU; go back to what `state` gave of a loop of this case"
            )
        self._at, self._commands = state.motion, state.commands

    @_in_turn
    def observe(self) -> dict[str, float]:
        """What is observed now, by name."""
        return dict(zip(self.observations, self._values(), strict=True))

    @_in_turn
    def gain(self) -> Gain:
        """How the force of a held fingertip follows the tensions at rest, near the present state,
        by the port's derivatives of finger and hood.

        Raises InputError for a finger that has none: one in an FMU, or in motion in a device or
        with its tip free."""
        finger = getattr(self.models.finger, "finger", None)
        if finger is None or getattr(self.models.finger, "device", None) is not None:
            raise InputError("gain: takes a finger of ours whose tip is held at a point or clamped")
        c, split = self._at.coupled, len(self.models.hood.tendons)
        state = finger.with_angles(c.finger.start, self.models.finger.angles(c.finger))
        if not len(state.basis):
            raise InputError('gain: the tip is free; hold it (finger.tip.kind = "point")')
        state = replace(state, reaction=-self.models.finger.tip_wrench(c.finger))
        load = Load(finger.bodies, ("hood",), c.point.wrench[:, None], np.zeros((0, 6)))
        by = self.models.hood.jacobian(c.hood)
        slope = finger.tangent(state, load, c.tension[1], by.load_motion)
        nq, jacobian = len(finger.joints), finger.jacobian(state)
        own = finger.own_torques(state.angles, np.ones(len(finger.tendons)))
        pull = np.zeros((len(slope), split + len(finger.tendons)))
        pull[:nq, :split] = jacobian.T @ by.load_tension
        for k, name in enumerate(finger.tendons):
            pull[:nq, split + k] = own[name]
        reaction = -np.linalg.lstsq(slope, pull, rcond=None)[0][nq:]
        force = -(state.basis[:, :3].T @ reaction)
        return Gain((*self.models.hood.tendons, *finger.tendons), force)

    def _posture(self, posture: Mapping[str, float | str]) -> dict[str, float]:
        """The angles (rad) by joint to begin in.  Raises InputError."""
        given = by_name("posture", posture, '{"PIP": 0.5}')
        known = self.models.finger.joints
        for joint in given:
            if joint not in known:
                raise InputError(f"posture: no joint {joint}; the finger has {', '.join(known)}")
        turned = {j: quantity_in_si(f"posture.{j}", v, units.ANGLE) for j, v in given.items()}
        return {**self.models.posture, **turned}

    def _off_posture(
        self, joints: Mapping[str, float], seed: int, spread: float | str
    ) -> dict[str, float]:
        """Angles (rad) at random about those of `joints`.  Raises InputError."""
        if not joints:
            raise InputError("seed: the finger is an FMU, which begins in a posture of its own")
        random = np.random.default_rng(whole_number("seed", seed, 0, MOST_SEED))
        most = quantity_in_si("spread", spread, units.ANGLE, 0.0)
        angles = np.array(list(joints.values()))
        ends = np.array([self.models.ranges.get(j, (-np.inf, np.inf)) for j in joints]).T
        turned = np.clip(angles + random.uniform(-most, most, len(angles)), *ends)
        return dict(zip(joints, turned.tolist(), strict=True))

    def _actions(self, action: Action) -> tuple[float, ...]:
        """All commands from now on.  Raises InputError."""
        out = list(self._commands[-1][1])
        given = by_name_or_in_order("action", action, tuple(self.actions), '{"EDC": 3.0}')
        for name, value in given.items():
            channel = self.actions.get(name)
            if channel is None:
                near = nearest_names(name, self.actions)
                hint = f"; did you mean {near[0]}?" if near else "."
                raise InputError(
                    f"action: nothing to command of the name {name}{hint} There are "
                    f"{', '.join(self.actions)}"
                )
            number = real_number(value)
            if not channel.least <= number <= channel.most:
                unit = f" {channel.unit}".rstrip()
                raise unexpected(
                    f"action {name}",
                    f"a number from {channel.least:g} to {channel.most:g}{unit}; {channel.meaning}",
                    value,
                )
            out[self._place[name]] = number
        return tuple(out)

    def _recent(self, now: float) -> Commands:
        """The commands that a dead time may still ask for."""
        if not self._has_delay:
            return ()
        last = sum(start < now - LONGEST_DELAY for start, _ in self._commands)
        return self._commands[max(last - 1, 0) :]

    def _set_start(self, action: tuple[float, ...]) -> None:
        self._commands = ((-np.inf, action),)

    def _command(self, name: str, base: float, time: float) -> float:
        """What multiplies a tendon's tension, activation or command at a time (s)."""
        place = self._place[name]
        for start, action in reversed(self._commands):
            if time > start:
                return action[place] / base
        return self._commands[0][1][place] / base

    def _with_live_signals(self, case: Case) -> tuple[Case, dict[str, Channel]]:
        """The case with the loop's actions as signals, and the actions."""
        hooded = case.hood.tendon_names(case.finger.kind)
        if hooded is None:  # known once it is built: those that the case pulls
            hooded = tuple(name for name, table in case.tendons.items() if _is_pulled(table))
        own = native_tendons(case.finger, case.hood.left_to_finger)
        tables, actions = dict(case.tendons), {}
        for name in dict.fromkeys((*hooded, *own)):
            table = case.tendons.get(name, TendonConfig())
            channel, base, changed = _channel(case, name, table)
            signal = LiveSignal(partial(self._command, name, base))
            tables[name] = table.model_copy(update={**changed, "signal": signal})
            actions[name] = channel
        return case.model_copy(update={"tendons": tables}), actions

    def _path_lengths(self, angles: Array) -> Array:
        return np.asarray(self.models.finger.path_lengths(angles))

    def _channels(self) -> list[tuple[str, Channel]]:
        """Names and meanings of the observations, in the order of `_values`."""
        finger, hood = self.models.finger, self.models.hood
        tendons = (*hood.tendons, *finger.tendons)
        out = [("time", Channel("s", "time since the reset"))]
        out += [(f"angle.{j}", Channel("rad", f"angle of the {j}")) for j in finger.joints]
        out += [(f"rate.{j}", Channel("rad/s", f"rate of the {j}")) for j in finger.joints]
        if self._tip() is not None:
            place = "place of the fingertip from the MCP"
            out += [(f"tip.{axis}", Channel("m", f"{place}, {axis}")) for axis in AXES]
        force = "force of the fingertip on the world"
        out += [(f"tip_force.{axis}", Channel("N", f"{force}, {axis}")) for axis in AXES]
        out += [(f"tension.{t}", Channel("N", f"tension of {t}")) for t in tendons]
        way = "how far it moved proximally from the hood's rest, or from the straight finger"
        out += [(f"excursion.{t}", Channel("m", f"excursion of {t}: {way}")) for t in tendons]
        slips = self._slips()
        out += [(f"slip_force.{s}", Channel("N", f"force in the {s} slip")) for s in slips]
        return out

    def _values(self) -> list[float]:
        finger, c = self.models.finger, self._at.coupled
        angles = finger.angles(c.finger)
        tip = self._tip()
        parts = [
            [c.time],
            angles,
            finger.rates(c.finger),
            () if tip is None else tip,
            finger.tip_wrench(c.finger)[:3],
            *c.tension,
            c.point.excursion,
            self._straight - self._path_lengths(angles),
            list(self._slips().values()),
        ]
        return np.concatenate(parts).tolist()

    def _tip(self) -> Array | None:
        return self.models.finger.tip(self.models.finger.angles(self._at.coupled.finger))

    def _slips(self) -> Mapping[str, float]:
        return self.models.slips(self._at.coupled)


def _is_pulled(table: TendonConfig) -> bool:
    return (table.force, table.excursion, table.actuation) != (None, None, None)


def _in_motion(case: Case, step: float) -> Case:
    """The case as a motion in steps of `step` s.  Raises InputError."""
    if case.forward is not None and case.forward.adaptive is not None:
        raise InputError(
            f"{case.name}: forward.adaptive: a loop sets the steps of its motion; leave it out"
        )
    if not case.finger.has_mass:
        raise InputError(f"{case.name}: a loop takes a finger with mass: {with_mass()}")
    if tip_support_kind(case.finger) == "posture":
        raise InputError(
            f'{case.name}: finger.tip.kind = "posture" holds every joint still, where no loop '
            'moves it; leave the tip free (kind = "free"), or hold it at a point (kind = "point")'
        )
    if not SHORTEST <= step <= LONGEST:
        raise InputError(
            f"step / substeps: is {step:g} s; expected {SHORTEST:g} to {LONGEST:g} s. Choose "
            "another step, or split it into more or fewer substeps"
        )
    length = units.spell(step, units.TIME)
    return case.replace({"forward.step": length, "forward.duration": length})


def _channel(case: Case, name: str, table: TendonConfig) -> tuple[Channel, float, dict[str, Any]]:
    """The action of a tendon, what it is divided by to be a factor, and what the tendon's table
    states in place of its numbers."""
    first = factor_of(table.signal)(0.0)
    if table.excursion is not None:
        says = "how far the tendon's end is drawn proximally from the reset on"
        return Channel("m", says, -0.05, 0.05), 1.0, {"excursion": 1.0}
    if table.actuation is not None:
        key = next(key for key in DRIVES if getattr(table.actuation, key, None) is not None)
        unit, least, most = DRIVES[key]
        says = f"{key} commanded of what pulls the tendon"
        start = getattr(table.actuation, key) * first
        changed = {"actuation": table.actuation.model_copy(update={key: 1.0})}
        return Channel(unit, says, least, most, start), 1.0, changed
    if table.muscle is not None and table.activation is not None:
        base, start = max(table.activation, LEAST_ACTIVATION), table.activation * first
        says = "activation of the muscle"
        return Channel("1", says, 0.0, 1.0, min(start, 1.0)), base, {"activation": base}
    most = 1000.0 if table.max_force is None else table.max_force
    start = case.tension(name) * first
    says = "tension of the tendon"
    channel = Channel("N", says, 0.0, max(most, start), start)
    return channel, 1.0, {"tension": 1.0, "activation": None}
