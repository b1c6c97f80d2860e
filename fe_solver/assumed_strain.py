"""The strains of the four-node shell element: which samples of them, and what becomes of them.

With y = (x1..x4, d1..d4) the positions and directors of an element's nodes every covariant strain
is a quadratic form of y,

    membrane   e_ab = (x,a . x,b - X,a . X,b) / 2
    bending    k_ab = (x,a . d,b + x,b . d,a - reference) / 2
    shear      g_a  =  x,a . d - reference

Only 21 of them are needed, the samples: five membrane strains at the edge midpoints and the centre
(MITC4+: Ko, Lee and Bathe 2017, Comput Struct 182:404, which leaves a flat element as it is and
cures the membrane locking of a warped one), four transverse shears at the edge midpoints (MITC4:
Dvorkin and Bathe 1984, Eng Comput 1:77) and the bending strains at the four Gauss points.  The
strains at a Gauss point, in local Cartesian axes, are constant combinations of the samples.  The
in-plane shear is evened, half way to its mean over the element (Hughes 1980, Int J Numer Meth Eng
15:1413, has the mean alone), so that it bends in its plane with a quarter of the locking, unless
they are asked not to.

A triangle is a quad whose last two corners are one node: its samples on the three edges are those
of the MITC3 element (Lee and Bathe 2004, Comput Struct 82:945).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GAUSS = CORNERS / np.sqrt(3.0)
KEPT = 0.5
"""Of the in-plane shear's variation over a quad, where it is evened: a quarter of the energy by
which it locks.  With a third of it slack bands crumple within the elements of fine meshes."""
MEMBRANE, BENDING, SHEAR = slice(0, 5), slice(5, 17), slice(17, 21)
"""The samples."""


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Bilinear shape functions and their derivatives by r and by s, each (4,)."""
    a, b = 1 + CORNERS[:, 0] * r, 1 + CORNERS[:, 1] * s
    return a * b / 4, CORNERS[:, 0] * b / 4, CORNERS[:, 1] * a / 4


def _xx(a: Array, b: Array) -> Array:
    """(8, 8) M with y.M.y / 2 = (x,a . x,b), of the positions' half of y."""
    out = np.zeros((8, 8))
    out[:4, :4] = np.outer(a, b) + np.outer(b, a)
    return out


def _xd(a: Array, b: Array) -> Array:
    """(8, 8) M with y.M.y / 2 = (sum a x) . (sum b d)."""
    out = np.zeros((8, 8))
    out[:4, 4:] = np.outer(a, b)
    out[4:, :4] = np.outer(b, a)
    return out


def _membrane(r: float, s: float) -> Array:
    """(3, 8, 8) forms of e_rr, e_ss, e_rs (tensor components) at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([_xx(nr, nr) / 2, _xx(ns, ns) / 2, _xx(nr, ns) / 2])


def _bending(r: float, s: float) -> Array:
    """(3, 8, 8) forms of k_rr, k_ss, k_rs at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([_xd(nr, nr), _xd(ns, ns), (_xd(nr, ns) + _xd(ns, nr)) / 2])


def _samples() -> Array:
    """(21, 8, 8) forms of the samples: sample i is y.forms[i].y / 2."""
    membrane = [
        _membrane(0, 1)[0],
        _membrane(0, -1)[0],
        _membrane(1, 0)[1],
        _membrane(-1, 0)[1],
        _membrane(0, 0)[2],
    ]
    bending = [form for r, s in GAUSS for form in _bending(r, s)]
    along_r = [_xd(shape(0, s)[1], shape(0, s)[0]) for s in (-1, 1)]
    along_s = [_xd(shape(r, 0)[2], shape(r, 0)[0]) for r in (-1, 1)]
    return np.stack(membrane + bending + along_r + along_s)


SAMPLES = _samples()
_HOURGLASS = (CORNERS[:, 0], CORNERS[:, 1], CORNERS[:, 0] * CORNERS[:, 1])


def distortion(X: Array) -> Array:
    """(5, ne) coefficients a_A..a_E of the MITC4+ membrane field; X (ne, 4, 3), no triangles.

    Ko, Lee and Bathe 2017, equations 15 to 18: the components of the element's hourglass vector
    along the dual base vectors of its centre."""
    xr, xs, xd = (np.einsum("a,nak->nk", c, X) / 4 for c in _HOURGLASS)
    normal = np.cross(xr, xs)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    dual_r, dual_s = np.cross(xs, normal), np.cross(normal, xr)
    cr = np.einsum("nk,nk->n", dual_r, xd) / np.einsum("nk,nk->n", dual_r, xr)
    cs = np.einsum("nk,nk->n", dual_s, xd) / np.einsum("nk,nk->n", dual_s, xs)
    d = cr**2 + cs**2 - 1
    a = [cr * (cr - 1) / 2, cr * (cr + 1) / 2, cs * (cs - 1) / 2, cs * (cs + 1) / 2, 2 * cr * cs]
    return np.stack(a) / d


