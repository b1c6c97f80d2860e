"""The tornado chart: how a quantity depends on the case's assumptions, the strongest at the top."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

from cosim.analyses.identify.sensitivity import Run, Sensitivity, SensitivityBar, bars
from cosim.results.compare import Target, reference_text, unit_of
from cosim.results.picture import new_picture

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOW, HIGH = "#0072b2", "#e69f00"
"""Blue and orange of Okabe and Ito's palette for colour-blind readers; hatched apart, for print."""
SEEN = "#009e73"
"""The palette's green, of what was measured."""
MOST_BARS = 22
"""Bars of a chart."""
TELLING = 0.01
"""The part of the strongest effect below which a variation is named under the chart and not drawn.
"""
ROOM = 0.28
"""Margin for the labels on either side of the bars, as a part of the span of all bars."""


def draw_tornado(result: Sensitivity, quantity: str, target: Target | None = None) -> Figure:
    """Bars from the case's own value to those at both sides of every variation, and where the
    measured value or band lies, if there is one."""
    from matplotlib.patches import Patch

    every = bars(result, quantity)
    least = TELLING * every[0].swing if every else 0.0
    drawn = [bar for bar in every if bar.swing > least][:MOST_BARS]
    figure = new_picture(10.5, 2.2 + 0.34 * max(len(drawn), 1))
    axes = figure.subplots()
    for place, bar in enumerate(drawn):
        _draw_bar(axes, place, bar, least)
    base = result.base[quantity]
    axes.axvline(base, color="black", lw=1.0)
    axes.set_yticks(range(len(drawn)), [bar.variation for bar in drawn])
    axes.set_ylim(len(drawn) - 0.4, -0.6)
    _make_room(axes, base, drawn)
    of, subject = unit_of(quantity), quantity.replace("/", " / ")
    axes.set_xlabel(subject + ("" if of == "1" else f" ({of})"), fontsize=9)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    key: list[Artist] = [
        Patch(facecolor=LOW, label="low"),
        Patch(facecolor=HIGH, hatch="////", label="high"),
    ]
    if target is not None:
        key.append(_draw_target(axes, target))
    figure.legend(handles=key, loc="outside upper right", ncols=3, frameon=False)
    figure.suptitle(f"{result.case}: {base:.4g} as it is", x=0.01, ha="left", fontsize=11)
    if note := _note(every, drawn):
        figure.text(0.01, -0.01, fill(note, 150), fontsize=7.5, va="top", color="0.25")
    return figure


def _draw_target(axes: Axes, target: Target) -> Artist:
    """Draw the target's band and its mean with one SD, as far as the chart reaches.  Returns the
    entry in the legend."""
    from matplotlib.patches import Patch

    ends = axes.get_xlim()
    far = False
    if target.low is not None or target.high is not None:
        low = min(ends[0], target.high or ends[0]) if target.low is None else target.low
        high = max(ends[1], low) if target.high is None else target.high
        axes.axvspan(low, high, color=SEEN, alpha=0.25, lw=0, zorder=0)
        far = high < ends[0] or low > ends[1]
    if target.reference is not None:
        sd = target.sd or 0.0
        axes.axvspan(target.reference - sd, target.reference + sd, color=SEEN, alpha=0.15, zorder=0)
        axes.axvline(target.reference, color=SEEN, lw=1.5, ls="--")
    axes.set_xlim(ends)
    place = ", beyond the chart" if far else ""
    return Patch(color=SEEN, alpha=0.4, label=f"{target.kind}: {reference_text(target)}{place}")


def _draw_bar(axes: Axes, place: int, bar: SensitivityBar, least: float) -> None:
    """Draw both sides in one row, or in halves of it where they would cover each other or one
    hardly changes anything (`least`)."""
    low, high = bar.changes
    opposed = low is not None and high is not None and low * high < 0
    weak = low is not None and high is not None and min(abs(low), abs(high)) <= least
    halved = low is not None and high is not None and (weak or not opposed)
    sides = ((bar.low, low, LOW, ""), (bar.high, high, HIGH, "////"))
    for i, (run, change, colour, hatch) in enumerate(sides):
        at, tall = (place - 0.2 + 0.4 * i, 0.38) if halved else (place, 0.76)
        if change is None and run.status == "failed":
            opposite = low if i else high
            _label(axes, f"{run.set_to}: failed", bar.base, at, -1 if (opposite or 0.0) > 0 else 1)
        if change is None:
            continue
        axes.barh(at, change, tall, bar.base, color=colour, hatch=hatch, edgecolor="white", lw=0)
        _label(axes, run.set_to, bar.base + change, at, 1 if change >= 0 else -1)


def _label(axes: Axes, text: str, x: float, y: float, way: int) -> None:
    side = "left" if way > 0 else "right"
    look: Any = {"textcoords": "offset points", "ha": side, "va": "center", "fontsize": 7}
    axes.annotate(text, (x, y), (4 * way, 0), **look)


def _make_room(axes: Axes, base: float, drawn: Sequence[SensitivityBar]) -> None:
    ends = [base] + [base + c for bar in drawn for c in bar.changes if c is not None]
    span = max(ends) - min(ends) or abs(base) or 1.0
    axes.set_xlim(min(ends) - ROOM * span, max(ends) + ROOM * span)


def _note(every: Sequence[SensitivityBar], drawn: Sequence[SensitivityBar]) -> str:
    """What is not in the chart: sides that failed, what hardly matters, what does not apply."""
    runs = [run for bar in every for run in (bar.low, bar.high)]
    failed = [f"{r.variation} {r.set_to}" for r in runs if r.status == "failed"]
    refused = [f"{r.variation} {r.set_to}" for r in runs if r.status == "refused"]
    left = (bar for bar in every if bar not in drawn)
    weak = [bar.variation for bar in left if any(change is not None for change in bar.changes)]
    absent = [bar.variation for bar in every if not _applies(bar.low) and not _applies(bar.high)]
    parts = (
        ("Did not converge", failed),
        ("Not allowed in a case", refused),
        (f"Under {TELLING:.0%} of the strongest", weak),
        ("Does not apply", absent),
    )
    return ". ".join(f"{what}: {'; '.join(names)}" for what, names in parts if names)


def _applies(run: Run) -> bool:
    return run.status != "does not apply"
