"""The board of curves as a page that needs nothing else: every curve, and how rough it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import output_file
from cosim.report.figures import new_picture, style_axes
from cosim.report.templates import template
from cosim.results.compare import number
from cosim.results.looks import look
from cosim.results.picture import picture_address
from cosim.roughness import WINDOW
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
    text = template("cosim.validation", "curves.html.j2").render(
        headline=headline(curves),
        window=f"{WINDOW:g}",
        border=f"{BORDER:g}",
        kinds=list(KINDS.values()),
        lines=table_rows(curves, before),
        curves=[
            (curve, picture_address(draw_curve(curve), DPI), _number_rows(curve, before))
            for curve in curves
        ],
    )
    with output_file(path) as part:
        part.write_text(text, encoding="utf-8")


def table_rows(curves: Sequence[Curve], before: CurvesFile) -> list[list[str]]:
    """Of each line sweep, part, the roughest number of each kind and in brackets what was committed
    of the same number, the largest rms over its aim, gaps and verdict."""
    was, rows = before.by_key(), []
    for line in lines(curves):
        cells = [line.sweep, line.part]
        for row in map(line.worst.get, KINDS):
            old = was.get(row.key) if row else None
            behind = f" ({number(old.rms, 2)})" if old else ""
            cells.append(number(row.rms if row else None, 2) + behind)
        rows.append([*cells, f"{line.ratio:.2g}", str(line.gaps or ""), line.verdict])
    return rows


def _number_rows(curve: Curve, before: CurvesFile) -> list[tuple[CurveRow, list[str]]]:
    """Each number with its size, rms, rms before, aim, largest residual and step."""
    was, rows = before.by_key(), []
    for row in curve.rows:
        old = was[row.key].rms if row.key in was else None
        shown = (row.size, row.rms, old, row.aim, row.largest, row.step)
        rows.append((row, [number(value, 3) for value in shown]))
    return rows


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
