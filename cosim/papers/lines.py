"""Line charts of the papers' figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cosim.port import Array
from cosim.report.figures import style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

MUSCLE_COLOURS = ("#0b5394", "#b45309", "#2e7d4f", "#8e3b8a", "0.45")
"""Colours of ED, FDP, FDS, the interossei and the lumbrical, in every figure."""
BAND_COLOURS = ("#0f7c8a", "#c2410c")
"""Colours of the middle and the lateral band."""
HEADROOM = 0.06


@dataclass(frozen=True)
class PlotLine:
    """A curve with its name; `dash` and `width` as matplotlib has them."""

    name: str
    x: Array
    y: Array
    colour: str
    dash: str = "-"
    width: float = 1.8


def line_chart(lines: Sequence[PlotLine], x: str, y: str) -> Callable[[Sheet], None]:
    """What draws the lines on a sheet, with their legend beside."""

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        for line in lines:
            axes.plot(line.x, line.y, line.dash, color=line.colour, lw=line.width, label=line.name)
        style_axes(axes, x, y)
        low, high = axes.dataLim.y0, axes.dataLim.y1
        room = HEADROOM * (high - low or 1.0)
        axes.set_ylim(low - room if low < 0 else min(0.0, low), high + room)
        if len(lines) > 1:
            sheet.legend(loc="outside lower center", ncols=min(3, len(lines)), frameon=False)

    return draw
