"""The strains of the nine-node shell element, quadratic in r and s.

A sheet of stiff fibres in a soft matrix passes force from fibre to fibre by shear, so that what a
fibre bears changes across it within sqrt(E / G) times less than along it, and what holds it narrows
it within a width: few quadratic elements follow both.

Its nodes are the corners, the middles of the edges r = -1, r = 1, s = -1 and s = 1, and the centre.
The samples are those of the MITC9 element (Bucalem and Bathe 1993, Int J Numer Meth Eng 36:3729):
what carries an index r is taken at the two Gauss points of r by the three of s, what carries an
index s the other way round, and e_rs at two by two.  The mean of the membrane strains in the base
of the element's centre is then made that of the untied ones (at two by two Gauss points), without
which a distorted patch under constant stress is out of balance by 1e-5.
"""

from __future__ import annotations

import itertools

import numpy as np

from fe_solver.elements.mitc4 import CORNERS
from fe_solver.elements.strain_forms import (
    Array,
    Element,
    bending,
    covariant,
    membrane,
    shear,
    to_centre,
)

LINEAR = (-np.sqrt(1 / 3), np.sqrt(1 / 3))
QUADRATIC = (-np.sqrt(0.6), 0.0, np.sqrt(0.6))
FACTORS = np.array([5.0, 8.0, 5.0]) / 9
GAUSS = np.array(list(itertools.product(QUADRATIC, QUADRATIC)))
MIDDLES = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [0.0, 0.0]])
NODES = np.vstack([CORNERS, MIDDLES])
IN_TURN = [0, 1, 2, 3, 6, 5, 7, 4, 8]
"""The nodes in the order of VTK and FEBio: corners, then the edges' middles from the first edge on,
then the centre."""
FROM_VTK = [IN_TURN.index(i) for i in range(9)]
"""The nodes of VTK, FEBio, Abaqus and gmsh in this order."""
LINES = np.array([[0, 3, 4], [1, 2, 5], [0, 1, 6], [3, 2, 7], [4, 5, 8], [6, 7, 8]])
"""The two ends and the middle of each edge, and of the two lines through the centre."""
TYING = np.array(list(itertools.product(LINEAR, LINEAR)))
ALONG_R = np.array(list(itertools.product(LINEAR, QUADRATIC)))
ALONG_S = np.array(list(itertools.product(QUADRATIC, LINEAR)))


def _line(x: float, at: Array) -> tuple[Array, Array]:
    """The quadratic shape functions (9,) of a line whose nodes are at -1, 0 and 1, for nodes `at`
    (9,), and their slopes."""
    middle = at == 0
    value = np.where(middle, 1 - x * x, x * (x + at) / 2)
    return value, np.where(middle, -2 * x, x + at / 2)


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Shape functions and their derivatives by r and by s, each (9,)."""
    (a, da), (b, db) = _line(r, NODES[:, 0]), _line(s, NODES[:, 1])
    return a * b, da * b, a * db


def _samples() -> Array:
    """The forms (63, 18, 18) of the samples: e_rr at ALONG_R, e_ss at ALONG_S, then e_rs, e_rr and
    e_ss at TYING; g_r as e_rr, g_s as e_ss."""
    rr = [membrane(shape, r, s)[0] for r, s in ALONG_R]
    ss = [membrane(shape, r, s)[1] for r, s in ALONG_S]
    rest = [membrane(shape, r, s)[i] for i in (2, 0, 1) for r, s in TYING]
    bend = [form for r, s in GAUSS for form in bending(shape, r, s)]
    along_r = [shear(shape, r, s)[0] for r, s in ALONG_R]
    along_s = [shear(shape, r, s)[1] for r, s in ALONG_S]
    return np.stack(rr + ss + rest + bend + along_r + along_s)


NINE = Element(
    NODES,
    shape,
    GAUSS,
    np.outer(FACTORS, FACTORS).ravel(),
    np.array([1.0] * 4 + [4.0] * 4 + [16.0]) / 36,
    _samples(),
    12,
    np.array([[0, 6, 8, 4], [6, 1, 5, 8], [4, 8, 7, 3], [8, 5, 2, 7]]),
)


def _between(points: Array, r: float, s: float) -> Array:
    """The weights (k,) at (r, s) of samples taken at products of Gauss points (k, 2)."""

    def weights(x: float, at: Array) -> Array:
        knots = np.unique(at)
        others = [knots[knots != a] for a in at]
        return np.array([np.prod((x - o) / (a - o)) for a, o in zip(at, others, strict=True)])

    return weights(r, points[:, 0]) * weights(s, points[:, 1])


def _covariant_membrane() -> tuple[Array, Array]:
    """The tied e_rr, e_ss, e_rs (9, 3, 24) at the Gauss points and the untied ones (4, 3, 24) at
    the tying points, from the samples."""
    tied, untied = np.zeros((9, 3, 24)), np.zeros((4, 3, 24))
    for g, (r, s) in enumerate(GAUSS):
        tied[g, 0, :6] = _between(ALONG_R, r, s)
        tied[g, 1, 6:12] = _between(ALONG_S, r, s)
        tied[g, 2, 12:16] = _between(TYING, r, s)
    for i, first in enumerate((16, 20, 12)):
        untied[range(4), i, range(first, first + 4)] = 1.0
    return tied, untied


def mitc_membrane(X: Array) -> Array:
    """The membrane e_rr, e_ss, e_rs (ne, 9, 3, 24) at the Gauss points from the samples, of
    elements X (ne, 9, 3)."""
    tied, untied = _covariant_membrane()
    turns, area = to_centre(NINE, X, GAUSS)
    strain = _transform(turns, tied)
    around, share = to_centre(NINE, X, TYING)
    strain += _mean(_transform(around, untied), share) - _mean(strain, area * NINE.factors[:, None])
    back = [covariant(np.linalg.inv(t), e) for t, e in zip(turns, strain, strict=True)]
    return np.stack(back, axis=1)


def _transform(turns: Array, tensors: Array) -> Array:
    """The covariant tensors (p, ne, 3, m) in the bases of `turns` (p, ne, 2, 2), from `tensors` (p,
    3, m), the same for all elements."""
    pairs = zip(turns, tensors, strict=True)
    return np.stack([covariant(t, np.tile(e, (len(t), 1, 1))) for t, e in pairs])


def _mean(strain: Array, weight: Array) -> Array:
    """The mean (ne, 3, m) of `strain` (p, ne, 3, m) by weight (p, ne)."""
    return np.einsum("pn,pnim->nim", weight / weight.sum(axis=0), strain)


def mitc_shear() -> Array:
    """The shears g_r, g_s (9, 2, 12) at the Gauss points from the shear samples."""
    out = np.zeros((9, 2, 12))
    for g, (r, s) in enumerate(GAUSS):
        out[g, 0, :6], out[g, 1, 6:] = _between(ALONG_R, r, s), _between(ALONG_S, r, s)
    return out
