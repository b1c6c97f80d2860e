"""Pictures of a scoreboard: every number of a group beside its reference, and all of one kind of
reference, measured against model.

Shapes and bars are those of a report's strip: a tick the reference, a dark bar 1 SD, a pale bar the
band of acceptance, and of the model a dot inside 1 SD, a diamond inside the band, a triangle
outside, a ring where there is nothing to judge by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.report.figures import style_axes
from cosim.results.compare import Comparison, Verdict
from cosim.results.picture import new_picture
from cosim.schema.types import TENDONS
from cosim.validation.run import SPLIT, Board
from cosim.validation.scoreboard import JudgedBoard
from cosim.validation.skill import judging_rows
from cosim.validation.uncertainty import Budget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MODEL, NULL, NOISE, BAND = "#0072b2", "#d55e00", "#e7d9a8", "#d5dde3"
"""Colours that colour-blind readers tell apart; shapes differ too."""
SHAPES: dict[Verdict, str] = {
    "inside 1 SD": "o",
    "inside the band": "D",
    "outside": "^",
    "nothing to judge by": "o",
}
NO_TENDON = "all tendons"
ROW, HEAD = 0.21, 1.3
"""Inches, of a row and of what stands above and below all."""
PARTS = {"mesh, u_num": "#0072b2", "inputs, u_input": "#56b4e9", "measured mean, u_D": "#999999"}
NONE = (None, None)
LONGEST = 72
"""Letters of a row's name."""
CHARTED = 1.15
"""How far a chart of measured against model reaches beyond the largest reference."""


def draw_rows(board: Board) -> Figure | None:
    """The numbers of a group by tendon, a panel for each unit; None where no row has a number."""
    rows = [row for row in board.rows if row.model is not None]
    units = list(dict.fromkeys(row.target.unit for row in rows))
    if not units:
        return None
    by_unit = [_by_tendon([row for row in rows if row.target.unit == unit]) for unit in units]
    counts = [len(ordered) for ordered in by_unit]
    picture = new_picture(9.6, HEAD * len(units) + ROW * sum(counts))
    panels = picture.subplots(len(units), 1, height_ratios=[c + 2 for c in counts], squeeze=False)
    for axes, unit, ordered in zip(panels.ravel(), units, by_unit, strict=True):
        _draw_unit(axes, board, ordered)
        style_axes(axes, "ratio" if unit == "1" else unit, "")
    _add_legend(picture, 4)
    return picture


