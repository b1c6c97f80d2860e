"""What the tables of fingers share: posture, passive joints, fingertip; what needs no solver."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.port import Hand
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import (
    AbductionAngle,
    Acceleration,
    BodyName,
    Coordinate,
    DipAngle,
    McpAngle,
    Number,
    PipAngle,
    Table,
)
from meshes.skeleton import JOINTS

EQUAL_SHARES = 0.5
"""The central slip's, where tendons part into two equal strands (An et al. 1979)."""


@dataclass(frozen=True)
class Extensor:
    """What a hood leaves to the finger of the extensor mechanism."""

    central: float | None = None
    """The central slip's share, where tendons of the finger's own part by fixed shares; None where
    the hood takes their place."""
    lies_on_bones: bool = False


class FingerConfig(Table):
    """What the table of any finger says without a solver."""

    title: ClassVar[str]
    """The kind in words, for reports."""
    is_native: ClassVar[bool] = True
    """A model of ours, not another's program."""
    has_mass: ClassVar[bool] = True
    has_literature: ClassVar[bool] = False
    """Moment arms and slips of this finger are published, and the packaged hood was fitted to
    them."""
    shell_case: ClassVar[str | None] = None
    """The packaged case with a shell laid out on this finger, where it is not the index finger's.
    """
    flexed: ClassVar[tuple[float, float, float]] = (30.0, 45.0, 15.0)
    """deg, MCP, PIP, DIP: the flexed posture in which forces of the slips are compared."""
    KEPT: ClassVar[frozenset[str]] = frozenset(
        {"posture", "tip", "limit", "passive", "splint", "tie", "gravity"}
    )
    """What bones and joints do not depend on."""

    def side(self) -> Hand:
        """The hand that the finger is of; the right one where the kind does not say."""
        hand: Hand = getattr(self, "hand", "right")
        return hand

    def files(self) -> tuple[Path, ...]:
        """The files that the finger is built from."""
        return ()

    def check_extensor(self, extensor: Extensor) -> None:
        """Check what this finger is to take over from a hood.  Raises InputError."""

    def anatomy_key(self) -> str:
        """A text that two fingers share only where bones and joints are alike."""
        parts = self.model_dump(mode="json", exclude=set(self.KEPT))
        return json.dumps([parts, stamps(self.files())], sort_keys=True)

    def muscle_areas(self, names: Collection[str]) -> tuple[Mapping[str, float], str]:
        """cm2 by muscle of a finger with the tendons `names`, and the source in words."""
        from rigid.fingers.index import INDEX

        return INDEX.areas, INDEX.areas_source


def stamps(files: Collection[Path]) -> list[str]:
    """Path, time and size of each file."""
    return [f"{path}:{path.stat().st_mtime_ns}:{path.stat().st_size}" for path in files]


class PlanarPostureConfig(Table):
    """Flexion angles, rad."""

    MCP: McpAngle
    """Flexion of the metacarpophalangeal joint."""
    PIP: PipAngle
    """Flexion of the proximal interphalangeal joint."""
    DIP: DipAngle
    """Flexion of the distal interphalangeal joint."""

    def angles(self) -> dict[str, float]:
        """Joint name -> angle (rad)."""
        return {name: float(value) for name, value in self}


class PostureConfig(PlanarPostureConfig):
    """Joint angles, rad; radial abduction positive."""

    MCP_abduction: AbductionAngle = 0.0
    """Radial abduction of the metacarpophalangeal joint."""


JointAngle = Annotated[float, quantity(units.ANGLE, least="-90 deg", most="150 deg")]
JointTorque = Annotated[float, quantity(units.TORQUE, least="-100 N*m", most="100 N*m")]


class LimitConfig(Table):
    """The torque that keeps a joint within `half_range` of the posture (OpenSim's
    CoordinateLimitForce)."""

    half_range: Annotated[float, quantity(units.ANGLE, least="0 deg", most="90 deg")]
    """How far a joint turns from the posture, to both sides, before the limit acts."""
    stiffness: Annotated[
        float, quantity(units.LIMIT_STIFFNESS, least="1e-4 N*m/deg", most="1000 N*m/deg")
    ]
    """Slope of the torque from `transition` beyond the limit on; without the table no limit."""
    transition: Annotated[float, quantity(units.ANGLE, above="0 deg", most="45 deg")]
    """Angle beyond the limit over which the stiffness sets in."""
    damping: Annotated[
        float, quantity(units.LIMIT_DAMPING, least="0 N*m*s/deg", most="100 N*m*s/deg")
    ] = 0.0
    """Torque per rate beyond the limit, in a motion."""


