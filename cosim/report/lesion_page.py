"""The report of a lesion: one page of the finger before and after it, free and held."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from cosim.port import Array
from cosim.report import drawings, words
from cosim.report.page import cell, colours
from cosim.report.strengths import insertion_forces, strength_of
from cosim.report.tables import Cell, ReportTable
from cosim.report.templates import own_file, template
from cosim.report.views import BoneSurface, Sheet, SheetField, View, limits, view_of
from cosim.results.compare import number, unit_of, value_of
from cosim.results.quantities import key_quantities
from cosim.results.result import Result

FIELD = "along"
LEAST_ANGLE, LEAST_FORCE = 0.05, 0.005
"""deg and N, below which a change is none worth telling."""


@dataclass(frozen=True)
class RunPair:
    """A case before and after a lesion, the fingertip `tip`: free or held."""

    tip: str
    before: Result
    after: Result


@dataclass(frozen=True)
class Map:
    """A strain map and whose it is."""

    title: str
    drawing: str


def tables_of_lesion(pairs: Sequence[RunPair]) -> list[ReportTable]:
    """For each pair its numbers before, after and the difference, strains of regions too; and of a
    sheet what its parts carry beside what they are known to bear."""
    columns = ("quantity", "unit", "before", "after", "after less before")
    out = []
    for pair in pairs:
        out.append(ReportTable(pair.tip, f"Fingertip {pair.tip}", columns, tuple(_rows(pair))))
        out.append(_load_and_strength(pair))
    return [table for table in out if table.rows]


def _load_and_strength(pair: RunPair) -> ReportTable:
    """What each part of a sheet carries; without rows of another hood."""
    labels = dict(p for run in (pair.after, pair.before) for p in insertion_forces(run.summary))
    rows: list[tuple[Cell, ...]] = []
    for label, quantity in labels.items():
        before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
        known = strength_of(quantity)
        rows.append((label, before, after, known.bears, known.says))
    return ReportTable(
        f"strength_{pair.tip}",
        f"Load against strength, fingertip {pair.tip}",
        ("part", "carries before, N", "carries after, N", "bears at least, N", "what is known"),
        tuple(rows),
    )


def _rows(pair: RunPair) -> list[tuple[Cell, ...]]:
    out: list[tuple[Cell, ...]] = []
    labels = dict(p for run in (pair.after, pair.before) for p in key_quantities(run.summary))
    for label, quantity in (*labels.items(), *_more(pair)):
        if pair.tip == "free" and quantity.startswith("fingertip"):
            continue
        before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
        gap = None if before is None or after is None else after - before
        out.append((label, unit_of(quantity), before, after, gap))
    return out


def _more(pair: RunPair) -> list[tuple[str, str]]:
    """Label and quantity of excursions, springs, strains of regions and tensions of cables."""
    found: dict[str, str] = {}
    for run in (pair.before, pair.after):
        s = run.summary
        pulled = [t for t, v in s.get("difference", {}).get("moment_arm_mm", {}).items() if v]
        found |= {f"excursion of {t}": f"excursion_mm.{t}" for t in pulled}
        for name in s.get("spring_force_N", ()):
            found[f"force of springs: {name.replace('_', ' ')}"] = f"spring_force_N.{name}"
        for name in s.get("region_strain_percent", ()):
            where = f"region_strain_percent.{name}.longitudinal.mean"
            found[f"mean strain along, {name.replace('_', ' ')}"] = where
        for name in s.get("cable", ()):
            found[f"tension of {name.replace('_', ' ')}"] = f"cable.{name}.tension_N"
    return list(found.items())


def lesion_sentences(pairs: Sequence[RunPair]) -> list[str]:
    """What changed, a sentence for each pair."""
    out = []
    for pair in pairs:
        parts = [*_angles(pair), *_forces(pair)]
        said = "; ".join(parts) if parts else "nothing changes that is worth telling"
        out.append(f"Fingertip {pair.tip}: {said}.".replace("-", "−"))
    return out


def _change(pair: RunPair, quantity: str) -> float | None:
    before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
    return None if before is None or after is None else after - before


def _angles(pair: RunPair) -> list[str]:
    out = []
    for joint in pair.after.summary.get("posture_deg", ()):
        gap = _change(pair, f"posture_deg.{joint}")
        if gap is not None and abs(gap) >= LEAST_ANGLE:
            more = ("radial", "ulnar") if joint.endswith("abduction") else ("flexed", "extended")
            name = joint.replace("_abduction", "")
            out.append(f"{name} {abs(gap):.1f}° more {more[0] if gap > 0 else more[1]}")
    return out


def _forces(pair: RunPair) -> list[str]:
    out = []
    named = {f"{slip} slip": f"slip_force_N.{slip}" for slip in ("central", "terminal")}
    if pair.tip == "held":
        named["fingertip"] = "fingertip_magnitude_N"
    for name, quantity in named.items():
        gap = _change(pair, quantity)
        if gap is not None and abs(gap) >= LEAST_FORCE:
            values = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
            before, after = (number(v or 0.0, 3) for v in values)
            out.append(f"{name} {before} N, then {after} N")
    return out


def limit_sentences(pairs: Sequence[RunPair]) -> Iterator[str]:
    """What is to be known first of a free finger whose joints limits hold, before or after."""
    for pair in (pair for pair in pairs if pair.tip == "free"):
        sides = [run.summary.get("joints_at_limit", {}) for run in (pair.before, pair.after)]
        stopped = [j.replace("_", " ") for j in dict.fromkeys([*sides[0], *sides[1]])]
        if stopped:
            yield (
                f"The finger with its fingertip free stands at its limits ({', '.join(stopped)}): "
                "there they bear what a lesion changes, and next to nothing moves. They lie "
                "finger.limit.half_range about the posture; a finger that is free to move has wide "
                'ones, as extends = "base/lesion.toml" gives it.'
            )


def lesion_page(
    title: str, lesion: Sequence[str], marked: Sequence[str], pairs: Sequence[RunPair]
) -> str:
    """The whole page; `lesion` in words, `marked` the names of regions that the maps frame."""
    seen = [(pair, view_of(pair.before), view_of(pair.after)) for pair in pairs]
    arrows = [arrow for pair in pairs if pair.tip == "held" for arrow in _arrows(pair)]
    maps, bar = _maps(seen, marked)
    return template("cosim.report", "lesion.html.j2", {"cell": cell}).render(
        words=words,
        title=title,
        lesion=lesion,
        pairs=pairs,
        limits=list(limit_sentences(pairs)),
        changes=lesion_sentences(pairs),
        tables=tables_of_lesion(pairs),
        question=words.question(pairs[0].after),
        postures=[(p, postures(a, b)) for p, a, b in seen if a.bones and b.bones],
        maps=maps,
        bar=bar,
        arrows=arrows,
        plane=drawings.sagittal(arrows) if arrows else "",
        style=own_file("page.css"),
    )


def _arrows(pair: RunPair) -> list[drawings.Arrow]:
    """The fingertip's forces in the sagittal plane, in the postures' colours."""
    sides = (("before", pair.before, BEFORE), ("after", pair.after, AFTER))
    found = [
        (f"{side}, {label}", tip, ink, drawings.DOTTED if place == drawings.REST else ())
        for side, run, ink in sides
        for place, label, tip in drawings.states_of(run)
        if place != drawings.LESS
    ]
    arrows = [drawings.Arrow(drawings.letter(i), *one) for i, one in enumerate(found)]
    return arrows if any(arrow.magnitude > drawings.LEAST for arrow in arrows) else []


def _maps(
    seen: Sequence[tuple[RunPair, View, View]], marked: Sequence[str]
) -> tuple[list[Map], str]:
    """All maps of strain along the fibres on one scale, and the scale; none without sheets."""
    views = [view for _, a, b in seen for view in (a, b)]
    fields = [f for v in views if v.sheet is not None for f in v.sheet.fields if f.key == FIELD]
    if len(fields) < len(views):
        return [], ""
    scale, inks, out = limits(views)[FIELD], colours(), []
    for pair, *both in seen:
        for side, run, view in zip(
            ("before", "after"), (pair.before, pair.after), both, strict=True
        ):
            first, sheet = both[0].sheet, view.sheet
            assert first is not None  # every view has a field, so a sheet
            assert sheet is not None
            flat = same_layout(sheet, _lay_out(run), first, _lay_out(pair.before))
            field = next(f for f in sheet.fields if f.key == FIELD)
            drawn = strain_map(sheet, flat, field, scale, inks, marked)
            out.append(Map(f"{side}, fingertip {pair.tip}", drawn))
    return out, colour_bar(fields[0], scale, inks)


def _lay_out(run: Result) -> Array:
    hood = run.hood
    assert hood is not None  # its sheet was drawn
    return hood.points - hood.point_data["displacement"]


SLICES = 28
"""Slices of a bone along its axis, for its outline."""
WIDE, MARGIN = 760.0, 14.0
BEFORE, AFTER, MARK = "#8a949c", "#00446b", "#c2410c"
SAME_PLACE = 1e-7
"""m."""
Place = Callable[[Array], Array]


def outline(bone: BoneSurface, frame: int) -> Array:
    """(k, 2) m distal and dorsal: the bone's contour in its own sagittal plane, where it stands."""
    v = bone.vertices
    edges = np.linspace(v[:, 0].min(), v[:, 0].max(), SLICES + 1)
    which = np.clip(np.searchsorted(edges, v[:, 0], side="right") - 1, 0, SLICES - 1)
    upper, lower = [], []
    for i in range(SLICES):
        here = v[which == i]
        if len(here):
            upper.append(here[here[:, 2].argmax()])
            lower.append(here[here[:, 2].argmin()])
    ends = v[v[:, 0].argmax()], v[v[:, 0].argmin()]
    local = np.array([*upper, ends[0], *reversed(lower), ends[1]]) * [1.0, 0.0, 1.0]
    placed = local @ bone.rotation[frame].T + bone.position[frame]
    return placed[:, [0, 2]]


