"""Fibre directions: from elements to nodes and to the Gauss points between them.

A fibre has no sense (f and -f are one), so directions are averaged as f f' and the mean is the
eigenvector of the largest eigenvalue.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .elements import kind_of

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


def smoothed(quads: Ints, fibre: Array, region: Ints | Sequence[str] | None = None) -> Array:
    """(ne, g, 3) unit directions at the Gauss points, continuous over each region, from one
    direction an element (ne, 3); `region` (ne,) keeps what belongs to one from another."""
    names = np.zeros(len(quads), dtype=int) if region is None else np.asarray(region)
    out = np.empty((len(quads), len(kind_of(quads).gauss), 3))
    for name in np.unique(names):
        own = names == name
        out[own] = at_gauss_points(quads[own], at_nodes(quads[own], fibre[own], int(quads.max())))
    return out


def followed(points: Array, quads: Ints, fibre: Array) -> Array:
    """(ne, g, 3) directions, not of unit length, at the Gauss points of elements with nodes at
    points (n, 3): everywhere the same combination of the element's base vectors as `fibre` (ne, 3)
    is at its centre, so that a fibre that runs along the mesh's lines follows them."""
    element, X = kind_of(quads), points[quads]
    centre = element.base_vectors(X, 0, 0)
    share = np.einsum("nak,nk->na", np.linalg.pinv(np.swapaxes(centre, 1, 2)), fibre)
    bases = [element.base_vectors(X, r, s) for r, s in element.gauss]
    return np.stack([np.einsum("na,nak->nk", share, base) for base in bases], axis=1)


def at_nodes(quads: Ints, fibre: Array, last: int) -> Array:
    """(last + 1, 3) unit directions at the nodes, the mean of the adjoining elements' (ne, 3); zero
    where there are none."""
    total = np.zeros((last + 1, 3, 3))
    unit = fibre / np.linalg.norm(fibre, axis=1, keepdims=True)
    np.add.at(total, quads, (unit[:, :, None] * unit[:, None, :])[:, None])
    out = _leading(total)
    out[np.trace(total, axis1=1, axis2=2) == 0] = 0.0
    return out


def at_gauss_points(quads: Ints, nodal: Array) -> Array:
    """(ne, g, 3) unit directions between those of the nodes (n, 3)."""
    corner = nodal[quads]
    tensor = corner[..., :, None] * corner[..., None, :]
    element = kind_of(quads)
    weight = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
    return _leading(np.einsum("ga,naij->ngij", weight, tensor))


def _leading(tensor: Array) -> Array:
    """(..., 3) unit eigenvectors of the largest eigenvalues of symmetric tensors (..., 3, 3), of
    the sense whose largest component is positive."""
    vector = np.linalg.eigh(tensor)[1][..., -1]
    largest = np.take_along_axis(vector, np.abs(vector).argmax(-1)[..., None], -1)
    return vector * np.where(largest < 0, -1.0, 1.0)
