"""A loaded FMU: values set and got by place, steps, and states that can be restored."""

from __future__ import annotations

import atexit
import tempfile
import weakref
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.coupling.state_arrays import Arrays, Special
from cosim.errors import ConvergenceError, CosimError, InputError
from cosim.files import temporary_folder
from cosim.fmu.archive import UnpackedFmu, check_if_ours, unpack_fmu
from cosim.fmu.instance import Instance, LibraryFacts
from cosim.fmu.mapping import VariablePlace
from cosim.fmu.table import APART, Loading
from cosim.port import Array
from cosim.processes import ForeignError, ForeignProcess

FREE_LIMIT = 5.0
"""s, for the end of an instance."""
Places = Mapping[str, VariablePlace]
"""Where a unit's quantities are, by name."""
Values = Mapping[str, Array | float]


@dataclass(frozen=True, eq=False)
class SavedState:
    """A state of a unit, kept inside it until this value is forgotten; and the time there."""

    owner: object = field(repr=False)
    time: float
    key: int | None
    """None of a unit that cannot keep states: good as long as it has not stepped since."""


class Command(NamedTuple):
    """A call of a unit's instance, and what is said where it fails."""

    method: str
    args: tuple[Any, ...]
    error: type[CosimError]
    what: str


class Unit:
    """An instance of a co-simulation FMU, initialised at time 0 with its own start values.

    It runs code of the archive, in a process of its own unless `loading` says otherwise: where that
    crashes, leaves or is over its time, the call raises InputError, and so do all later ones.

    Raises InputError for an FMU that cannot be opened (`archive.unpack_fmu`) or instantiated, and
    for one that another format of our own program wrote (`unit_format.check_if_ours`)."""

    def __init__(self, path: Path, loading: Loading = APART) -> None:
        room = temporary_folder("fmu")
        self.opened: UnpackedFmu = unpack_fmu(path, Path(room.name), loading.strict)
        try:
            is_ours = check_if_ours(self.opened.folder / "resources")
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        description = self.opened.description
        self.is_fmi2 = description.fmiVersion == "2.0"
        self._owner, self._keys, self._forgotten = object(), count(), list[int]()
        self.time = 0.0
        self._current: SavedState | None = None
        self._limit = loading.load_limit
        facts = LibraryFacts(
            Path(path).stem,
            str(self.opened.folder),
            description.guid or "",
            description.coSimulation.modelIdentifier,
            self.is_fmi2,
        )
        self._process: ForeignProcess | None = None
        self._instance: Instance | None = None
        if loading.in_process:
            self._instance = Instance(facts)
            weakref.finalize(self, _free_instance, self._instance, room)
        else:
            self._number = next(_NUMBERS)
            self._process = _process_of_our_units() if is_ours else ForeignProcess()
            weakref.finalize(self, _free_apart, self._process, self._number, is_ours, room)
            self._call_apart("begin", facts, "cannot be loaded")
        try:
            self._do(Command("load", (), InputError, "cannot be loaded"))
            self._do(Command("create", (), InputError, "cannot be instantiated"))
        except InputError:
            if self._process is not None:  # what a unit of ours has imported stays in its process
                self._process.kill()
            raise
        self._limit = loading.call_limit
        self._initialise()

    @property
    def is_alive(self) -> bool:
        """Whether it can be called: false once its process has ended."""
        return self._process is None or self._process.is_alive

    def set(self, place: VariablePlace, value: Array | float) -> None:
        """Inputs belong to a state, so that this makes another one of it."""
        if self.opened.rolls_back:
            self._current = None
        self._do(self._setting(place, value))

    def get(self, place: VariablePlace) -> Array:
        """The value at a place, in its shape. Raises ConvergenceError where it is not finite or not
        given."""
        return self._value(place, self._do(self._getting(place)))

    def step(self, dt: float) -> None:
        """Step the unit by `dt` s.  Raises ConvergenceError where it cannot make the step."""
        self._current = None
        self._do(self._stepping(self.time, dt))
        self.time += dt

    def step_from(
        self,
        saved: SavedState,
        place: Places,
        given: Values,
        dt: float,
        names: Iterable[str] = (),
        *,
        keep: bool = True,
    ) -> dict[str, Array]:
        """Step from a saved state under what is `given` of the quantities that the unit has; the
        values there of those of `names` that it has.  Without `keep` its state there is not saved
        at once, as by who does not ask for it.

        Raises InputError and ConvergenceError."""
        asked = [name for name in names if name in place]
        commands = [
            *self._restoring(saved),
            *(self._setting(place[name], v) for name, v in given.items() if name in place),
            self._stepping(saved.time, dt),
            *(self._getting(place[name]) for name in asked),
        ]
        key = next(self._keys) if keep and self.opened.rolls_back else None
        if key is not None:
            commands.append(self._saving(key))
        self._current, self.time = None, saved.time
        answers = self._do_all(commands, self._stepping(saved.time, dt).what)
        self.time += dt
        if key is not None:
            answers.pop()
            self._current = self._kept(key, self.time)
        values = answers[len(answers) - len(asked) :]
        return {n: self._value(place[n], v) for n, v in zip(asked, values, strict=True)}

    def values(
        self, place: Places, names: Iterable[str], at: SavedState | None = None
    ) -> dict[str, Array]:
        """The values of the quantities that the unit has, of a saved state or as it is now."""
        asked = [name for name in names if name in place]
        first = [] if at is None else self._restoring(at)
        commands = [*first, *(self._getting(place[name]) for name in asked)]
        answers = self._do_all(commands, "gave no value")[len(first) :]
        if at is not None:
            self.time, self._current = at.time, at
        return {n: self._value(place[n], v) for n, v in zip(asked, answers, strict=True)}

    def derivative(
        self, unknown: Sequence[VariablePlace], known: Sequence[VariablePlace], seed: Array
    ) -> Array:
        """Directional derivative of the unknowns' values, one after another."""
        refs = [[r for place in group for r in place.references] for group in (unknown, known)]
        size = [] if self.is_fmi2 else [sum(place.size for place in unknown)]
        by_unit, to_si = (
            np.concatenate([np.broadcast_to(place.factor, place.size) for place in group])
            for group in (known, unknown)
        )
        args = (*refs, (np.asarray(seed) / by_unit).tolist(), *size)
        what = "gave no directional derivative"
        answer = self._do(Command("getDirectionalDerivative", args, ConvergenceError, what))
        return np.asarray(to_si * np.array(answer))

    def save(self) -> SavedState:
        """The state as it is now."""
        if self._current is None:
            key = next(self._keys) if self.opened.rolls_back else None
            if key is not None:
                self._do(self._saving(key))
            self._current = self._kept(key, self.time)
        return self._current

    def restore(self, saved: SavedState) -> None:
        """Back to a saved state.  Raises InputError for a unit that keeps none and has stepped
        since."""
        if commands := self._restoring(saved):
            self._do_all(commands, commands[0].what)
        self.time, self._current = saved.time, saved

    def serialise(self, saved: SavedState) -> bytes:
        """A saved state as bytes, of a unit that serialises."""
        content: bytes = self._do(Command("serialise", (saved.key,), InputError, "wrote no state"))
        return content

    def read(self, content: bytes, time: float) -> SavedState:
        """The state that `serialise` made, at a time in s.  A unit may refuse it here or in the
        next step from it."""
        key = next(self._keys)
        self._do(Command("read", (key, content), InputError, "read no state"))
        return self._kept(key, time)

    def owns(self, saved: SavedState) -> bool:
        """Whether the state is of this instance."""
        return saved.owner is self._owner

    def _setting(self, place: VariablePlace, value: Array | float) -> Command:
        values = ((np.ravel(value) - place.offset) / place.factor).tolist()
        setter = "setReal" if self.is_fmi2 else "setFloat64"
        if place.switch:
            setter, values = "setBoolean", [bool(v) for v in values]
        return Command(setter, (place.references, values), InputError, "took no value")

    def _getting(self, place: VariablePlace) -> Command:
        what = "gave no value"
        if self.is_fmi2:
            return Command("getReal", (place.references,), ConvergenceError, what)
        return Command("getFloat64", (place.references, place.size), ConvergenceError, what)

    def _value(self, place: VariablePlace, answer: Sequence[float]) -> Array:
        values = np.array(answer)
        if not np.isfinite(values).all():
            raise ConvergenceError(f"{self.opened.path}: put out a value that is not finite")
        return (place.factor * values + place.offset).reshape(place.shape)

    def _stepping(self, time: float, dt: float) -> Command:
        args = (time, dt) if self.is_fmi2 else (time, dt, False)
        return Command(
            "doStep", args, ConvergenceError, f"could not step from {time:g} s by {dt:g} s"
        )

    def _restoring(self, saved: SavedState) -> list[Command]:
        """The way back to a saved state, if there is one to go."""
        if saved is self._current:
            return []
        if not self.owns(saved):
            raise InputError(f"{self.opened.path}: the state is of another unit")
        if saved.key is None:
            raise InputError(
                f"{self.opened.path}: a step had to be repeated from an earlier state, which this "
                "FMU cannot do (canGetAndSetFMUState is not true). The coupling schemes implicit "
                "and newton, step control and tangents by differences repeat steps; write "
                'coupling.scheme = "explicit"; "linear" also works if the FMU gives a tangent'
            )
        return [Command("restore", (saved.key,), ConvergenceError, "lost a state")]

    def _saving(self, key: int) -> Command:
        return Command("save", (key,), InputError, "did not save its state")

    def _kept(self, key: int | None, time: float) -> SavedState:
        """A state that the instance holds for as long as this value lives.

        It may be forgotten at any moment, even within a step, when a unit must not be called; so
        that is only noted, and the instance told with its next call."""
        saved = SavedState(self._owner, time, key)
        if key is not None:
            weakref.finalize(saved, self._forgotten.append, key)
        return saved

    def _initialise(self) -> None:
        start = [("setupExperiment", ())] if self.is_fmi2 else []
        calls = [*start, ("enterInitializationMode", ()), ("exitInitializationMode", ())]
        what = "cannot be initialised"
        self._do_all([Command(*call, InputError, what) for call in calls], what)

    def _do(self, command: Command) -> Any:
        """What a call of the unit returns.  Raises its error, and InputError where the unit's
        process has ended."""
        return self._do_all([command], command.what)[-1]

    def _do_all(self, commands: Sequence[Command], what: str) -> list[Any]:
        """What calls of the unit return, all sent at once; `what` is said where it has ended."""
        calls = [(command.method, command.args) for command in commands]
        old = [self._forgotten.pop() for _ in range(len(self._forgotten))]
        if old:
            calls.insert(0, ("forget", (old,)))
        if self._instance is not None:
            answers, reason = self._instance.do(calls)
        else:
            answers, reason = self._call_apart("do", calls, what)
        if reason:
            failed = commands[max(len(answers) - bool(old), 0)]
            raise failed.error(f"{self.opened.path}: {failed.what}: {reason}")
        return answers[1:] if old else answers

    def _call_apart(self, function: str, argument: Any, what: str) -> Any:
        """What a function of `instance` returns in the process of the instance."""
        assert self._process is not None
        where = f"cosim.fmu.instance:{function}"
        try:
            return self._process.call(where, self._number, argument, limit=self._limit)
        except ForeignError as error:
            raise InputError(f"{self.opened.path}: {what}: {error}") from error


