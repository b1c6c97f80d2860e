"""Small sparse matrices with a known meaning."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


def chain(stiffness: np.ndarray) -> sp.csc_array:
    """(n, n) of springs (n,) in a row, the first of them held."""
    beyond = np.append(stiffness[1:], 0.0)
    out = sp.diags_array(
        [stiffness + beyond, -stiffness[1:], -stiffness[1:]], offsets=[0, 1, -1], format="csc"
    )
    return sp.csc_array(out)


def slots_of(matrix: sp.csc_array) -> sp.csc_array:
    """Its pattern, with 1 + the place of each entry in its data (see `analyse`)."""
    slots = sp.csc_array(matrix, copy=True)
    slots.data[:] = np.arange(1.0, matrix.nnz + 1)
    return slots
