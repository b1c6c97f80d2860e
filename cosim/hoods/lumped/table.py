"""What a case may say of a hood in lumped form: muscles, springs and moment arms at the joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import JointAngle
from cosim.hoods.kind import FINGERS, HoodConfig, HoodKind
from cosim.hoods.lesion import SLIPS, InjurableParts, LesionConfig
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import Count, Number, Table, TendonName

JOINTS = ("MCP", "PIP", "DIP")
"""The joints in flexion; a hood in lumped form has no arms in abduction, unless it is reduced."""
ALL_JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")


class ArmConfig(Table):
    """A moment arm, flexion positive: `constant` + `slope` times the joint's angle, m, m/rad."""

    constant: Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")]
    """Moment arm at a joint angle of zero, flexion positive."""
    slope: Annotated[float, quantity(units.ARM_SLOPE, least="-50 mm/rad", most="50 mm/rad")] = 0.0
    """Change of the arm per angle of the joint."""


Arms = dict[Annotated[str, name_of("joint", JOINTS)], ArmConfig]
Powers = Annotated[
    tuple[tuple[Annotated[Count, Field(ge=0, le=12)], ...], ...], Field(min_length=1)
]
Stiffness = Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")]


class ConnectingTendonConfig(Table):
    """A spring from a muscle's junction to the bones; `rest`: how much slack it has with all joints
    straight, m."""

    muscle: TendonName
    """The muscle from whose junction it leads."""
    stiffness: Stiffness
    """Its stiffness."""
    rest: Annotated[float, quantity(units.LENGTH, least="-20 mm", most="20 mm")] = 0.0
    """Slack with all joints straight; negative: pre-stretch."""
    arms: Annotated[Arms, Field(min_length=1)]
    """Its moment arms by joint."""


class ReductionConfig(Table):
    """What `cosim export` fitted: one potential of joint angles and tensions over a box, from which
    torques and excursions follow (rigid/hoods/reduced.py).  `angles`: the box, by joint in the
    finger's order; `tensions`: of each muscle the greatest, with `toe` of it; `energy` in J, a row
    for each of `angle_powers`, a column for each of `tension_terms`; `slips`: central and terminal,
    N and 1/m, for each of `slip_powers` a constant and a factor of each joint's torque."""

    angles: dict[Annotated[str, name_of("joint", ALL_JOINTS)], tuple[JointAngle, JointAngle]]
    """The box of joint angles: lowest and highest by joint, in the finger's order."""
    tensions: dict[TendonName, Annotated[float, quantity(units.FORCE, above="0 N", most="1000 N")]]
    """Greatest tension by muscle."""
    toe: Annotated[Number, Field(gt=0, le=1)]
    """Part of the greatest tension below which the fit is rounded off to zero."""
    angle_powers: Powers
    """Powers of the scaled angles of each term."""
    tension_terms: Annotated[
        tuple[tuple[Annotated[Count, Field(ge=0, le=3)], ...], ...], Field(min_length=1)
    ]
    """Powers of the tensions of each term."""
    energy: tuple[tuple[Number, ...], ...]
    """Coefficients (J): a row for each of `angle_powers`, a column for each of `tension_terms`."""
    slip_powers: Powers
    """Powers of the scaled angles of each term of the slips' forces."""
    slips: tuple[tuple[tuple[Number, ...], ...], tuple[tuple[Number, ...], ...]]
    """Coefficients (N, 1/m) of central and terminal slip: for each of `slip_powers` a constant and
    one for each joint's torque."""


