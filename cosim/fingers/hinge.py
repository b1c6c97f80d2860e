"""The finger of hinges: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from cosim.fingers.chain import joint_torques, thick_rods, tip_support
from cosim.fingers.common import ChainFingerConfig, Extensor
from cosim.fingers.kind import FingerKind
from cosim.port import Triangles
from cosim.schema.types import Phalanx

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger


class HingeFingerConfig(ChainFingerConfig):
    """The analytic planar finger: three hinges in a row."""

    title: ClassVar[str] = "planar finger of hinges, analytic"
    has_mass: ClassVar[bool] = False
    kind: Literal["hinge"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    """Lengths of proximal, middle and distal phalanx."""


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
