"""A loaded FMU: values set and got by place, steps, and states that can be restored."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cosim.coupling.state_arrays import Arrays, Special
from cosim.errors import ConvergenceError, InputError
from cosim.fmu.archive import UnpackedFmu, unpack_fmu
from cosim.fmu.mapping import VariablePlace
from cosim.fmu.unit_format import check_if_ours
from cosim.port import Array

MOST_LOGGED = 5
T = TypeVar("T")
Places = Mapping[str, VariablePlace]
"""Where a unit's quantities are, by name."""
Values = Mapping[str, Array | float]


@dataclass(frozen=True, eq=False)
class SavedState:
    """A state of a unit, kept inside it until this value is forgotten; and the time there."""

    owner: object = field(repr=False)
    time: float
    pointer: Any
    """None of a unit that cannot keep states: good as long as it has not stepped since."""


class Unit:
    """An instance of a co-simulation FMU, initialised at time 0 with its own start values.

    It runs code of the archive in this process.  Raises InputError for an FMU that cannot be opened
    (`archive.unpack_fmu`) or instantiated, and for one that another format of our own program wrote
    (`unit_format.check_if_ours`)."""

    def __init__(self, path: Path) -> None:
        room = tempfile.TemporaryDirectory(prefix="fmu_", ignore_cleanup_errors=True)
        self.opened: UnpackedFmu = unpack_fmu(path, Path(room.name))
        try:
            check_if_ours(self.opened.folder / "resources")
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        description = self.opened.description
        self.is_fmi2 = description.fmiVersion == "2.0"
        self._log: list[str] = FMI2_LOG if self.is_fmi2 else []
        self._fmu = self._instance(description)
        self._owner, self._keys, self._forgotten = object(), count(), list[int]()
        self._pointers: dict[int, Any] = {}
        weakref.finalize(self, _free_instance, self._fmu, self._pointers, room)
        self.time = 0.0
        self._current: SavedState | None = None
        self._call(self._initialise, InputError, "cannot be initialised")

    def set(self, place: VariablePlace, value: Array | float) -> None:
        """Inputs belong to a state, so that this makes another one of it."""
        if self.opened.rolls_back:
            self._current = None
        values = ((np.ravel(value) - place.offset) / place.factor).tolist()
        if place.switch:
            setter = self._fmu.setBoolean
            values = [bool(v) for v in values]
        else:
            setter = self._fmu.setReal if self.is_fmi2 else self._fmu.setFloat64
        self._call(lambda: setter(place.references, values), InputError, "took no value")

    def get(self, place: VariablePlace) -> Array:
        """The value at a place, in its shape. Raises ConvergenceError where it is not finite or not
        given."""
        values = np.array(self._call(lambda: self._read(place), ConvergenceError, "gave no value"))
        if not np.isfinite(values).all():
            raise ConvergenceError(f"{self.opened.path}: put out a value that is not finite")
        return (place.factor * values + place.offset).reshape(place.shape)

    def step(self, dt: float) -> None:
        """Step the unit by `dt` s.  Raises ConvergenceError where it cannot make the step."""
        self._current = None
        self._call(
            lambda: self._fmu.doStep(self.time, dt, *([] if self.is_fmi2 else [False])),
            ConvergenceError,
            f"could not step from {self.time:g} s by {dt:g} s",
        )
        self.time += dt

    def step_from(self, saved: SavedState, place: Places, given: Values, dt: float) -> None:
        """Step from a saved state under what is `given` of the quantities that the unit has.

        Raises InputError and ConvergenceError."""
        self.restore(saved)
        for name, value in given.items():
            if name in place:
                self.set(place[name], value)
        self.step(dt)

    def values(self, place: Places, names: Iterable[str]) -> dict[str, Array]:
        """The values of the quantities that the unit has."""
        return {name: self.get(place[name]) for name in names if name in place}

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
        seeds = (np.asarray(seed) / by_unit).tolist()
        answer = self._call(
            lambda: self._fmu.getDirectionalDerivative(*refs, seeds, *size),
            ConvergenceError,
            "gave no directional derivative",
        )
        return np.asarray(to_si * np.array(answer))

    def save(self) -> SavedState:
        """The state as it is now."""
        if self._current is None:
            pointer = None
            if self.opened.rolls_back:
                pointer = self._call(self._fmu.getFMUState, InputError, "did not save its state")
            self._current = SavedState(self._owner, self.time, pointer)
            self._keep(self._current)
        return self._current

    def restore(self, saved: SavedState) -> None:
        """Back to a saved state.  Raises InputError for a unit that keeps none and has stepped
        since."""
        if saved is self._current:
            return
        if saved.owner is not self._owner:
            raise InputError(f"{self.opened.path}: the state is of another unit")
        if saved.pointer is None:
            raise InputError(
                f"{self.opened.path}: a step had to be repeated from an earlier state, which this "
                "FMU cannot do (canGetAndSetFMUState is not true). The coupling schemes implicit "
                "and newton, step control and tangents by differences repeat steps; write "
                'coupling.scheme = "explicit"; "linear" also works if the FMU gives a tangent'
            )
        self._call(lambda: self._fmu.setFMUState(saved.pointer), ConvergenceError, "lost a state")
        self.time, self._current = saved.time, saved

    def serialise(self, saved: SavedState) -> bytes:
        """A saved state as bytes, of a unit that serialises."""
        write = self._fmu.serializeFMUState
        content: bytes = self._call(lambda: write(saved.pointer), InputError, "wrote no state")
        return content

    def read(self, content: bytes, time: float) -> SavedState:
        """The state that `serialise` made, at a time in s.  A unit may refuse it here or in the
        next step from it."""
        read = self._fmu.deserializeFMUState
        saved = SavedState(
            self._owner, time, self._call(lambda: read(content), InputError, "read no state")
        )
        self._keep(saved)
        return saved

    def owns(self, saved: SavedState) -> bool:
        """Whether the state is of this instance."""
        return saved.owner is self._owner

    def _keep(self, saved: SavedState) -> None:
        """Hold a state for as long as `saved` lives; let go of those whose time is over.

        A value may be forgotten at any moment, even within a step, when a unit must not be called;
        so that is only noted, and the unit told here."""
        while self._forgotten:
            self._fmu.freeFMUState(self._pointers.pop(self._forgotten.pop()))
        if saved.pointer is not None:
            key = next(self._keys)
            self._pointers[key] = saved.pointer
            weakref.finalize(saved, self._forgotten.append, key)

    def _read(self, place: VariablePlace) -> list[float]:
        if self.is_fmi2:
            out: list[float] = self._fmu.getReal(place.references)
        else:
            out = self._fmu.getFloat64(place.references, place.size)
        return out

    def _instance(self, description: Any) -> Any:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        load = partial(
            FMU2Slave if self.is_fmi2 else FMU3Slave,
            instanceName=Path(self.opened.path).stem,
            guid=description.guid,
            modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=str(self.opened.folder),
        )
        with chdir("."):  # FMPy changes the folder and stays there where a library does not load
            slave = self._call(load, InputError, "cannot be loaded")
        log = self._log
        logger = {"callbacks": _listening()} if self.is_fmi2 else {"logMessage": _logger(log)}
        instantiate = partial(slave.instantiate, loggingOn=True, **logger)
        self._call(instantiate, InputError, "cannot be instantiated")
        return slave

    def _initialise(self) -> None:
        if self.is_fmi2:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def _call(self, call: Callable[[], T], error: type[Exception], what: str) -> T:
        """What a call of the unit returns.  Raises `error` with `what` and what the unit logged."""
        if self.is_fmi2:
            _listening()
        self._log.clear()
        try:
            return call()
        except Exception as failure:  # FMPy raises Exception itself
            logged = "; ".join(self._log[-MOST_LOGGED:])
            reason = logged or str(failure)
            raise error(f"{self.opened.path}: {what}: {reason}") from failure


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


