"""The still drawings of a report, as SVG: force vectors in the sagittal plane, and for each row of
a comparison where the model lies beside the reference's SD and band."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from string import ascii_uppercase

import numpy as np

from cosim.port import Array
from cosim.results.compare import Comparison, ForceVector, Verdict, force_vectors, value_of
from cosim.results.looks import look
from cosim.results.result import Result

INKS = ("#00446b", "#0a7d6c", "#5b3a8e", "#2e6b3e", "#8c1d40", "#4d4d4d")
"""Dark enough for paper and for the letters of the legend."""
REFERENCE = "#b3540a"
SHAFT, DASHED = 2.4, (2.5, 1.7)
"""Width of an arrow, px, and the dashes of one that is not the answer itself."""
DOTTED = (1.0, 1.2)
"""The dashes of what is there at rest, of several runs."""
REST, LESS = "unloaded.", "difference."
PLACES = {"": "loaded", REST: "at rest", LESS: "loaded less at rest"}
"""What a report draws of a run's fingertip force, by where the summary has it."""
SHAPES: dict[Verdict, str] = {
    "inside 1 SD": "●",
    "inside the band": "◆",
    "outside": "▲",
    "nothing to judge by": "○",
    "no value": "–",
}
"""What a verdict looks like besides its word and colour."""
LEAST = 1e-6
"""N, below which a force is none."""
WIDE, MARGIN, TOP = 420.0, 46.0, 26.0


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
        """N, in the plane."""
        return math.hypot(*self.tip)


def arrows_of(runs: Sequence[Result]) -> list[Arrow]:
    """The model's forces, then those that they are compared with; none where all are zero."""
    found = list(_of_one(runs[0])) if len(runs) == 1 else list(_of_many(runs))
    given = [vector for run in runs for vector in force_vectors(run.comparison)]
    references = {(v.label, v.reference, v.sd): v for v in given}.values()
    arrows = [
        Arrow(letter(i), label, tip, ink, dashes, sd)
        for i, (label, tip, ink, dashes, sd) in enumerate(
            [*found, *(_reference(vector) for vector in references)]
        )
    ]
    return arrows if any(arrow.magnitude > LEAST for arrow in arrows) else []


