"""The still drawings of a report: force vectors in the sagittal plane, and for each row of a
comparison where the model lies beside the reference's SD and band."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from string import ascii_uppercase
from typing import TYPE_CHECKING

import numpy as np

from cosim.report.figures import style_axes
from cosim.report.templates import packed_picture
from cosim.results.compare import Comparison, ForceVector, force_vectors, value_of
from cosim.results.looks import look
from cosim.results.picture import as_png, new_picture
from cosim.results.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INKS = ("#00446b", "#0a7d6c", "#5b3a8e", "#2e6b3e", "#8c1d40", "#4d4d4d")
"""Dark enough for paper and for the letters of the legend."""
REFERENCE = "#b3540a"
SHAFT, DASHED = 1.8, (2.5, 1.7)
"""Width of an arrow, points, and the dashes of one that is not the answer itself."""
DOTTED = (1.0, 1.2)
"""The dashes of what is there at rest, of several runs."""
REST, LESS = "unloaded.", "difference."
PLACES = {"": "loaded", REST: "at rest", LESS: "loaded less at rest"}
"""What a report draws of a run's fingertip force, by where the summary has it."""
LEAST_FORCE = 1e-6
"""N, below which a force is none."""
WIDE, LEAST_WIDE, AROUND = 4.2, 2.6, 0.7
"""Inches: the longer side of the plane, its width at least, and what stands around it."""
DPI = 150


@dataclass(frozen=True)
class Arrow:
    """A force in the sagittal plane, N: (distal, dorsal), with the SD of a reference."""

    letter: str
    label: str
    tip: tuple[float, float]
    ink: str
    dashes: tuple[float, ...] = ()
    """Strokes and gaps in widths of the shaft; none: it is full."""
    sd: tuple[float, float] | None = None

    @property
    def magnitude(self) -> float:
        """The arrow's length (N) in the plane."""
        return math.hypot(*self.tip)


def arrows_of(runs: Sequence[Result]) -> list[Arrow]:
    """The model's forces, then those that they are compared with; none where all are zero."""
    forces = list(_forces_of_run(runs[0])) if len(runs) == 1 else list(_forces_of_runs(runs))
    given = [vector for run in runs for vector in force_vectors(run.comparison)]
    references = {(v.label, v.reference, v.sd): v for v in given}.values()
    arrows = [
        Arrow(letter(i), label, tip, ink, dashes, sd)
        for i, (label, tip, ink, dashes, sd) in enumerate(
            [*forces, *(_reference(vector) for vector in references)]
        )
    ]
    return arrows if any(arrow.magnitude > LEAST_FORCE for arrow in arrows) else []


