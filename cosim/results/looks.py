"""The looks of what is drawn: lines and bars of a plot, the colour maps of a hood, the colours of
bones, tendons, fibres and forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.port import Array

COLOURS = (
    *("#332288", "#cc6677", "#117733", "#aa4499", "#44aa99"),
    *("#882255", "#999933", "#000000", "#88ccee", "#ddcc77"),
)
"""Paul Tol's "muted" scheme and black, which colour-blind readers tell apart; the darkest first."""


BONE, TENDON, RESTING_TENDON = "#ede3cc", "#1f6b57", "#8fb0a6"
"""Colours of bones, and of tendons that pull and do not."""
PLAIN_HOOD, FORCE = "#8caecb", "#000000"
"""Colours of a hood without a field, and of the fingertip's force."""
INKS = ("#000000", "#8800ff", "#553344")
"""Colours of the fibre families.  For every kind of colour vision they differ from each other, from
the bones and from both colour maps."""
COVERED = 95.0
"""Per cent of the values that a colour scale covers: a few extreme cells do not set it."""


def colour_map(is_signed: bool) -> tuple[str, ...]:
    """Return the 256 colours (hex, from the least value to the greatest) of a field's scale.

    A signed field gets a diverging map from blue over grey to red (Moreland 2009), whose grey
    middle is seen on white paper; any other viridis without its darkest fifth, on which the black
    strokes of fibres would not be seen.  Both are safe for colour-blind readers."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    name, first = ("coolwarm", 0.0) if is_signed else ("viridis", 0.2)
    return tuple(to_hex(colour) for colour in colormaps[name](np.linspace(first, 1.0, 256)))


def colour_limits(values: Array, is_signed: bool) -> tuple[float, float]:
    """Return the ends of the scale for a field's values of any shape, all frames and runs together:
    symmetric about zero for a signed field."""
    values = np.ravel(values)
    if is_signed:
        most = float(np.percentile(np.abs(values), COVERED)) or 1.0
        return -most, most
    beyond = (100 - COVERED) / 2
    low, high = (float(v) for v in np.percentile(values, (beyond, 100 - beyond)))
    return (low, high) if high > low else (low - 0.5, low + 0.5)


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
