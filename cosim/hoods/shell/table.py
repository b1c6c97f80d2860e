"""What a case may say of a hood of shell elements."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from cosim.errors import InputError, nearest_names
from cosim.fingers.common import PostureConfig, stamps
from cosim.hoods.kind import FINGERS, HoodConfig, kind_of
from cosim.hoods.lesion import SLIPS, SUPPORTS, InjurableParts, LesionConfig
from cosim.hoods.shell.fibre_table import (
    CurvedFibresConfig,
    FibrousConfig,
    SecondGasserConfig,
    SecondLinearConfig,
    SecondMooneyRivlinConfig,
)
from cosim.hoods.shell.point_table import GridConfig, check_names, read_points
from cosim.hoods.supports import ContactConfig, SpringConfig
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import (
    BendingStiffness,
    Coordinate,
    Count,
    ExtraLength,
    File,
    Modulus,
    Number,
    RegionConfig,
    Table,
    Thickness,
)
from meshes.hood_lines import fineness, quads_of
from meshes.hood_mesh import REGIONS, SPRINGS

SHEET_SUPPORTS = (
    *("oblique_retinacular_radial", "oblique_retinacular_ulnar"),
    *("dorsal_capsule", "loose_tissue"),
)
"""Supports that only a sheet has; a cut lets go of them."""
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
LACKING = {"one_sheet": ("triangular_ligament",)}
"""Regions that a layout does not have."""
MOST_NAMES = 20
"""Of points, that a message lists."""
PARTS = InjurableParts(
    (*SLIPS, *SUPPORTS, *SHEET_SUPPORTS, *ACROSS, *THIN_SHEETS), REGIONS, REGIONS, ACROSS
)


class GeneratedMeshConfig(Table):
    """Our own hood, laid out on the bones in `rest_posture`, where it is free of stress.  As
    "one_sheet" its wings reach the central slip's insertion, without a triangular ligament."""

    kind: Literal["generated"]
    quads: Annotated[Count, Field(ge=100, le=20000)]
    """Elements, about: rows and columns are whole multiples of the coarsest mesh's, which makes
    104, 416, 936, 1664, ... of four nodes."""
    elements: Literal["linear", "quadratic"] = "linear"
    """Four nodes ("linear") or nine ("quadratic")."""
    layout: Literal["anatomical", "one_sheet"] = "anatomical"
    """The regions: of the anatomical hood, or of one sheet without a triangular ligament."""
    rest_posture: PostureConfig
    """Posture in which the hood is laid out, free of stress."""

    @property
    def lacks(self) -> tuple[str, ...]:
        """Regions that this layout does not have."""
        return LACKING.get(self.layout, ())


class MeshFileConfig(Table):
    """A hood mesh of the user's."""

    kind: Literal["file"]
    path: File
    """A hood mesh: .json of `cosim export`, or as `cosim new` writes it."""


class IsotropicConfig(RegionConfig):
    """Saint Venant-Kirchhoff."""

    kind: Literal["isotropic"]
    modulus: Modulus
    """Young's modulus."""
    poisson: Annotated[Number, Field(ge=0, le=0.49)]
    """Poisson's ratio."""


class TransverselyIsotropicConfig(FibrousConfig):
    """Saint Venant-Kirchhoff with fibres: moduli along and across them, contraction across a pull
    along them (`poisson`) and in the plane across them (`poisson_across`), shear along them.  A
    `second` family adds its own modulus."""

    kind: Literal["transversely_isotropic"]
    modulus_along: Modulus
    """Young's modulus along the fibres."""
    modulus_across: Modulus
    """Young's modulus across the fibres."""
    shear_modulus: Modulus
    """Shear modulus along the fibres."""
    poisson: Annotated[Number, Field(ge=0, le=2)]
    """Contraction across a pull along the fibres."""
    poisson_across: Annotated[Number, Field(ge=0, le=0.99)]
    """Contraction in the plane across the fibres."""
    second: SecondLinearConfig | None = None
    """A second family, which adds its own modulus; without it there is one."""


class NeoHookeanConfig(RegionConfig):
    """Compressible, by its moduli at small strain."""

    kind: Literal["neo_hookean"]
    modulus: Modulus
    """Young's modulus at small strain."""
    poisson: Annotated[Number, Field(ge=0, le=0.49)]
    """Poisson's ratio at small strain."""


