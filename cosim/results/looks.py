"""How lines and bars of a plot differ: by colour, then by dashes or hatches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

COLOURS = (
    *("#332288", "#cc6677", "#117733", "#aa4499", "#44aa99"),
    *("#882255", "#999933", "#000000", "#88ccee", "#ddcc77"),
)
"""Paul Tol's "muted" scheme and black, which colour-blind readers tell apart; the darkest first."""


@dataclass(frozen=True)
class Look:
    """A colour, the strokes and gaps of a line in line widths (none: it is full), and the hatch of
    a bar."""

    colour: str
    dashes: tuple[float, ...]
    hatch: str

    @property
    def line(self) -> dict[str, Any]:
        """Keywords of a line for matplotlib."""
        return {"color": self.colour, "ls": (0, self.dashes) if self.dashes else "-"}

    @property
    def bar(self) -> dict[str, Any]:
        """Keywords of a bar for matplotlib."""
        return {"color": self.colour, "hatch": self.hatch, "edgecolor": "white", "lw": 0}


def look(i: int, colours: Sequence[str] = COLOURS) -> Look:
    """The look of the i-th thing of a plot; no two are the same.

    When the colours are used up they come again with dashes, then with a dot more after each dash
    at every turn."""
    turn, place = divmod(i, len(colours))
    if turn == 0:
        return Look(colours[place], (), "")
    dots = turn - 1
    return Look(colours[place], (4.0, 1.5) + (1.0, 1.5) * dots, "//" + "." * dots)
