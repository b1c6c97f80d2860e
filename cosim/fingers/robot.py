"""The robotic finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.errors import InputError
from cosim.fingers.chain import build_on_mujoco, rods
from cosim.fingers.common import Extensor, JointedFingerConfig
from cosim.fingers.kind import FingerKind
from cosim.fingers.pulleys import Pulleys, Routes, routes_of
from cosim.port import Triangles
from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Mass, Number, Switch, Table
from meshes.skeleton import BODIES, Skeleton

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.fingers.robot_tables import Guides, RobotDesign
    from rigid.model import FingerModel

THIN = 1e-3
"""m, of the rods that stand for its bones in pictures: its extensor runs 1.2 mm above them at the
DIP."""

Link = Annotated[float, quantity(units.LENGTH, least="10 mm", most="200 mm")]
FlexorArm = Annotated[float, quantity(units.LENGTH, least="0.5 mm", most="40 mm")]
ExtensorArm = Annotated[float, quantity(units.LENGTH, least="-40 mm", most="-0.1 mm")]
SideArm = Annotated[float, quantity(units.LENGTH, least="-40 mm", most="40 mm")]
Along = Annotated[float, quantity(units.LENGTH, above="0 mm", most="150 mm")]
Before = Annotated[float, quantity(units.LENGTH, least="-150 mm", most="-1 mm")]
Height = Annotated[float, quantity(units.LENGTH, least="-40 mm", most="40 mm")]


class RobotLengthsConfig(Table):
    """Lengths of the phalanges, from joint axis to joint axis and to the tip."""

    proximal: Link = 0.0534
    """Length of the proximal phalanx."""
    middle: Link = 0.0320
    """Length of the middle phalanx."""
    distal: Link = 0.0237
    """Length of the distal phalanx, to the fingertip."""


class RobotMassesConfig(Table):
    """Masses of the phalanges; each is a uniform rod of 5 mm radius."""

    proximal: Mass = 0.0055
    """Mass of the proximal phalanx."""
    middle: Mass = 0.0020
    """Mass of the middle phalanx."""
    distal: Mass = 0.0012
    """Mass of the distal phalanx."""


class ExtensorArmsConfig(Table):
    """Moment arms of the extensor, negative since it extends; the radii of the pulleys that it runs
    over are these over the shares of the tension that cross the joint."""

    MCP: ExtensorArm = -0.01093
    """At the MCP, all branches together: the radius of the pulley there, with its sign."""
    PIP: ExtensorArm = -0.00181
    """At the PIP, of the branches that cross it together: 3/4 of the radius of the pulley there."""
    DIP: ExtensorArm = -0.00113
    """At the DIP, of the long branch: half the radius of the pulley there."""


class FlexorArmsConfig(Table):
    """Moment arms of the flexors, which run through the same guides as far as the middle
    phalanx."""

    MCP: FlexorArm = 0.01347
    """At the MCP, of both flexors."""
    PIP: FlexorArm = 0.00799
    """At the PIP, of both flexors."""
    DIP: FlexorArm = 0.00614
    """At the DIP, of the DIP flexor."""


class AbductionArmsConfig(Table):
    """Arms of the tendon that abducts, beside the MCP."""

    MCP: SideArm = 0.00617
    """At the MCP, positive where it flexes."""
    MCP_abduction: SideArm = 0.00844
    """In abduction, positive towards the radial side."""


class AdductionArmsConfig(Table):
    """Arms of the tendon that adducts, beside the MCP."""

    MCP: SideArm = 0.00606
    """At the MCP, positive where it flexes."""
    MCP_abduction: SideArm = -0.00886
    """In abduction, negative towards the ulnar side."""


class RobotArmsConfig(Table):
    """Moment arms of the paper's tendons in the straight finger (its table III), for which the
    heights of their guides and the radii of their pulleys are solved; positive where a tendon
    flexes or abducts."""

    extensor: ExtensorArmsConfig = Field(default_factory=ExtensorArmsConfig)
    """Moment arms of the extensor, whose tension a pulley parts."""
    flexors: FlexorArmsConfig = Field(default_factory=FlexorArmsConfig)
    """Moment arms of the DIP flexor and the PIP flexor."""
    abduction: AbductionArmsConfig = Field(default_factory=AbductionArmsConfig)
    """Moment arms of the abduction tendon."""
    adduction: AdductionArmsConfig = Field(default_factory=AdductionArmsConfig)
    """Moment arms of the adduction tendon."""

    def table(self) -> tuple[tuple[float, ...], ...]:
        """Lengthening in mm per rad, joints in rows and tendons in columns, as table III has it."""
        e, f, ab, ad = self.extensor, self.flexors, self.abduction, self.adduction
        arms = (
            (e.MCP, f.MCP, f.MCP, ab.MCP, ad.MCP),
            (0.0, 0.0, 0.0, ab.MCP_abduction, ad.MCP_abduction),
            (e.PIP, f.PIP, f.PIP, 0.0, 0.0),
            (e.DIP, f.DIP, 0.0, 0.0, 0.0),
        )
        return tuple(tuple(-_mm(arm) if arm else 0.0 for arm in row) for row in arms)


class RobotGuidesConfig(Table):
    """Where the paper's tendons are guided: distances along a bone from its proximal joint, distal
    positive, and heights, dorsal positive.  The paper does not print them; all are assumptions."""

    origin: Before = -0.045
    """Along the metacarpal: where every tendon begins."""
    head_radius: Annotated[float, quantity(units.LENGTH, least="1 mm", most="30 mm")] = 0.010
    """Radius of the metacarpal's head, a sphere that flexors, abduction and adduction touch."""
    flexor_x: Before = -0.020
    """Along the metacarpal: the flexors' guide before the MCP."""
    flexor_z: Height = -0.01347
    """Height of the flexors' guide before the MCP."""
    flexor_proximal: Along = 0.014
    """Along the proximal phalanx: the flexors' guide; its height follows from the arms."""
    flexor_middle: Along = 0.010
    """Along the middle phalanx: the DIP flexor's guide, where the PIP flexor ends."""
    flexor_distal: Along = 0.007
    """Along the distal phalanx: where the DIP flexor ends."""
    extensor_x: Before = -0.008
    """Along the metacarpal: the extensor's guide before the MCP."""
    extensor_z: Height = 0.010
    """Height of the extensor's guide before the MCP."""
    extensor_proximal_x: Along = 0.008
    """Along the proximal phalanx: the extensor's guide, where its branch to this bone ends."""
    extensor_proximal_z: Height = 0.009
    """Height of the extensor's guide on the proximal phalanx."""
    before_pip: Along = 0.0084
    """The extensor's second guide on the proximal phalanx: how far before the PIP axis."""
    after_pip: Along = 0.007
    """Along the middle phalanx: the extensor's guide, where its branch to this bone ends."""
    pip_height: Height = 0.0015
    """Height of the extensor's guides before and after the PIP."""
    before_dip: Along = 0.007
    """The extensor's second guide on the middle phalanx: how far before the DIP axis."""
    distal: Along = 0.006
    """Along the distal phalanx: where the extensor's long branch ends."""
    dip_height: Height = 0.0012
    """Height of the extensor's guide before the DIP and of its end beyond."""
    side_x: Before = -0.008
    """Along the metacarpal: guides of abduction and adduction tendon."""
    side_y: Annotated[float, quantity(units.LENGTH, least="1 mm", most="40 mm")] = 0.011
    """How far radial the abduction tendon's guide is, and ulnar the adduction tendon's."""
    side_z: Height = -0.004
    """Height of both."""
    side_end: Along = 0.014
    """Along the proximal phalanx: where both end, at heights that follow from the arms."""

    def guides(self) -> Guides:
        """The same in mm."""
        from rigid.fingers.robot_tables import Guides

        return Guides(**{name: _mm(value) for name, value in self})


