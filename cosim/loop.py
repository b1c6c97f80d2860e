"""A coupled motion in a loop of the user's own: `reset`, `step(action)`, named observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cosim.arguments import by_name, case_from, quantity_in_si, whole_number
from cosim.case.schema import Case
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


class Channel(NamedTuple):
    """An action or an observation."""

    unit: str
    meaning: str
    least: float = -np.inf
    most: float = np.inf
    start: float = 0.0
    """Of an action: what acts at a reset, unless another is given."""


@dataclass(frozen=True)
class LoopState:
    """All that is needed to go on from a time; a value, which no step changes."""

    motion: MotionState
    commands: tuple[tuple[float, Mapping[str, float]], ...]
    """s and, by tendon, the action from then on, the oldest first."""
    loop: object
    """What it is a state of: of each loop another."""


@dataclass(frozen=True)
class Gain:
    """How the fingertip's force follows the tensions, at rest near a state."""

    tendons: tuple[str, ...]
    matrix: Array
    """(3, nt) N/N, of the force on the world along distal, radial and dorsal."""


class Loop:
    """A finger and a hood that step when they are asked to, for a controller or a learner.

    `case`: as `load` takes it, of a finger with mass (index, middle, planar, robot, or an FMU's).
    `step`: s, or a text with its unit, between two observations; it is made of `substeps` equal
    steps of the motion.

    An action gives numbers by tendon, and those that are not named stay: N of a tendon, 0 to 1 of a
    muscle with a fibre, V or Pa of a pneumatic cylinder, N m or m of a motor, m of a tendon whose
    end is drawn (`actions` says which, with unit and bounds).  Observations are numbers by name,
    always in the order of `observations`, which says their units: angles and rates of the joints,
    place of the fingertip and its force on the world, tensions, excursions, forces in the slips.

    >>> import cosim
    >>> loop = cosim.Loop("pulley_edc", step="2 ms")
    >>> loop.actions["EDC"].unit, loop.observations["tip_force.dorsal"].unit
    ('N', 'N')
    >>> seen = loop.reset()
    >>> for _ in range(5):
    ...     seen = loop.step({"EDC": 2.0})
    >>> round(seen["time"], 6), round(seen["tension.EDC"], 3)
    (0.01, 2.0)

    Raises InputError for a case that cannot move, or whose motion chooses its own steps."""

    def __init__(self, case: AnyCase, step: float | str = "2 ms", *, substeps: int = 1) -> None:
        given = case_from(case)
        self.dt = quantity_in_si("step", step, units.TIME, 1e-6)
        self._substeps = whole_number("substeps", substeps, 1, MOST_SUBSTEPS)
        stated = _in_motion(given, self.dt / self._substeps)
        self._commands: tuple[tuple[float, Mapping[str, float]], ...] = ()
        self._token = object()
        self.case, actions = self._with_live_signals(stated)
        self.actions: Mapping[str, Channel] = MappingProxyType(actions)
        assert self.case.forward is not None
        self._set_start({name: channel.start for name, channel in self.actions.items()})
        self.models = moving_models(self.case, self.case.forward, "step / substeps")
        self._has_delay = any(t.actuation is not None for t in self.case.tendons.values())
        self._straight = self._path_lengths(np.zeros(len(self.models.finger.joints)))
        self._at = self._begun = self.models.moves.begin(self.models.initial_state)
        self._first = self._commands
        self.observations: Mapping[str, Channel] = MappingProxyType(dict(self._channels()))

    def reset(
        self,
        posture: Mapping[str, float | str] | None = None,
        action: Mapping[str, float] | None = None,
    ) -> dict[str, float]:
        """Put the finger at rest in the case's posture, or with the joints of `posture` (rad, or
        texts with a unit) elsewhere, the hood in equilibrium on it under the actions of the case,
        or `action`; return what is observed there.

        Raises InputError for a posture or an action that there is not, and ConvergenceError;
        the loop then stands where it stood."""
        before = self.state
        self._commands = self._first
        try:
            if action is not None:
                self._set_start(self._actions(action))
            if posture is None and action is None:
                self._at = self._begun
            else:
                self._at = self.models.moves.begin(self._initial(posture))
        except BaseException:
            self.state = before
            raise
        return self.observe()

    def step(self, action: Mapping[str, float] | None = None) -> dict[str, float]:
        """Let `step` s pass under an action, and return what is observed at their end.

        Raises InputError for an action that there is not, and ConvergenceError where a step of the
        motion does not converge; the loop then stands where it stood before the step."""
        before, now = self.state, self._at.coupled.time
        at = before.motion
        asked = self._actions(action or {})
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
    def state(self) -> LoopState:
        """The state of now, to go back to: `loop.state = before`."""
        return LoopState(self._at, self._commands, self._token)

    @state.setter
    def state(self, state: LoopState) -> None:
        if not isinstance(state, LoopState):
            raise unexpected("state", "a state of this loop", state)
        if state.loop is not self._token:
            raise InputError(
                "state: is of another loop, whose finger, hood and actions this one has not; go "
                "back to what this loop's own `state` gave"
            )
        self._at, self._commands = state.motion, state.commands

    def observe(self) -> dict[str, float]:
        """What is observed now, by name."""
        return dict(zip(self.observations, self._values(), strict=True))

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

    def _initial(self, posture: Mapping[str, float | str] | None) -> Any:
        given = by_name("posture", posture or {}, '{"PIP": 0.5}')
        known = self.models.finger.joints
        for joint in given:
            if joint not in known:
                raise InputError(f"posture: no joint {joint}; the finger has {', '.join(known)}")
        turned = {j: quantity_in_si(f"posture.{j}", v, units.ANGLE) for j, v in given.items()}
        return self.models.finger.begin({**self.models.posture, **turned})

    def _actions(self, action: Mapping[str, float]) -> Mapping[str, float]:
        """The actions by tendon from now on.  Raises InputError."""
        out = dict(self._commands[-1][1])
        for name, value in by_name("action", action, '{"EDC": 3.0}').items():
            channel = self.actions.get(name)
            if channel is None:
                near = nearest_names(name, self.actions)
                hint = f"; did you mean {near[0]}?" if near else "."
                raise InputError(
                    f"action: nothing to command of the name {name}{hint} There are "
                    f"{', '.join(self.actions)}"
                )
            number = _number(value)
            if not channel.least <= number <= channel.most:
                unit = f" {channel.unit}".rstrip()
                raise InputError(
                    f"action {name} = {value!r}: expected a number from {channel.least:g} to "
                    f"{channel.most:g}{unit}; {channel.meaning}"
                )
            out[name] = number
        return out

    def _recent(self, now: float) -> tuple[tuple[float, Mapping[str, float]], ...]:
        """The commands that a dead time may still ask for."""
        if not self._has_delay:
            return ()
        last = sum(start < now - LONGEST_DELAY for start, _ in self._commands)
        return self._commands[max(last - 1, 0) :]

    def _set_start(self, action: Mapping[str, float]) -> None:
        self._commands = ((-np.inf, action),)

    def _command(self, name: str, base: float, time: float) -> float:
        """What multiplies a tendon's tension, activation or command at a time (s)."""
        for start, action in reversed(self._commands):
            if time > start:
                return action[name] / base
        return self._commands[0][1][name] / base

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


def _number(value: object) -> float:
    """A number, or nan for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return float("nan")
    return float(value)


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