def letter(n: int) -> str:
    """A, B, ... Z, A2, B2, ..."""
    return ascii_uppercase[n % 26] + (str(n // 26 + 1) if n >= 26 else "")


Place = Callable[[float, float], tuple[float, float]]
"""Where a force (distal, dorsal) N stands in a drawing."""
Drawn = tuple[str, tuple[float, float], str, tuple[float, ...], tuple[float, float] | None]


def _of_one(run: Result) -> Iterator[Drawn]:
    inks = {"": INKS[0], REST: INKS[5], LESS: INKS[0]}
    for place, label, tip in states_of(run):
        yield f"model, {label}", tip, inks[place], DASHED if place == LESS else (), None


def _of_many(runs: Sequence[Result]) -> Iterator[Drawn]:
    """The loaded state of each run and what it has at rest; their difference only where a reference
    is one."""
    compared = any(row.target.quantity.startswith(LESS) for run in runs for row in run.comparison)
    for i, run in enumerate(runs):
        one = look(i, INKS)
        own = {"": (), REST: DOTTED, LESS: DASHED}
        for place, label, tip in states_of(run):
            if place != LESS or compared:
                yield f"{run.name}, {label}", tip, one.colour, (*own[place], *one.dashes), None


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


def sagittal(arrows: Sequence[Arrow]) -> str:
    """The arrows from one origin; seen from the radial side: distal to the left, dorsal up."""
    reach = [np.zeros(2)]
    for arrow in arrows:
        sd = np.array(arrow.sd or (0.0, 0.0))
        reach += [np.array(arrow.tip) - sd, np.array(arrow.tip) + sd]
    low, high = np.min(reach, axis=0), np.max(reach, axis=0)
    span = max(float((high - low).max()), 1e-6)
    low, high = low - 0.12 * span, high + 0.12 * span
    unit = (WIDE - 2 * MARGIN) / max(float((high - low)[0]), float((high - low)[1]), 1e-9)
    tall = float((high - low)[1]) * unit + TOP + MARGIN

    def at(distal: float, dorsal: float) -> tuple[float, float]:
        middle = (low[0] + high[0]) / 2
        return WIDE / 2 - (distal - middle) * unit, TOP + (high[1] - dorsal) * unit

    parts = [*_grid(low, high, at, tall), *(p for a in arrows for p in _arrow(a, at, unit))]
    label = "Fingertip forces in the sagittal plane: " + "; ".join(
        f"{a.letter} {a.label}, {a.magnitude:.3g} N in the plane" for a in arrows
    )
    return (
        f'<svg class="plane" viewBox="0 0 {WIDE:.0f} {tall:.0f}" role="img" '
        f'aria-label="{escape(label, quote=True)}">{"".join(parts)}</svg>'
    )


def _grid(low: Array, high: Array, at: Place, tall: float) -> Iterator[str]:
    for axis, (first, last) in enumerate(zip(low, high, strict=True)):
        for tick in ticks(float(first), float(last)):
            ends = (
                [(tick, low[1]), (tick, high[1])]
                if axis == 0
                else [(low[0], tick), (high[0], tick)]
            )
            (x1, y1), (x2, y2) = (at(*end) for end in ends)
            kind = "axis" if tick == 0 else "grid"
            yield f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'
            text = f"{tick:.4g}".replace("-", "−")
            if axis == 0:
                yield f'<text x="{x1:.1f}" y="{tall - 28:.1f}" text-anchor="middle">{text}</text>'
            else:
                x = max(x1, x2) + 6
                yield f'<text x="{x:.1f}" y="{y1 + 4:.1f}">{text}</text>'
    yield f'<text class="what" x="6" y="{tall - 8:.1f}">← distal, N</text>'
    yield '<text class="what" x="6" y="16">↑ dorsal, N</text>'


def ticks(low: float, high: float) -> list[float]:
    """About five round numbers from low to high."""
    rough = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 12) for k in range(first, last + 1)]


def _arrow(arrow: Arrow, at: Place, unit: float) -> Iterator[str]:
    (x0, y0), (x, y) = at(0.0, 0.0), at(*arrow.tip)
    lengths = " ".join(f"{SHAFT * part:g}" for part in arrow.dashes)
    dash = f' stroke-dasharray="{lengths}"' if lengths else ""
    if arrow.sd is not None:
        rx, ry = (max(s * unit, 0.5) for s in arrow.sd)
        yield (
            f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}" fill="{arrow.ink}" '
            f'fill-opacity="0.12" stroke="{arrow.ink}" stroke-dasharray="3 3"/>'
        )
    length = math.hypot(x - x0, y - y0)
    if length > 1:
        ux, uy = (x - x0) / length, (y - y0) / length
        size = min(10.0, length / 2)
        bx, by = x - size * ux, y - size * uy
        wing = 0.38 * size
        yield (
            f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{bx:.1f}" y2="{by:.1f}" '
            f'stroke="{arrow.ink}" stroke-width="{SHAFT}"{dash}/>'
            f'<polygon fill="{arrow.ink}" points="{x:.1f},{y:.1f} {bx - wing * uy:.1f},'
            f'{by + wing * ux:.1f} {bx + wing * uy:.1f},{by - wing * ux:.1f}"/>'
        )
    else:
        ux, uy = -1.0, 0.0
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{arrow.ink}"/>'
    yield (
        f'<text class="letter" style="fill:{arrow.ink}" text-anchor="middle" '
        f'x="{x + 12 * ux:.1f}" y="{y + 12 * uy + 4:.1f}">{arrow.letter}</text>'
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
