"""What a case may say of a hood of cables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import PostureConfig
from cosim.hoods.kind import HoodConfig, HoodKind
from cosim.hoods.lesion import SLIPS, SUPPORTS, InjurableParts
from cosim.hoods.supports import ContactConfig, SpringConfig
from cosim.hoods.view import Colour
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import ExtraLength, Modulus, Number, Section, Table
from meshes.cable_net import CABLES
from meshes.hood_mesh import SPRINGS

COURSES = (
    "central_band",
    *("lateral_band_radial", "lateral_band_ulnar"),
    *("lateral_slip_radial", "lateral_slip_ulnar"),
    *("medial_slip_radial", "medial_slip_ulnar"),
    *("hood_edge_radial", "hood_edge_ulnar"),
)
"""Cables that run from end to end."""
PARTS = InjurableParts(
    (*SLIPS, *SUPPORTS, *COURSES, "extensor_tendon_distal", "triangular_ligament"),
    (*SLIPS, *COURSES),
    (*SLIPS, *COURSES),
)


class CableConfig(Table):
    """A cable, or each of its kind on either side and in each row: cross-section, tangent modulus
    beyond the toe, and how much longer than laid out it is, m."""

    section: Section
    """Cross-section of each cable of this name."""
    modulus: Modulus
    """Tangent modulus beyond the toe."""
    extra_length: ExtraLength = 0.0
    """How much longer than laid out; negative: shorter."""


class CableMeshConfig(Table):
    """Our own net, laid out on the bones in `rest_posture`, where it is free of stress but for the
    residual tension, in cells of about `spacing`, m."""

    spacing: Annotated[float, quantity(units.LENGTH, least="0.3 mm", most="5 mm")]
    """Size of a cell, about."""
    rest_posture: PostureConfig
    """Posture in which the net is laid out, free of stress but for the residual tension."""


ENDS = {
    "index": {"EDC": "central", "EI": "indicis", "LUM": "radial", "FPI": "ulnar"},
    "robot": {"extensor": "central"},
}
"""By finger, the tendons that act through the net and the ends that they pull."""


class CableHoodConfig(HoodConfig):
    """A net of cables that bear tension alone, over the bones: the tendinous rhombus.  The law of
    each is quadratic up to the strain `toe`, then straight; `residual_tension` (N) beside it keeps
    slack cables from being mechanisms.  `contact.offset` is where their centre lines touch."""

    title: ClassVar[str] = "a net of cables that bear tension alone, over the bones"
    fits: ClassVar[tuple[str, ...]] = ("index", "robot")
    lies_on_bones: ClassVar[bool] = True
    needs_no_tension: ClassVar[bool] = False
    can_be_injured: ClassVar[bool] = True
    rungs: ClassVar[Mapping[str, str]] = {"cable": "base/cable"}
    example: ClassVar[tuple[str, ...]] = (
        "cable_edc",
        'hood.mesh.spacing="3 mm"',
        "solve.hood_tolerance=1e-12",
    )
    kind: Literal["cable"]
    mesh: CableMeshConfig
    """How the net is laid out."""
    cables: dict[Annotated[str, name_of("cable", CABLES)], CableConfig]
    """Cross-section and modulus by cable."""
    toe: Annotated[Number, Field(gt=0, le=0.2)]
    """Strain up to which the tension is quadratic."""
    residual_tension: Annotated[float, quantity(units.FORCE, least="1e-4 N", most="1 N")]
    """Tension of a slack cable, which keeps the net from being a mechanism."""
    contact: ContactConfig
    """Contact with the bones."""
    springs: dict[Annotated[str, name_of("spring set", SPRINGS)], SpringConfig]
    """What holds the net beside its insertions, by set."""

    @model_validator(mode="after")
    def _complete(self) -> CableHoodConfig:
        if lacking := [name for name in CABLES if name not in self.cables]:
            raise fault(f"cables: the net also has {', '.join(lacking)}; name them")
        return self

    @property
    def has_friction(self) -> bool:
        return self.contact.friction > 0

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return tuple(ENDS.get(finger, ()))

    def parts(self) -> InjurableParts:
        return PARTS


COLOURS = (
    Colour(
        key="cable_tension",
        label="Tension of the cables",
        unit="N",
        in_results=("cable_tension", None),
        factor=1.0,
        on_mesh="tension",
        mesh_factor=1.0,
        on_lines=True,
    ),
    Colour(
        key="cable_strain",
        label="Engineering strain of the cables, end to end",
        unit="%",
        in_results=("cable_strain", None),
        factor=100.0,
        on_mesh="end_to_end_strain",
        mesh_factor=100.0,
        is_signed=True,
        on_lines=True,
    ),
)
KIND = HoodKind(CableHoodConfig, "cosim.hoods.cable.build:BUILDER", COLOURS)
