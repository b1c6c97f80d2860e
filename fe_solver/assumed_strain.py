"""The strains of the four-node shell element: which samples of them, and what becomes of them.

Of the strains (`strain_forms`) 21 are needed, the samples: five membrane strains at the edge
midpoints and the centre (MITC4+: Ko, Lee and Bathe 2017, Comput Struct 182:404, which leaves a flat
element as it is and cures the membrane locking of a warped one), four transverse shears at the edge
midpoints (MITC4: Dvorkin and Bathe 1984, Eng Comput 1:77) and the bending strains at the four Gauss
points.  The strains there, in local Cartesian axes, are constant combinations of the samples.  The
in-plane shear is evened, half way to its mean over the element (Hughes 1980, Int J Numer Meth Eng
15:1413, has the mean alone), so that it bends in its plane with a quarter of the locking, unless
they are asked not to.

A triangle is a quad whose last two corners are one node: its samples on the three edges are those
of the MITC3 element (Lee and Bathe 2004, Comput Struct 82:945).
"""

from __future__ import annotations

import numpy as np

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

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GAUSS = CORNERS / np.sqrt(3.0)
KEPT = 0.5
"""Of the in-plane shear's variation over a quad, where it is evened: a quarter of the energy by
which it locks.  With a third of it slack bands crumple within the elements of fine meshes."""


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Bilinear shape functions and their derivatives by r and by s, each (4,)."""
    a, b = 1 + CORNERS[:, 0] * r, 1 + CORNERS[:, 1] * s
    return a * b / 4, CORNERS[:, 0] * b / 4, CORNERS[:, 1] * a / 4


def _samples() -> Array:
    """(21, 8, 8) forms of the samples: sample i is y.forms[i].y / 2."""
    at = ((0, 1, 0), (0, -1, 0), (1, 0, 1), (-1, 0, 1), (0, 0, 2))
    stretch = [membrane(shape, r, s)[i] for r, s, i in at]
    bend = [form for r, s in GAUSS for form in bending(shape, r, s)]
    along_r = [shear(shape, 0, s)[0] for s in (-1, 1)]
    along_s = [shear(shape, r, 0)[1] for r in (-1, 1)]
    return np.stack(stretch + bend + along_r + along_s)


FOUR = Element(
    CORNERS,
    shape,
    GAUSS,
    np.ones(4),
    np.full(4, 0.25),
    _samples(),
    4,
    np.array([[0, 1, 2, 3]]),
)
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


def quad_membrane(X: Array, a: Array, even: bool) -> Array:
    """(ne, 4, 3, 5) membrane e_rr, e_ss, e_rs at the Gauss points from the samples: MITC4+'s and,
    where `even`, with KEPT of what the shear along the base vectors of the element's centre varies
    about its mean over the element X (ne, 4, 3): by that a bilinear quad, bent in its plane,
    locks."""
    tied = np.stack([_tied_membrane(a, r, s) for r, s in GAUSS], axis=1)
    if not even:
        return tied
    turns, area = to_centre(FOUR, X, GAUSS)
    strain = np.stack([covariant(t, tied[:, g]) for g, t in enumerate(turns)])
    strain[:, :, 2] = mean_kept(strain[:, :, 2], area, KEPT)
    back = [covariant(np.linalg.inv(t), e) for t, e in zip(turns, strain, strict=True)]
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
