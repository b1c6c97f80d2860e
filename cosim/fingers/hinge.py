"""The finger of hinges: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from cosim.fingers.chain import joint_torques, tip_support
from cosim.fingers.common import (
    Extensor,
    FingerConfig,
    HeldTipConfig,
    LimitConfig,
    PassiveConfig,
    PlanarPostureConfig,
    TipConfig,
)
from cosim.fingers.kind import FingerKind
from cosim.fingers.rods import thick_rods
from cosim.port import Triangles
from cosim.schema.fields import name_of
from cosim.schema.types import Phalanx

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger


class HingeFingerConfig(FingerConfig):
    """The analytic planar finger: three hinges in a row."""

    title: ClassVar[str] = "planar finger of hinges, analytic"
    has_mass: ClassVar[bool] = False
    kind: Literal["hinge"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    """Lengths of proximal, middle and distal phalanx."""
    posture: PlanarPostureConfig
    """Joint angles, held or from which the finger starts."""
    tip: TipConfig = HeldTipConfig(kind="point")
    limit: LimitConfig | None = None
    """Limits of the joints; without it they turn freely."""
    passive: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], PassiveConfig] = Field(
        default_factory=dict
    )
    """Passive torques by joint; a joint that is not named has none."""


def build(finger: HingeFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, which has no tendons of its own."""
    from rigid.chain.hinge import JOINTS
    from rigid.chain.hinge import HingeFinger as Hinges

    support = tip_support(finger.tip, in_plane=True)
    return Hinges(finger.lengths, law=joint_torques(finger, JOINTS), support=support)


def bones(finger: HingeFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Rods for bones: surfaces in the bodies' frames, m."""
    return thick_rods(finger.lengths)


KIND = FingerKind(HingeFingerConfig, build, bones)