def _tied_membrane(a: Array, r: float, s: float) -> Array:
    """(ne, 3, 5) MITC4+ e_rr, e_ss, e_rs at one point from the membrane samples; a (5, ne)."""
    aA, aB, aC, aD, aE = a
    p, q = r * r - 1, s * s - 1
    rr = [
        0.5 * (1 - 2 * aA + s + 2 * aA * s * s),
        0.5 * (1 - 2 * aB - s + 2 * aB * s * s),
        aC * q,
        aD * q,
        aE * q,
    ]
    ss = [
        aA * p,
        aB * p,
        0.5 * (1 - 2 * aC + r + 2 * aC * r * r),
        0.5 * (1 - 2 * aD - r + 2 * aD * r * r),
        aE * p,
    ]
    rs = [
        0.25 * (r + 4 * aA * r * s),
        0.25 * (-r + 4 * aB * r * s),
        0.25 * (s + 4 * aC * r * s),
        0.25 * (-s + 4 * aD * r * s),
        1 + aE * r * s,
    ]
    return np.moveaxis(np.array([rr, ss, rs]), 2, 0)


def base_vectors(X: Array, r: float, s: float) -> Array:
    """(ne, 2, 3) rows the covariant base vectors r and s of the elements X (ne, 4, 3)."""
    _, nr, ns = shape(r, s)
    return np.stack([np.einsum("a,nak->nk", nr, X), np.einsum("a,nak->nk", ns, X)], axis=1)


def quad_membrane(X: Array, a: Array, even: bool) -> Array:
    """(ne, 4, 3, 5) membrane e_rr, e_ss, e_rs at the Gauss points from the samples: MITC4+'s and,
    where `even`, with KEPT of what the shear along the base vectors of the element's centre varies
    about its mean over the element X (ne, 4, 3): by that a bilinear quad, bent in its plane,
    locks."""
    tied = [_tied_membrane(a, r, s) for r, s in GAUSS]
    if not even:
        return np.stack(tied, axis=1)
    at_centre = base_vectors(X, 0, 0)
    dual = np.linalg.solve(at_centre @ np.swapaxes(at_centre, 1, 2), at_centre)
    bases = [base_vectors(X, r, s) for r, s in GAUSS]
    turns = [np.einsum("nak,nbk->nab", dual, base) for base in bases]
    area = np.stack([np.linalg.norm(np.cross(b[:, 0], b[:, 1]), axis=1) for b in bases])
    strain = [_covariant(turn, e) for turn, e in zip(turns, tied, strict=True)]
    mean = np.einsum("gn,gni->ni", area / area.sum(axis=0), [e[:, 2] for e in strain])
    for e in strain:
        e[:, 2] = mean + KEPT * (e[:, 2] - mean)
    back = [_covariant(np.linalg.inv(t), e) for t, e in zip(turns, strain, strict=True)]
    return np.stack(back, axis=1)


def tied_shear(r: float, s: float) -> Array:
    """(2, 4) g_r, g_s at one point from the shear samples."""
    return np.array([[1 - s, 1 + s, 0, 0], [0, 0, 1 - r, 1 + r]]) / 2


TRIANGLE_MEMBRANE = np.array([[0, 4.0, 0, 0, 0], [0, 0, 0, 4, 0], [0, 2, -2, 2, 0]])
"""A triangle's constant membrane strain along its first and last edge from the samples."""


def triangle_shear(r: float, s: float) -> Array:
    """(2, 4) MITC3 shear along the first and last edge from the shear samples."""
    xi, eta = (1 + r) * (1 - s) / 4, (1 + s) / 2
    return np.array([[2 - 2 * eta, 0, 2 * eta, -2 * eta], [2 * xi, 0, 2 - 2 * xi, 2 * xi]])


def _covariant(J: Array, tensor: Array) -> Array:
    """Covariant tensors (rr, ss, rs) in another basis: J (ne, 2, 2) holds the components there of
    the base vectors r and s, its columns; tensor (ne, 3, m)."""
    P = np.linalg.inv(J)
    a, b, c, d = P[:, 0, 0], P[:, 0, 1], P[:, 1, 0], P[:, 1, 1]
    T = [[a * a, c * c, 2 * a * c], [b * b, d * d, 2 * b * d], [a * b, c * d, a * d + b * c]]
    return np.einsum("ijn,njm->nim", np.array(T), tensor)


def to_cartesian(J: Array, tensor: Array) -> Array:
    """Covariant tensors (rr, ss, rs) to local Cartesian (11, 22, 2 x 12), J as in `_covariant`."""
    return _covariant(J, tensor) * np.array([1.0, 1.0, 2.0])[:, None]
