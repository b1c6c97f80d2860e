"""A written FMU at work inside a simulator, whatever the standard's version: its values, its state,
and the border that no exception crosses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.coupling.state_arrays import Special
from cosim.errors import CosimError, InputError
from cosim.fmu.quantity import Quantity, Values
from cosim.fmu.unit_format import read_about
from cosim.fmu_export.motion_parts import moving_part
from cosim.fmu_export.part import UnitPart
from cosim.fmu_export.state import SerialisedState, Snapshot
from cosim.fmu_export.static_parts import CoupledPart, FingerPart, HoodPart
from cosim.models.build import Models, build
from cosim.port import Array, State
from cosim.processes import one_blas_thread

CASE = "case.toml"
"""The resolved case, a file of the unit's resources."""
PARTS = ("hood", "finger", "coupled")
AT_REST_STEP, AT_REST_STOP = 0.02, 1.0
"""s, that a unit of a case at rest states for a simulator that asks: in it no time passes."""


def part_of(case: Case, part: str, tangent: bool = True) -> UnitPart:
    """The hood, the finger or both of a case, at rest or, of one with a table [forward], in motion;
    the hood and the finger without the tangent of the hood's load where none is wanted.

    Raises InputError."""
    if part not in PARTS:
        raise InputError(f"part {part!r}: write {', '.join(PARTS[:-1])} or {PARTS[-1]}")
    if case.forward is not None and part != "hood":
        return moving_part(case, case.forward, part, tangent)
    makers: Mapping[str, Callable[[Case, Models], UnitPart]] = {
        "hood": partial(HoodPart, tangent=tangent),
        "finger": partial(FingerPart, tangent=tangent),
        "coupled": CoupledPart,
    }
    return makers[part](case, build(case))


def fault_of(call: Callable[[], None]) -> str:
    """What went wrong in a call from the simulator; empty where nothing did.

    An exception that crosses this border ends the simulator's process, so all are told: a panic of
    a compiled library is a BaseException and no Exception.  The user's own Ctrl-C passes."""
    try:
        call()
    except KeyboardInterrupt:
        raise
    except CosimError as error:
        return str(error)
    except BaseException as error:
        return f"a fault of the program, {type(error).__name__}: {error}"
    return ""