class FibreMooneyRivlinConfig(CurvedFibresConfig):
    """FEBio's `trans iso Mooney-Rivlin`: matrix c1, c2, fibres with an exponential toe c3 (exp(c4
    (l - 1)) - 1) up to the stretch lam_max, linear with c5 beyond; incompressible without a bulk
    modulus.  A `second` family has such numbers of its own."""

    kind: Literal["trans_iso_mooney_rivlin"]
    c1: Modulus
    """First coefficient of the Mooney-Rivlin matrix."""
    c2: Annotated[float, quantity(units.PRESSURE, least="0 MPa", most="100 GPa")]
    """Second coefficient of the Mooney-Rivlin matrix."""
    c3: Modulus
    """Factor of the exponential toe."""
    c4: Annotated[Number, Field(gt=0, le=600)]
    """Exponent of the toe."""
    c5: Modulus
    """Modulus of the straight fibres."""
    lam_max: Annotated[Number, Field(gt=1, le=2)]
    """Stretch at which the fibres are straight."""
    bulk_modulus: Modulus | None = None
    """Bulk modulus; without it the law is incompressible."""
    second: SecondMooneyRivlinConfig | None = None
    """A second family with numbers of its own; without it there is one."""


class FibreGasserConfig(CurvedFibresConfig):
    """Holzapfel, Gasser and Ogden: matrix c, fibres k1, k2 dispersed by `dispersion` (0 aligned,
    1/3 isotropic) about the two directions at `angle` from the region's own; incompressible
    without a bulk modulus.  With a `second` family there is no `angle`: the first one lies in the
    region's direction, the second has its own direction and numbers."""

    kind: Literal["holzapfel_gasser_ogden"]
    c: Modulus
    """Neo-Hookean coefficient of the matrix."""
    k1: Modulus
    """Stiffness of the fibres at small stretch."""
    k2: Annotated[Number, Field(gt=0, le=1e4)]
    """Exponent of the stiffening."""
    dispersion: Annotated[Number, Field(ge=0, le=0.3333)]
    """Spread of the fibres: 0 aligned, 1/3 isotropic."""
    angle: Annotated[float, quantity(units.ANGLE, least="0 deg", most="90 deg")] | None = None
    """Two families of the same numbers, at this angle on both sides of the region's direction."""
    bulk_modulus: Modulus | None = None
    """Bulk modulus; without it the law is incompressible."""
    second: SecondGasserConfig | None = None
    """A second family with numbers of its own, in place of `angle`."""

    @model_validator(mode="after")
    def _families(self) -> FibreGasserConfig:
        if (self.angle is None) == (self.second is None):
            raise fault(
                "write either angle (two families of the same numbers on both sides of the "
                "region's direction) or a table second (a second family of its own numbers)"
            )
        return self


MaterialConfig = Annotated[
    IsotropicConfig
    | TransverselyIsotropicConfig
    | NeoHookeanConfig
    | FibreMooneyRivlinConfig
    | FibreGasserConfig,
    Field(discriminator="kind"),
]


LAWS = {kind_of(table): table for table in get_args(get_args(MaterialConfig)[0])}
FIBRE_KEYS = tuple(
    key for key in CurvedFibresConfig.model_fields if key not in RegionConfig.model_fields
)


def region_keys(kind: object) -> list[str]:
    """The keys of a region under this kind of law that are not the law's: its thickness or section,
    and how its (first) fibres lie.  None for what is no law's kind.

    >>> region_keys("neo_hookean")
    ['thickness', 'section', 'tension_field']
    """
    keys = LAWS[str(kind)].model_fields if str(kind) in LAWS else ()
    return [key for key in CurvedFibresConfig.model_fields if key in keys and key != "second"]


class ExtraLengthsConfig(Table):
    """How much longer than laid out a slip is, m."""

    central_slip: ExtraLength = 0.0
    """Of the central slip; negative: shorter."""
    terminal_slip: ExtraLength = 0.0
    """Of the terminal slip; negative: shorter."""


class RetinaculumConfig(Table):
    """An eyelet of the metacarpal through which the extensors run, m from the MCP; their end hangs
    on ropes to there, as high as it was laid."""

    proximal: Annotated[float, quantity(units.LENGTH, least="30 mm", most="150 mm")]
    """Proximal of the MCP."""
    ulnar: Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")] = 0.0
    """Ulnar of the metacarpal's axis."""


