"""What the tables of a case share: their base and the values that they state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

from cosim.files import MB
from cosim.schema import units
from cosim.schema.fields import existing_file, fault, name_of, quantity
from meshes.skeleton import BODIES

MUSCLES = (
    *("EDC", "EI", "EDM", "LUM", "FPI", "RI", "RIp", "UI", "ADM", "ADMp"),
    *("FDP", "FDS", "FDIm", "FDIl"),
)
OF_ROBOT = (
    "extensor",
    "dip_flexor",
    "pip_flexor",
    "abduction",
    "adduction",
    "second_extensor",
)
MOST_SURFACE = 64 * MB
"""The largest file of a bone: some 1.3 million triangles of a binary STL."""
TENDONS = MUSCLES + OF_ROBOT

Phalanx = Annotated[float, quantity(units.LENGTH, above="0 mm", most="200 mm")]
Mass = Annotated[float, quantity(units.MASS, above="0 g", most="10 kg")]
Inertia = Annotated[float, quantity(units.INERTIA, above="0 kg*mm**2", most="1 kg*m**2")]
COORDINATE = quantity(units.LENGTH, least="-200 mm", most="200 mm")
Coordinate = Annotated[float, COORDINATE]
Force = Annotated[float, quantity(units.FORCE, least="0 N", most="1000 N")]
Acceleration = Annotated[
    float, quantity(units.ACCELERATION, least="-100 m/s**2", most="100 m/s**2")
]
Thickness = Annotated[float, quantity(units.LENGTH, above="0 mm", most="5 mm")]
Modulus = Annotated[float, quantity(units.PRESSURE, above="0 MPa", most="100 GPa")]
BendingStiffness = Annotated[float, quantity(units.TORQUE, least="0 N*mm", most="100 N*mm")]
Section = Annotated[float, quantity(units.AREA, above="0 mm**2", most="100 mm**2")]
Gap = Annotated[float, quantity(units.LENGTH, above="0 mm", most="1 mm")]
Offset = Annotated[float, quantity(units.LENGTH, least="0 mm", most="10 mm")]
ExtraLength = Annotated[float, quantity(units.LENGTH, least="-3 mm", most="5 mm")]
# Joint ranges: Xu et al. 2012, Design of an anthropomorphic robotic finger system, table II.
McpAngle = Annotated[float, quantity(units.ANGLE, least="-30 deg", most="90 deg")]
AbductionAngle = Annotated[float, quantity(units.ANGLE, least="-35 deg", most="35 deg")]
PipAngle = Annotated[float, quantity(units.ANGLE, least="0 deg", most="110 deg")]
DipAngle = Annotated[float, quantity(units.ANGLE, least="0 deg", most="70 deg")]
File = Annotated[Path, existing_file(256 * MB)]
SurfaceFile = Annotated[Path, existing_file(MOST_SURFACE)]
ArchiveFile = Annotated[Path, existing_file(1024 * MB)]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Count = Annotated[int, Strict()]
Switch = Annotated[bool, Strict()]
TendonName = Annotated[str, name_of("tendon", TENDONS)]
BodyName = Annotated[str, name_of("body", BODIES)]


class Table(BaseModel):
    """A table of a case: frozen, unknown keys refused.  The text below a key is its description in
    the JSON Schema and in `cosim explain`."""

    model_config = ConfigDict(
        defer_build=True,
        frozen=True,
        extra="forbid",
        protected_namespaces=(),
        use_attribute_docstrings=True,
    )


class RegionConfig(Table):
    """What every region may say: its thickness, or the cross-section that thickness times the
    region's mean width makes, where it differs from the hood's; and `tension_field`, with which the
    sheet wrinkles instead of bearing compression in its plane."""

    thickness: Thickness | None = None
    """Thickness of the region; without it the hood's."""
    section: Section | None = None
    """Cross-section that thickness times mean width makes, in place of `thickness`."""
    tension_field: Switch = False
    """The sheet wrinkles instead of bearing compression in its plane."""

    @property
    def fibrous(self) -> Any:
        """The region as one with fibres; None for a region without."""
        return None

    @property
    def slides(self) -> bool:
        """Whether the region has fibres that slide on each other."""
        return False

    @model_validator(mode="after")
    def _one_way(self) -> RegionConfig:
        if self.thickness is not None and self.section is not None:
            raise fault("gives both thickness and section; write one of them")
        return self
