"""What a case may say of injury and repair: what is cut, stuck to the bone or shortened."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator

from cosim import units
from cosim.case_fields import fault, quantity
from cosim.case_types import Table
from meshes.hood_mesh import REGIONS

Shortening = Annotated[float, quantity(units.LENGTH, above="0 mm", most="5 mm")]

SLIPS = ("central_slip", "terminal_slip")
SUPPORTS = (
    *("sagittal_band_radial", "sagittal_band_ulnar"),
    *("retinacular_radial", "retinacular_ulnar"),
    *("ligament_radial", "ligament_ulnar"),
)
"""What springs stand for: a cut lets go of them."""
ACROSS = (
    *("lateral_band_radial", "lateral_band_ulnar"),
    *("central_band", "extensor_tendon_distal"),
)
"""Regions of a sheet that a cut parts across the fibres."""
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
    shorten: tuple[str, ...]


OF_MESH: Mapping[str, Parts] = {
    "shell": Parts((*SLIPS, *SUPPORTS, *ACROSS), REGIONS, REGIONS),
    "cable": Parts(
        (*SLIPS, *SUPPORTS, *COURSES, "triangular_ligament"),
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
    every direction.  `shorten`: how much shorter a part is than the case says, m."""

    cut: tuple[str, ...] = ()
    adhere: tuple[str, ...] = ()
    shorten: dict[str, Shortening] = Field(default_factory=dict)
    adhesion: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")] = 1e6
    """The thesis's stiffness of ligamentous adhesions to the proximal phalanx, 1000 N/mm."""

    @model_validator(mode="after")
    def _sound(self) -> Lesion:
        if not (self.cut or self.adhere or self.shorten):
            raise fault(
                'says nothing; write for example cut = ["central_slip"], adhere = ["central_band"] '
                'or shorten = { terminal_slip = "1 mm" }, or leave the table out'
            )
        for key, names in (("cut", self.cut), ("adhere", self.adhere)):
            if twice := [name for name in names if names.count(name) > 1]:
                raise fault(f"{key}: names {twice[0]} twice")
        if both := [name for name in self.cut if name in self.shorten]:
            raise fault(f"{both[0]} is both cut and shortened; leave one of them")
        return self

    def names(self) -> dict[str, tuple[str, ...]]:
        """The parts that each key names."""
        return {"cut": self.cut, "adhere": self.adhere, "shorten": tuple(self.shorten)}


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
        allowed = {"cut": known.cut, "adhere": known.adhere, "shorten": known.shorten}[key]
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
