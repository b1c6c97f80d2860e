"""The planar finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from cosim.fingers.chain import build_on_mujoco
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
from cosim.schema.types import Acceleration, Inertia, Mass, Phalanx

if TYPE_CHECKING:
    from rigid.chain.planar_chain import PlanarChain
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel


class PlanarFingerConfig(FingerConfig):
    """Three links in a plane on MuJoCo: lengths, distances of the centres of mass from the proximal
    joints, masses, and moments of inertia about the centres of mass."""

    title: ClassVar[str] = "planar finger of three links"
    kind: Literal["planar"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    """Lengths of proximal, middle and distal phalanx."""
    centres: tuple[Phalanx, Phalanx, Phalanx]
    """Distances of the centres of mass from the proximal joints."""
    masses: tuple[Mass, Mass, Mass]
    """Masses of the phalanges, from proximal to distal."""
    inertias: tuple[Inertia, Inertia, Inertia]
    """Moments of inertia about the centres of mass, normal to the plane."""
    posture: PlanarPostureConfig
    """Joint angles, held or from which the finger starts."""
    tip: TipConfig = HeldTipConfig(kind="point")
    limit: LimitConfig | None = None
    """Limits of the joints; without it they turn freely."""
    passive: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], PassiveConfig] = Field(
        default_factory=dict
    )
    """Passive torques by joint; a joint that is not named has none."""
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
    """Gravity along the world's axes distal, radial and dorsal; none by default."""


def planar_chain(finger: PlanarFingerConfig) -> PlanarChain:
    """The finger in closed form."""
    from rigid.chain.planar_chain import PlanarChain

    parts = (finger.lengths, finger.centres, finger.masses, finger.inertias)
    length, centre, mass, inertia = (np.array(part) for part in parts)
    return PlanarChain(length, centre, mass, inertia)


def model(finger: PlanarFingerConfig, extensor: Extensor) -> FingerModel:
    """Bones, joints and tendons of the finger's MuJoCo model."""
    return planar_chain(finger).model()


def build(finger: PlanarFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, whose tip is held in its plane alone."""
    return build_on_mujoco(finger, model(finger, extensor), in_plane=True)


def bones(finger: PlanarFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Rods for bones: surfaces in the bodies' frames, m."""
    return thick_rods(finger.lengths)


KIND = FingerKind(PlanarFingerConfig, build, bones, model)
