"""What a case may say of a hood of shell elements."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import Posture
from cosim.hoods.shell.fibre_table import Fibrous, SecondGasser, SecondLinear, SecondMooneyRivlin
from cosim.hoods.supports import Contact, Spring
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import (
    BendingStiffness,
    Count,
    ExtraLength,
    File,
    Modulus,
    Number,
    Region,
    Table,
    Thickness,
)
from meshes.hood_mesh import REGIONS, SPRINGS


class GeneratedMesh(Table):
    """Our own hood, laid out on the bones in `rest_posture`, where it is free of stress.  As
    "one_sheet" its wings reach the central slip's insertion, without a triangular ligament."""

    kind: Literal["generated"]
    quads: Annotated[Count, Field(ge=120, le=20000)]
    elements: Literal["linear", "quadratic"] = "linear"
    layout: Literal["anatomical", "one_sheet"] = "anatomical"
    rest_posture: Posture


class MeshFile(Table):
    """A hood mesh of the user's."""

    kind: Literal["file"]
    path: File


class Isotropic(Region):
    """Saint Venant-Kirchhoff."""

    kind: Literal["isotropic"]
    modulus: Modulus
    poisson: Annotated[Number, Field(ge=0, le=0.49)]


class TransverselyIsotropic(Fibrous):
    """Saint Venant-Kirchhoff with fibres: moduli along and across them, contraction across a pull
    along them (`poisson`) and in the plane across them (`poisson_across`), shear along them.  A
    `second` family adds its own modulus."""

    kind: Literal["transversely_isotropic"]
    modulus_along: Modulus
    modulus_across: Modulus
    shear_modulus: Modulus
    poisson: Annotated[Number, Field(ge=0, le=2)]
    poisson_across: Annotated[Number, Field(ge=0, le=0.99)]
    second: SecondLinear | None = None


class NeoHookean(Region):
    """Compressible, by its moduli at small strain."""

    kind: Literal["neo_hookean"]
    modulus: Modulus
    poisson: Annotated[Number, Field(ge=0, le=0.49)]


class FibreMooneyRivlin(Fibrous):
    """FEBio's `trans iso Mooney-Rivlin`: matrix c1, c2, fibres with an exponential toe c3 (exp(c4
    (l - 1)) - 1) up to the stretch lam_max, linear with c5 beyond; incompressible without a bulk
    modulus.  A `second` family has such numbers of its own."""

    kind: Literal["trans_iso_mooney_rivlin"]
    c1: Modulus
    c2: Annotated[float, quantity(units.PRESSURE, least="0 MPa", most="100 GPa")]
    c3: Modulus
    c4: Annotated[Number, Field(gt=0, le=600)]
    c5: Modulus
    lam_max: Annotated[Number, Field(gt=1, le=2)]
    bulk_modulus: Modulus | None = None
    second: SecondMooneyRivlin | None = None


class FibreGasser(Fibrous):
    """Holzapfel, Gasser and Ogden: matrix c, fibres k1, k2 dispersed by `dispersion` (0 aligned,
    1/3 isotropic) about the two directions at `angle` from the region's own; incompressible
    without a bulk modulus.  With a `second` family there is no `angle`: the first one lies in the
    region's direction, the second has its own direction and numbers."""

    kind: Literal["holzapfel_gasser_ogden"]
    c: Modulus
    k1: Modulus
    k2: Annotated[Number, Field(gt=0, le=1e4)]
    dispersion: Annotated[Number, Field(ge=0, le=0.3333)]
    angle: Annotated[float, quantity(units.ANGLE, least="0 deg", most="90 deg")] | None = None
    bulk_modulus: Modulus | None = None
    second: SecondGasser | None = None

    @model_validator(mode="after")
    def _families(self) -> FibreGasser:
        if (self.angle is None) == (self.second is None):
            raise fault(
                "write either angle (two families of the same numbers on both sides of the "
                "region's direction) or a table second (a second family of its own numbers)"
            )
        return self


Material = Annotated[
    Isotropic | TransverselyIsotropic | NeoHookean | FibreMooneyRivlin | FibreGasser,
    Field(discriminator="kind"),
]


class ExtraLengths(Table):
    """How much longer than laid out a slip is, m."""

    central_slip: ExtraLength = 0.0
    terminal_slip: ExtraLength = 0.0


class ShellHood(Table):
    """The shell finite-element hood.  `bending_stiffness` (N m, of a strip per its width): as if
    with a sheet, isotropic and incompressible, that acts in bending alone, beside what the regions'
    laws make."""

    kind: Literal["shell"]
    mesh: Annotated[GeneratedMesh | MeshFile, Field(discriminator="kind")]
    thickness: Thickness
    bending_stiffness: BendingStiffness = 0.0
    regions: dict[Annotated[str, name_of("region", REGIONS)], Material]
    contact: Contact
    extra_length: ExtraLengths = ExtraLengths()
    springs: dict[Annotated[str, name_of("spring set", SPRINGS)], Spring]

    @model_validator(mode="after")
    def _complete(self) -> ShellHood:
        lacking = [name for name in REGIONS if name not in self.regions]
        if self.mesh.kind == "generated" and self.mesh.layout == "one_sheet":
            lacking = [name for name in lacking if name != "triangular_ligament"]
        if lacking and self.mesh.kind == "generated":
            raise fault(f"regions: the generated mesh also has {', '.join(lacking)}; name them")
        return self
