"""Degrees of freedom, sparse assembly and the one sparse factorisation.

Each node has five degrees of freedom: its displacement along the columns of its basis A (3, 3) and
the turn of its director along two tangents T (3, 2).  A guided node slides along the first column
of its basis; a tied node moves with its body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cosim.port import ConvergenceError

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
DOFS = 5


def tangents(directors: Array) -> Array:
    """(n, 3, 2) orthonormal vectors normal to the unit directors (n, 3)."""
    helper = np.zeros_like(directors)
    helper[np.arange(len(directors)), np.argmin(np.abs(directors), axis=1)] = 1.0
    t1 = np.cross(directors, helper)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    return np.stack([t1, np.cross(directors, t1)], axis=2)


def turned(directors: Array, basis: Array, angles: Array) -> Array:
    """Directors (n, 3) turned on the sphere by angles (n, 2) along the tangents (n, 3, 2)."""
    step = np.einsum("nij,nj->ni", basis, angles)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    sinc = np.sinc(size / np.pi)
    out = np.cos(size) * directors + sinc * step
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def free_dofs(n: int, tied: Ints, guided: Ints) -> Ints:
    """Indices of the free degrees of freedom of n nodes."""
    mask = np.ones((n, DOFS), dtype=bool)
    mask[tied] = False
    mask[guided, 1:3] = False
    return np.flatnonzero(mask)


@dataclass(frozen=True)
class Pattern:
    """Where element entries go in the sparse tangent; built once for a mesh.

    slot (ne * 400,) position of every element entry in the data of the full matrix (CSR, 5n);
    diagonal (n, 5, 5) positions of the nodes' own blocks; `order` the free dofs in the
    factorisation's order, and `free_slot` the full matrix's data positions that make the free
    matrix (CSC, in that order)."""

    size: int
    indptr: Ints
    indices: Ints
    slot: Ints
    diagonal: Ints
    order: Ints
    free_slot: Ints
    free_indptr: Ints
    free_indices: Ints

    def assemble(self, elements: Array, nodes: Array) -> Array:
        """Full data from element blocks (ne, 20, 20) and node blocks (n, 5, 5)."""
        data: Array = np.bincount(
            self.slot, weights=elements.ravel(), minlength=len(self.indices)
        ).astype(float, copy=False)
        data[self.diagonal] += nodes
        return data

    def full(self, data: Array) -> sp.csr_array:
        return sp.csr_array((data, self.indices, self.indptr), shape=(self.size, self.size))

    def free(self, data: Array) -> sp.csc_array:
        n = len(self.order)
        return sp.csc_array(
            (data[self.free_slot], self.free_indices, self.free_indptr), shape=(n, n)
        )


def make_pattern(quads: Ints, n: int, free: Ints) -> Pattern:
    """The sparsity of n nodes joined by quads (ne, 4), with a fill-reducing order of the free
    dofs."""
    dof = (quads[:, :, None] * DOFS + np.arange(DOFS)).reshape(len(quads), 20)
    rows, cols = np.repeat(dof, 20, axis=1).ravel(), np.tile(dof, (1, 20)).ravel()
    size = n * DOFS
    own = (np.arange(n)[:, None] * DOFS + np.arange(DOFS))[:, :, None]
    key = np.concatenate([rows * size + cols, (own * size + np.swapaxes(own, 1, 2)).ravel()])
    unique, inverse = np.unique(key, return_inverse=True)
    indices = unique % size
    indptr = np.searchsorted(unique, np.arange(size + 1) * size)
    slot, diagonal = inverse[: len(rows)], inverse[len(rows) :].reshape(n, DOFS, DOFS)
    positions = sp.csr_array((np.arange(1.0, len(unique) + 1), indices, indptr), shape=(size, size))
    order = free[_fill_reducing(positions[free][:, free])]
    ordered = sp.csc_array(positions[order][:, order])
    ordered.sort_indices()
    free_slot = ordered.data.astype(np.intp) - 1
    return Pattern(
        size, indptr, indices, slot, diagonal, order, free_slot, ordered.indptr, ordered.indices
    )


def _fill_reducing(matrix: sp.csr_array) -> Ints:
    """Minimum-degree order of a symmetric pattern, as SuperLU finds it."""
    regular = sp.csc_array(matrix, copy=True)
    regular.data[:] = 1.0
    regular = sp.csc_array(regular + sp.diags_array(np.full(matrix.shape[0], 1e3)))
    lu = spla.splu(
        regular, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.argsort(lu.perm_c)


def factorise(matrix: sp.csc_array) -> spla.SuperLU:
    """LU of a symmetric matrix already in a fill-reducing order, pivots on the diagonal.

    Raises ConvergenceError for a singular one."""
    try:
        return spla.splu(
            matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise ConvergenceError(
            f"the hood's tangent stiffness cannot be factorised ({error}): some part of it is "
            "free to move. Tie or guide its nodes, or give it springs that are not slack."
        ) from error