def letter(n: int) -> str:
    """A, B, ... Z, A2, B2, ..."""
    return ascii_uppercase[n % 26] + (str(n // 26 + 1) if n >= 26 else "")


Drawn = tuple[str, tuple[float, float], str, tuple[float, ...], tuple[float, float] | None]


def _forces_of_run(run: Result) -> Iterator[Drawn]:
    inks = {"": INKS[0], REST: INKS[5], LESS: INKS[0]}
    for place, label, tip in states_of(run):
        yield f"model, {label}", tip, inks[place], DASHED if place == LESS else (), None


def _forces_of_runs(runs: Sequence[Result]) -> Iterator[Drawn]:
    """The loaded state of each run and what it has at rest; their difference only where a reference
    is one."""
    compared = any(row.target.quantity.startswith(LESS) for run in runs for row in run.comparison)
    for i, run in enumerate(runs):
        one = look(i, INKS)
        dashes = {"": (), REST: DOTTED, LESS: DASHED}
        for place, label, tip in states_of(run):
            if place != LESS or compared:
                yield f"{run.name}, {label}", tip, one.colour, (*dashes[place], *one.dashes), None


def states_of(run: Result) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Key, name and fingertip force (distal, dorsal) N of the loaded state, the unloaded one and
    their difference, as far as the summary has them."""
    places = PLACES if "unloaded" in run.summary else {"": "at the end"}
    for place, label in places.items():
        if (tip := _in_plane(run, place)) is not None:
            yield place, label, tip


def _in_plane(run: Result, place: str) -> tuple[float, float] | None:
    distal, dorsal = (
        value_of(run.summary, f"{place}fingertip_force_N.{axis}") for axis in ("distal", "dorsal")
    )
    return None if distal is None or dorsal is None else (distal, dorsal)


def _reference(vector: ForceVector) -> Drawn:
    spread = ", ellipse 1 SD" if vector.sd else ""
    return f"{vector.kind}: {vector.label}{spread}", vector.reference, REFERENCE, DASHED, vector.sd


def plane(arrows: Sequence[Arrow]) -> str:
    """The picture of the arrows as an element of HTML."""
    words = "Fingertip forces in the sagittal plane: " + "; ".join(
        f"{a.letter} {a.label}, {a.magnitude:.3g} N in the plane" for a in arrows
    )
    picture = sagittal(arrows)
    address, width = packed_picture(as_png(picture, DPI)), 96 * picture.get_size_inches()[0]
    style = f'style="width: {width:.0f}px; max-width: 100%"'
    return f'<img alt="{escape(words)}" data-save="fingertip force" {style} src="{address}">'


def sagittal(arrows: Sequence[Arrow]) -> Figure:
    """The arrows from one origin; seen from the radial side: distal to the left, dorsal up."""
    tips = np.array([arrow.tip for arrow in arrows])
    spread = np.array([arrow.sd or (0.0, 0.0) for arrow in arrows])
    reach = np.vstack([np.zeros(2), tips - spread, tips + spread])
    low, high = reach.min(axis=0), reach.max(axis=0)
    room = 0.14 * max(float((high - low).max()), 1e-6)
    low, high = low - room, high + room
    wide, tall = WIDE * (high - low) / (high - low).max()
    figure = new_picture(max(wide, LEAST_WIDE) + AROUND, tall + AROUND)
    axes = figure.subplots()
    style_axes(axes, "← distal, N", "dorsal, N →")
    axes.set_aspect("equal")
    axes.set(xlim=(high[0], low[0]), ylim=(low[1], high[1]))
    axes.axhline(0.0, color="0.5", lw=0.8, zorder=1)
    axes.axvline(0.0, color="0.5", lw=0.8, zorder=1)
    for arrow in arrows:
        _draw_arrow(axes, arrow)
    return figure


def _draw_arrow(axes: Axes, arrow: Arrow) -> None:
    """An arrow from the origin with its letter beyond its head, and the ellipse of its SD."""
    from matplotlib.patches import Ellipse

    if arrow.sd is not None:
        width, height = (2 * sd for sd in arrow.sd)
        axes.add_patch(Ellipse(arrow.tip, width, height, fc=arrow.ink, alpha=0.12))
        axes.add_patch(Ellipse(arrow.tip, width, height, fill=False, ec=arrow.ink, ls=":"))
    unit = np.array([1.0, 0.0])
    if arrow.magnitude > LEAST_FORCE:
        unit = np.array(arrow.tip) / arrow.magnitude
        dashes = {"linestyle": (0, arrow.dashes)} if arrow.dashes else {}
        style = {"arrowstyle": "-", "lw": SHAFT, "color": arrow.ink, "shrinkA": 0, **dashes}
        axes.annotate("", arrow.tip, (0, 0), arrowprops={**style, "shrinkB": 5}, zorder=3)
        head = {"arrowstyle": "-|>,head_length=.6,head_width=.25", "lw": 0, "color": arrow.ink}
        axes.annotate(
            "", arrow.tip, (0, 0), arrowprops={**head, "shrinkA": 0, "shrinkB": 0}, zorder=3
        )
    else:
        axes.plot(*arrow.tip, "o", color=arrow.ink, ms=4)
    axes.annotate(
        arrow.letter,
        arrow.tip,
        (-9 * unit[0], 9 * unit[1]),
        textcoords="offset points",
        color=arrow.ink,
        weight="bold",
        ha="center",
        va="center",
    )


def strip(row: Comparison) -> str:
    """Where the model lies: the band as a pale bar, 1 SD as a dark one, the reference as a tick."""
    t, model = row.target, row.model
    sd = t.sd or 0.0
    around = [] if t.reference is None else [t.reference - sd, t.reference + sd]
    known = [v for v in (t.low, t.high, model, *around) if v is not None]
    low, high = min(known), max(known)
    span = (high - low) or 1.0
    low, high = low - 0.08 * span, high + 0.08 * span

    def x(value: float | None, open_end: float) -> float:
        return 120.0 * ((open_end if value is None else value) - low) / (high - low)

    parts = []
    if t.low is not None or t.high is not None:
        left, right = x(t.low, low), x(t.high, high)
        parts.append(
            f'<rect class="band" x="{left:.1f}" y="3" width="{right - left:.1f}" height="14"/>'
        )
    if t.reference is not None:
        if t.sd is not None:
            left, right = x(t.reference - sd, low), x(t.reference + sd, low)
            parts.append(
                f'<rect class="sd" x="{left:.1f}" y="7" width="{right - left:.1f}" height="6"/>'
            )
        tick = x(t.reference, low)
        parts.append(f'<line class="ref" x1="{tick:.1f}" x2="{tick:.1f}" y1="2" y2="18"/>')
    if model is not None:
        parts.append(f'<circle class="model" cx="{x(model, low):.1f}" cy="10" r="4"/>')
    return f'<svg class="strip" viewBox="0 0 120 20" aria-hidden="true">{"".join(parts)}</svg>'
