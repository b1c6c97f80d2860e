"""The robotic finger: what a case may say of it, and how it is built; all else of it is its
paper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from cosim.errors import InputError
from cosim.fingers.chain import build_on_mujoco, rods
from cosim.fingers.common import Extensor, JointedFingerConfig
from cosim.fingers.kind import FingerKind
from cosim.port import Triangles
from cosim.schema.types import Switch
from meshes.skeleton import BODIES, Skeleton

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel

THIN = 1e-3
"""m, of the rods that stand for its bones in pictures: its extensor runs 1.2 mm above them at the
DIP."""


class RobotFingerConfig(JointedFingerConfig):
    """The robotic finger of Xu et al. 2012 on MuJoCo (rigid/fingers/robot.py), with its own
    tendons: over its extensor's pulley under `hood.kind = "split"`; any other hood takes that
    extensor's place."""

    title: ClassVar[str] = "robotic finger of Xu et al. 2012"
    kind: Literal["robot"]
    second_extensor: Switch = False
    """Six tendons: one more extensor, to the proximal phalanx alone."""

    def check_extensor(self, extensor: Extensor) -> None:
        from rigid.fingers.robot_tables import LONG, SHORT

        if extensor.central not in (None, 2 * SHORT):
            raise InputError(
                f"hood.central: the robotic finger's pulley splits its extensor by {LONG:g} and "
                f"twice {SHORT:g}, and has no other shares; leave it out"
            )


def model(finger: RobotFingerConfig, extensor: Extensor) -> FingerModel:
    """Without its pulley another hood takes the central extensor's place."""
    from rigid.fingers.robot import robot_finger
    from rigid.fingers.robot_tables import TENDONS

    whole = robot_finger(finger.second_extensor)
    if extensor.central is not None:
        return whole
    return whole.with_only(*(m for m in whole.muscles if m != TENDONS[0]))


def build(finger: RobotFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def skeleton(finger: RobotFingerConfig) -> Skeleton:
    """Joints and lengths of its MuJoCo model."""
    from meshes.robot_net import straight_skeleton
    from rigid.fingers.robot_tables import LENGTHS

    return straight_skeleton(LENGTHS)


def bones(finger: RobotFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Under a hood the human bones after which its own were printed (paper, section II), each as
    long as its phalanx; else rods, thin enough to leave its extensor in sight."""
    from meshes.robot_net import bones_of
    from rigid.fingers.robot_tables import LENGTHS

    if extensor.lies_on_bones:
        return bones_of(skeleton(finger))
    return rods(LENGTHS, dict.fromkeys(BODIES, THIN))


def width(finger: RobotFingerConfig) -> float:
    """The finger's width over that of our index finger."""
    from meshes.robot_net import wider

    return wider(skeleton(finger))


KIND = FingerKind(RobotFingerConfig, build, bones, model, skeleton, width)
