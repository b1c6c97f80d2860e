"""Degrees of freedom and sparse assembly.

Each node has five degrees of freedom: its displacement along the columns of its basis A (3, 3) and
the turn of its director along two tangents T (3, 2).  A guided node is held along some of them; a
tied node moves with its body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fe_solver.elements.kernels import gathered
from fe_solver.solver.linear_algebra import Analysis, analyse, positions

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
DOFS = 5


def cross(a: Array, b: Array) -> Array:
    """(..., 3) vector products; for the few hundred vectors of a sheet twice as fast as numpy's."""
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def tangents(directors: Array) -> Array:
    """(n, 3, 2) orthonormal vectors normal to the unit directors (n, 3)."""
    helper = np.zeros_like(directors)
    helper[np.arange(len(directors)), np.argmin(np.abs(directors), axis=1)] = 1.0
    t1 = cross(directors, helper)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    return np.stack([t1, cross(directors, t1)], axis=2)


def turned(directors: Array, basis: Array, angles: Array) -> Array:
    """Directors (n, 3) turned on the sphere by angles (n, 2) along the tangents (n, 3, 2)."""
    step = np.einsum("nij,nj->ni", basis, angles)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    sinc = np.sinc(size / np.pi)
    out = np.cos(size) * directors + sinc * step
    return out / np.linalg.norm(out, axis=1, keepdims=True)


@dataclass(frozen=True)
class Pattern:
    """Where element entries go in the sparse tangent; built once for a mesh.

    Of the full matrix (CSR, 5n): indptr, indices; entry k of its data is the sum of the element
    entries gather[gather_start[k]:gather_start[k + 1]], always in this order; diagonal (n, 5, 5)
    positions of the nodes' own blocks, pair (k, 2, 3, 3) those of the blocks between pairs of nodes
    (first row second column, and the reverse); `free` the free degrees of freedom, ascending."""

    size: int
    indptr: Ints
    indices: Ints
    gather_start: Ints
    gather: Ints
    diagonal: Ints
    pair: Ints
    free: Ints

    def assemble(self, elements: Array, nodes: Array, pairs: Array) -> Array:
        """Full data from element blocks (ne, 5k, 5k), node blocks (n, 5, 5) and the blocks (k, 3,
        3) of the pairs' first node by their second."""
        data = gathered(self.gather_start, self.gather, elements.reshape(-1))
        data[self.diagonal] += nodes
        np.add.at(data, self.pair[:, 0], pairs)
        np.add.at(data, self.pair[:, 1], np.swapaxes(pairs, 1, 2))
        return data

    def full(self, data: Array) -> sp.csr_array:
        return sp.csr_array((data, self.indices, self.indptr), shape=(self.size, self.size))

    @cached_property
    def slots(self) -> sp.csc_array:
        """The free part, its entries 1 + their positions in the full data."""
        positions = self.full(np.arange(1.0, len(self.indices) + 1))
        out = sp.csc_array(positions[self.free][:, self.free])
        out.sort_indices()
        return out

    def free_part(self, data: Array) -> sp.csc_array:
        """The free part of the full matrix."""
        slots = self.slots
        return sp.csc_array((data[self._positions], slots.indices, slots.indptr), slots.shape)

    @cached_property
    def _positions(self) -> Ints:
        return positions(self.slots)

    @cached_property
    def analysis(self) -> Analysis:
        """Of the free part, for symmetric values."""
        return analyse(self.slots)

    @cached_property
    def general(self) -> Analysis:
        """Of the free part, for indefinite and unsymmetric values too."""
        return analyse(self.slots, "superlu")


def make_pattern(quads: Ints, n: int, free: Ints, pairs: Ints | None = None) -> Pattern:
    """The sparsity of n nodes joined by elements (ne, k) and by pairs (k, 2) of nodes."""
    pairs = np.zeros((0, 2), dtype=np.intp) if pairs is None else pairs
    dof = (quads[:, :, None] * DOFS + np.arange(DOFS)).reshape(len(quads), DOFS * quads.shape[1])
    size = n * DOFS
    elements = (dof[:, :, None] * size + dof[:, None, :]).ravel()
    own = np.arange(n)[:, None] * DOFS + np.arange(DOFS)
    diagonal = own[:, :, None] * size + own[:, None, :]
    ends = pairs[:, :, None] * DOFS + np.arange(3)
    across = ends[:, 0, :, None] * size + ends[:, 1, None, :]
    back = ends[:, 1, :, None] * size + ends[:, 0, None, :]
    both = np.stack([across, back], axis=1)
    unique, inverse = np.unique(
        np.concatenate([elements, diagonal.ravel(), both.ravel()]), return_inverse=True
    )
    slot, rest = inverse[: len(elements)], inverse[len(elements) :]
    return Pattern(
        size,
        np.searchsorted(unique, np.arange(size + 1) * size),
        unique % size,
        np.concatenate([[0], np.cumsum(np.bincount(slot, minlength=len(unique)))]),
        np.argsort(slot, kind="stable"),
        rest[: diagonal.size].reshape(diagonal.shape),
        rest[diagonal.size :].reshape(both.shape),
        free,
    )


def add_at(out: Array, index: Any, values: Array) -> None:
    """Add in place where an index may come more than once."""
    np.add.at(out, index, values)


def scattered(index: Ints, values: Array, n: int) -> Array:
    """Sum of values (..., 3) at node indices (...) into (n, 3)."""
    flat, index = values.reshape(-1, 3), index.ravel()
    sums = [np.bincount(index, weights=flat[:, k], minlength=n) for k in range(3)]
    return np.stack(sums, axis=1).astype(float, copy=False)  # of no values they are integers
