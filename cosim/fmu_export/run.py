"""A written FMU at work inside a simulator, whatever the standard's version: its values, its state,
and the border that no exception crosses."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from cosim.case.file import load_case
from cosim.coupling.state_arrays import Special
from cosim.errors import CosimError, InputError
from cosim.fmu.quantity import WITH_TANGENT, Quantity
from cosim.fmu_export.part import UnitPart
from cosim.fmu_export.part_of import part_of
from cosim.fmu_export.state import SerialisedState, Snapshot
from cosim.port import Array
from cosim.processes import one_blas_thread
from cosim.version import __version__

CASE, ABOUT = "case.toml", "about.json"
"""Files of a unit: the resolved case, and which part of it the unit is."""


class UnitRun:
    """The values of all quantities, one after another in one array, and the part that steps them.

    `resources` is the unit's folder of that name.  Raises InputError."""

    @one_blas_thread()
    def __init__(self, resources: Path) -> None:
        about = _about(resources / ABOUT)
        self.name = f"cosim_{about['part']}"
        case = load_case(resources / CASE)
        self.description = f"{about['part']}: {case.title}"
        text = (resources / CASE).read_text(encoding="utf-8")
        self.token = str(uuid5(NAMESPACE_URL, f"{about} {text}"))
        """What FMI calls GUID or instantiation token: the same for the same unit."""
        self.part: UnitPart = part_of(case, about["part"], about["tangent"])
        self.quantities = self.part.quantities
        ends = list(accumulate((q.zero().size for q in self.quantities), initial=0))
        self.place = {q.name: slice(*ends[i : i + 2]) for i, q in enumerate(self.quantities)}
        self._values = np.concatenate([np.ravel(self.part.begin[q.name]) for q in self.quantities])
        self._state, self._fault, self.time = self.part.start(), "", 0.0
        self._special = _special(self.part)

    @property
    def serialises(self) -> bool:
        """Whether its states can be written as bytes."""
        return self._special is not None

    def get(self, entries: Sequence[int] | slice) -> list[float]:
        """Values at places of the array; all NaN where one is none, after which no step succeeds
        until a state is restored."""
        try:
            out: list[float] = self._values[entries].tolist()
        except IndexError as error:
            return self.refuse(f"a value was asked for that does not exist ({error})")
        return out

    def set(self, entries: Sequence[int] | slice, values: Sequence[float]) -> None:
        """Set values at places of the array; where that cannot be, no step succeeds afterwards."""
        changed = self._values.copy()
        try:
            changed[entries] = values
        except (IndexError, ValueError) as error:
            self.refuse(f"a value was set that does not exist ({error})")
        self._values = changed

    def refuse(self, fault: str) -> list[float]:
        """Make every step fail for this reason; NaN, more than any caller can want."""
        self._fault = fault
        return [np.nan] * len(self._values)

    def step(self, time: float, dt: float) -> str:
        """A step of `dt` s from `time` s, which is only told again; empty, or what went wrong, in
        which case nothing has changed."""
        if self._fault:
            return self._fault
        try:
            self._step(dt)
        except CosimError as error:
            return str(error)
        except Exception as error:  # what crosses this border ends the simulator's process
            return f"a fault of the program, {type(error).__name__}: {error}"
        self.time = time + dt
        return ""

    def snapshot(self) -> Snapshot:
        """All that the next step reads and writes."""
        return Snapshot(self.token, self.time, self._values, self._state, self._special)

    def restore(self, snapshot: Any) -> None:
        """A state of this or another instance, in memory or as bytes; anything else makes the next
        steps fail."""
        try:
            taken = self._take_step(snapshot)
        except CosimError as error:
            self.refuse(f"a state was set that is none of this unit's: {error}")
            return
        except Exception as error:  # as in a step
            self.refuse(f"a state was set, and a fault of the program, {error!r}, kept it out")
            return
        self._values, self._state, self._fault = taken.values, taken.state, ""
        self.time = taken.time

    def _take_step(self, snapshot: Any) -> Snapshot:
        if isinstance(snapshot, SerialisedState):
            snapshot = snapshot.read(self.token, self.part.template, self._special)
        if not isinstance(snapshot, Snapshot) or snapshot.values.shape != self._values.shape:
            raise InputError("it is nothing that this unit has given out")
        return snapshot

    @one_blas_thread()
    def _step(self, dt: float) -> None:
        given = {q.name: self._value(q) for q in self.quantities if q.causality != "output"}
        missing = [name for name, value in given.items() if not np.isfinite(value).all()]
        if missing:
            raise InputError(f"{', '.join(missing)}: holds a value that is not finite")
        state, outputs = self.part.step(self._state, given, dt)
        shown: dict[str, Array] = dict(outputs)
        if given.get(WITH_TANGENT.name):
            shown |= self.part.tangent(state)
        values = self._values.copy()
        for name, value in shown.items():
            values[self.place[name]] = np.ravel(value)
        self._values, self._state = values, state

    def _value(self, quantity: Quantity) -> Array:
        return self._values[self.place[quantity.name]].reshape(quantity.shape)


def _special(part: UnitPart) -> Special | None:
    """How the part's states are written; None where they cannot be."""
    try:
        return part.special()
    except InputError:
        return None


def _about(path: Path) -> Mapping[str, Any]:
    """Which part, with its tangent or not, by which version.  Raises InputError."""
    about: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    if about["version"] != __version__:
        raise InputError(
            f"this FMU was written by cosim-hand {about['version']}, and this Python has "
            f"{__version__}; install cosim-hand=={about['version']}, or write the FMU anew"
        )
    return about
