"""The surfaces of bones that a hood of finite elements lies on."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError
from cosim.port import Triangles

if TYPE_CHECKING:
    from fe_solver.surfaces.spline_distance import Surface

MARGIN = 5e-3
"""m, how far beyond a bone its baked distance reaches."""


def pose_surfaces(bones: Mapping[str, Triangles]) -> dict[str, Surface]:
    """Surfaces of bones with a distance baked round each, by body and in its frame."""
    return {
        body: _pose_surface(body, *map(_frozen, triangles)) for body, triangles in bones.items()
    }


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
def _pose_surface(body: str, vertices: _frozen, faces: _frozen) -> Surface:
    from fe_solver.surfaces.spline_distance import SplineDistance, cache_folder

    try:
        return SplineDistance.bake(vertices.array, faces.array, margin=MARGIN, cache=cache_folder())
    except InputError as error:
        raise InputError(f"finger.bones.{body}.surface: {error}") from error
