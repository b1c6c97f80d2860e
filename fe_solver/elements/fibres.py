"""Fibre directions: from elements to nodes and to the Gauss points between them, and turned within
the sheet.

A fibre has no sense (f and -f are one), so directions are averaged as f f' and the mean is the
eigenvector of the largest eigenvalue.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.kinds import kind_of


def smooth_fibres(quads: Ints, fibre: Array, region: Ints | Sequence[str] | None = None) -> Array:
    """The unit directions (ne, g, 3) at the Gauss points, continuous over each region, from one
    direction an element (ne, 3); `region` (ne,) keeps what belongs to one from another."""
    names = np.zeros(len(quads), dtype=int) if region is None else np.asarray(region)
    out = np.empty((len(quads), len(kind_of(quads).gauss), 3))
    for name in np.unique(names):
        on = names == name
        out[on] = at_gauss_points(quads[on], at_nodes(quads[on], fibre[on], int(quads.max())))
    return out


def follow_mesh(points: Array, quads: Ints, fibre: Array) -> Array:
    """The directions (ne, g, 3), not of unit length, at the Gauss points of elements with nodes at
    points (n, 3): everywhere the same combination of the element's base vectors as `fibre` (ne, 3)
    is at its centre, so that a fibre that runs along the mesh's lines follows them."""
    element, X = kind_of(quads), points[quads]
    centre = element.base_vectors(X, 0, 0)
    share = np.einsum("nak,nk->na", np.linalg.pinv(np.swapaxes(centre, 1, 2)), fibre)
    bases = [element.base_vectors(X, r, s) for r, s in element.gauss]
    return np.stack([np.einsum("na,nak->nk", share, base) for base in bases], axis=1)


def gauss_points(values: Array, quads: Ints) -> Array:
    """The values (ne, g, ...) at the Gauss points, between those of the nodes (n, ...)."""
    element = kind_of(quads)
    weight = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
    return np.einsum("ga,na...->ng...", weight, values[quads])


def normals(points: Array, quads: Ints) -> Array:
    """The unit normals (ne, g, 3) at the Gauss points, right-handed about the elements' corners."""
    element, X = kind_of(quads), points[quads]
    bases = (element.base_vectors(X, r, s) for r, s in element.gauss)
    out = np.stack([np.cross(base[:, 0], base[:, 1]) for base in bases], axis=1)
    return np.asarray(out / np.linalg.norm(out, axis=2, keepdims=True))


def turn_in_sheet(points: Array, quads: Ints, fibre: Array, angle: Array | float) -> Array:
    """The unit directions (ne, g, 3) of `fibre` (ne, g, 3), brought into the sheet and turned by
    `angle` (ne, g), rad, counter-clockwise about the normal."""
    normal = normals(points, quads)
    first = _into(normal, fibre)
    angle = np.broadcast_to(angle, first.shape[:2])[..., None]
    return np.asarray(np.cos(angle) * first + np.sin(angle) * np.cross(normal, first))


def angle_between(points: Array, quads: Ints, first: Array, second: Array) -> Array:
    """The turn (ne, g) rad, above -pi/2 and at most pi/2, from `first` to `second`, directions (ne,
    g, 3) brought into the sheet, counter-clockwise about the normal."""
    normal = normals(points, quads)
    a, b = _into(normal, first), _into(normal, second)
    sine = np.einsum("egk,egk->eg", np.cross(a, b), normal)
    cosine = np.einsum("egk,egk->eg", a, b)
    same = np.where(cosine < 0, -1.0, 1.0)
    return np.asarray(np.arctan2(same * sine, same * cosine))


def _into(normal: Array, fibre: Array) -> Array:
    """Unit parts of directions in the plane across the normals."""
    out = fibre - np.einsum("egk,egk->eg", fibre, normal)[..., None] * normal
    return np.asarray(out / np.linalg.norm(out, axis=2, keepdims=True))


def at_nodes(quads: Ints, fibre: Array, last: int) -> Array:
    """The unit directions (last + 1, 3) at the nodes, the mean of the adjoining elements' (ne, 3);
    zero where there are none."""
    total = np.zeros((last + 1, 3, 3))
    unit = fibre / np.linalg.norm(fibre, axis=1, keepdims=True)
    np.add.at(total, quads, (unit[:, :, None] * unit[:, None, :])[:, None])
    out = leading(total)
    out[np.trace(total, axis1=1, axis2=2) == 0] = 0.0
    return out


def at_gauss_points(quads: Ints, nodal: Array) -> Array:
    """The unit directions (ne, g, 3) at the Gauss points, between those of the nodes (n, 3)."""
    corner = nodal[quads]
    tensor = corner[..., :, None] * corner[..., None, :]
    element = kind_of(quads)
    weight = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
    return leading(np.einsum("ga,naij->ngij", weight, tensor))


def leading(tensor: Array) -> Array:
    """The unit eigenvectors (..., 3) of the largest eigenvalues of symmetric tensors (..., 3, 3),
    of the sense whose largest component is positive."""
    vector = np.linalg.eigh(tensor)[1][..., -1]
    largest = np.take_along_axis(vector, np.abs(vector).argmax(-1)[..., None], -1)
    return vector * np.where(largest < 0, -1.0, 1.0)
