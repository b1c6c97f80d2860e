"""The page of repairs beside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cosim.analyses.repairs import MEASURES, Compared, RepairTable, table_of_repairs
from cosim.report.figures import style_axes
from cosim.report.templates import html_page
from cosim.results.compare import number
from cosim.results.picture import new_picture, picture_address

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 130
INTACT, INJURED, REPAIR = "#3d474e", "#c2410c", "#00446b"
SHOWN = ("pip_lag", "dip_droop", "tip_force")


def repairs_page(found: RepairTable) -> str:
    """Return the page: the answer, a picture, the table and what did not work out."""
    return html_page(
        "repairs.html.j2",
        title=found.title,
        answer=repair_sentences(found),
        picture=picture_address(repairs_picture(found), DPI),
        table=table_of_repairs(found),
        measure=MEASURES[found.rank],
        conditions=found.conditions,
        failures=[f"{row.title}: {row.failure}" for row in found.repairs if row.failure],
    )


def repair_sentences(found: RepairTable) -> list[str]:
    """Return what the table says, in words: what the injury changes, and which repair comes nearest
    to the intact finger."""
    m, measured = MEASURES[found.rank], found.rank
    gap = found.injured.off(measured, found.intact)
    out = [f"The injury changes the {m.words.partition(',')[0]} by {_size(gap, m.unit)}."]
    best = found.repairs[0]
    left = best.off(measured, found.intact)
    if not np.isfinite(left):
        return [*out, "No repair has an answer in every condition."]
    out.append(f"Nearest to the intact finger: {best.title}, {_size(left, m.unit)} off.")
    close = [
        row.title
        for row in found.repairs[1:]
        if row.off(measured, found.intact) - left <= _spread(found)
    ]
    if found.conditions and close:
        out.append(
            f"Over the conditions the injury itself varies by {_size(_spread(found), m.unit)}: "
            f"within that {' and '.join(close)} cannot be told from it."
        )
    if gap > 0 and left > gap:
        out.append("It is farther off than the injury is: by this number no repair helps.")
    return out


def _spread(found: RepairTable) -> float:
    """How much the injury's change differs over the conditions."""
    return float(np.ptp(found.injured.values[found.rank] - found.intact.values[found.rank]))


def _size(value: float, unit: str) -> str:
    return f"{number(value, 2)} {unit}"


def repairs_picture(found: RepairTable) -> Figure:
    """Return the picture: a row for each finger with its number, or its range over the conditions,
    and the intact finger's as a band."""
    rows = found.rows
    shown = [
        key
        for key in dict.fromkeys((found.rank, *SHOWN))
        if np.isfinite(found.intact.values[key]).all()
    ]
    picture = new_picture(3.0 + 2.4 * len(shown), 1.1 + 0.36 * len(rows))
    panels = picture.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, key in zip(panels, shown, strict=True):
        m = MEASURES[key]
        style_axes(axes, "\n".join([*m.words.split(", "), m.unit]), "")
        intact = found.intact.values[key]
        axes.axvspan(intact.min(), intact.max(), color="0.88", zorder=0)
        axes.axvline(intact.mean(), color=INTACT, lw=1.0, zorder=1)
        for i, row in enumerate(rows):
            _draw_row(axes, i, row, key)
    panels[0].set(yticks=range(len(rows)), yticklabels=[row.title for row in rows])
    panels[0].invert_yaxis()
    return picture


def _draw_row(axes: Axes, i: int, row: Compared, key: str) -> None:
    values = row.values[key][np.isfinite(row.values[key])]
    if not len(values):
        return
    ink = INTACT if i == 0 else INJURED if i == 1 else REPAIR
    axes.plot([values.min(), values.max()], [i, i], color=ink, lw=2.5, alpha=0.5)
    axes.plot(values.mean(), i, "o", color=ink, ms=6)
