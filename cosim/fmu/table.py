"""What a case says of any FMU: where it is, and how it is loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cosim.port import Hand
from cosim.schema import units
from cosim.schema.fields import quantity
from cosim.schema.types import ArchiveFile, Switch, Table

LOAD_LIMIT, CALL_LIMIT = 20.0, 120.0
"""s, where nothing else is said."""


@dataclass(frozen=True)
class Loading:
    """How an FMU is loaded."""

    strict: bool = False
    """Whether small faults of its description are refused."""
    in_process: bool = False
    """Whether its library is loaded into this process."""
    time_limit: float | None = None
    """s, for loading it and for any call of it; None: LOAD_LIMIT and CALL_LIMIT.  Calls in this
    process have none."""

    @property
    def load_limit(self) -> float:
        """s, for loading its library and making its instance."""
        return self.time_limit or LOAD_LIMIT

    @property
    def call_limit(self) -> float:
        """s, for any other call."""
        return self.time_limit or CALL_LIMIT


APART = Loading()
"""In a process of its own."""


class FmuTable(Table):
    """The keys of an FMU, in the table of a hood or of a finger."""

    path: ArchiveFile
    """The FMU; it runs code."""
    assume_si: Switch = False
    """Take variables without a stated unit as SI units."""
    hand: Hand = "right"
    """In whose frame it speaks: that of a left hand has y ulnar."""
    strict: Switch = False
    """Refuse an FMU whose description breaks the standard; otherwise what can be read is read, with
    a warning."""
    time_limit: Annotated[float, quantity(units.TIME, above="0 s", most="1e6 s")] | None = None
    """Longest time for loading the FMU and for each of its steps; without it 20 s and 120 s."""
    in_process: Switch = False
    """Load the FMU's library into the program itself: a step is faster, and a fault of the library
    ends the program."""

    def files(self) -> tuple[Path, ...]:
        """The file that the FMU is."""
        return (self.path,)

    def speech(self) -> dict[str, Any]:
        """How the FMU is loaded and what it says is read, as its loader's keywords."""
        return {"assume_si": self.assume_si, "loading": self.loading(), "hand": self.hand}

    def loading(self) -> Loading:
        """How the FMU is loaded."""
        return Loading(self.strict, self.in_process, self.time_limit)
