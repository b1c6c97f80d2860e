"""Tendon paths, eyelets and fingertip of a packaged finger carried over to a user's bones.

A point goes with the nearest point of its bone, and keeps its height off it: what lies between bone
and tendon is soft tissue, which no bone tells.  Of a finger of stated lengths, which is ours at
another size, heights are stretched as the bones are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from cosim.anatomy.joints import Joints, parent_axis
from cosim.anatomy.register import Fit
from cosim.fingers.kind import Eyelets
from cosim.port import Array
from meshes.skeleton import BODIES, JOINTS, Skeleton
from rigid.model import (
    FingerModel,
    PathElement,
    Strand,
    Vector,
    Via,
    WrapCylinder,
    WrapSphere,
    vector,
)

AT_JOINT = 1e-6
"""m, of a surface's centre from the joint's."""
FLEXION = {"metacarpal": "MCP", "proximal": "PIP", "middle": "DIP"}


@dataclass(frozen=True)
class Carrier:
    """From a packaged finger's frames to a user's."""

    ours: Skeleton
    fits: Mapping[str, Fit]
    joints: Joints
    with_tissue: bool = False
    """Whether heights off a bone are stretched with it."""

    def points(self, body: str, points: Array) -> Array:
        """Points (n, 3) m about a packaged bone, in the user's frame of the body."""
        points, fit = np.atleast_2d(points), self.fits[body]
        foot = fit.foot(points)
        off = self.joints.axes[body].T @ (fit.matrix if self.with_tissue else fit.rotation)
        return self.joints.local(body, fit.carry(foot)) + (points - foot) @ off.T

    def point(self, body: str, point: Vector) -> Vector:
        """One such point."""
        return vector(self.points(body, np.array(point))[0])

    def eyelets(self, eyelets: Eyelets) -> dict[str, Vector]:
        """Eyelets beside the metacarpal, m distal, dorsal and radial, by tendon."""
        out = {}
        for tendon, (distal, dorsal, radial) in eyelets.items():
            x, y, z = self.point("metacarpal", (distal, radial, dorsal))
            out[tendon] = (x, z, y)
        return out

    def model(self, model: FingerModel) -> FingerModel:
        """A packaged finger's model over the user's joints."""
        user, tip = self.joints.skeleton, self.joints.skeleton.length[3]
        segments = [model.segments[0]]
        for i, segment in enumerate(model.segments[1:], 1):
            turn, longer = user.zero[i - 1], user.length[i] / self.ours.length[i]
            axes = {joint: user.axis[JOINTS.index(joint)] for joint in JOINTS}
            segments.append(
                replace(
                    segment,
                    length=float(user.length[i]),
                    position=(float(user.length[i - 1]), 0.0, 0.0),
                    rotation=(vector(turn[0]), vector(turn[1]), vector(turn[2])),
                    hinges=tuple(
                        replace(hinge, axis=vector(axes[hinge.name])) for hinge in segment.hinges
                    ),
                    centre=vector(longer * np.array(segment.centre)),
                )
            )
        tendons = tuple(
            replace(tendon, strands=tuple(map(self._strand, tendon.strands)))
            for tendon in model.tendons
        )
        return replace(
            model, segments=tuple(segments), tip=(float(tip), 0.0, 0.0), tendons=tendons, meshes={}
        )

    def _strand(self, strand: Strand) -> Strand:
        path: list[PathElement] = []
        for k, element in enumerate(strand.path):
            match element:
                case Via():
                    path.append(self._via(element))
                case _:
                    ends = cast(Via, strand.path[k - 1]), cast(Via, strand.path[k + 1])
                    path.append(self._surface(element, *ends))
        return replace(strand, path=tuple(path))

    def _via(self, via: Via) -> Via:
        return replace(via, point=self.point(via.body, via.point))

    def _surface(
        self, surface: WrapCylinder | WrapSphere, before: Via, after: Via
    ) -> WrapCylinder | WrapSphere:
        """A surface about the joint at the distal end of its body, larger as the straight way
        between the points beside it passes that joint further off."""
        i = BODIES.index(surface.body)
        ratio = _passes(self.joints.skeleton, i, self._via(before), self._via(after)) / _passes(
            self.ours, i, before, after
        )
        ours, user = (
            np.array([s.length[i] if i else 0.0, 0.0, 0.0])
            for s in (self.ours, self.joints.skeleton)
        )
        off = np.array(surface.centre) - ours
        assert np.linalg.norm(off) < AT_JOINT, "a surface about no joint"
        side = None
        if surface.side is not None:
            side = vector(user + ratio * (np.array(surface.side) - ours))
        centre, radius = vector(user), ratio * surface.radius
        match surface:
            case WrapSphere():
                return replace(surface, centre=centre, radius=radius, side=side)
            case WrapCylinder():
                axis = vector(parent_axis(self.joints.skeleton, FLEXION[surface.body]))
                return replace(surface, centre=centre, axis=axis, radius=radius, side=side)


def _passes(skeleton: Skeleton, i: int, before: Via, after: Via) -> float:
    """How far (m) the straight way from a point of body `i` to one of the next passes its joint's
    flexion axis at zero angles."""
    centre = np.array([skeleton.length[i] if i else 0.0, 0.0, 0.0])
    axis = parent_axis(skeleton, FLEXION[BODIES[i]])
    start = np.array(before.point) - centre
    end = skeleton.zero[i] @ np.array(after.point)
    start, end = (p - (p @ axis) * axis for p in (start, end))
    way = (end - start) / np.linalg.norm(end - start)
    return float(np.linalg.norm(np.cross(start, way)))
