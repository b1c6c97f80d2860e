"""Fibres of a hood as short strokes over the sheet, few enough to tell them apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.hoods.view import FAMILIES
from cosim.port import Array

SPACING, LENGTH = 2.0e-3, 1.6e-3
"""m: strokes are no nearer to one another, and how long they are."""
LIFT = 0.35e-3
"""m over the sheet, so that quads that bulge beside them do not hide them."""


def stroke_cells(points: Array, quads: np.ndarray) -> np.ndarray:
    """The quads (k,) that get a stroke: evenly spread, however dense the mesh is; points (n, 3)
    m."""
    from scipy.spatial import cKDTree

    centre = points[quads].mean(axis=1)
    tree, taken, chosen = cKDTree(centre), np.zeros(len(quads), dtype=bool), []
    for i in range(len(quads)):
        if not taken[i]:
            chosen.append(i)
            taken[tree.query_ball_point(centre[i], SPACING)] = True
    return np.array(chosen, dtype=np.intp)


def strokes(points: Array, quads: np.ndarray, direction: Array) -> Array:
    """The ends (k, 2, 3) m of a stroke over each of the quads (m, 4) that has a direction (m,
    3)."""
    own = np.linalg.norm(direction, axis=1) > 0
    corners, along = points[quads[own]], direction[own]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    middle = corners.mean(axis=1) + LIFT * normal
    half = LENGTH / 2 * along
    return np.stack([middle - half, middle + half], axis=1)


def families_of(cell_data: Mapping[str, Array]) -> list[Array]:
    """The directions (m, 3) of each family that a hood's cell data hold."""
    return [np.asarray(cell_data[name]) for name in FAMILIES if name in cell_data]


def carry(quads: np.ndarray, before: Array, after: Array, direction: Array) -> Array:
    """Directions (k, 3) on quads (k, 4) after their nodes moved from `before` (n, 3) to `after`;
    unit, or zero where they were zero."""
    first, last = (_bases(x[quads]) for x in (before, after))
    share = np.einsum("eka,ek->ea", np.linalg.pinv(first), direction)
    out = np.einsum("ea,eak->ek", share, last)
    size = np.linalg.norm(out, axis=1, keepdims=True)
    return np.asarray(out / np.where(size > 0, size, 1.0))


def _bases(corners: Array) -> Array:
    """Base vectors (k, 2, 3) at the centres of quads with corners (k, 4, 3)."""
    one = corners[:, 1] + corners[:, 2] - corners[:, 0] - corners[:, 3]
    two = corners[:, 2] + corners[:, 3] - corners[:, 0] - corners[:, 1]
    return np.stack([one, two], axis=1)
