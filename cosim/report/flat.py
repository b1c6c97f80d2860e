"""A curved sheet laid out flat with least stretch.

First conformally (Levy et al. 2002, ACM TOG 21:362, "Least squares conformal maps"), then as
rigidly as possible (Liu et al. 2008, Comput Graph Forum 27:1495, "A local/global approach to mesh
parameterization"): each triangle is turned as best it can be, then all are joined in the least
squares sense, in turns.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import factorized

from cosim.port import Array

ROUNDS = 40
GAP = 2e-3
"""m, between pieces."""


def flatten_sheet(points: Array, quads: np.ndarray) -> Array:
    """Plane coordinates (n, 2) m of a sheet (n, 3) of `quads` (m, 4): the first axis as far as can
    be along world x (distal), from 0 on, the second towards world y (radial), about its middle.
    Pieces that do not hang together lie beside each other; nodes of no quad are at zero."""
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    edges = (triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel())
    graph = sp.coo_matrix((np.ones(len(edges[0])), edges), (len(points), len(points)))
    owner = connected_components(graph, directed=False)[1][triangles[:, 0]]
    out, across = np.zeros((len(points), 2)), 0.0
    for n, piece in enumerate(np.unique(owner)):
        used, small = np.unique(triangles[owner == piece], return_inverse=True)
        flat = _piece(points[used], small.reshape(-1, 3))
        if n:
            flat[:, 1] += across + GAP - flat[:, 1].min()
        out[used], across = flat, float(flat[:, 1].max())
    return out


def _piece(points: Array, faces: np.ndarray) -> Array:
    local = _corners(points, faces)
    flat = _as_rigid_as_possible(_conformal(points, faces, local), faces, local)
    return _orient(flat, points)


def _corners(points: Array, faces: np.ndarray) -> Array:
    """The corners (m, 3) of each triangle in its own plane, complex."""
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / length[:, None]
    x = np.einsum("ij,ij->i", c - a, along)
    y = np.linalg.norm(np.cross(along, c - a), axis=1)
    return np.stack([0 * length, length, x + 1j * y], axis=1)


def _conformal(points: Array, faces: np.ndarray, local: Array) -> Array:
    """The map (n,), complex, whose triangles keep their angles best, two far nodes held."""
    n, rows = len(points), np.repeat(np.arange(len(faces)), 3)
    weight = np.stack([local[:, (k + 2) % 3] - local[:, (k + 1) % 3] for k in range(3)], axis=1)
    weight /= np.sqrt(np.imag(np.conj(local[:, 1]) * local[:, 2]))[:, None]
    system = sp.csr_matrix((weight.ravel(), (rows, faces.ravel())), shape=(len(faces), n))
    held = np.array([np.argmin(points[:, 0]), np.argmax(points[:, 0])])
    ends = np.array([0, np.linalg.norm(points[held[1]] - points[held[0]])], dtype=complex)
    free = np.setdiff1d(np.arange(n), held)
    inner = system[:, free]
    normal, right = inner.conj().T @ inner, -(inner.conj().T @ (system[:, held] @ ends))
    out = np.zeros(n, dtype=complex)
    out[held], out[free] = ends, factorized(normal.tocsc())(right)
    return out


def _as_rigid_as_possible(flat: Array, faces: np.ndarray, local: Array) -> Array:
    """Turns of finding each triangle's rotation and of joining all of them."""
    n = len(flat)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.roll(local, -1, axis=1) - local
    opposite = np.roll(local, -2, axis=1)
    to_start, to_end = local - opposite, np.roll(local, -1, axis=1) - opposite
    area = np.imag(np.conj(to_start) * to_end)
    weight = (np.real(np.conj(to_start) * to_end) / area).ravel()
    across = sp.coo_matrix(
        (np.r_[-weight, -weight], (np.r_[start, end], np.r_[end, start])), (n, n)
    )
    laplacian = across - sp.diags(np.asarray(across.sum(axis=1)).ravel())
    solve = factorized(laplacian.tocsc()[1:, 1:])
    for _ in range(ROUNDS):
        now = (flat[end] - flat[start]).reshape(edge.shape)
        turn = np.sum(weight.reshape(edge.shape) * now * np.conj(edge), axis=1)
        turned = weight * (turn / np.maximum(np.abs(turn), 1e-300)).repeat(3) * edge.ravel()
        right = np.zeros(n, dtype=complex)
        np.add.at(right, end, turned)
        np.subtract.at(right, start, turned)
        flat = np.r_[0, solve(right.real[1:]) + 1j * solve(right.imag[1:])]
    return flat


def _orient(flat: Array, points: Array) -> Array:
    """Turned, and mirrored if need be, so that the axes run distally and radially."""
    plane = np.stack([flat.real, flat.imag], axis=1)
    plane -= plane.mean(axis=0)
    shared = plane.T @ (points[:, :2] - points[:, :2].mean(axis=0))
    distal = shared[:, 0] / np.linalg.norm(shared[:, 0])
    radial = np.array([-distal[1], distal[0]])
    radial *= np.sign(radial @ shared[:, 1])
    out = plane @ np.stack([distal, radial], axis=1)
    out[:, 0] -= out[:, 0].min()
    out[:, 1] -= (out[:, 1].max() + out[:, 1].min()) / 2
    return out
