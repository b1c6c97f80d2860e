"""Directors, areas and means at the nodes of elements (ne, k), triangles as (a, b, c, c)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.elements.kinds import display_quads, kind_of
from fe_solver.elements.mitc9 import LINES


def check_middles(points: Array, quads: Ints, element: Callable[[int], str]) -> None:
    """Check that the middles of nine-node quads (ne, 9) lie between their corners: each nearer to
    the middle of its line than the line's ends are, and any two on the sides on which a flat quad
    has them.  `element` names an element by its index; elements of four nodes have no middles.

    Raises InputError for the first that does not."""
    if quads.shape[1] != 9:
        return
    X = points[quads]
    first, last, middle = np.moveaxis(X[:, LINES], 2, 0)
    square, off = ((last - first) ** 2).sum(axis=2), middle - (first + last) / 2
    wrong = (4 * (off**2).sum(axis=2) >= square) & (square > 0)
    flat = np.concatenate([X[:, LINES[:4, :2]].mean(axis=2), X[:, None, :4].mean(axis=2)], axis=1)
    i, j = np.triu_indices(5, 1)
    turned = ((X[:, 4 + i] - X[:, 4 + j]) * (flat[:, i] - flat[:, j])).sum(axis=2) < 0
    wrong[:, :5] |= (turned[:, :, None] & (i[:, None] == np.arange(5))).any(axis=1)
    bad = np.argwhere(wrong)
    if len(bad):
        a, b, m = LINES[bad[0, 1]] + 1
        raise InputError(
            f"{element(int(bad[0, 0]))}: its node {m} does not lie between its nodes {a} and {b}. "
            "The order of a nine-node quad is: four corners, the middles of the edges 1-4, 2-3, 1-2"
            " and 4-3, the centre; quads in the order of VTK, FEBio, Abaqus or gmsh are taken by "
            "fe_solver.sheet.quads_from_vtk"
        )


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
