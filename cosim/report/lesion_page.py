"""The report of a lesion: one page of the finger before and after it, free and held.

Beside what the parts of a sheet carry stand their known strengths.  The collection of measurements
(`cosim.measured`) has what is in print, which is little: for most parts no ultimate load was found,
and the tables say so.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.measured import Measured, measured_of_kind
from cosim.port import Array
from cosim.report import drawings, words
from cosim.report.clinical_signs import Sign, clinical_signs
from cosim.report.templates import html_page
from cosim.report.views import BoneSurface, Sheet, SheetField, View, limits, view_of
from cosim.results.compare import number, unit_of, value_of
from cosim.results.looks import colour_map
from cosim.results.picture import new_picture, picture_address
from cosim.results.quantities import key_quantities
from cosim.results.result import Result
from cosim.results.table import Cell, ReportTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes


NOT_KNOWN = "no strength in print"


@dataclass(frozen=True)
class Strength:
    """What is known of a part: the least that it bears, N, and what the sources say."""

    bears: float | None
    says: str


def strength_of(quantity: str) -> Strength:
    """What is known of the part that carries a quantity of a summary."""
    _, _, part = quantity.rpartition(".")
    part = f"{part}_slip" if quantity.startswith("slip_force_N.") else part
    borne, asked = (
        [m for m in measured_of_kind(kind, measured=False) if m.of["part"] == part]
        for kind in ("strength", "demand")
    )
    least = [n for m in borne if (n := m.low if m.value is None else m.value) is not None]
    says = "; ".join(map(_words, (*borne, *asked)))
    return Strength(max(least, default=None), says or NOT_KNOWN)


def _words(m: Measured) -> str:
    size = f"{m.value:g}" if m.value is not None else f"at least {m.low:g}"
    n = f", n {m.n}" if m.n else ""
    return f"{size} {m.unit}: {m.note} ({m.cited.text}, {m.read}{n})"


def insertion_forces(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Label and quantity of the force in each insertion, region and set of springs of a sheet;
    nothing for a hood that is none."""
    if "region_force_N" not in summary:
        return
    for slip in summary.get("slip_force_N", ()):
        yield f"{slip} slip, insertion", f"slip_force_N.{slip}"
    for region in summary["region_force_N"]:
        yield f"{region.replace('_', ' ')}, middle", f"region_force_N.{region}"
    for springs in summary.get("spring_force_N", ()):
        if springs != "central_slip":  # the insertion above
            yield f"springs: {springs.replace('_', ' ')}", f"spring_force_N.{springs}"


FIELD = "along"
STRENGTH = "strength_"
"""What the keys of tables of parts beside their strengths begin with."""
LEAST_ANGLE, LEAST_FORCE = 0.05, 0.005
"""deg and N, below which a change is none worth telling."""


@dataclass(frozen=True)
class RunPair:
    """A case before and after a lesion, the fingertip `tip`: free or held."""

    tip: str
    before: Result
    after: Result


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
        f"{STRENGTH}{pair.tip}",
        f"Load against strength, fingertip {pair.tip}",
        ("part", "carries before, N", "carries after, N", "bears at least, N", "what is known"),
        tuple(rows),
    )


