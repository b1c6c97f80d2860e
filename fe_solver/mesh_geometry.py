"""Directors, areas and means at the nodes of a mesh of quads and triangles (a, b, c, c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


def is_triangle(quads: Ints) -> NDArray[np.bool_]:
    """(ne,) whose last two corners are one node."""
    return quads[:, 2] == quads[:, 3]


def corner_shares(quads: Ints) -> Array:
    """(ne, 4) of an element for each of its corners; a triangle's doubled corner counts once."""
    triangle = is_triangle(quads)[:, None]
    return np.where(triangle, np.array([2.0, 2.0, 1.0, 1.0]) / 6, 0.25)


def node_directors(points: Array, quads: Ints) -> Array:
    """(n, 3) unit normals at the nodes: the mean of the adjoining corners' normals."""
    p = points[quads]
    edge_in, edge_out = p - np.roll(p, 1, axis=1), np.roll(p, -1, axis=1) - p
    corner = np.cross(edge_in, edge_out)
    triangle = is_triangle(quads)
    corner[triangle] = corner[triangle, :1] * [[[1.0], [1], [0.5], [0.5]]]
    out = np.zeros_like(points)
    np.add.at(out, quads, corner)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def node_means(values: Array, quads: Ints, count: int) -> Array:
    """(n,) mean of the quads' values (ne,) that meet at each node."""
    total = np.bincount(quads.ravel(), weights=np.repeat(values, 4), minlength=count)
    return total / np.maximum(np.bincount(quads.ravel(), minlength=count), 1)


def node_areas(points: Array, quads: Ints) -> Array:
    """(n,) m2, of each adjoining element its corner's share."""
    p = points[quads]
    area = np.linalg.norm(np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), axis=1) / 2
    shares = (area[:, None] * corner_shares(quads)).ravel()
    total = np.bincount(quads.ravel(), weights=shares, minlength=len(points))
    return total.astype(float, copy=False)
