"""Rods that stand for bones in pictures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.port import Triangles
from meshes.skeleton import BODIES


def rods(lengths: tuple[float, float, float], radius: Mapping[str, float]) -> dict[str, Triangles]:
    """A capsule from joint to joint, and of the first bone as much as MuJoCo's model shows;
    lengths of the phalanges and `radius` by body: m."""
    from trimesh.creation import capsule

    from rigid.fingers.anatomy import VIEW_METACARPAL

    out = {}
    for body, length in zip(BODIES, (VIEW_METACARPAL, *lengths), strict=True):
        rod = capsule(abs(length), radius[body], count=[16, 16])
        points = np.array(rod.vertices - rod.bounds.mean(axis=0))[:, [2, 0, 1]]
        points[:, 0] += length / 2
        out[body] = points, np.array(rod.faces)
    return out


def thick_rods(lengths: tuple[float, float, float]) -> dict[str, Triangles]:
    """Rods for bones, as thick as MuJoCo's model shows them: surfaces in the bodies' frames, m."""
    from rigid.fingers.anatomy import VIEW_RADIUS

    return rods(lengths, VIEW_RADIUS)
