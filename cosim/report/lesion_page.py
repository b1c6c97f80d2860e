"""The report of a lesion: one page of the finger before and after it, free and held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cosim.port import Array
from cosim.report import drawings, words
from cosim.report.lesion_drawings import (
    AFTER,
    BEFORE,
    colour_bar,
    postures,
    same_layout,
    strain_map,
)
from cosim.report.page import colours, own_file, templates
from cosim.report.strengths import carried, strength_of
from cosim.report.tables import Cell, Table, asked
from cosim.report.views import View, limits, view_of
from cosim.results.compare import number, unit_of, value_of
from cosim.results.result import Result

FIELD = "along"
LEAST_ANGLE, LEAST_FORCE = 0.05, 0.005
"""deg and N, below which a change is none worth telling."""


@dataclass(frozen=True)
class Pair:
    """A case before and after a lesion, the fingertip `tip`: free or held."""

    tip: str
    before: Result
    after: Result


@dataclass(frozen=True)
class Map:
    """A strain map and whose it is."""

    title: str
    drawing: str


def tables_of_lesion(pairs: Sequence[Pair]) -> list[Table]:
    """For each pair its numbers before, after and the difference, strains of regions too; and of a
    sheet what its parts carry beside what they are known to bear."""
    columns = ("quantity", "unit", "before", "after", "after less before")
    out = []
    for pair in pairs:
        out.append(Table(pair.tip, f"Fingertip {pair.tip}", columns, tuple(_rows(pair))))
        out.append(_load_and_strength(pair))
    return [table for table in out if table.rows]


def _load_and_strength(pair: Pair) -> Table:
    """What each part of a sheet carries; without rows of another hood."""
    labels = dict(p for run in (pair.after, pair.before) for p in carried(run.summary))
    rows: list[tuple[Cell, ...]] = []
    for label, quantity in labels.items():
        before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
        known = strength_of(quantity)
        rows.append((label, before, after, known.bears, known.says))
    return Table(
        f"strength_{pair.tip}",
        f"Load against strength, fingertip {pair.tip}",
        ("part", "carries before, N", "carries after, N", "bears at least, N", "what is known"),
        tuple(rows),
    )


def _rows(pair: Pair) -> list[tuple[Cell, ...]]:
    out: list[tuple[Cell, ...]] = []
    labels = dict(p for run in (pair.after, pair.before) for p in asked(run.summary))
    for label, quantity in (*labels.items(), *_more(pair)):
        if pair.tip == "free" and quantity.startswith("fingertip"):
            continue
        before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
        gap = None if before is None or after is None else after - before
        out.append((label, unit_of(quantity), before, after, gap))
    return out


def _more(pair: Pair) -> list[tuple[str, str]]:
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


def told_of_lesion(pairs: Sequence[Pair]) -> list[str]:
    """What changed, a sentence for each pair."""
    out = []
    for pair in pairs:
        parts = [*_angles(pair), *_forces(pair)]
        said = "; ".join(parts) if parts else "nothing changes that is worth telling"
        out.append(f"Fingertip {pair.tip}: {said}.".replace("-", "−"))
    return out


def _change(pair: Pair, quantity: str) -> float | None:
    before, after = (value_of(run.summary, quantity) for run in (pair.before, pair.after))
    return None if before is None or after is None else after - before


def _angles(pair: Pair) -> list[str]:
    out = []
    for joint in pair.after.summary.get("posture_deg", ()):
        gap = _change(pair, f"posture_deg.{joint}")
        if gap is not None and abs(gap) >= LEAST_ANGLE:
            more = ("radial", "ulnar") if joint.endswith("abduction") else ("flexed", "extended")
            name = joint.replace("_abduction", "")
            out.append(f"{name} {abs(gap):.1f}° more {more[0] if gap > 0 else more[1]}")
    return out


def _forces(pair: Pair) -> list[str]:
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


def lesion_page(
    title: str, lesion: Sequence[str], marked: Sequence[str], pairs: Sequence[Pair]
) -> str:
    """The whole page; `lesion` in words, `marked` the names of regions that the maps frame."""
    seen = [(pair, view_of(pair.before), view_of(pair.after)) for pair in pairs]
    arrows = [arrow for pair in pairs if pair.tip == "held" for arrow in _arrows(pair)]
    maps, bar = _maps(seen, marked)
    return (
        templates()
        .get_template("lesion.html.j2")
        .render(
            title=title,
            lesion=lesion,
            pairs=pairs,
            changes=told_of_lesion(pairs),
            tables=tables_of_lesion(pairs),
            question=words.question(pairs[0].after),
            postures=[(p, postures(a, b)) for p, a, b in seen if a.bones and b.bones],
            maps=maps,
            bar=bar,
            arrows=arrows,
            plane=drawings.sagittal(arrows) if arrows else "",
            style=own_file("page.css"),
        )
    )


def _arrows(pair: Pair) -> list[drawings.Arrow]:
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


def _maps(seen: Sequence[tuple[Pair, View, View]], marked: Sequence[str]) -> tuple[list[Map], str]:
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
            flat = same_layout(sheet, _laid(run), first, _laid(pair.before))
            field = next(f for f in sheet.fields if f.key == FIELD)
            drawn = strain_map(sheet, flat, field, scale, inks, marked)
            out.append(Map(f"{side}, fingertip {pair.tip}", drawn))
    return out, colour_bar(fields[0], scale, inks)


def _laid(run: Result) -> Array:
    hood = run.hood
    assert hood is not None  # its sheet was drawn
    return hood.points - hood.point_data["displacement"]
