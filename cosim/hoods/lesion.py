"""What a case may say of injury and repair: parts cut, stuck to the bone, shorter or longer."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Table
from meshes.hood_mesh import REGIONS

LengthChange = Annotated[float, quantity(units.LENGTH, above="0 mm", most="5 mm")]

SLIPS = ("central_slip", "terminal_slip")
SUPPORTS = (
    *("sagittal_band_radial", "sagittal_band_ulnar"),
    *("retinacular_radial", "retinacular_ulnar"),
    *("ligament_radial", "ligament_ulnar"),
)
"""What springs stand for: a cut lets go of them, and takes away the sheet of a sagittal band."""
SHEET_SUPPORTS = ("oblique_retinacular_radial", "oblique_retinacular_ulnar", "dorsal_capsule")
"""The same, which only a sheet has."""
ACROSS = (
    *("lateral_band_radial", "lateral_band_ulnar"),
    *("central_band", "extensor_tendon_distal"),
    *("lateral_slip_radial", "lateral_slip_ulnar"),
)
"""Regions of a sheet that a cut parts across the fibres."""
THIN_SHEETS = (
    *("transverse_fibres_radial", "transverse_fibres_ulnar"),
    *("oblique_fibres_radial", "oblique_fibres_ulnar"),
    "triangular_ligament",
)
"""Regions of a sheet between its tendons, which a cut takes out whole."""
COURSES = (
    "central_band",
    *("lateral_band_radial", "lateral_band_ulnar"),
    *("lateral_slip_radial", "lateral_slip_ulnar"),
    *("medial_slip_radial", "medial_slip_ulnar"),
    *("hood_edge_radial", "hood_edge_ulnar"),
)
"""Cables of a net that run from end to end."""


@dataclass(frozen=True)
class Parts:
    """The names that each key of a lesion takes in a kind of hood."""

    cut: tuple[str, ...]
    adhere: tuple[str, ...]
    lengths: tuple[str, ...]
    """Of `shorten` and `lengthen`."""


OF_MESH: Mapping[str, Parts] = {
    "shell": Parts((*SLIPS, *SUPPORTS, *SHEET_SUPPORTS, *ACROSS, *THIN_SHEETS), REGIONS, REGIONS),
    "cable": Parts(
        (*SLIPS, *SUPPORTS, *COURSES, "extensor_tendon_distal", "triangular_ligament"),
        (*SLIPS, *COURSES),
        (*SLIPS, *COURSES),
    ),
    "two_band": Parts(SLIPS, (), SLIPS),
}


class Lesion(Table):
    """An injury of the hood, or its repair; before it the hood is as the case lays it.

    `cut`: a slip comes off its bone, a band of springs lets go, any other part is severed across
    its fibres (`meshes.severed` has the places).  `adhere`: a part grows onto the bone beneath it,
    where it was laid: each of its nodes is held there by `adhesion` (N/m, of the whole part) in
    every direction.  `shorten` and `lengthen`: how much shorter or longer a part is than the case
    says, m."""

    cut: tuple[str, ...] = ()
    adhere: tuple[str, ...] = ()
    shorten: dict[str, LengthChange] = Field(default_factory=dict)
    lengthen: dict[str, LengthChange] = Field(default_factory=dict)
    adhesion: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")] = 1e6
    """The thesis's stiffness of ligamentous adhesions to the proximal phalanx, 1000 N/mm."""

    @model_validator(mode="after")
    def _sound(self) -> Lesion:
        if not any(self.names().values()):
            raise fault(
                'says nothing; write for example cut = ["central_slip"], adhere = ["central_band"] '
                'or shorten = { terminal_slip = "1 mm" } (or lengthen), or leave the table out'
            )
        for key, names in (("cut", self.cut), ("adhere", self.adhere)):
            if twice := [name for name in names if names.count(name) > 1]:
                raise fault(f"{key}: names {twice[0]} twice")
        for word, changed in (("shortened", self.shorten), ("lengthened", self.lengthen)):
            if both := [name for name in self.cut if name in changed]:
                raise fault(f"{both[0]} is both cut and {word}; leave one of them")
        if both := [name for name in self.shorten if name in self.lengthen]:
            raise fault(f"{both[0]} is both shortened and lengthened; leave one of them")
        return self

    def names(self) -> dict[str, tuple[str, ...]]:
        """The parts that each key names."""
        return {
            "cut": self.cut,
            "adhere": self.adhere,
            "shorten": tuple(self.shorten),
            "lengthen": tuple(self.lengthen),
        }

    def length_changes(self) -> dict[str, float]:
        """m by part, how much longer it is than the case says; negative where it is shorter."""
        return {name: -less for name, less in self.shorten.items()} | self.lengthen


def idle_cut(lesion: Lesion, springs: Collection[str]) -> str:
    """What is wrong with a lesion that cuts springs of a sheet which `springs`, the sets that its
    case gives a stiffness, do not name; empty where nothing is."""
    for name in lesion.cut:
        if name in SHEET_SUPPORTS and name not in springs:
            return (
                f"lesion.cut: the hood has no {name} to cut; give hood.springs.{name} a stiffness "
                "and a slack, or leave it out"
            )
    return ""


def lesion_fault(lesion: Lesion, kind: str, connecting: Sequence[str], reduced: bool) -> str:
    """What is wrong with a lesion of a hood of that kind, whose connecting tendons (of a network)
    are named so; empty where nothing is."""
    known = OF_MESH.get(kind)
    if kind == "network" and not reduced:
        tendons = (*SLIPS, *connecting)
        known = Parts(tendons, (), tendons)
    if known is None:
        what = "a reduced network" if reduced else f'a hood of kind "{kind}"'
        return f"lesion: {what} has no parts to injure; {', '.join((*OF_MESH, 'network'))} have"
    for key, names in lesion.names().items():
        allowed = {"cut": known.cut, "adhere": known.adhere}.get(key, known.lengths)
        for name in names:
            if name not in allowed:
                return f"lesion.{key}: {_unknown(name, kind, allowed)}"
    return ""


def _unknown(name: str, kind: str, allowed: Sequence[str]) -> str:
    if not allowed:
        return f'a hood of kind "{kind}" lies on no bone; "shell" and "cable" do'
    near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return f'no part {name[:60]!r} of a hood of kind "{kind}"; {hint}known: {", ".join(allowed)}'