def postures(before: View, after: View) -> str:
    """Both fingers in their last frames, seen from the radial side: distal to the left, dorsal up;
    before in grey, dashed, and after in blue with its hood."""
    shapes = [[outline(bone, -1) for bone in view.bones] for view in (before, after)]
    drawn = [p for shape in shapes for p in shape]
    drawn += [line for view in (before, after) for line in _hood(view)]
    at, tall = _fit_to_pixels(np.concatenate(drawn), WIDE)
    parts = []
    for view, shape, ink, dash in zip(
        (before, after), shapes, (BEFORE, AFTER), (' stroke-dasharray="5 3"', ""), strict=True
    ):
        fill = "#eef1f3" if dash else "#cfe0ea"
        parts += [
            f'<path d="{_path(at(p))}" fill="{fill}" fill-opacity=".55" stroke="{ink}" '
            f'stroke-width="1.4"{dash}/>'
            for p in shape
        ]
        parts += _lines(view, at, ink, dash)
    label = f"Postures: {before.name} dashed, {after.name} full"
    return _svg(parts, WIDE, tall, label)


def _hood(view: View) -> list[Array]:
    """(k, 2) m each, distal and dorsal: the quads of the hood, or its cables and the tendons."""
    if view.sheet is not None:
        return list(view.sheet.points[-1][view.sheet.quads][..., [0, 2]])
    return [np.asarray(path)[:, [0, 2]] for path in view.tendons[-1].values()]