def fold(table: ReportTable, pairs: Sequence[RunPair]) -> tuple[ReportTable, ReportTable]:
    """The rows of a table that a page shows at first, and those that it folds: of parts without a
    strength in print, and what is none of the key quantities."""
    keys = {
        label
        for pair in pairs
        for run in (pair.before, pair.after)
        for label, _ in key_quantities(run.summary)
    }
    of_parts = table.key.startswith(STRENGTH)
    first = [row[-1] != NOT_KNOWN if of_parts else row[0] in keys for row in table.rows]
    shown, folded = (
        tuple(row for row, is_first in zip(table.rows, first, strict=True) if is_first == wanted)
        for wanted in (True, False)
    )
    title = "Parts of which no strength is in print" if of_parts else "Springs, regions and cables"
    return replace(table, rows=shown), replace(
        table, key=f"{table.key}_more", title=title, rows=folded
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
    quantities: dict[str, str] = {}
    for run in (pair.before, pair.after):
        s = run.summary
        pulled = [t for t, v in s.get("difference", {}).get("moment_arm_mm", {}).items() if v]
        quantities |= {f"excursion of {t}": f"excursion_mm.{t}" for t in pulled}
        if "tendon_shift_mm" in s:
            quantities["shift of the extensor tendon over the MCP, radially"] = "tendon_shift_mm"
        for name in s.get("spring_force_N", ()):
            quantities[f"force of springs: {name.replace('_', ' ')}"] = f"spring_force_N.{name}"
        for name in s.get("region_strain_percent", ()):
            where = f"region_strain_percent.{name}.longitudinal.mean"
            quantities[f"mean strain along, {name.replace('_', ' ')}"] = where
        for name in s.get("cable", ()):
            quantities[f"tension of {name.replace('_', ' ')}"] = f"cable.{name}.tension_N"
    return list(quantities.items())


def lesion_sentences(pairs: Sequence[RunPair]) -> list[str]:
    """What changed, a sentence for each pair."""
    out = []
    for pair in pairs:
        parts = [*_angles(pair), *_forces(pair)]
        changes = "; ".join(parts) if parts else "nothing changes that is worth telling"
        out.append(f"Fingertip {pair.tip}: {changes}.".replace("-", "−"))
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
        borne = [j for side in sides for j, at in side.items() if at["limit_torque_Nmm"]]
        stopped = [j.replace("_", " ") for j in dict.fromkeys(borne)]
        if stopped:
            yield (
                f"The finger with its fingertip free stands at its limits ({', '.join(stopped)}): "
                "there they bear what a lesion changes, and next to nothing moves. They lie "
                "finger.limit.half_range about the posture; a finger that is free to move has wide "
                'ones, as extends = "base/lesion.toml" gives it.'
            )


def signs_of(pairs: Sequence[RunPair]) -> list[Sign]:
    """What a surgeon would see of the finger with its fingertip free."""
    return [s for p in pairs if p.tip == "free" for s in clinical_signs(p.before, p.after)]


def lesion_page(
    title: str,
    lesion: Sequence[str],
    marked: Sequence[str],
    pairs: Sequence[RunPair],
    notes: Sequence[str] = (),
) -> str:
    """The whole page; `lesion` in words, `marked` the names of regions that the maps frame, `notes`
    what is said first."""
    seen = [(pair, view_of(pair.before), view_of(pair.after)) for pair in pairs]
    arrows = [arrow for pair in pairs if pair.tip == "held" for arrow in _arrows(pair)]
    return html_page(
        "lesion.html.j2",
        words=words,
        title=title,
        lesion=lesion,
        pairs=pairs,
        limits=[*notes, *limit_sentences(pairs)],
        signs=signs_of(pairs),
        changes=lesion_sentences(pairs),
        tables=[fold(table, pairs) for table in tables_of_lesion(pairs)],
        question=words.question(pairs[0].after),
        postures=[(p, postures(a, b)) for p, a, b in seen if a.bones and b.bones],
        maps=_maps(seen, marked),
        arrows=arrows,
        plane=drawings.plane(arrows) if arrows else "",
    )


def _arrows(pair: RunPair) -> list[drawings.Arrow]:
    """The fingertip's forces in the sagittal plane, in the postures' colours."""
    sides = (("before", pair.before, BEFORE), ("after", pair.after, AFTER))
    forces = [
        (f"{side}, {label}", tip, ink, drawings.DOTTED if place == drawings.REST else ())
        for side, run, ink in sides
        for place, label, tip in drawings.states_of(run)
        if place != drawings.LESS
    ]
    arrows = [drawings.Arrow(drawings.letter(i), *one) for i, one in enumerate(forces)]
    return arrows if any(arrow.magnitude > drawings.LEAST_FORCE for arrow in arrows) else []


def _maps(seen: Sequence[tuple[RunPair, View, View]], marked: Collection[str]) -> str:
    """All maps of strain along the fibres, as HTML; empty without sheets."""
    maps = []
    for pair, before, after in seen:
        for side, run, view in (("before", pair.before, before), ("after", pair.after, after)):
            if before.sheet is None or view.sheet is None:
                return ""
            field = next((f for f in view.sheet.fields if f.key == FIELD), None)
            if field is None:
                return ""
            flat = same_layout(view.sheet, _lay_out(run), before.sheet, _lay_out(pair.before))
            maps.append(StrainMap(f"{side}, fingertip {pair.tip}", view.sheet, flat, field))
    scale = limits([view for _, *both in seen for view in both])[FIELD]
    return draw_maps(maps, scale, marked)


def _lay_out(run: Result) -> Array:
    hood = run.hood
    assert hood is not None  # its sheet was drawn
    return hood.points - hood.point_data["displacement"]


PIXEL = 2e-4
"""m, of the grid on which a bone's silhouette is found."""
MARGIN = 4
"""Pixels about a bone; gaps narrower than twice that are closed."""
DPI = 150
WIDE = 8.0
"""Inches, of the page's pictures."""
BEFORE, AFTER, MARK = "#8a949c", "#00446b", "#c2410c"
SAME_PLACE = 1e-7
"""m."""


def outline(bone: BoneSurface, frame: int) -> Array:
    """The bone's silhouette (k, 2) m, distal and dorsal, seen from the radial side, where it
    stands: the longest contour around its triangles, on a grid of PIXEL."""
    from contourpy import contour_generator
    from scipy.ndimage import binary_closing, binary_fill_holes, gaussian_filter

    placed = bone.vertices @ bone.rotation[frame].T + bone.position[frame]
    seen = _fill(placed[:, [0, 2]][bone.faces])
    low = seen.min(axis=0) - MARGIN * PIXEL
    places = np.round((seen - low) / PIXEL).astype(int)
    mask = np.zeros(places.max(axis=0) + MARGIN + 1, dtype=bool)
    mask[tuple(places.T)] = True
    whole = binary_fill_holes(binary_closing(mask, iterations=MARGIN - 1))
    lines = contour_generator(z=gaussian_filter(whole.astype(float), 1.0).T).lines(0.5)
    return low + PIXEL * max(map(np.asarray, lines), key=len)


def _fill(triangles: Array) -> Array:
    """Points (k, 2) on triangles (n, 3, 2) m, nearer to each other than PIXEL."""
    sides = triangles - np.roll(triangles, 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    points = []
    for count in np.unique(parts := np.ceil(1.5 * longest / PIXEL).astype(int)):
        i, j = np.triu_indices(count + 1)
        weights = np.stack([i, j - i, count - j], axis=1) / max(count, 1)
        points.append((weights @ triangles[parts == count]).reshape(-1, 2))
    return np.concatenate(points)


def postures(before: View, after: View) -> str:
    """Both fingers in their last frames, as HTML, seen from the radial side: distal to the left,
    dorsal up; before in grey, dashed, and after in blue with its hood."""
    from matplotlib.collections import LineCollection, PolyCollection

    looks = ((before, BEFORE, "#eef1f3", "--"), (after, AFTER, "#cfe0ea", "-"))
    bones = [[outline(bone, -1) for bone in view.bones] for view in (before, after)]
    hoods = [_hood(view) for view in (before, after)]
    drawn = np.concatenate([line for lines in (*bones, *hoods) for line in lines])
    wide, tall = np.ptp(drawn, axis=0)
    picture = new_picture(WIDE, WIDE * float(tall / wide) + 0.2)
    axes = picture.subplots()
    for shapes, lines, (view, ink, fill, dash) in zip(bones, hoods, looks, strict=True):
        for shape in shapes:
            axes.fill(*shape.T, fc=(fill, 0.55), ec=ink, lw=1.1, ls=dash)
        if view.sheet is not None:
            quads = PolyCollection(lines, fc=(ink, 0.03), ec=(ink, 0.25), lw=0.35)
            axes.add_collection(quads)
        else:
            axes.add_collection(LineCollection(lines, colors=[(ink, 0.6)], lw=0.8, ls=dash))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.invert_xaxis()
    axes.axis("off")
    words = f"Postures: {before.name} dashed, {after.name} full"
    return f'<img alt="{escape(words)}" src="{picture_address(picture, DPI)}">'


def _hood(view: View) -> list[Array]:
    """The quads of the hood, or its cables and the tendons, (k, 2) m each, distal and dorsal."""
    if view.sheet is not None:
        return list(view.sheet.points[-1][view.sheet.quads][..., [0, 2]])
    return [np.asarray(path)[:, [0, 2]] for path in view.tendons[-1].values()]


def same_layout(sheet: Sheet, reference: Array, whole: Sheet, places: Array) -> Array:
    """The flat places (n, 2) m of `sheet`, whose nodes lie at `reference` (n, 3) as laid, taken
    from a sheet of which it is a part, with nodes `places`; its own where it is no part of it."""
    from scipy.spatial import cKDTree

    far, which = cKDTree(places).query(reference)
    return whole.flat[which] if far.max() < SAME_PLACE else sheet.flat


@dataclass(frozen=True)
class StrainMap:
    """A sheet laid out flat at `flat` (n, 2) m, coloured by the last values of a field."""

    title: str
    sheet: Sheet
    flat: Array
    field: SheetField


def draw_maps(
    maps: Sequence[StrainMap], scale: tuple[float, float], marked: Collection[str]
) -> str:
    """The maps on one scale of colours, as HTML, two in a row: distal to the left and radial up;
    the regions `marked` are framed.  Over each quad stands its region and value."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import ListedColormap

    colours = ListedColormap(colour_map(is_signed=True))
    extent = np.array([np.ptp(one.flat, axis=0) for one in maps]).max(axis=0)
    rows = (len(maps) + 1) // 2
    picture = new_picture(WIDE, rows * (0.5 * WIDE * float(extent[1] / extent[0]) + 0.3) + 0.7)
    panels = picture.subplots(rows, 2, squeeze=False).ravel()
    for axes, one in zip(panels, maps, strict=False):
        quads = PolyCollection(list(one.flat[one.sheet.quads]), cmap=colours, lw=0.3)
        quads.set(array=one.field.values[-1], clim=scale, edgecolor="face")
        axes.add_collection(quads)
        frame = list(one.flat[_rim(one.sheet, marked)])
        axes.add_collection(LineCollection(frame, colors=MARK, lw=1.5))
        axes.set_title(one.title, fontsize=10)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.invert_xaxis()
    for axes in panels:
        axes.axis("off")
    bar = picture.colorbar(
        quads, ax=list(panels), location="bottom", extend="both", aspect=50, shrink=0.5
    )
    bar.set_label(f"{one.field.label}, {one.field.unit}")
    address = picture_address(picture, DPI)
    words = f"{one.field.label}, {one.field.unit}"
    size = DPI * picture.get_size_inches()
    names = "".join(_names(axes, one, size[1]) for axes, one in zip(panels, maps, strict=False))
    return (
        f'<div class="titled"><img alt="{escape(words)}" src="{address}">'
        f'<svg role="group" aria-label="Strain maps" viewBox="0 0 {size[0]:.0f} {size[1]:.0f}">'
        f"{names}</svg></div>"
    )


def _names(axes: Axes, one: StrainMap, height: float) -> str:
    """Invisible shapes over the quads of a drawn map, each with its region and value."""
    corners = np.array([0.0, height]) + [1.0, -1.0] * axes.transData.transform(one.flat)
    shapes, parts = corners[one.sheet.quads], []
    for quad, region, value in zip(shapes, one.sheet.region, one.field.values[-1], strict=True):
        path = "L".join(f"{x:.0f} {y:.0f}" for x, y in quad)
        words = f"{region.replace('_', ' ')}: {value:.2f} {one.field.unit}"
        parts.append(f'<path d="M{path}Z"><title>{escape(words)}</title></path>')
    return f'<g aria-label="{escape(one.title)}">{"".join(parts)}</g>'


def _rim(sheet: Sheet, marked: Collection[str]) -> np.ndarray:
    """The edges (k, 2) that only one of the marked quads has."""
    quads = sheet.quads[np.isin(sheet.region, list(marked))]
    edges = np.sort(np.concatenate([quads[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1)
    distinct, count = np.unique(edges.reshape(-1, 2), axis=0, return_counts=True)
    return distinct[count == 1]
