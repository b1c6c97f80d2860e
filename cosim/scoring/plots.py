"""Pictures of scores: skills by group, and every measured number with what each model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from cosim.report.figures import style_axes
from cosim.results.compare import Comparison
from cosim.results.looks import look
from cosim.results.picture import new_picture
from cosim.scoring.groups import row_words
from cosim.scoring.run import HandScore, groups_of, score_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "oDs^vPX*dp"
"""Shapes of the models, which tell them apart besides the colours."""
ROW = 0.24
"""Inches of a row."""
LEAST_SKILL = -1.0
"""Where the axis of skills ends; a worse model is an arrow there."""
BEYOND = 0.6
"""How far an axis reaches beyond the measured numbers, as a part of their extent."""
LONGEST = 66


def draw_skills(hands: Sequence[HandScore]) -> Figure:
    """The skill of each model by group of measured numbers, reference models as grey ticks."""
    groups = [g for g in groups_of(hands) if _any_skill(hands, g.group.name, g.group.finger)]
    fingers = {g.group.finger for g in groups}
    picture = new_picture(9.8, 1.5 + 0.42 * len(groups) + 0.16 * len(hands))
    axes = picture.subplots()
    for place, g in enumerate(groups):
        _draw_references(axes, hands, place, g.group.name, g.group.finger)
        for i, hand in enumerate(hands):
            mine = score_of(hand, g)
            if mine is None or mine.skill is None:
                continue
            shift = 0.5 * ((i + 0.5) / len(hands) - 0.5)
            _draw_clipped(axes, mine.skill.value, place + shift, i, hand.model.name)
    axes.axvline(0, color="0.45", lw=0.9)
    axes.axvline(1, color="0.45", lw=0.9, ls=":")
    names = [
        g.group.name
        + (f", {g.group.finger} finger" if len(fingers) > 1 else "")
        + ("" if g.group.counts else "*")
        for g in groups
    ]
    axes.set_yticks(range(len(groups)), names)
    axes.set(xlim=(LEAST_SKILL - 0.08, 1.08), ylim=(len(groups) - 0.4, -0.6))
    style_axes(axes, "skill: 0 as good as no answer, 1 perfect (arrows: below -1)", "")
    _legend(picture, axes)
    return picture


def _any_skill(hands: Sequence[HandScore], group: str, finger: str) -> bool:
    every = (g for hand in hands for g in hand.groups)
    return any(
        g.skill is not None for g in every if (g.group.name, g.group.finger) == (group, finger)
    )


def _draw_references(
    axes: Axes, hands: Sequence[HandScore], place: int, group: str, finger: str
) -> None:
    every = (g for hand in hands for g in hand.groups)
    ranks = [g.rank for g in every if (g.group.name, g.group.finger) == (group, finger) and g.rank]
    skills: Mapping[str, float] = ranks[0].skills if ranks else {}
    for value in skills.values():
        if value >= LEAST_SKILL:
            axes.plot(value, place, "|", color="0.55", ms=20, mew=1.6, label="reference models")


def _draw_clipped(axes: Axes, value: float, place: float, i: int, name: str) -> None:
    inside = value >= LEAST_SKILL
    style = look(i)
    marker = MARKERS[i % len(MARKERS)] if inside else "<"
    axes.plot(max(value, LEAST_SKILL), place, marker, color=style.colour, ms=6.5, label=name)


def _legend(picture: Figure, *panels: Axes) -> None:
    handles = {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        if getattr(handle, "get_marker", str)() not in ("<", ">")
    }
    for axes in panels:  # a model that is beyond the axis everywhere
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    ordered = sorted(handles, key=lambda label: label.startswith(("measured", "reference")))
    picture.legend(
        [handles[label] for label in ordered],
        ordered,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=8.5,
    )


def draw_rows(hands: Sequence[HandScore], finger: str, group: str) -> Figure | None:
    """The measured numbers of a group as ticks with their SD, and each model's as marks, a panel
    for each unit; numbers far off are arrows at the edge.  None where no model has a number."""
    scored = [
        (i, g)
        for i, hand in enumerate(hands)
        for g in hand.groups
        if (g.group.finger, g.group.name) == (finger, group) and g.rows
    ]
    rows: dict[str, Comparison] = {}
    words: dict[str, str] = {}
    answers: dict[str, list[tuple[int, float]]] = {}
    for i, g in scored:
        for row in g.rows:
            name = row.target.name
            rows.setdefault(name, row)
            words.setdefault(name, row_words(g.group, row))
            if row.model is not None:
                answers.setdefault(name, []).append((i, row.model))
    units = list(dict.fromkeys(rows[name].target.unit for name in answers))
    if not units:
        return None
    names = {u: [n for n in rows if rows[n].target.unit == u and n in answers] for u in units}
    heights = [len(names[u]) + 2 for u in units]
    picture = new_picture(9.8, 1.0 + 0.5 * len(units) + ROW * sum(heights))
    panels = picture.subplots(len(units), 1, height_ratios=heights, squeeze=False).ravel()
    for axes, unit in zip(panels, units, strict=True):
        low, high = _limits([rows[n] for n in names[unit]], names[unit], answers)
        for place, name in enumerate(names[unit]):
            _draw_measured(axes, rows[name], place, low, high)
            for i, value in answers[name]:
                shift = 0.36 * ((i + 0.5) / len(hands) - 0.5)
                _draw_answer(axes, value, place + shift, i, hands[i].model.name, (low, high))
        axes.axvline(0, color="0.45", lw=0.8)
        axes.set_yticks(
            range(len(names[unit])), [shorten(words[n], LONGEST) for n in names[unit]], fontsize=8
        )
        axes.set(xlim=(low, high), ylim=(len(names[unit]) - 0.4, -0.6))
        style_axes(axes, "ratio" if unit == "1" else unit, "")
    _legend(picture, *panels)
    return picture


def _limits(
    rows: Sequence[Comparison],
    names: Sequence[str],
    answers: Mapping[str, Sequence[tuple[int, float]]],
) -> tuple[float, float]:
    """The ends of an axis: what was measured with its SD and zero, and of the models' numbers those
    that are not far off."""
    stated = [0.0]
    for row in rows:
        t = row.target
        stated += [v for v in (t.low, t.high) if v is not None]
        if t.reference is not None:
            stated += [t.reference - (t.sd or 0.0), t.reference + (t.sd or 0.0)]
    least, most = min(stated), max(stated)
    room = BEYOND * (most - least)
    near = [v for n in names for _, v in answers[n] if least - room <= v <= most + room]
    low, high = min([least, *near]), max([most, *near])
    edge = 0.04 * (high - low)
    return low - edge, high + edge


def _draw_measured(axes: Axes, row: Comparison, place: int, low: float, high: float) -> None:
    t = row.target
    if t.reference is None:
        ends = (low if t.low is None else t.low, high if t.high is None else t.high)
        axes.plot(
            ends, [place] * 2, color="0.8", lw=9, solid_capstyle="butt", label="measured band"
        )
        return
    if t.sd:
        axes.plot(
            [t.reference - t.sd, t.reference + t.sd],
            [place] * 2,
            color="0.75",
            lw=6,
            solid_capstyle="butt",
            label="measured, 1 SD between hands",
        )
    axes.plot(t.reference, place, "|", color="black", ms=13, mew=2.2, label="measured")


def _draw_answer(
    axes: Axes, value: float, place: float, i: int, name: str, ends: tuple[float, float]
) -> None:
    low, high = ends
    edge = 0.012 * (high - low)
    marker = "<" if value < low else ">" if value > high else MARKERS[i % len(MARKERS)]
    at = float(np.clip(value, low + edge, high - edge))
    axes.plot(at, place, marker, color=look(i).colour, ms=4.6, alpha=0.9, label=name)
