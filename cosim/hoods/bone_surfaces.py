"""The surfaces of bones that a hood of finite elements lies on."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial

import numpy as np

from cosim.errors import InputError
from cosim.hoods.supports import ContactConfig
from cosim.port import Triangles
from fe_solver.forces.contact import needed_distance
from fe_solver.surfaces.spline_distance import SplineDistance, cache_folder
from meshes.cover import Head, Joint, thinner
from meshes.skeleton import Skeleton

LEAST, STEP = 5e-3, 2e-3
"""m, how far beyond a bone its baked distance reaches at least, and in what steps further: so that
a study or a slider of the contact's height does not bake anew for each value."""


def pose_surfaces(
    bones: Mapping[str, Triangles], level: Mapping[str, float] | None = None
) -> dict[str, SplineDistance]:
    """Surfaces of bones with a distance baked round each, by body and in its frame; `level` (m) by
    body is how high over the bone a hood touches it at most, zero where it is not stated."""
    heights = level or {}
    return {
        body: _pose_surface(body, *map(_frozen, triangles), _margin(heights.get(body, 0.0)))
        for body, triangles in bones.items()
    }


def contact_levels(
    contact: ContactConfig,
    bones: Mapping[str, Triangles],
    skeleton: Skeleton,
    highest: float = 0.0,
) -> tuple[dict[str, SplineDistance], dict[str, float]]:
    """By body the surface over which a hood touches a bone and the offset (m) from it at which its
    face does, as a case states them: where a head is covered by less than the bone's back, the
    surface lies as much deeper.  `highest`: m that the hood touches above its face at most."""
    offset = {body: getattr(contact.offset, body) for body in bones}
    surfaces = pose_surfaces(bones, {body: o + highest for body, o in offset.items()})
    for body, stated in contact.heads:
        if stated is not None:
            head = Head(*(min(over, offset[body]) for over in (stated.face, stated.sides)))
            joint = Joint.of(skeleton, body)
            less = partial(thinner, joint=joint, back=offset[body], head=head)
            surfaces[body] = surfaces[body].plus(less)
    return surfaces, offset


def _margin(level: float) -> float:
    """m to bake beyond a bone that is touched at `level` m."""
    steps = np.ceil((needed_distance(level, 0.0) - LEAST) / STEP - 1e-9)
    return LEAST + STEP * max(float(steps), 0.0)


class _frozen:
    """An array that can be a cache's key."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array
        self.key = hash((array.shape, array.tobytes()))

    def __hash__(self) -> int:
        return self.key

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _frozen) and np.array_equal(self.array, other.array)


@lru_cache(maxsize=32)
def _pose_surface(body: str, vertices: _frozen, faces: _frozen, margin: float) -> SplineDistance:

    try:
        return SplineDistance.bake(vertices.array, faces.array, margin=margin, cache=cache_folder())
    except InputError as error:
        raise InputError(f"finger.bones.{body}.surface: {error}") from error