def _mm(metres: float) -> float:
    """In mm, as the decimals of a case say it."""
    return round(1e3 * metres, 9)


class RobotFingerConfig(JointedFingerConfig):
    """The robotic finger of Xu et al. 2012 on MuJoCo (rigid/fingers/robot.py), with its own
    tendons: over its extensor's pulley under `hood.kind = "split"`; any other hood takes that
    extensor's place.  Lengths, masses, arms and guides are the paper's or chosen for it, and may be
    another finger's."""

    title: ClassVar[str] = "robotic finger of Xu et al. 2012"
    kind: Literal["robot"]
    second_extensor: Switch = False
    """Six tendons: one more extensor, to the proximal phalanx alone."""
    lengths: RobotLengthsConfig = Field(default_factory=RobotLengthsConfig)
    """Lengths of the phalanges."""
    masses: RobotMassesConfig = Field(default_factory=RobotMassesConfig)
    """Masses of the phalanges."""
    arms: RobotArmsConfig = Field(default_factory=RobotArmsConfig)
    """Moment arms of the paper's tendons in the straight finger."""
    extensor_share: Annotated[Number, Field(ge=0.1, le=0.9)] = 0.5
    """What the extensor's pulley leaves of its tension to the distal phalanx; its other two
    branches share the rest equally."""
    guides: RobotGuidesConfig = Field(default_factory=RobotGuidesConfig)
    """Where the paper's tendons are guided."""
    paper_tendons: Switch = True
    """The tendons of the paper are there; without them it has those of `pulleys` and `points`
    alone."""
    pulleys: Pulleys = Field(default_factory=dict)
    """Tendons of a builder's own over pulleys of constant radius, beside the paper's or in place
    of one of that name, by tendon."""
    points: Routes = Field(default_factory=dict)
    """Points of the bones that tendons of a builder's own run through, by tendon."""

    @model_validator(mode="after")
    def _check_second(self) -> RobotFingerConfig:
        if self.second_extensor and not self.paper_tendons:
            raise fault("gives second_extensor and no paper_tendons; write one of them")
        return self

    def check_extensor(self, extensor: Extensor) -> None:
        short = (1.0 - self.extensor_share) / 2
        if extensor.central not in (None, 0.5, 2 * short):
            raise InputError(
                "hood.central: the robotic finger's pulley splits its extensor by "
                f"{self.extensor_share:g} and twice {short:g} (finger.extensor_share), and has no "
                "other shares; leave it out"
            )

    def design(self) -> RobotDesign:
        """What the robotic finger is built of."""
        from rigid.fingers.robot_tables import RobotDesign

        size, mass = self.lengths, self.masses
        return RobotDesign(
            (size.proximal, size.middle, size.distal),
            (mass.proximal, mass.middle, mass.distal),
            self.arms.table(),
            self.extensor_share,
            self.guides.guides(),
            routes_of(self.pulleys, self.points),
            self.paper_tendons,
        )