class PassiveConfig(Table):
    """A passive joint torque: linear, N m/rad about `rest` (an angle in rad, or "posture"), or a
    `curve` of (angle, torque) points through which a smooth line runs, straight beyond its ends;
    and viscous damping, which acts where the finger moves in time."""

    stiffness: (
        Annotated[float, quantity(units.JOINT_STIFFNESS, least="0 N*m/rad", most="100 N*m/rad")]
        | None
    ) = None
    """Slope of a linear torque about `rest`; without it and without a curve there is none."""
    rest: (
        Annotated[
            float | Literal["posture"],
            quantity(units.ANGLE, least="-90 deg", most="110 deg", word="posture"),
        ]
        | None
    ) = None
    """Angle without torque, or "posture": that of the case."""
    curve: Annotated[tuple[tuple[JointAngle, JointTorque], ...], Field(min_length=2)] | None = None
    """Points of angle and torque, flexing torques positive."""
    damping: Annotated[
        float, quantity(units.JOINT_DAMPING, least="0 N*m*s/rad", most="1 N*m*s/rad")
    ] = 0.0
    """Viscous torque per rate of the joint, in a motion."""

    @model_validator(mode="after")
    def _one_way(self) -> PassiveConfig:
        if (self.stiffness is None) != (self.rest is None):
            raise fault('gives one of stiffness and rest; write both, for example rest = "posture"')
        if self.curve is not None and self.stiffness is not None:
            raise fault("gives both a curve and a stiffness; write one of them")
        angles = [angle for angle, _ in self.curve or ()]
        if any(b <= a for a, b in pairwise(angles)):
            raise fault("curve: its angles must rise from point to point")
        return self


class SplintConfig(Table):
    """A splint of a joint, or a pin: it lets the joint turn within `range` and bears a torque
    beyond, in the place of `finger.limit`."""

    range: tuple[JointAngle, JointAngle] | None = None
    """From which angle to which the joint turns freely; without it the splint holds the joint where
    it stands when it is put on."""
    stiffness: Annotated[
        float, quantity(units.JOINT_STIFFNESS, above="0 N*m/rad", most="100 N*m/rad")
    ] = 20.0
    """Slope of the torque from half a degree beyond the range on."""
    begins: Annotated[float, quantity(units.TIME, least="0 s", most="1000 s")] | None = None
    """In a motion, when it is put on: at the first step from then on; without it from the start."""
    ends: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] | None = None
    """In a motion, when it is taken off."""

    @model_validator(mode="after")
    def _can_be_worn(self) -> SplintConfig:
        if self.range is not None and self.range[1] < self.range[0]:
            raise fault("range: its second angle must not be below its first")
        if self.ends is not None and self.ends <= (self.begins or 0.0):
            raise fault("ends: must be after 0 s and after begins")
        return self

    @property
    def has_times(self) -> bool:
        """Whether it is put on or taken off in a motion."""
        return self.begins is not None or self.ends is not None


Point = tuple[Coordinate, Coordinate, Coordinate]


class TieConfig(Table):
    """A strand from one bone to another, straight, which bears tension alone: a tenodesis, a check
    rein, a ligament that is laid anew."""

    bones: tuple[BodyName, BodyName]
    """The bones that it ends on."""
    at: tuple[Point, Point]
    """Where on each: distal, radial and dorsal of its proximal joint (of the metacarpal: its distal
    one), along its own axes."""
    stiffness: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e5 N/mm")]
    """The whole strand's: its modulus times its section over its length.  In the first 0.2 mm of
    stretch it is softer, as its fibres come taut one after the other."""
    taut: dict[Annotated[str, name_of("joint", JOINTS)], JointAngle] = Field(default_factory=dict)
    """Angles of joints at which it comes taut; those that are not named stand as in the posture."""
    slack: Annotated[float, quantity(units.LENGTH, least="-10 mm", most="50 mm")] = 0.0
    """How much longer it is than that; negative where it is drawn tight."""

    @model_validator(mode="after")
    def _runs_between(self) -> TieConfig:
        if self.bones[0] == self.bones[1]:
            raise fault("bones: names one bone twice; a tie runs from one to another")
        return self


class HeldTipConfig(Table):
    """The fingertip is held at a point: free to turn there ("point"), clamped against flexion too
    ("clamped"), or not held at all ("free"); with "posture" every joint is held instead, as bones
    on a rig are."""

    kind: Literal["point", "clamped", "free", "posture"]
    """How the fingertip is held."""


