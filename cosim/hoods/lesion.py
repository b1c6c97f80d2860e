"""What a case may say of injury and repair: parts cut, stuck to the bone, shorter or longer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Annotated

from pydantic import Field, model_validator

from cosim.errors import first_twice
from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import BodyName, Coordinate, Table
from meshes.cable_net import CableNet
from meshes.hood_mesh import HoodMesh
from meshes.severed import cut_net, cut_part, cut_part_of

Share = Annotated[float, Field(gt=0.0, lt=1.0)]
LengthChange = Annotated[float, quantity(units.LENGTH, above="0 mm", most="5 mm")]

SLIPS = ("central_slip", "terminal_slip")
GRAFT_NAME = r"^[a-z][a-z0-9_]{0,30}$"
SUPPORTS = (
    *("sagittal_band_radial", "sagittal_band_ulnar"),
    *("retinacular_radial", "retinacular_ulnar"),
    *("ligament_radial", "ligament_ulnar"),
)
"""What springs stand for: a cut lets go of them, and takes away the sheet of a sagittal band."""


@dataclass(frozen=True)
class InjurableParts:
    """The names that each key of a lesion takes in a kind of hood."""

    cut: tuple[str, ...]
    adhere: tuple[str, ...]
    lengths: tuple[str, ...]
    """Parts that `shorten` and `lengthen` may name."""
    cut_partly: tuple[str, ...] = ()
    joined: tuple[str, ...] = ()
    """Parts whose ends a suture joins, and that a graft may run to."""


Stiffness = Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e5 N/mm")]


class SutureConfig(Table):
    """What joins the ends of a part that is cut, a slip to its bone; it bears tension alone."""

    stiffness: Stiffness
    """The whole suture's."""
    gap: Annotated[float, quantity(units.LENGTH, least="0 mm", most="10 mm")] = 0.0
    """How far the ends part before it bears anything."""


class GraftConfig(Table):
    """A strand from a part of the hood to a bone or to another part; it bears tension alone."""

    start: str
    """The part of the hood, which it holds in its middle or where that is cut by `lesion.cut`."""
    end: str | None = None
    """A part of the hood; or write bone and at."""
    bone: BodyName | None = None
    """The bone that it ends on."""
    at: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Where on it: distal, radial and dorsal of its proximal joint (of the metacarpal: its distal
    one), along its own axes."""
    stiffness: Stiffness
    """The whole graft's: its modulus times its section over its length."""
    slack: Annotated[float, quantity(units.LENGTH, least="-10 mm", most="10 mm")] = 0.0
    """How much longer it is than its way in the hood as laid; negative where it is drawn taut."""

    @model_validator(mode="after")
    def _one_end(self) -> GraftConfig:
        if (self.bone is None) != (self.at is None) or (self.end is None) == (self.bone is None):
            raise fault("has one end: write end, a part of the hood, or bone and at")
        return self


class LesionConfig(Table):
    """An injury of the hood, or its repair; before it the hood is as the case lays it.

    `cut`: a slip comes off its bone, a band of springs lets go, any other part is severed across
    its fibres (`meshes.severed` has the places).  `adhere`: a part grows onto the bone beneath it,
    where it was laid: each of its nodes is held there by `adhesion` (N/m, of the whole part) in
    every direction.  `shorten` and `lengthen`: how much shorter or longer a part is than the case
    says, m.  `suture` and `graft`: what a surgeon joins, with springs that bear tension alone."""

    cut: tuple[str, ...] = ()
    """Parts that are severed, or that come off their bone."""
    cut_partly: dict[str, Share] = Field(default_factory=dict)
    """The share of a part's width that is severed across its fibres, from the radial side."""
    adhere: tuple[str, ...] = ()
    """Parts that grow onto the bone beneath them."""
    shorten: dict[str, LengthChange] = Field(default_factory=dict)
    """How much shorter a part is than the case says."""
    lengthen: dict[str, LengthChange] = Field(default_factory=dict)
    """How much longer a part is than the case says."""
    suture: dict[str, SutureConfig] = Field(default_factory=dict)
    """What joins the ends of a part that is cut, by part."""
    graft: dict[Annotated[str, Field(pattern=GRAFT_NAME)], GraftConfig] = Field(
        default_factory=dict
    )
    """Strands that are laid in, by a name of the user's."""
    adhesion: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")] = 1e6
    """The thesis's stiffness of ligamentous adhesions to the proximal phalanx, 1000 N/mm."""

    @model_validator(mode="after")
    def _check_parts(self) -> LesionConfig:
        if not any(self.names().values()):
            raise fault(
                'is empty; write for example cut = ["central_slip"], adhere = ["central_band"] '
                'or shorten = { terminal_slip = "1 mm" } (or lengthen), or leave the table out'
            )
        for key, names in (("cut", self.cut), ("adhere", self.adhere)):
            if twice := first_twice(names):
                raise fault(f"{key}: names {twice} twice")
        for word, changed in (("shortened", self.shorten), ("lengthened", self.lengthen)):
            if both := [name for name in self.cut if name in changed]:
                raise fault(f"{both[0]} is both cut and {word}; leave one of them")
        if both := [name for name in self.cut if name in self.cut_partly]:
            raise fault(f"{both[0]} is both cut and cut_partly; leave one of them")
        if whole := [name for name in self.suture if name not in self.cut]:
            raise fault(f'suture: {whole[0]} is not cut; write cut = ["{whole[0]}"] too')
        if both := [name for name in self.shorten if name in self.lengthen]:
            raise fault(f"{both[0]} is both shortened and lengthened; leave one of them")
        return self

    def names(self) -> dict[str, tuple[str, ...]]:
        """The parts that each key names."""
        return {
            "cut": self.cut,
            "cut_partly": tuple(self.cut_partly),
            "adhere": self.adhere,
            "shorten": tuple(self.shorten),
            "lengthen": tuple(self.lengthen),
            "suture": tuple(self.suture),
            "graft": tuple(
                place
                for graft in self.graft.values()
                for place in (graft.start, graft.end)
                if place is not None
            ),
        }

    def length_changes(self) -> dict[str, float]:
        """How much longer (m) each part is than the case says; negative where it is shorter."""
        return {name: -less for name, less in self.shorten.items()} | self.lengthen


def apply_lesion_to_mesh(mesh: HoodMesh, lesion: LesionConfig | None) -> HoodMesh:
    """The mesh with all cuts made.  Raises InputError."""
    if lesion is None:
        return mesh
    partly = (partial(cut_part_of, part=part, share=s) for part, s in lesion.cut_partly.items())
    whole = (partial(cut_part, part=part) for part in lesion.cut)
    cut = reduce(lambda left, make: make(left), (*partly, *whole), mesh)
    return replace(cut, whole=mesh)


def apply_lesion_to_net(net: CableNet, lesion: LesionConfig | None) -> CableNet:
    """The net with all cuts made.  Raises InputError."""
    if lesion is None:
        return net
    return replace(reduce(cut_net, lesion.cut, net), whole=net)


def longer(extra: Mapping[str, float], lesion: LesionConfig | None) -> dict[str, float]:
    """How much longer (m) than laid each part is, with what a lesion adds to it or takes."""
    out = dict(extra)
    for name, more in (lesion.length_changes() if lesion else {}).items():
        out[name] = out.get(name, 0.0) + more
    return out
