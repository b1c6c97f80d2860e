"""What a case may say: its tables, names, units and ranges.  All values are SI once parsed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import (
    FmuFinger,
    HingeFinger,
    IndexFinger,
    MiddleFinger,
    PlanarFinger,
    Posture,
)
from cosim.fingers.robot import RobotFinger
from cosim.fmu.quantity import HOOD_QUANTITIES
from cosim.hoods.cable.table import CableHood
from cosim.hoods.lesion import Lesion, idle_cut, lesion_fault
from cosim.hoods.lumped.table import NetworkHood, TwoBandHood
from cosim.hoods.shell.fibre_table import Fibrous, SecondGasser, SecondLinear, SecondMooneyRivlin
from cosim.hoods.supports import Contact, Spring
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import (
    BendingStiffness,
    BodyName,
    Coordinate,
    Count,
    ExtraLength,
    File,
    Modulus,
    Number,
    Region,
    Switch,
    Table,
    TendonName,
    Thickness,
)
from cosim.tendons.table import Tendon
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


class PathPoint(Table):
    """A point fixed to a body, in its frame, m."""

    body: BodyName
    point: tuple[Coordinate, Coordinate, Coordinate]


class PulleyHood(Table):
    """Tendons as straight lines through points fixed to bodies."""

    kind: Literal["pulley"]
    paths: dict[TendonName, Annotated[tuple[PathPoint, ...], Field(min_length=2)]]


class FmuHood(Table):
    """A hood in an FMU of FMI 2 or 3, which is a program and runs as one.  `tendons` and `sources`
    name its own, in its order; `map` says, by quantity, how its variables are called where they are
    not called as in our own units; `rest_step` is a communication step in which it comes to rest,
    for one without the switch `static`."""

    kind: Literal["fmu"]
    path: File
    tendons: Annotated[tuple[TendonName, ...], Field(min_length=1)]
    sources: Annotated[tuple[str, ...], Field(min_length=1)]
    map: dict[Annotated[str, name_of("quantity", HOOD_QUANTITIES)], str] = Field(
        default_factory=dict
    )
    rest_step: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] | None = None
    assume_si: Switch = False


class SplitHood(Table):
    """No hood at all: tendons that part into strands of fixed shares, `central` of what enters the
    hood going to the central slip (equal parts in the normative model: An et al. 1979)."""

    kind: Literal["split"]
    central: Annotated[Number, Field(ge=0, le=1)] = 0.5


class Solve(Table):
    """Tolerances: of the coupling (relative residual) and of the hood's own equilibrium."""

    resting_tension: Annotated[float, quantity(units.FORCE, least="0 N", most="10 N")] = 0.05
    tolerance: Annotated[Number, Field(ge=1e-14, le=1e-2)] = 5e-7
    max_iterations: Annotated[Count, Field(ge=1, le=1000)] = 50
    hood_tolerance: Annotated[Number, Field(ge=1e-14, le=1e-2)] = 1e-10


class OneWay(Table):
    """What a one-way pass hands to the finger, and what acts there beside it.  As it stands: the
    hood's wrenches and nothing twice; `cases/base/thesis_one_way.toml` has the other choices."""

    lumping: Literal["bodies", "centre_of_mass"] = "bodies"
    """Wrenches where they act, or each phalanx's force alone at its centre of mass: no moment."""
    joint_contact: Literal["none", "distal", "proximal"] = "none"
    """The force that the joint at this end of each phalanx passes on while the bones stand still is
    handed over too: a bone's net reaction holds such forces, and the finger makes them itself."""
    muscles: Switch = True
    """The finger's own tendons pull."""
    passive: Switch = True
    """The finger's own passive joint torques act; its limits always do."""


class Coupling(Table):
    """How finger and hood come to agree.  Of an equilibrium: by Newton's method ("newton", which
    "linear" is there too), by a fixed point that asks for no derivatives ("implicit", with
    `accelerator`), or not at all ("one_way": the hood is solved once, in the posture).  Of a
    motion, a step at a time: linearly implicit ("linear": one hood solve a step), "newton",
    "implicit", staggered ("explicit") or side by side ("jacobi")."""

    scheme: Literal["linear", "newton", "implicit", "explicit", "jacobi", "one_way"] = "linear"
    accelerator: Literal["constant", "aitken", "iqn_ils"] = "aitken"
    tolerance: Annotated[float, quantity(units.ANGLE, above="0 deg", most="1 deg")] = 1e-9
    """Of the joint angles, of the iterated schemes, rad."""
    one_way: OneWay = OneWay()
    allow_double_counting: Switch = False
    """Run even where the hood hands over a force that the finger makes too."""

    @model_validator(mode="after")
    def _of_one_way(self) -> Coupling:
        if self.scheme != "one_way" and self.one_way != OneWay():
            raise fault('has a table one_way, which goes with scheme = "one_way" alone')
        return self


