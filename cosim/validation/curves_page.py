"""The board of curves as a page that needs nothing else: every curve, and how rough it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import output_file
from cosim.report.figures import new_picture, style_axes
from cosim.report.templates import template
from cosim.results.compare import number
from cosim.results.picture import as_png, data_address
from cosim.validation.curves import (
    ARM,
    BORDER,
    KINDS,
    SLIP,
    TIP,
    Curve,
    CurveRow,
    CurvesFile,
    Kind,
    Line,
    headline,
    lines,
    quantities,
)
from cosim.validation.roughness import WINDOW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100
COLOURS = ("#0072b2", "#d55e00", "#009e73")
"""Of an axis, a slip or a joint; colour-blind readers tell them apart."""
STYLES = ("o-", "s--", "^:", "D-.")
"""Of the tendons whose arms are drawn."""
GAP, QUIET = "#cc3311", "0.6"


def write_page(path: Path, curves: Sequence[Curve], before: CurvesFile) -> None:
    """The page of the curves, with what was committed of them `before`.  Raises InputError where
    the file cannot be written."""
    was = before.by_key()
    text = template("cosim.validation", "curves.html.j2").render(
        headline=headline(curves),
        window=f"{WINDOW:g}",
        border=f"{BORDER:g}",
        kinds=list(KINDS.values()),
        lines=[(line, line_cells(line, before)) for line in lines(curves)],
        curves=[_curve(curve, was) for curve in curves],
    )
    with output_file(path) as part:
        part.write_text(text, encoding="utf-8")


def line_cells(line: Line, before: CurvesFile) -> list[str]:
    """The roughest number of each kind, and behind it what was committed of the same number."""
    was = before.by_key()
    cells = []
    for row in map(line.worst.get, KINDS):
        old = was.get(row.key) if row else None
        cells.append(
            number(row.rms if row else None, 2) + (f" ({number(old.rms, 2)})" if old else "")
        )
    return cells


def _curve(curve: Curve, was: dict[tuple[str, str, str], CurveRow]) -> dict[str, Any]:
    return {
        "name": curve.sweep.name,
        "title": curve.sweep.cases[0].title,
        "is_within": curve.is_within,
        "gaps": curve.gaps,
        "picture": data_address(as_png(draw_curve(curve), DPI)),
        "rows": [(row, _numbers(row, was.get(row.key))) for row in curve.rows],
    }


def _numbers(row: CurveRow, old: CurveRow | None) -> list[str]:
    was = old.rms if old else None
    shown = (row.size, row.rms, was, row.aim, row.largest, row.step)
    return [number(value, 3) for value in shown]


def draw_curve(curve: Curve) -> Figure:
    """Fingertip force, slip forces and moment arms over the joint that moves."""
    picture = new_picture(11.0, 3.2)
    for axes, kind in zip(picture.subplots(1, 3), (TIP, SLIP, ARM), strict=True):
        _draw_kind(axes, curve, kind)
    return picture


def _draw_kind(axes: Axes, curve: Curve, kind: Kind) -> None:
    sweep, names = curve.sweep, quantities(curve.sweep.pulled)
    mine = [name for name, of in names.items() if of is kind]
    for i, name in enumerate(mine):
        tendon, component = divmod(i, len(COLOURS))
        style: Any = {"color": COLOURS[component], "lw": 1, "ms": 2}
        label = " ".join(name.split(".")[1:])
        axes.plot(sweep.angles, curve.values[name], STYLES[tendon % 4], label=label, **style)
    for angle in curve.gaps:
        axes.axvline(angle, color=GAP, lw=1.2, ls=":")
    if sweep.joint == "PIP" and sweep.angles[0] < BORDER < sweep.angles[-1]:
        axes.axvline(BORDER, color=QUIET, lw=0.8)
    style_axes(axes, f"{sweep.joint}, deg", f"{kind.name}, {'mm' if kind is ARM else 'N'}")
    above: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0}
    if mine:
        axes.legend(frameon=False, fontsize=7, ncols=3, **above)