class NetworkHoodConfig(HoodConfig):
    """A network of tendons (Development and Validation of Modeling Framework for Interconnected
    Tendon Networks): `muscles` with the arms at which they cross joints themselves, `connecting`
    tendons from their junctions on.  With `operating_force` the shares depend on posture alone, as
    they are at that force of every muscle.  One that is `reduced` from another hood has neither
    arms nor connecting tendons of its own."""

    title: ClassVar[str] = (
        "no deformable hood: tendons sprung from junctions, moment arms at joints"
    )
    fits: ClassVar[tuple[str, ...]] = (*FINGERS, "planar", "hinge", "robot")
    can_be_injured: ClassVar[bool] = True
    rungs: ClassVar[Mapping[str, str]] = {"network": "base/network"}
    example: ClassVar[tuple[str, ...]] = ("network_edc",)
    kind: Literal["network"]
    muscles: Annotated[dict[TendonName, Arms], Field(min_length=1)]
    """Moment arms by muscle and joint, up to its junction."""
    connecting: dict[str, ConnectingTendonConfig]
    """Tendons from junctions on, by a name of your own."""
    operating_force: Annotated[float, quantity(units.FORCE, above="0 N", most="1000 N")] | None = (
        None
    )
    """Force of every muscle at which the shares are fixed; without it they follow the load."""
    reduced: ReductionConfig | None = None
    """The fit of another hood, in place of arms and connecting tendons."""

    @model_validator(mode="after")
    def _check_network(self) -> NetworkHoodConfig:
        if self.reduced is not None and (
            self.connecting or any(self.muscles.values()) or self.operating_force is not None
        ):
            raise fault(
                "reduced: stands for all arms and connecting tendons; leave out the muscles' arms, "
                "connecting tendons and operating_force"
            )
        if self.reduced is not None and tuple(self.reduced.tensions) != tuple(self.muscles):
            raise fault(
                f"reduced.tensions: expected the hood's muscles, {', '.join(self.muscles)}, in "
                "this order"
            )
        for name, tendon in self.connecting.items():
            if tendon.muscle not in self.muscles:
                raise fault(
                    f"connecting.{name}: its muscle {tendon.muscle} is not among the hood's "
                    f"muscles; they are {', '.join(self.muscles)}"
                )
        return self

    @property
    def shares_fixed(self) -> bool:
        return self.operating_force is not None

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return tuple(self.muscles)

    def parts(self) -> InjurableParts | None:
        tendons = (*SLIPS, *self.connecting)
        return None if self.reduced is not None else InjurableParts(tendons, (), tendons)

    def cannot_be_injured(self, lesion: LesionConfig) -> str:
        return "a reduced network has no parts to injure" if self.reduced is not None else ""


class TwoBandHoodConfig(HoodConfig):
    """An extensor that parts into a middle and a lateral band (Buchner, Hines and Hemami 1988),
    with the elasticity K between them and the share `lateral_share` of its tension in the lateral
    band where both shifts agree; other `muscles` cross the joints on their own."""

    title: ClassVar[str] = "no deformable hood: a middle and a lateral band, moment arms at joints"
    fits: ClassVar[tuple[str, ...]] = ("index", "planar", "hinge", "robot")
    can_be_injured: ClassVar[bool] = True
    rungs: ClassVar[Mapping[str, str]] = {"two_band": "base/two_band"}
    example: ClassVar[tuple[str, ...]] = ("two_band_edc",)
    kind: Literal["two_band"]
    muscles: Annotated[dict[TendonName, Arms], Field(min_length=1)]
    """Moment arms by muscle and joint."""
    extensor: TendonName = "EDC"
    """The muscle that parts into both bands."""
    middle: Annotated[Arms, Field(min_length=1)]
    """Moment arms of the middle band by joint."""
    lateral: Annotated[Arms, Field(min_length=1)]
    """Moment arms of the lateral band by joint."""
    elasticity: Stiffness = 500.0
    """Stiffness between the bands."""
    lateral_share: Annotated[Number, Field(gt=0, lt=1)] = 0.5
    """Share of the extensor's tension in the lateral band where both bands shift alike."""

    @model_validator(mode="after")
    def _check_network(self) -> TwoBandHoodConfig:
        if self.extensor not in self.muscles:
            raise fault(
                f"extensor: {self.extensor} is not among the hood's muscles; they are "
                f"{', '.join(self.muscles)}"
            )
        return self

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return tuple(self.muscles)

    def parts(self) -> InjurableParts:
        return InjurableParts(SLIPS, (), SLIPS)

    def on_finger(self, finger: str, laid: object) -> TwoBandHoodConfig:
        """The planar finger's flexors are the hood's; the index finger has its own."""
        if finger != "index":
            return self
        left = {name: arms for name, arms in self.muscles.items() if name not in ("FDP", "FDS")}
        return self.model_copy(update={"muscles": left})


NETWORK = HoodKind(NetworkHoodConfig, "cosim.hoods.lumped.build:NETWORK")
TWO_BANDS = HoodKind(TwoBandHoodConfig, "cosim.hoods.lumped.build:TWO_BANDS")