def _logger(log: list[str]) -> Callable[..., None]:
    def write_line(*facts: Any) -> None:
        log.append(" ".join(facts[-1].decode("utf-8", "replace").split()))

    return write_line


FMI2_LOG: list[str] = []
"""What units of FMI 2 log: FMPy's proxy, which puts their messages together, has one listener for
all of a process, whichever was named last."""


@cache
def _listener() -> Any:
    """The listener that fills FMI2_LOG; it outlives every unit, since a proxy that calls one that
    is gone brings the process down."""
    from fmpy import fmi2

    return fmi2.fmi2CallbackLoggerTYPE(_logger(FMI2_LOG))


def _listening() -> Any:
    """FMI 2's table of callbacks, once the proxy calls our listener."""
    from ctypes import byref

    from fmpy import calloc, fmi2, free
    from fmpy.logging import addLoggerProxy

    table = fmi2.fmi2CallbackFunctions()
    table.logger = _listener()
    table.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    table.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    addLoggerProxy(byref(table))
    return table


def _free_instance(
    fmu: Any, pointers: dict[int, Any], room: tempfile.TemporaryDirectory[str]
) -> None:
    """States are freed before their instance, and that before its files go."""
    for pointer in pointers.values():
        fmu.freeFMUState(pointer)
    fmu.freeInstance()
    room.cleanup()