def state_serialisers(units: Sequence[Unit]) -> Special:
    """How their saved states are written and read.  Raises InputError for a unit that cannot."""
    for unit in units:
        if not unit.opened.serialises:
            raise InputError(
                f"forward.checkpoint: {unit.opened.path}: this FMU cannot write its state "
                "(canSerializeFMUState is not true); leave forward.checkpoint out"
            )

    def of(saved: SavedState) -> Unit:
        return next(unit for unit in units if unit.owns(saved))

    def write(saved: SavedState) -> Arrays:
        content = np.frombuffer(of(saved).serialise(saved), dtype=np.uint8)
        return {"time": np.array(saved.time), "content": content}

    def read(template: SavedState, arrays: Arrays) -> SavedState:
        return of(template).read(arrays["content"].tobytes(), float(arrays["time"]))

    return {SavedState: (write, read)}


def _free_instance(instance: Instance, room: tempfile.TemporaryDirectory[str]) -> None:
    """An instance is freed before its files go."""
    instance.free()
    room.cleanup()


def _free_apart(
    process: ForeignProcess,
    number: int,
    is_shared: bool,
    room: tempfile.TemporaryDirectory[str],
) -> None:
    """The same of an instance in a process of its own, however that takes it."""
    if process.is_alive:
        with suppress(ForeignError):
            process.call("cosim.fmu.instance:free", number, limit=FREE_LIMIT)
    if not is_shared:
        process.end()
    room.cleanup()


_NUMBERS = count()
"""The numbers of instances in processes of their own."""
_SHARED: list[ForeignProcess] = []
"""The last process of the units that this program wrote."""


def _process_of_our_units() -> ForeignProcess:
    """The process that the units of our own program share, since each imports the program."""
    if not (_SHARED and _SHARED[0].is_alive):
        _SHARED[:] = [ForeignProcess()]
        atexit.register(_SHARED[0].kill)
    return _SHARED[0]