class UnitRun:
    """The values of all quantities, one after another in one array, and the part that steps them.

    `resources` is the unit's folder of that name.  Raises InputError."""

    @one_blas_thread()
    def __init__(self, resources: Path) -> None:
        about = read_about(resources)
        self.name = f"cosim_{about['part']}"
        case = load_case(resources / CASE)
        self.description = f"{about['part']}: {case.title}"
        text = (resources / CASE).read_text(encoding="utf-8")
        self.token = str(uuid5(NAMESPACE_URL, f"{about} {text}"))
        """What FMI calls GUID or instantiation token: the same for the same unit."""
        forward = case.forward
        self.step_size = AT_REST_STEP if forward is None else forward.step
        self.stop_time = AT_REST_STOP if forward is None else forward.duration
        self.part: UnitPart = part_of(case, about["part"], about["tangent"])
        self.quantities = self.part.quantities
        ends = list(accumulate((q.zero().size for q in self.quantities), initial=0))
        self.place = {q.name: slice(*ends[i : i + 2]) for i, q in enumerate(self.quantities)}
        self._signs = {q.name: q.signs(case.finger.side()) for q in self.quantities}
        """Between the frame of the case's hand, in which the unit speaks, and the program's."""
        begin = [np.ravel(self._signs[q.name] * self.part.begin[q.name]) for q in self.quantities]
        self._values = np.concatenate(begin)
        outputs = [np.full(q.zero().size, q.causality == "output") for q in self.quantities]
        self._is_output = np.concatenate(outputs)
        self._state, self._fault, self.time = self.part.start(), "", 0.0
        self._initialising, self._evaluated = False, False
        self._special = _special(self.part)

    @property
    def serialises(self) -> bool:
        """Whether its states can be written as bytes."""
        return self._special is not None

    def get(self, entries: Sequence[int] | slice) -> list[float]:
        """Values at places of the array; all NaN where one is none, after which no step succeeds
        until a state is restored.

        In initialization mode outputs follow from the inputs that are set; they are NaN where these
        have no answer, which `exit_initialization` then tells."""
        out: list[float] = []

        def read() -> None:
            nonlocal out
            asked = self._initialising and self._is_output[entries].any()
            failed = asked and bool(fault_of(self._evaluate))
            out = np.where(self._is_output & failed, np.nan, self._values)[entries].tolist()

        fault = fault_of(read)
        if fault:
            return self.refuse(f"a value was asked for that does not exist ({fault})")
        return out

    def set(self, entries: Sequence[int] | slice, values: Sequence[float]) -> None:
        """Set values at places of the array; where that cannot be, no step succeeds afterwards."""
        changed = self._values.copy()

        def write() -> None:
            changed[entries] = values

        fault = fault_of(write)
        if fault:
            self.refuse(f"a value was set that does not exist ({fault})")
        self._values, self._evaluated = changed, False

    def refuse(self, fault: str) -> list[float]:
        """Make every step fail for this reason; NaN, more than any caller can want."""
        self._fault = fault
        return [np.nan] * len(self._values)

    def step(self, time: float, dt: float) -> str:
        """A step of `dt` s from `time` s, which is only told again; empty, or what went wrong, in
        which case nothing has changed."""
        fault = self._fault or fault_of(lambda: self._step(dt))
        if not fault:
            self.time = time + dt
        return fault

    def enter_initialization(self) -> None:
        """From now on outputs follow from the inputs without a step."""
        self._initialising = True

    def exit_initialization(self) -> str:
        """Make the outputs those of the inputs; empty, or why there are none."""
        fault = self._fault or fault_of(self._evaluate)
        self._initialising = False
        return fault

    def snapshot(self) -> Snapshot:
        """All that the next step reads and writes."""
        return Snapshot(self.token, self.time, self._values, self._state, self._special)

    def restore(self, snapshot: Any) -> None:
        """A state of this or another instance, in memory or as bytes; anything else makes the next
        steps fail."""

        def take() -> None:
            taken = self._read_snapshot(snapshot)
            self._values, self._state, self._fault = taken.values, taken.state, ""
            self.time, self._evaluated = taken.time, False

        fault = fault_of(take)
        if fault:
            self.refuse(f"a state was set that is none of this unit's: {fault}")

    def _read_snapshot(self, snapshot: Any) -> Snapshot:
        if isinstance(snapshot, SerialisedState):
            snapshot = snapshot.read(self.token, self.part.template, self._special)
        if not isinstance(snapshot, Snapshot) or snapshot.values.shape != self._values.shape:
            raise InputError("it was not given out by this unit")
        return snapshot

    @one_blas_thread()
    def _step(self, dt: float) -> None:
        self._show(*self.part.step(self._state, self._given(), dt))

    @one_blas_thread()
    def _evaluate(self) -> None:
        """Outputs at the start of the inputs as they are now."""
        if not self._evaluated:
            self._show(*self.part.initial(self._given()))
            self._evaluated = True

    def _given(self) -> Values:
        """Inputs and parameters by name.  Raises InputError for one that is not finite."""
        given = {q.name: self._value(q) for q in self.quantities if q.causality != "output"}
        missing = [name for name, value in given.items() if not np.isfinite(value).all()]
        if missing:
            raise InputError(f"{', '.join(missing)}: holds a value that is not finite")
        return given

    def _show(self, state: State, outputs: Values) -> None:
        values = self._values.copy()
        for name, value in outputs.items():
            values[self.place[name]] = np.ravel(self._signs[name]) * np.ravel(value)
        self._values, self._state = values, state

    def _value(self, quantity: Quantity) -> Array:
        values = self._values[self.place[quantity.name]].reshape(quantity.shape)
        return self._signs[quantity.name] * values


def _special(part: UnitPart) -> Special | None:
    """How the part's states are written; None where they cannot be."""
    try:
        return part.special()
    except InputError:
        return None