def _lines(view: View, at: Place, ink: str, dash: str) -> list[str]:
    """The hood from the side."""
    closed = view.sheet is not None
    path = "".join(_path(at(line), close=closed) for line in _hood(view))
    fill = f'fill="{ink}" fill-opacity=".10"' if closed else 'fill="none"'
    faint, width = (".28", ".4") if closed else (".6", "1")
    dash = "" if closed else dash
    return [
        f'<path d="{path}" {fill} stroke="{ink}" stroke-opacity="{faint}" '
        f'stroke-width="{width}"{dash}/>'
    ]


def _fit_to_pixels(points: Array, width: float) -> tuple[Place, float]:
    """From (k, 2) m, distal and up, to pixels, distal to the left; and the drawing's height."""
    low, high = points.min(axis=0), points.max(axis=0)
    unit = (width - 2 * MARGIN) / float(high[0] - low[0])

    def at(p: Array) -> Array:
        return np.stack(
            [MARGIN + (high[0] - p[:, 0]) * unit, MARGIN + (high[1] - p[:, 1]) * unit], axis=1
        )

    return at, float(high[1] - low[1]) * unit + 2 * MARGIN


def _path(points: Array, close: bool = True) -> str:
    text = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f"M{text}{'Z' if close else ''}"


def _svg(parts: Sequence[str], wide: float, tall: float, label: str) -> str:
    return (
        f'<svg class="plane" viewBox="0 0 {wide:.0f} {tall:.0f}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def same_layout(sheet: Sheet, reference: Array, other: Sheet, theirs: Array) -> Array:
    """(n, 2) m: the flat places of `sheet`, whose nodes lie at `reference` (n, 3) as laid, taken
    from a sheet of which it is a part, with nodes `theirs`; its own where it is no part of it."""
    from scipy.spatial import cKDTree

    far, which = cKDTree(theirs).query(reference)
    return other.flat[which] if far.max() < SAME_PLACE else sheet.flat


def strain_map(
    sheet: Sheet,
    flat: Array,
    field: SheetField,
    scale: tuple[float, float],
    colours: Sequence[str],
    marked: Collection[str],
) -> str:
    """The sheet laid out flat at `flat` (n, 2) m, distal to the left and radial up, each quad in
    the colour of the field's last values; the regions `marked` are framed."""
    values = field.values[-1]
    share = np.clip((values - scale[0]) / (scale[1] - scale[0]), 0, 1)
    index = np.round(share * (len(colours) - 1)).astype(int)
    at, tall = _fit_to_pixels(flat, WIDE / 2)
    cells = [at(corners) for corners in flat[sheet.quads]]
    parts = [
        f'<path d="{_path(cell)}" fill="{colours[i]}" stroke="{colours[i]}" stroke-width=".3">'
        f"<title>{escape(name.replace('_', ' '))}: {value:.2f} {escape(field.unit)}</title></path>"
        for cell, i, name, value in zip(cells, index, sheet.region, values, strict=True)
    ]
    edges = _rim(sheet, marked)
    frame = "".join(_path(at(flat[edge]), close=False) for edge in edges)
    if frame:
        parts.append(f'<path d="{frame}" fill="none" stroke="{MARK}" stroke-width="1.8"/>')
    return _svg(parts, WIDE / 2, tall, f"{field.label}, {field.unit}")


def _rim(sheet: Sheet, marked: Collection[str]) -> np.ndarray:
    """(k, 2) edges that only one of the marked quads has."""
    quads = sheet.quads[np.isin(sheet.region, list(marked))]
    edges = np.sort(np.concatenate([quads[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1)
    found, count = np.unique(edges.reshape(-1, 2), axis=0, return_counts=True)
    return found[count == 1]


def colour_bar(field: SheetField, scale: tuple[float, float], colours: Sequence[str]) -> str:
    """The scale of colours with its ends and middle, below the maps."""
    n, wide = len(colours), 320.0
    step = wide / n
    parts = [
        f'<rect x="{20 + i * step:.2f}" y="4" width="{step + 0.3:.2f}" height="12" '
        f'fill="{colour}"/>'
        for i, colour in enumerate(colours)
    ]
    for share in (0.0, 0.5, 1.0):
        value = scale[0] + share * (scale[1] - scale[0])
        parts.append(
            f'<text x="{20 + share * wide:.1f}" y="31" text-anchor="middle">{value:.2f}</text>'
        )
    parts.append(
        f'<text x="{20 + wide / 2:.1f}" y="48" text-anchor="middle" class="what">'
        f"{escape(field.label)}, {escape(field.unit)}</text>"
    )
    return f'<svg class="bar" viewBox="0 0 360 54" aria-hidden="true">{"".join(parts)}</svg>'
