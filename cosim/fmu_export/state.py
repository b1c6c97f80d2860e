"""States of a written FMU: kept in memory, or as bytes from which another process can continue."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO

import numpy as np

from cosim.coupling.state_arrays import Arrays, Special, flatten, rebuild
from cosim.errors import InputError
from cosim.port import Array, State

UNIT, TIME, VALUES = "unit", "time", "values"
UNREADABLE = (OSError, ValueError, TypeError, EOFError, KeyError, IndexError, zipfile.BadZipFile)
"""What reading bytes raises that are no state, or another's."""


@dataclass(frozen=True)
class Snapshot:
    """All that a step reads and writes; neither array nor state is ever changed in place."""

    token: str
    """The key of the unit whose state it is."""
    time: float
    """s, as FMI 3 tells it."""
    values: Array
    state: State
    special: Special | None
    """How the state is written; None where it cannot be."""

    def to_bytes(self) -> bytes:
        """The same bytes for the same state; none of a unit that says that it writes none."""
        if self.special is None:
            return b""
        arrays = flatten(self.state, self.special)
        arrays |= {UNIT: np.array(self.token), TIME: np.array(self.time), VALUES: self.values}
        file = BytesIO()
        np.savez(file, **arrays)
        return file.getvalue()


@dataclass(frozen=True)
class SerialisedState:
    """A state as bytes, which say nothing of what to build; read by the unit that takes it up."""

    content: bytes

    def to_bytes(self) -> bytes:
        """The bytes as they were given."""
        return self.content

    def read(self, token: str, template: Callable[[], State], special: Special | None) -> Snapshot:
        """The snapshot, of the same unit (`token`), whose states are like `template`'s.

        Raises InputError."""
        if special is None:
            raise InputError("this unit's states cannot be serialised")
        try:
            with np.load(BytesIO(self.content), allow_pickle=False) as file:
                arrays: Arrays = {name: file[name] for name in file.files}
            theirs, time, values = (arrays.pop(name) for name in (UNIT, TIME, VALUES))
            if str(theirs) != token:
                raise InputError("the state was written by another unit, or another version of it")
            state = rebuild(template(), arrays, special)
            return Snapshot(token, float(time), np.array(values, dtype=float), state, special)
        except UNREADABLE as error:
            raise InputError(f"the bytes are no whole state of this unit ({error})") from error