WHOLE, ULNAR = (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)
PALMAR, DORSAL = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
# An et al. 1979: in the third to the fifth digit the lumbrical runs palmar of the interosseous.
WITH_TWO_INTEROSSEI = {
    "EDC": ("central", WHOLE),
    "LUM": ("radial", PALMAR),
    "RI": ("radial", DORSAL),
    "UI": ("ulnar", WHOLE),
}
ENDS = {
    "index": {
        "EDC": ("central", WHOLE),
        "EI": ("central", ULNAR),
        "LUM": ("radial", WHOLE),
        "FPI": ("ulnar", WHOLE),
    },
    "middle": WITH_TWO_INTEROSSEI,
    "ring": WITH_TWO_INTEROSSEI,
    # The extensor digiti minimi joins its common extensor from the ulnar side.
    "little": {
        "EDC": ("central", WHOLE),
        "EDM": ("central", ULNAR),
        "LUM": ("radial", PALMAR),
        "RI": ("radial", DORSAL),
        "ADM": ("ulnar", WHOLE),
    },
}
"""By finger, the tendons that act through the hood: the end that each one pulls, and of the half
that it pulls on which side that is (metacarpal's frame)."""


class ShellHoodConfig(HoodConfig):
    """The shell finite-element hood.  `bending_stiffness` (N m, of a strip per its width): as if
    with a sheet, isotropic and incompressible, that acts in bending alone, beside what the regions'
    laws make."""

    title: ClassVar[str] = "a sheet of nonlinear shell elements over the bones"
    fits: ClassVar[tuple[str, ...]] = FINGERS
    lies_on_bones: ClassVar[bool] = True
    needs_no_tension: ClassVar[bool] = False
    can_be_injured: ClassVar[bool] = True
    rungs: ClassVar[Mapping[str, str]] = {
        "isotropic shell": "base/isotropic_finger",
        "fibre shell": "base/index_finger",
    }
    example: ClassVar[tuple[str, ...]] = (
        "base/one_sheet.toml",
        "hood.mesh.quads=120",
        "solve.hood_tolerance=1e-11",
    )
    kind: Literal["shell"]
    mesh: Annotated[GeneratedMeshConfig | MeshFileConfig, Field(discriminator="kind")]
    """The mesh: generated, or a file."""
    thickness: Thickness
    """Thickness of the regions that have neither `thickness` nor `section` of their own; `cosim
    check` names them."""
    bending_stiffness: BendingStiffness = 0.0
    """Of a strip per its width, as if of a sheet that acts in bending alone, besides what the
    regions' laws make."""
    regions: dict[Annotated[str, name_of("region", REGIONS, also=("all",))], MaterialConfig]
    """Material by region; `all` is of every region, with a region's own keys on top."""
    contact: ContactConfig
    """Contact with the bones."""
    extra_length: ExtraLengthsConfig = ExtraLengthsConfig()
    """How much longer than laid out each slip is."""
    retinaculum: RetinaculumConfig | None = None
    """Where the extensors run under the retinaculum; without it their end slides on lines along the
    metacarpal and cannot slip sideways."""
    points: dict[str, tuple[Coordinate, Coordinate, Coordinate]] = Field(default_factory=dict)
    """Places on the undeformed hood (world axes, as it is laid), such as ink dots."""
    points_file: File | None = None
    """A CSV file of more points, with the columns name,distal_mm,radial_mm,dorsal_mm (or in m, cm,
    um)."""
    grids: dict[str, GridConfig] = Field(default_factory=dict)
    """Grids of points, for image correlation."""
    gauges: dict[str, tuple[str, str]] = Field(default_factory=dict)
    """Pairs of points by their names; the change of their distance is a strain."""
    springs: dict[Annotated[str, name_of("spring set", SPRINGS)], SpringConfig]
    """What holds the hood beside its insertions, by set."""

    @model_validator(mode="before")
    @classmethod
    def _spread_all(cls, values: Any) -> Any:
        """With `regions.all` in place of the regions that no file names; those that one names have
        it already (`cosim.case.layers`)."""
        match values:
            case {"regions": {"all": {**every}, **named}, "mesh": {**mesh}}:
                lacks = LACKING.get(str(mesh.get("layout")), ())
                left = {name: every for name in REGIONS if name not in (*lacks, *named)}
                return {**values, "regions": {**named, **left}}
            case {"regions": {"all": other}} if not hasattr(other, "keys"):
                raise fault("regions.all: must be a table, [hood.regions.all]")
        return values

    @model_validator(mode="after")
    def _points_have_names(self) -> ShellHoodConfig:
        try:
            listed = {} if self.points_file is None else read_points(self.points_file)
        except InputError as error:
            raise fault(f"points_file: {error}") from None
        of_grids = [name for grid, laid in self.grids.items() for name in laid.names(grid)]
        names = (*self.points, *listed, *of_grids)
        try:
            check_names(names)
        except ValueError as error:
            raise fault(f"points: {error}") from None
        self._check_gauges(names)
        return self

    def _check_gauges(self, names: Sequence[str]) -> None:
        for name, ends in self.gauges.items():
            for end in ends:
                if end not in names:
                    near = nearest_names(end, names)
                    hint = f"did you mean {near[0]}? " if near else ""
                    known = ", ".join(names[:MOST_NAMES]) or "none"
                    more = " ..." if len(names) > MOST_NAMES else ""
                    raise fault(f"gauges.{name}: no point {end!r}; {hint}known: {known}{more}")
            if ends[0] == ends[1]:
                raise fault(f"gauges.{name}: both ends are {ends[0]}")

    @model_validator(mode="after")
    def _complete(self) -> ShellHoodConfig:
        if self.mesh.kind == "file":
            return self
        needed = [name for name in REGIONS if name not in self.mesh.lacks]
        if lacking := [name for name in needed if name not in self.regions]:
            raise fault(f"regions: the generated mesh also has {', '.join(lacking)}; name them")
        return self

    @property
    def generated_quads(self) -> int | None:
        return self.mesh.quads if self.mesh.kind == "generated" else None

    @property
    def mesh_fineness(self) -> int | None:
        if self.mesh.kind == "file":
            return None
        return fineness(self.mesh.quads, self.mesh.elements == "quadratic")

    def mesh_values(self, fineness: int) -> dict[str, Any]:
        if self.mesh.kind == "file":
            return {}
        return {"hood.mesh.quads": quads_of(fineness, self.mesh.elements == "quadratic")}

    @property
    def has_smooth_tangent(self) -> bool:
        return self.contact.penetration is None and self.contact.friction == 0

    @property
    def has_friction(self) -> bool:
        return self.contact.friction > 0

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return tuple(ENDS.get(finger, ()))

    def parts(self) -> InjurableParts:
        return PARTS

    def cannot_be_injured(self, lesion: LesionConfig) -> str:
        """Springs that the case gives no stiffness cannot be cut."""
        for name in lesion.cut:
            if name in SHEET_SUPPORTS and name not in self.springs:
                return (
                    f"lesion.cut: the hood has no {name} to cut; give hood.springs.{name} a "
                    "stiffness and a slack, or leave it out"
                )
        return ""

    def files(self) -> tuple[Path, ...]:
        listed = () if self.points_file is None else (self.points_file,)
        return (*self._mesh_files(), *listed)

    def _mesh_files(self) -> tuple[Path, ...]:
        return (self.mesh.path,) if self.mesh.kind == "file" else ()

    def check_files(self) -> None:
        from meshes.hood_mesh import read

        for path in self._mesh_files():
            read(path)

    def mesh_key(self) -> str:
        parts = self.model_dump(mode="json", include={"mesh", "thickness"})
        level = self.contact.model_dump(include={"offset", "heads"})
        return json.dumps([parts, level, stamps(self._mesh_files())], sort_keys=True)

    def followers(self) -> Mapping[str, str]:
        stated = [n for n, r in self.regions.items() if r.thickness or r.section]
        names = [name for name in self.regions if name not in stated]
        those = ", ".join(names) if stated and names else "every region" if names else "no region"
        rest = f"; {len(stated)} have a thickness or section of their own" if stated else ""
        return {"hood.thickness": f"acts on {those}{rest}"}

    def laws(self, kind: str) -> Mapping[str, Any]:
        return {name: region for name, region in self.regions.items() if region.kind == kind}

    def rung(self) -> str:
        isotropic = all(region.kind == "isotropic" for region in self.regions.values())
        return "isotropic shell" if isotropic else "fibre shell"

    def on_finger(self, finger: str, laid: ShellHoodConfig | None) -> ShellHoodConfig:
        return self if laid is None else laid.model_copy(update={"regions": self.regions})
