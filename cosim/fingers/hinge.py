"""The finger of hinges: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from cosim.fingers.chain import joint_torques, thick_rods, tip_support
from cosim.fingers.common import ChainFingerConfig, Extensor
from cosim.fingers.kind import FingerKind
from cosim.fingers.pulleys import Pulleys
from cosim.port import Triangles
from cosim.schema.types import Phalanx

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger


class HingeFingerConfig(ChainFingerConfig):
    """The analytic planar finger: three hinges in a row, and tendons over pulleys in closed
    form."""

    title: ClassVar[str] = "planar finger of hinges, analytic"
    has_mass: ClassVar[bool] = False
    kind: Literal["hinge"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    """Lengths of proximal, middle and distal phalanx."""
    pulleys: Pulleys = Field(default_factory=dict)
    """Tendons of its own over pulleys of constant radius, by tendon."""


def tendons(finger: HingeFingerConfig) -> tuple[str, ...]:
    """Names of its own tendons."""
    return tuple(finger.pulleys)


def build(finger: HingeFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with its tendons in closed form."""
    from rigid.chain.hinge import JOINTS
    from rigid.chain.hinge import HingeFinger as Hinges

    support = tip_support(finger.tip, in_plane=True)
    pulleys = {name: pulley.radius() for name, pulley in finger.pulleys.items()}
    law = joint_torques(finger, JOINTS)
    return Hinges(finger.lengths, law=law, support=support, pulleys=pulleys)


def bones(finger: HingeFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Rods for bones: surfaces in the bodies' frames, m."""
    return thick_rods(finger.lengths)


KIND = FingerKind(HingeFingerConfig, build, bones, tendons=tendons)
