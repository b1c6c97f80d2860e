"""The robotic finger under a hood of cables in place of its extensor's pulley.

Its bones were printed after a scan of human ones (paper, section II), and it had a crocheted hood
before: here the human index finger's bones, each as long as its phalanx, and over them the net of
`meshes.cable_net`, pulled by the one extensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from cosim.hoods.bone_surfaces import baked_surfaces
from cosim.hoods.cable.table import CableHood
from cosim.port import Triangles

if TYPE_CHECKING:
    from meshes.cable_net import CableNet
    from meshes.skeleton import Skeleton

ROBOT_ENDS = {"extensor": "central"}
"""The tendon that acts through the net and the end that it pulls."""


def robot_skeleton() -> Skeleton:
    """The robotic finger's joints, as its MuJoCo model has them."""
    from meshes.robot_net import straight_skeleton
    from rigid.fingers.robot_tables import LENGTHS

    return straight_skeleton(LENGTHS)


def robot_bones() -> dict[str, Triangles]:
    """Surfaces in the bodies' frames, m."""
    from meshes.robot_net import bones_of

    return bones_of(robot_skeleton())


def robot_net(hood: CableHood, skeleton: Skeleton, bones: Mapping[str, Triangles]) -> CableNet:
    """The net of a cable hood over these bones."""
    from meshes.cable_net import lay
    from meshes.robot_net import extensor_alone, wider

    offset = hood.contact.offset
    net = lay(
        skeleton,
        baked_surfaces(bones),
        {body: getattr(offset, body) for body in bones},
        hood.mesh.rest_posture.angles(),
        hood.mesh.spacing,
        wider(skeleton),
    )
    return extensor_alone(net)
