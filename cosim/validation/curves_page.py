"""The board of curves as a page that needs nothing else: every curve, and how rough it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import write_text
from cosim.report.figures import style_axes
from cosim.report.templates import html_page
from cosim.results.compare import number
from cosim.results.looks import look
from cosim.results.picture import new_picture, picture_address
from cosim.results.table import MISS, Cell, ReportTable
from cosim.roughness import WINDOW
from cosim.validation.curves import (
    ARM,
    BORDER,
    KINDS,
    SLIP,
    TIP,
    Curve,
    CurvesFile,
    Kind,
    headline,
    lines,
    quantities,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100
GAP, QUIET = "#cc3311", "0.6"


def write_page(path: Path, curves: Sequence[Curve], before: CurvesFile) -> None:
    """The page of the curves, with what was committed of them `before`.  Raises InputError where
    the file cannot be written."""
    text = html_page(
        "curves.html.j2",
        "cosim.validation",
        headline=headline(curves),
        window=f"{WINDOW:g}",
        border=f"{BORDER:g}",
        kinds=list(KINDS.values()),
        sweeps=table_of(curves, before),
        curves=[
            (curve, picture_address(draw_curve(curve), DPI), _numbers(curve, before))
            for curve in curves
        ],
    )
    write_text(path, text)


def table_of(curves: Sequence[Curve], before: CurvesFile) -> ReportTable:
    """A line for each sweep in each part: the roughest number of each kind and in brackets what was
    committed of the same number, the largest rms over its aim, gaps and verdict."""
    was, rows = before.by_key(), []
    for line in lines(curves):
        cells = [line.sweep, line.part]
        for row in map(line.worst.get, KINDS):
            old = was.get(row.key) if row else None
            behind = f" ({number(old.rms, 2)})" if old else ""
            cells.append(number(row.rms if row else None, 2) + behind)
        verdict = f"{MISS} {line.verdict}" if line.verdict == "misses" else line.verdict
        rows.append([*cells, f"{line.ratio:.2g}", str(line.gaps or ""), verdict])
    names = [f"{k.name}, {k.unit} (aims {k.aims[0]:g}, {k.aims[1]:g})" for k in KINDS.values()]
    heads = ("sweep", "part", *names, "over aim", "gaps", "verdict")
    title = (
        "rms of what a cubic leaves over 20 deg, the worst of each kind; in brackets as committed"
    )
    return ReportTable("sweeps", title, heads, rows)


def _numbers(curve: Curve, before: CurvesFile) -> ReportTable:
    was, rows = before.by_key(), list[list[Cell]]()
    for row in curve.rows:
        old = was[row.key].rms if row.key in was else None
        shown = (row.size, row.rms, old, row.aim, row.largest, row.step, row.unit)
        verdict = f"{MISS} misses" if row.ratio > 1 else ""
        rows.append([row.quantity, row.part, *shown, verdict])
    heads = ("Number", "Part", "Size", "rms", "Before", "Aim", "Largest", "Step", "Unit", "")
    return ReportTable("numbers of " + curve.sweep.name, curve.sweep.name, heads, rows, 3)


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
        style: Any = {"marker": "o", "ms": 2, **look(i).line, "lw": 1}
        label = " ".join(name.split(".")[1:])
        axes.plot(sweep.angles, curve.values[name], label=label, **style)
    for angle in curve.gaps:
        axes.axvline(angle, color=GAP, lw=1.2, ls=":")
    if sweep.joint == "PIP" and sweep.angles[0] < BORDER < sweep.angles[-1]:
        axes.axvline(BORDER, color=QUIET, lw=0.8)
    style_axes(axes, f"{sweep.joint}, deg", f"{kind.name}, {'mm' if kind is ARM else 'N'}")
    above: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0}
    if mine:
        axes.legend(frameon=False, fontsize=7, ncols=3, **above)
