"""Directors, areas and means at the nodes of elements (ne, k), triangles as (a, b, c, c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints
from fe_solver.elements.kinds import display_quads, kind_of


def is_triangle(quads: Ints) -> NDArray[np.bool_]:
    """Return which elements (ne,) have one node for their last two corners."""
    return quads[:, 2] == quads[:, 3]


def corner_shares(quads: Ints) -> Array:
    """Return each node's share (ne, k) of an element; a triangle's doubled corner counts once."""
    share = np.tile(kind_of(quads).share, (len(quads), 1))
    share[is_triangle(quads), :4] = np.array([2.0, 2.0, 1.0, 1.0]) / 6
    return share


def node_directors(points: Array, quads: Ints) -> Array:
    """Return unit normals at the nodes, (n, 3): the mean of the adjoining elements' there."""
    element, p = kind_of(quads), points[quads]
    bases = [element.base_vectors(p, r, s) for r, s in element.nodes]
    corner = np.stack([np.cross(b[:, 0], b[:, 1]) for b in bases], axis=1)
    triangle = is_triangle(quads)
    corner[triangle, :4] = corner[triangle, :1] * [[[1.0], [1], [0.5], [0.5]]]
    out = np.zeros_like(points)
    np.add.at(out, quads, corner)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def node_means(values: Array, quads: Ints, count: int) -> Array:
    """Return the mean (n,) at each node of the values (ne,) of the elements that meet there, or of
    those (ne, k) that they have at it."""
    each = np.broadcast_to(values.T, quads.T.shape).T.ravel()
    total = np.bincount(quads.ravel(), weights=each, minlength=count)
    return total / np.maximum(np.bincount(quads.ravel(), minlength=count), 1)


def element_areas(points: Array, quads: Ints) -> Array:
    """Return the areas (ne,) m2 of the flat quads that show the elements."""
    p = points[display_quads(quads)]
    area = np.linalg.norm(np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), axis=1) / 2
    return np.asarray(area.reshape(-1, len(kind_of(quads).shown)).sum(axis=1))


def node_areas(points: Array, quads: Ints) -> Array:
    """Return each node's area (n,) m2: of each adjoining element its corner's share."""
    shares = (element_areas(points, quads)[:, None] * corner_shares(quads)).ravel()
    total = np.bincount(quads.ravel(), weights=shares, minlength=len(points))
    return total.astype(float, copy=False)