class Adaptive(Table):
    """Steps whose length follows from their error: that of a joint angle in a step, estimated by
    the difference of two halves and a whole step, is at most `tolerance`.  A step that would have
    to be shorter than `floor` stops the run."""

    tolerance: Annotated[float, quantity(units.ANGLE, above="0 deg", most="10 deg")]
    floor: Annotated[float, quantity(units.TIME, least="1e-9 s", most="0.1 s")] = 1e-6


class Forward(Table):
    """A motion in time from rest in the posture, in place of an equilibrium: the tensions or
    activations act from the start on."""

    duration: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] = 2.0
    step: Annotated[float, quantity(units.TIME, least="1e-6 s", most="0.1 s")] = 1e-3
    """Of every step; with `adaptive` of the first and the longest."""
    adaptive: Adaptive | None = None
    """Of a coupled motion."""
    must_rest: Switch = True
    """The run fails where the finger is still moving at the end."""
    checkpoint: Annotated[Count, Field(ge=0, le=1_000_000)] | None = None
    """Steps from one checkpoint of a coupled motion to the next; without it one is written every
    ten seconds of computing; 0: none."""

    @model_validator(mode="after")
    def _whole_steps(self) -> Forward:
        steps = round(self.duration / self.step)
        if steps < 1 or abs(steps * self.step - self.duration) > 1e-9 * self.duration:
            raise fault("its duration must be a multiple of the step")
        if self.adaptive is not None and self.adaptive.floor > self.step:
            raise fault("adaptive.floor must not be above the step, which is the longest")
        return self


class Output(Table):
    """What is written besides the numbers."""

    picture: Switch = True


class CaseFile(Table):
    """A case as its files state it."""

    title: str
    notes: str | None = None
    finger: Annotated[
        IndexFinger | MiddleFinger | HingeFinger | PlanarFinger | RobotFinger | FmuFinger,
        Field(discriminator="kind"),
    ]
    tendons: dict[TendonName, Tendon] = Field(default_factory=dict)
    hood: Annotated[
        ShellHood | PulleyHood | SplitHood | NetworkHood | TwoBandHood | CableHood | FmuHood,
        Field(discriminator="kind"),
    ]
    lesion: Lesion | None = None
    solve: Solve = Solve()
    forward: Forward | None = None
    coupling: Coupling = Coupling()
    output: Output = Output()

    @model_validator(mode="after")
    def _can_be_injured(self) -> CaseFile:
        if wrong := self.unfit_lesion():
            raise fault(wrong)
        return self

    def unfit_lesion(self) -> str:
        """Why this hood cannot have the lesion; empty where it can, or there is none."""
        if self.lesion is None:
            return ""
        network = self.hood if isinstance(self.hood, NetworkHood) else None
        connecting = tuple(network.connecting) if network is not None else ()
        reduced = network is not None and network.reduced is not None
        if wrong := lesion_fault(self.lesion, self.hood.kind, connecting, reduced):
            return wrong
        return idle_cut(self.lesion, self.hood.springs) if self.hood.kind == "shell" else ""


class Case(CaseFile):
    """A checked case: SI floats, angles in rad, paths absolute."""

    name: str
    """The file's stem."""
    source: Path

    def tension(self, tendon: str) -> float:
        """N; the resting tension where the case says nothing else."""
        stated = self.tendons.get(tendon, Tendon()).force
        return self.solve.resting_tension if stated is None else stated

    def setting_key(self) -> str:
        """A text that two cases share if and only if they differ in nothing but name and tendons; a
        file that they read counts with its time and size."""
        shared = {"finger", "hood", "lesion", "solve", "coupling"}
        parts = self.model_dump(mode="json", include=shared)
        return json.dumps([parts, _stamps(self)], sort_keys=True)

    def mesh_key(self) -> str:
        """A text that two cases with a shell hood share only where its mesh is laid out alike,
        before any lesion; a file that they read counts with its time and size."""
        apart = {"posture", "tip", "limit", "passive", "gravity"}
        parts = [
            self.hood.model_dump(mode="json", include={"mesh", "thickness"}),
            self.hood.contact.offset.model_dump() if isinstance(self.hood, ShellHood) else None,
            self.finger.model_dump(mode="json", exclude=apart),
        ]
        return json.dumps([parts, _stamps(self)], sort_keys=True)


def _stamps(case: Case) -> list[str]:
    return [f"{path}:{path.stat().st_mtime_ns}:{path.stat().st_size}" for path in _files(case)]


def _files(case: Case) -> list[Path]:
    """The files that a case's models are built from."""
    own = case.finger if isinstance(case.finger, IndexFinger) else None
    bones = own.bones.values() if own else ()
    model = [own.path] if own and own.path else []
    mesh = case.hood.mesh if isinstance(case.hood, ShellHood) else None
    units = [
        part.path for part in (case.hood, case.finger) if isinstance(part, FmuHood | FmuFinger)
    ]
    meshes = [mesh.path] if isinstance(mesh, MeshFile) else []
    return [b.surface for b in bones] + meshes + model + units