def _add_legend(picture: Figure, columns: int) -> None:
    """One legend below all panels, each word once."""
    handles = {
        label: handle
        for axes in picture.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    style: Any = {"loc": "outside lower center", "frameon": False, "fontsize": 8}
    picture.legend(handles.values(), handles, ncols=columns, **style)


def tendon_of(row: Comparison) -> str:
    """The tendon that a row's name or trial names first."""
    words = f"{row.target.name} {row.target.case}".replace(",", " ").replace(":", " ")
    words = words.replace("_", " ").upper()
    return next((word for word in words.split() if word in TENDONS), NO_TENDON)


def _by_tendon(rows: Sequence[Comparison]) -> list[Comparison]:
    order = [*TENDONS, NO_TENDON]
    return sorted(rows, key=lambda row: order.index(tendon_of(row)))


def _draw_unit(axes: Axes, board: Board, rows: Sequence[Comparison]) -> None:
    axes.axvline(0, color="0.45", lw=0.9)
    noise = board.noise.get(rows[0].target.unit)
    for place, row in enumerate(rows):
        _draw_reference(axes, row, place, 0.0 if noise is None else noise.mean)
        _draw_answers(axes, board, row, place)
    names = [
        shorten(row.target.name + (" (fitted)" if row.target.fitted else ""), LONGEST)
        for row in rows
    ]
    axes.set_yticks(range(len(rows)), names, fontsize=7.5)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    tendons = [tendon_of(row) for row in rows]
    for i in range(1, len(rows)):
        if tendons[i] != tendons[i - 1]:
            axes.axhline(i - 0.5, color="0.6", lw=0.8)
    axes.margins(x=0.04)


def _draw_reference(axes: Axes, row: Comparison, place: int, noise: float) -> None:
    t = row.target
    if t.low is not None or t.high is not None:
        left, right = _finite_band(t.low, t.high, row)
        axes.barh(place, right - left, 0.7, left, color=BAND, label="band of acceptance")
    if t.reference is None:
        return
    if noise:
        axes.barh(
            place,
            2 * noise,
            0.7,
            t.reference - noise,
            color=NOISE,
            label="noise of the hands' mean",
        )
    if t.sd:
        axes.plot([t.reference - t.sd, t.reference + t.sd], [place] * 2, color="0.25", lw=2.2)
    axes.plot(t.reference, place, "|", color="black", ms=11, mew=2, label="reference, 1 SD")


def _finite_band(low: float | None, high: float | None, row: Comparison) -> tuple[float, float]:
    """The ends of a band; one that is open lies as far off the other as the model, and more."""
    closed = low if low is not None else high
    assert closed is not None
    assert row.model is not None
    room = 1.1 * max(abs(row.model - closed), 0.1 * abs(closed))
    return closed - room if low is None else low, closed + room if high is None else high


def _draw_answers(axes: Axes, board: Board, row: Comparison, place: int) -> None:
    split = board.split.get(row.target)
    if split is not None:
        axes.plot(split, place, "s", mfc="none", color=NULL, ms=5, label=f"null model: {SPLIT}")
    face = "white" if row.verdict == "nothing to judge by" else MODEL
    look: Any = {"mfc": face, "mec": MODEL, "ms": 5.5, "ls": "", "label": f"model, {row.verdict}"}
    assert row.model is not None
    axes.plot(row.model, place, SHAPES[row.verdict], **look)


def draw_budgets(judged: JudgedBoard) -> Figure | None:
    """The budget of every number of a group, a panel for each unit: bars of what the uncertainty is
    made of, a mark of |E| and a line at 95 % of u_val; None where nothing is known of any."""
    rows = [
        row
        for row in judged.board.rows
        if row.model is not None and (judged.budget(row).u_num, judged.budget(row).u_input) != NONE
    ]
    units = list(dict.fromkeys(row.target.unit for row in rows))
    if not units:
        return None
    by_unit = [_by_tendon([row for row in rows if row.target.unit == unit]) for unit in units]
    counts = [len(ordered) for ordered in by_unit]
    picture = new_picture(9.6, HEAD * len(units) + 1.35 * ROW * sum(counts))
    panels = picture.subplots(len(units), 1, height_ratios=[c + 2 for c in counts], squeeze=False)
    for axes, unit, ordered in zip(panels.ravel(), units, by_unit, strict=True):
        for place, row in enumerate(ordered):
            _draw_budget(axes, judged.budget(row), place)
        names = [shorten(row.target.name, LONGEST) for row in ordered]
        axes.set_yticks(range(len(ordered)), names, fontsize=7.5)
        axes.set_ylim(len(ordered) - 0.4, -0.6)
        axes.set_xlim(left=0)
        style_axes(axes, "uncertainty and error" + (f", {unit}" if unit != "1" else ""), "")
    _add_legend(picture, 5)
    return picture


def _draw_budget(axes: Axes, budget: Budget, place: int) -> None:
    parts = (budget.u_num, budget.u_input, budget.u_data)
    for i, ((label, colour), u) in enumerate(zip(PARTS.items(), parts, strict=True)):
        if u is not None:
            axes.barh(place + 0.24 * (i - 1), u, 0.24, color=colour, label=label)
    if budget.expanded is not None:
        ends = [place - 0.42, place + 0.42]
        axes.plot([budget.expanded] * 2, ends, color="black", lw=1.6, label="95 % of u_val")
    if budget.error is not None:
        shape = {"model differs": "^", "within uncertainty": "o", "no u_val": "D"}
        face = "white" if budget.judgement == "no u_val" else NULL
        label = f"|model - measured|, {budget.judgement}"
        style: Any = {"mfc": face, "mec": NULL, "ms": 5, "ls": "", "label": label}
        axes.plot(abs(budget.error), place, shape[budget.judgement], **style)


def draw_kind(board: Board) -> Figure | None:
    """Measured against model of the rows that count, a chart for each unit, with the null models as
    lines and crosses; None where no row has both."""
    rows = [
        row
        for row in judging_rows(board.rows)
        if row.model is not None and row.target.reference is not None
    ]
    units = [unit for unit, n in Counter(row.target.unit for row in rows).items() if n > 1]
    if not units:
        return None
    picture = new_picture(3.3 * len(units) + 0.4, 4.2)
    for axes, unit in zip(picture.subplots(1, len(units), squeeze=False)[0], units, strict=True):
        _draw_chart(axes, board, [row for row in rows if row.target.unit == unit])
        words = ", a ratio" if unit == "1" else f", {unit}"
        style_axes(axes, f"reference{words}", f"model{words}")
    handles, labels = axes.get_legend_handles_labels()
    distinct = dict(zip(labels, handles, strict=True))
    picture.legend(
        distinct.values(),
        distinct,
        loc="outside lower center",
        ncols=min(3, 2 * len(units)),
        frameon=False,
        fontsize=8,
    )
    return picture


def _draw_chart(axes: Axes, board: Board, rows: Sequence[Comparison]) -> None:
    references = np.array([row.target.reference for row in rows], dtype=float)
    models = np.array([row.model for row in rows], dtype=float)
    most = CHARTED * float(np.abs(references).max())
    ends = np.array([-most if references.min() < 0 else 0.0, most])
    axes.plot(ends, ends, color="black", lw=1.2, label="model as measured")
    for factor in (0.5, 2.0):
        axes.plot(ends, factor * ends, color="0.6", lw=0.8, ls="--", label="half and twice that")
    sds = np.array([row.target.sd or 0.0 for row in rows])
    axes.errorbar(references, models, xerr=sds, fmt="none", ecolor="0.6", lw=0.9)
    if board.split:
        places = [(r.target.reference, board.split.get(r.target)) for r in rows]
        known = np.array([p for p in places if p[1] is not None], dtype=float).reshape(-1, 2)
        axes.plot(*known.T, "x", color=NULL, ms=5, label=f"null model: {SPLIT}")
    axes.plot(references, models, "o", color=MODEL, ms=4.5, alpha=0.85, label="model")
    room = 1.08 * max(most, float(np.abs(models).max()))
    axes.set(xlim=1.02 * ends, ylim=(-room if min(models.min(), references.min()) < 0 else 0, room))
    axes.axhline(0, color="0.45", lw=0.8)
    axes.axvline(0, color="0.45", lw=0.8)
