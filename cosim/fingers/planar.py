"""The planar finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from cosim.fingers.chain import build_on_mujoco, thick_rods
from cosim.fingers.common import Extensor, MassiveFingerConfig
from cosim.fingers.kind import FingerKind
from cosim.fingers.pulleys import Pulleys, Routes, routes_of
from cosim.port import Triangles
from cosim.schema.types import Inertia, Mass, Phalanx

if TYPE_CHECKING:
    from rigid.chain.planar_chain import PlanarChain
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel


class PlanarFingerConfig(MassiveFingerConfig):
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
    pulleys: Pulleys = Field(default_factory=dict)
    """Tendons of its own over pulleys of constant radius, by tendon."""
    points: Routes = Field(default_factory=dict)
    """Points of the bones that tendons of its own run through, by tendon."""


def planar_chain(finger: PlanarFingerConfig) -> PlanarChain:
    """The finger in closed form."""
    from rigid.chain.planar_chain import PlanarChain

    parts = (finger.lengths, finger.centres, finger.masses, finger.inertias)
    length, centre, mass, inertia = (np.array(part) for part in parts)
    return PlanarChain(length, centre, mass, inertia)


def model(finger: PlanarFingerConfig, extensor: Extensor) -> FingerModel:
    """Bones, joints and tendons of the finger's MuJoCo model."""
    from rigid.fingers.pulley_tendons import routed_tendon

    bare = planar_chain(finger).model()
    own = (routed_tendon(r, bare.segments) for r in routes_of(finger.pulleys, finger.points))
    return replace(bare, tendons=tuple(own))


def build(finger: PlanarFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, whose tip is held in its plane alone."""
    return build_on_mujoco(finger, model(finger, extensor), in_plane=True)


def bones(finger: PlanarFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Rods for bones: surfaces in the bodies' frames, m."""
    return thick_rods(finger.lengths)


KIND = FingerKind(PlanarFingerConfig, build, bones, model)
