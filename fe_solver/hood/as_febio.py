"""What a hood has and FEBio's format cannot say, each with what is written in its place."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion, Triangles
from fe_solver.elements.mesh_geometry import node_means
from fe_solver.febio.laws import needs_fibre, softer
from fe_solver.forces.contact import Contact
from fe_solver.hood.linear_contact import linear_contact, needs_linear
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.fibres import TransIsoMooneyRivlin
from fe_solver.sheet import Sheet, ShellPart
from fe_solver.solver.model import ShellModel

BULK = 2.2e9
"""Pa, of water, in place of an infinite bulk modulus."""
SHARE = 0.1
"""Of a hood's own bending stiffness, what is written as thickness: enough that a sheet which is
slack on the way does not crease; more would bring its fibres too far from its middle."""
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
    hood: ShellHood,
    solved: Callable[[], HoodState],
    heads: Collection[str],
    spacing: float = 0.25e-3,
) -> Replacements:
    """What is written in place of what FEBio's format cannot say; the equilibrium that is `solved`
    is asked for where contact is to be made straight about it, `heads` and `spacing` as of
    `linear_contact`.  What else there is no form for stays as it is, and is refused where the hood
    is made a job.  Raises InputError as `sheet_of` and `in_situ` do."""
    sheet, out = sheet_of(hood), []
    in_situ(sheet)  # what is refused, before anything is solved
    if any(p.sliding for p in sheet.parts):
        words = "fibres that do not slide: a shell bends as a solid"
        out.append(_of_parts("hood.regions.*.sliding_fibres", words, _solid))
    if any(p.bending.any() for p in sheet.parts):
        words = f"parts so thick that they bend with {100 * SHARE:g} % of it, and as much softer"
        out.append(Replacement("hood.bending_stiffness", words, thicker))
    if any(_with_bulk(p) is not p for p in sheet.parts):
        words = f"{1e-6 * BULK:g} MPa in place of an infinite one"
        out.append(_of_parts("hood.regions.*.bulk_modulus", words, _with_bulk))
    if sheet.fibre.ndim == 3 and any(needs_fibre(p.law) for p in sheet.parts):
        words = "one direction in each element"
        out.append(Replacement("fibres", words, _with_one_fibre))
    if np.ptp(sheet.thickness):
        words = "parts share their faces towards the bones, not their mid-surfaces"
        out.append(Replacement("thickness", words, on_faces))
    as_written = hood
    for r in out:
        as_written = r.apply(as_written)
    assert as_written.sheet is not None
    surfaces: Mapping[str, Triangles] = {}
    if needs_linear(hood, heads):
        contacts, surfaces = linear_contact(hood, solved(), heads, as_written.sheet, spacing)
        words = (
            f"{len(contacts)} penalties by place, straight about this equilibrium, on surfaces of "
            "equal energy of the tissue"
        )
        out.append(Replacement("hood.contact", words, lambda h: _with_contacts(h, contacts)))
    return Replacements(tuple(out), surfaces)


def sheet_of(hood: ShellHood) -> Sheet:
    """Return a hood's sheet.  Raises InputError where there is none, or of elements that FEBio's
    format has no shell for."""
    sheet = hood.sheet
    if sheet is None:
        raise InputError("a hood of cables is not written: FEBio's format is given shells alone")
    if sheet.quads.shape[1] != 4:
        raise InputError(
            "a hood of nine-node elements is not written, only one of four-node elements; set "
            'hood.mesh.elements to "linear"'
        )
    if sheet.left is not None:
        raise InputError(
            "a hood with a part that is cut partly is not written: no shell of FEBio's format has "
            "lost a share of its width; leave out lesion.cut_partly"
        )
    return sheet


def _of_parts(setting: str, words: str, change: Callable[[ShellPart], ShellPart]) -> Replacement:
    def apply(hood: ShellHood) -> ShellHood:
        assert hood.sheet is not None
        sheet = replace(hood.sheet, parts=tuple(change(p) for p in hood.sheet.parts))
        return with_sheet(hood, sheet)

    return Replacement(setting, words, apply)


def with_sheet(hood: ShellHood, sheet: Sheet) -> ShellHood:
    """The hood with the materials and fibres of another sheet through the same nodes."""
    bare = sheet.model(bodies=hood.bodies)
    model = replace(hood.model, section=bare.section, tables=bare.tables)
    return replace(hood, sheet=sheet, model=model)


def thicker(hood: ShellHood, share: float = SHARE) -> ShellHood:
    """The hood with no bending of its own, each part so thick that its matrix alone bends with a
    `share` of that, and as much softer: its membrane is the same."""
    sheet = hood.sheet
    assert sheet is not None
    parts, thickness = list(sheet.parts), np.array(sheet.thickness)
    for i, part in enumerate(parts):
        own = sheet.part == i
        h = float(thickness[own].mean()) if own.any() else 0.0
        if not part.bending.any() or not own.any():
            continue
        across = part.law.response(np.zeros((1, 1, 3))).tangent[0, 0, 1, 1]
        wanted = h * max(1.0, float(np.sqrt(share * part.bending[1, 1] / across)))
        parts[i] = replace(part, bending=np.zeros((3, 3)), law=softer(part.law, h / wanted))
        thickness[own] *= wanted / h
    return with_sheet(hood, replace(sheet, parts=tuple(parts), thickness=thickness))


def bones_lie_below(model: ShellModel, rest: Motion) -> bool:
    """Whether the directors point away from what the sheet touches."""
    total = 0.0
    for k in model.contacts:
        R = rest.rotation[k.body]
        slope = k.surface.distance(k.local(model.reference, rest.position, rest.rotation)).gradient
        total += float(np.vdot(slope @ R.T, model.directors[k.nodes]))
    return total > 0


def on_faces(hood: ShellHood) -> ShellHood:
    """The hood with elements that share their faces towards the bones where they meet, in place of
    their mid-surfaces."""
    sheet = hood.sheet
    assert sheet is not None
    half = np.broadcast_to(sheet.thickness.T, sheet.quads.T.shape).T / 2
    off = half - node_means(half, sheet.quads, len(sheet.points))[sheet.quads]
    away = 1 if bones_lie_below(hood.model, hood.rest) else -1
    return with_sheet(hood, replace(sheet, height=sheet.height + away * off))


def mean_fibre(sheet: Sheet) -> Array:
    """The mean fibre direction (ne, 3) of each element in its plane, whose senses say nothing."""
    along = sheet.model().tables.frame[:, :, 0]
    sense = np.einsum("egk,ek->eg", along, along[:, 0])
    mean = (along * np.where(sense < 0, -1.0, 1.0)[..., None]).mean(axis=1)
    return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def _with_one_fibre(hood: ShellHood) -> ShellHood:
    assert hood.sheet is not None
    return with_sheet(hood, replace(hood.sheet, fibre=mean_fibre(hood.sheet)))


def _with_contacts(hood: ShellHood, contacts: tuple[Contact, ...]) -> ShellHood:
    return replace(hood, model=replace(hood.model, contacts=contacts))


def _solid(part: ShellPart) -> ShellPart:
    return replace(part, sliding=False)


def _with_bulk(part: ShellPart) -> ShellPart:
    """The part with a finite bulk modulus; itself where it has one, or needs none."""

    def finite(law: Any) -> Any:
        return law if np.isfinite(getattr(law, "k", 0.0)).all() else replace(law, k=BULK)

    law: Any = part.law
    if isinstance(law, CrossedFibres):
        base = finite(law.base)
        return part if base is law.base else replace(part, law=replace(law, base=base))
    changed = finite(law)
    return part if changed is law else replace(part, law=changed)


def in_situ(sheet: Sheet) -> Sheet:
    """The sheet with a stretch in situ, along the fibres alone, in place of the growth of its
    parts: the same sheet.

    Raises InputError where a part grows across its fibres, or unevenly, or is of a law that FEBio
    has no such stretch for."""
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
        if type(part.law) is not TransIsoMooneyRivlin:
            raise InputError(
                f"the region {part.name!r} is longer than laid out, and FEBio's format says that "
                "of trans iso Mooney-Rivlin with one fibre family alone; set hood.extra_length."
                f'{part.name} to "0 mm"'
            )
        parts[i] = replace(part, in_situ_stretch=float(1 / (1 + grown[0, 0])), isochoric=False)
    return replace(sheet, parts=tuple(parts), growth=None)
