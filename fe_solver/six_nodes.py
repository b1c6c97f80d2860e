"""The strains of the six-node shell element: quadratic in s, linear in r.

A sheet of stiff fibres in a soft matrix passes force from fibre to fibre by shear, so that what a
fibre bears changes across it within sqrt(E / G) times less than along it.  Laid with r along the
fibres the element follows that in few columns, and stays linear where a sheet leaves a bone and
bends within a row.

Its nodes are the corners and the middles of the edges r = -1 (between corners 0 and 3) and r = 1
(between 1 and 2).  The samples are those of the MITC elements (Bathe and Dvorkin 1986, Int J Numer
Meth Eng 22:697; Bucalem and Bathe 1993, Int J Numer Meth Eng 36:3729), direction by direction:
what carries an index r is taken at r = 0 and, along s, at the three Gauss points, what carries an
index s at the two Gauss points of s, between which it is linear.  e_ss and e_rs are taken at both
Gauss points of r, so that constant strains stay constant in tapered elements.  Of what the in-plane
shear, along the base vectors of the element's centre, varies along r as much is kept as by a
four-node element, which locks in its plane otherwise.  The mean of the strains in that base is then
made that of the untied ones (at two by two Gauss points), without which a distorted patch under
constant stress is out of balance by 1e-5.
"""

from __future__ import annotations

import itertools

import numpy as np

from .assumed_strain import CORNERS, KEPT
from .strain_forms import (
    Array,
    Element,
    bending,
    covariant,
    mean_kept,
    membrane,
    shear,
    to_centre,
)

LINEAR, ENDS = (-np.sqrt(1 / 3), np.sqrt(1 / 3)), (-1.0, 1.0)
QUADRATIC = (-np.sqrt(0.6), 0.0, np.sqrt(0.6))
GAUSS = np.array(list(itertools.product(LINEAR, QUADRATIC)))
NODES = np.vstack([CORNERS, [[-1.0, 0.0], [1.0, 0.0]]])
TYING = np.array(list(itertools.product(LINEAR, LINEAR)))


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Shape functions and their derivatives by r and by s, each (6,)."""
    a, middle = NODES[:, 0], NODES[:, 1] == 0
    along, slope = (1 + a * r) / 2, a / 2
    across = np.where(middle, 1 - s * s, s * (s + NODES[:, 1]) / 2)
    bend = np.where(middle, -2 * s, s + NODES[:, 1] / 2)
    return along * across, slope * across, along * bend


def _samples() -> Array:
    """(38, 12, 12) forms: e_rr at the three points of s, then at the two; e_ss, then e_rs, and g_s
    at two of r by two of s, of g_s the ends of r; g_r as e_rr at the three."""
    stretch = [membrane(shape, 0, s)[0] for s in (*QUADRATIC, *LINEAR)]
    rest = [membrane(shape, r, s)[i] for i in (1, 2) for r, s in TYING]
    bend = [form for r, s in GAUSS for form in bending(shape, r, s)]
    along_r = [shear(shape, 0, s)[0] for s in QUADRATIC]
    along_s = [shear(shape, r, s)[1] for r, s in itertools.product(ENDS, LINEAR)]
    return np.stack(stretch + rest + bend + along_r + along_s)


def _between(s: float) -> Array:
    """(2,) weights of the samples at the two Gauss points of s."""
    return (1 + s / np.array(LINEAR)) / 2


SIX = Element(
    NODES,
    shape,
    GAUSS,
    np.tile(np.array([5.0, 8.0, 5.0]) / 9, 2),
    np.array([1.0, 1.0, 1.0, 1.0, 4.0, 4.0]) / 12,
    _samples(),
    7,
    np.array([[0, 1, 5, 4], [4, 5, 2, 3]]),
)


def _covariant_membrane() -> tuple[Array, Array]:
    """(6, 3, 13) tied e_rr, e_ss, e_rs at the Gauss points and (4, 3, 13) the untied ones at the
    tying points, from the samples."""
    tied, own = np.zeros((2, 3, 3, 13)), np.zeros((2, 2, 3, 13))
    for i in range(2):
        for j, s in enumerate(QUADRATIC):
            tied[i, j, 0, j] = 1.0
            tied[i, j, 1, 5 + 2 * i : 7 + 2 * i] = _between(s)
            tied[i, j, 2, 9 + 2 * i : 11 + 2 * i] = _between(s)
        for j in range(2):
            own[i, j, 0, 3 + j] = own[i, j, 1, 5 + 2 * i + j] = own[i, j, 2, 9 + 2 * i + j] = 1.0
    return tied.reshape(6, 3, 13), own.reshape(4, 3, 13)


def tied_membrane(X: Array, even: bool) -> Array:
    """(ne, 6, 3, 13) membrane e_rr, e_ss, e_rs at the Gauss points from the samples, of elements X
    (ne, 6, 3); `even` as in `assumed_strain.quad_membrane`."""
    tied, own = _covariant_membrane()
    turns, area = to_centre(SIX, X, GAUSS)
    strain = _turned(turns, tied)
    if even:
        for row in range(3):
            there = np.arange(row, 6, 3)
            strain[there, :, 2] = mean_kept(strain[there, :, 2], area[there], KEPT)
    around, share = to_centre(SIX, X, TYING)
    strain += _mean(_turned(around, own), share) - _mean(strain, area * SIX.factors[:, None])
    back = [covariant(np.linalg.inv(t), e) for t, e in zip(turns, strain, strict=True)]
    return np.stack(back, axis=1)


def _turned(turns: Array, tensors: Array) -> Array:
    """(p, ne, 3, m) covariant tensors (p, 3, m), the same for all elements, in the bases of `turns`
    (p, ne, 2, 2)."""
    pairs = zip(turns, tensors, strict=True)
    return np.stack([covariant(t, np.tile(e, (len(t), 1, 1))) for t, e in pairs])


def _mean(strain: Array, weight: Array) -> Array:
    """(ne, 3, m) of (p, ne, 3, m) by weight (p, ne)."""
    return np.einsum("pn,pnim->nim", weight / weight.sum(axis=0), strain)


def tied_shear(r: float, s: float) -> Array:
    """(2, 7) g_r, g_s at a Gauss point from the shear samples."""
    out = np.zeros((2, 7))
    out[0, QUADRATIC.index(s)] = 1.0
    out[1, 3:5], out[1, 5:7] = (1 - r) / 2 * _between(s), (1 + r) / 2 * _between(s)
    return out
