"""What a hood has and FEBio's format cannot say, each with what is written in its place."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Triangles
from fe_solver.hood.linear_contact import linear_contact
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.linear import Law
from fe_solver.sheet import Sheet, ShellPart

BULK = 2.2e9
"""Pa, of water, in place of an infinite bulk modulus."""
EVEN = 1e-9
"""Relative difference of growths that are one."""


@dataclass(frozen=True)
class Replacement:
    """Something of a hood in another form."""

    setting: str
    """What of the case it is."""
    words: str
    """What is written."""
    apply: Callable[[ShellHood], ShellHood]


@dataclass(frozen=True)
class Replacements:
    """All that a hood needs to be written."""

    each: tuple[Replacement, ...]
    surfaces: Mapping[str, Triangles]
    """By body, in its frame, what the hood touches in place of the bone."""

    def apply(self, hood: ShellHood) -> ShellHood:
        """The hood with all of them."""
        for r in self.each:
            hood = r.apply(hood)
        return hood


def replacements(
    hood: ShellHood, state: HoodState, heads: Collection[str], spacing: float = 0.5e-3
) -> Replacements:
    """What is written in place of what FEBio's format cannot say, for a hood in its solved `state`;
    `heads` and `spacing` as of `linear_contact`.  What there is no form for stays as it is, and is
    refused where the hood is made a job."""
    sheet, out = hood.sheet, []
    if sheet is None:
        return Replacements((), {})
    if any(p.sliding for p in sheet.parts):
        words = "fibres that do not slide: a shell bends as a solid"
        out.append(_of_parts("hood.regions.*.sliding_fibres", words, _solid))
    if any(p.bending.any() for p in sheet.parts):
        words = "none: a shell bends as its material does"
        out.append(_of_parts("hood.bending_stiffness", words, _without_bending))
    if any(_with_bulk(p) is not p for p in sheet.parts):
        words = f"{1e-6 * BULK:g} MPa in place of an infinite one"
        out.append(_of_parts("hood.regions.*.bulk_modulus", words, _with_bulk))
    contacts, surfaces = linear_contact(hood, state, heads, spacing)
    if surfaces:
        words = (
            f"{len(contacts)} penalties by place, straight about this equilibrium, on surfaces of "
            "equal energy of the tissue"
        )
        out.append(Replacement("hood.contact", words, lambda h: _with_contacts(h, contacts)))
    return Replacements(tuple(out), surfaces)


def _of_parts(setting: str, words: str, change: Callable[[ShellPart], ShellPart]) -> Replacement:
    def apply(hood: ShellHood) -> ShellHood:
        assert hood.sheet is not None
        sheet = replace(hood.sheet, parts=tuple(change(p) for p in hood.sheet.parts))
        return with_sheet(hood, sheet)

    return Replacement(setting, words, apply)


def with_sheet(hood: ShellHood, sheet: Sheet) -> ShellHood:
    """The hood with the materials of another sheet through the same nodes."""
    return replace(hood, sheet=sheet, model=replace(hood.model, section=sheet.section))


def _with_contacts(hood: ShellHood, contacts: tuple) -> ShellHood:  # type: ignore[type-arg]
    return replace(hood, model=replace(hood.model, contacts=contacts))


def _solid(part: ShellPart) -> ShellPart:
    return replace(part, sliding=False)


def _without_bending(part: ShellPart) -> ShellPart:
    return replace(part, bending=np.zeros((3, 3)))


def _with_bulk(part: ShellPart) -> ShellPart:
    """The part with a finite bulk modulus; itself where it has one, or needs none."""

    def finite(law: Law) -> Law:
        k = getattr(law, "k", 0.0)
        return law if np.isfinite(k).all() else replace(law, k=BULK)  # type: ignore[type-var]

    law = part.law
    if isinstance(law, CrossedFibres):
        base = finite(law.base)
        return part if base is law.base else replace(part, law=replace(law, base=base))
    changed = finite(law)  # type: ignore[arg-type]
    return part if changed is law else replace(part, law=changed)


def in_situ(sheet: Sheet) -> Sheet:
    """The sheet with a stretch in situ, along the fibres alone, in place of the growth of its
    parts: the same sheet.  Raises InputError where a part grows across its fibres, or unevenly."""
    if sheet.growth is None or not sheet.growth[sheet.stretch == 1.0].any():
        return sheet
    parts = list(sheet.parts)
    for i, part in enumerate(parts):
        grown = sheet.growth[sheet.part == i]
        if part.in_situ_stretch != 1.0 or not grown.any():
            continue
        if np.ptp(grown[:, 0]) > EVEN or grown[:, 1].any():
            raise InputError(
                f"the region {part.name!r} grows unevenly or across its fibres, which FEBio's "
                "format has no word for"
            )
        parts[i] = replace(part, in_situ_stretch=float(1 / (1 + grown[0, 0])), isochoric=False)
    return replace(sheet, parts=tuple(parts), growth=None)