def model(finger: RobotFingerConfig, extensor: Extensor) -> FingerModel:
    """Without its pulley another hood takes the central extensor's place."""
    from rigid.fingers.robot import robot_finger
    from rigid.fingers.robot_tables import TENDONS

    whole = robot_finger(finger.second_extensor, finger.design())
    if extensor.central is not None:
        return whole
    return whole.with_only(*(m for m in whole.muscles if m != TENDONS[0]))


def build(finger: RobotFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def skeleton(finger: RobotFingerConfig) -> Skeleton:
    """Joints and lengths of its MuJoCo model."""
    from meshes.robot_net import straight_skeleton

    return straight_skeleton(finger.design().lengths)


def bones(finger: RobotFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Under a hood the human bones after which its own were printed (paper, section II), each as
    long as its phalanx; else rods, thin enough to leave its extensor in sight."""
    from meshes.robot_net import bones_of

    if extensor.lies_on_bones:
        return bones_of(skeleton(finger))
    return rods(finger.design().lengths, dict.fromkeys(BODIES, THIN))


def width(finger: RobotFingerConfig) -> float:
    """The finger's width over that of our index finger."""
    from meshes.robot_net import wider

    return wider(skeleton(finger))


KIND = FingerKind(RobotFingerConfig, build, bones, model, skeleton, width)