class DeviceTipConfig(Table):
    """A sphere about the fingertip that pushes against what surrounds it, with friction, in a
    motion in time.  Defaults are those of the thesis (section 2.2.1) and of Simbody."""

    sphere: Annotated[float, quantity(units.LENGTH, above="0 mm", most="100 mm")] = 8e-3
    """Diameter of the sphere."""
    width: Annotated[float, quantity(units.LENGTH, above="0 mm", most="200 mm")] = 9e-3
    """Distance of opposite walls, or inner diameter of the shell."""
    dissipation: Annotated[float, quantity(units.DISSIPATION, least="0 s/m", most="1e4 s/m")] = 0.99
    """Damping of the contact (Hunt and Crossley 1975)."""
    static_friction: Annotated[Number, Field(ge=0, le=10)] = 0.1
    """Coefficient of friction at rest."""
    dynamic_friction: Annotated[Number, Field(ge=0, le=10)] = 0.03
    """Coefficient of friction in sliding."""
    viscous_friction: Annotated[float, quantity(units.DRAG, least="0 s/m", most="1e4 s/m")] = 0.6
    """Coefficient of friction per sliding velocity."""
    transition_velocity: Annotated[float, quantity(units.SPEED, above="0 m/s", most="10 m/s")] = (
        0.01
    )
    """Sliding velocity at which friction is greatest."""

    @model_validator(mode="after")
    def _fits(self) -> DeviceTipConfig:
        if not self.width > self.sphere:
            raise fault("its width must exceed the sphere's diameter")
        return self


class CageTipConfig(DeviceTipConfig):
    """A cube of six walls, Hunt-Crossley; `stiffness` is the plane-strain modulus of sphere and
    walls, Pa."""

    kind: Literal["cage"]
    stiffness: Annotated[float, quantity(units.PRESSURE, above="0 MPa", most="1000 GPa")] = 20e9
    """Plane-strain modulus of sphere and walls."""


class ShellTipConfig(DeviceTipConfig):
    """A hollow sphere, elastic foundation; `stiffness` is pressure over depth, Pa/m."""

    kind: Literal["shell"]
    stiffness: Annotated[
        float, quantity(units.CONTACT_STIFFNESS, above="0 N/mm**3", most="1e6 N/mm**3")
    ] = 20e9
    """Pressure per depth of the elastic foundation."""


TipConfig = Annotated[
    HeldTipConfig | CageTipConfig | ShellTipConfig,
    Field(discriminator="kind", description="What holds the fingertip, or what it pushes against."),
]


class ChainFingerConfig(FingerConfig):
    """What the table of every finger of ours states."""

    posture: PlanarPostureConfig
    """Joint angles, held or from which the finger starts."""
    tip: TipConfig = HeldTipConfig(kind="point")
    limit: LimitConfig | None = None
    """Limits of the joints; without it they turn freely."""
    passive: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], PassiveConfig] = Field(
        default_factory=dict
    )
    """Passive torques by joint; a joint that is not named has none."""
    splint: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], SplintConfig] = Field(
        default_factory=dict
    )
    """Splints by joint."""

    @model_validator(mode="after")
    def _splints_lie_within_limits(self) -> ChainFingerConfig:
        if self.limit is None:
            return self
        posture, free = self.posture.angles(), self.limit.half_range
        for joint, splint in self.splint.items():
            low, high = splint.range or (posture[joint],) * 2
            if low < posture[joint] - free or high > posture[joint] + free:
                raise fault(
                    f"splint.{joint}.range: must lie within what finger.limit lets the joint turn, "
                    f"half_range about the posture; a joint beyond it wears no splint"
                )
        return self


class MassiveFingerConfig(ChainFingerConfig):
    """What the table of a finger of ours with mass states."""

    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
    """Gravity along the world's axes distal, radial and dorsal; none by default."""
    tie: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,30}$")], TieConfig] = Field(
        default_factory=dict
    )
    """Strands from bone to bone, by a name of the user's."""


class JointedFingerConfig(MassiveFingerConfig):
    """What the table of a finger with the joints of a human one states."""

    hand: Hand = "right"
    """The side.  Of a left hand all that the case states and the numbers of a run are said by
    direction (distal, radial, dorsal; flexion and radial abduction positive) and are the right
    hand's; files of bones are read, and shapes, models and pictures made, as those of the left
    hand, in its own frame: x distal, y ulnar, z dorsal."""
    posture: PostureConfig = PostureConfig.model_construct(
        MCP=math.radians(30), MCP_abduction=0.0, PIP=math.radians(45), DIP=math.radians(15)
    )
    """Joint angles, held or from which the finger starts; by default 30, 45 and 15 deg."""
    passive: dict[Annotated[str, name_of("joint", JOINTS)], PassiveConfig] = Field(
        default_factory=dict
    )
    """Passive torques by joint; a joint that is not named has none."""
    splint: dict[Annotated[str, name_of("joint", JOINTS)], SplintConfig] = Field(
        default_factory=dict
    )
    """Splints by joint."""
