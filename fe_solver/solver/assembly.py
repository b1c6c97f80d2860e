"""Degrees of freedom and sparse assembly.

Each node has five degrees of freedom: its displacement along the columns of its basis A (3, 3) and
the turn of its director along two tangents T (3, 2).  A guided node is held along some of them; a
tied node moves with its body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from cosim.port import Array, Ints
from fe_solver.elements.kernels import sum_entries
from fe_solver.solver.linear_algebra import Analysis, analyse, positions

DOFS = 5


@dataclass(frozen=True)
class Pattern:
    """Where element entries go in the sparse tangent (CSR, 5n); built once for a mesh."""

    size: int
    indptr: Ints
    """The full matrix's."""
    indices: Ints
    """The full matrix's."""
    gather_start: Ints
    """Entry k of the data sums gather[gather_start[k]:gather_start[k + 1]]."""
    gather: Ints
    """Element entries, summed always in this order."""
    diagonal: Ints
    """(n, 5, 5) positions of the nodes' own blocks."""
    pair: Ints
    """(k, 2, 3, 3) positions of the blocks between pairs of nodes (first row second column, and the
    reverse)."""
    free: Ints
    """The free degrees of freedom, ascending."""

    def assemble(self, elements: Array, nodes: Array, pairs: Array) -> Array:
        """Full data from element blocks (ne, 5k, 5k), node blocks (n, 5, 5) and the blocks (k, 3,
        3) of the pairs' first node by their second."""
        data = sum_entries(self.gather_start, self.gather, elements.reshape(-1))
        data[self.diagonal] += nodes
        np.add.at(data, self.pair[:, 0], pairs)
        np.add.at(data, self.pair[:, 1], np.swapaxes(pairs, 1, 2))
        return data

    def full(self, data: Array) -> sp.csr_array:
        """The full matrix of entries `data`."""
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
        """The analysis of the free part for symmetric values."""
        return analyse(self.slots)

    @cached_property
    def general(self) -> Analysis:
        """The analysis of the free part that serves indefinite and unsymmetric values too."""
        return analyse(self.slots, "superlu")


def make_pattern(quads: Ints, n: int, free: Ints, pairs: Ints | None = None) -> Pattern:
    """The sparsity of n nodes joined by elements (ne, k) and by pairs (k, 2) of nodes."""
    pairs = np.zeros((0, 2), dtype=np.intp) if pairs is None else pairs
    dof = (quads[:, :, None] * DOFS + np.arange(DOFS)).reshape(len(quads), DOFS * quads.shape[1])
    size = n * DOFS
    elements = (dof[:, :, None] * size + dof[:, None, :]).ravel()
    nodal = np.arange(n)[:, None] * DOFS + np.arange(DOFS)
    diagonal = nodal[:, :, None] * size + nodal[:, None, :]
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
