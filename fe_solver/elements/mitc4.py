"""The strains of the four-node shell element: which samples of them, and what becomes of them.

Of the strains (`strain_forms`) 21 are needed, the samples: five membrane strains at the edge
midpoints and the centre (MITC4+: Ko, Lee and Bathe 2017, Comput Struct 182:404, which leaves a flat
element as it is and cures the membrane locking of a warped one), four transverse shears at the edge
midpoints (MITC4: Dvorkin and Bathe 1984, Eng Comput 1:77) and the bending strains at the four Gauss
points.  The strains there, in local Cartesian axes, are constant combinations of the samples.  A
bilinear element, bent in its plane, shears and so locks; of what the membrane strain varies over a
quad only its projection upon the two fields of Pian and Sumihara is kept (`_project_variation`),
unless it is asked for as it is.

A triangle is a quad whose last two corners are one node: its samples on the three edges are those
of the MITC3 element (Lee and Bathe 2004, Comput Struct 82:945).
"""

from __future__ import annotations

import numpy as np

from fe_solver.elements.strain_forms import (
    Array,
    Element,
    bending,
    covariant,
    membrane,
    shear,
    to_centre,
)

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GAUSS = CORNERS / np.sqrt(3.0)


def shape(r: float, s: float) -> tuple[Array, Array, Array]:
    """Bilinear shape functions and their derivatives by r and by s, each (4,)."""
    a, b = 1 + CORNERS[:, 0] * r, 1 + CORNERS[:, 1] * s
    return a * b / 4, CORNERS[:, 0] * b / 4, CORNERS[:, 1] * a / 4


def _samples() -> Array:
    """The forms (21, 8, 8) of the samples: sample i is y.forms[i].y / 2."""
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
    """The coefficients a_A..a_E (5, ne) of the MITC4+ membrane field; X (ne, 4, 3), no triangles.

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


def _mitc_membrane(a: Array, r: float, s: float) -> Array:
    """The MITC4+ e_rr, e_ss, e_rs (ne, 3, 5) at one point from the membrane samples; a (5, ne)."""
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


def quad_membrane(X: Array, a: Array, centre: Array | None) -> Array:
    """The MITC4+ membrane strains e_rr, e_ss, e_rs (ne, 4, 3, 5) at the Gauss points from the
    samples, of elements X (ne, 4, 3); a (5, ne) as from `distortion`.

    With the base vectors r and s (ne, 2, 3) of the stress-free elements' `centre` the strain bends
    in its plane without locking (`_project_variation`); without, it is bilinear."""
    tied = np.stack([_mitc_membrane(a, r, s) for r, s in GAUSS], axis=1)
    if centre is None:
        return tied
    turns, area = to_centre(FOUR, X, GAUSS)
    strain = np.stack([covariant(t, tied[:, g]) for g, t in enumerate(turns)])
    strain = _project_variation(centre, area / area.sum(axis=0), strain)
    back = [covariant(np.linalg.inv(t), e) for t, e in zip(turns, strain, strict=True)]
    return np.stack(back, axis=1)


def _project_variation(centre: Array, share: Array, strain: Array) -> Array:
    """The strains' mean and, of what they vary about it, the projection (4, ne, 3, m) upon

        (s - <s>) g_r o g_r    and    (r - <r>) g_s o g_s,    g_r, g_s the centre's base vectors,

    the stresses that Pian and Sumihara (1984, Int J Numer Meth Eng 20:1685) assume beside constant
    ones.  Taken as strains they make of the element a B-bar element (Piltner and Taylor 1999, Int J
    Numer Meth Eng 44:615): Pian and Sumihara's where Poisson's ratio is zero, of any law elsewhere.
    The mean is that of the untouched strain, so that any patch of constant stress is in balance.

    strain (4, ne, 3, m) covariant in the base of the centre (ne, 2, 3), share (4, ne) of the area.
    """
    mean = np.einsum("gn,gnim->nim", share, strain)
    metric = np.einsum("nik,njk->ijn", centre, centre)
    fields = np.stack([metric[:, 0] ** 2, metric[:, 1] ** 2, metric[:, 0] * metric[:, 1]], axis=1)
    lever = GAUSS[:, ::-1, None] - np.einsum("gn,gi->in", share, GAUSS[:, ::-1])
    products = np.einsum("gn,gin,gjn->nij", share, lever, lever) * np.moveaxis(metric**2, 2, 0)
    moments = np.einsum("gn,gin,gnim->nim", share, lever, strain[:, :, :2])
    size = np.linalg.solve(products, moments)
    return np.asarray(mean + np.einsum("gin,ikn,nim->gnkm", lever, fields, size))


def mitc_shear(r: float, s: float) -> Array:
    """The shears g_r, g_s (2, 4) at one point from the shear samples."""
    return np.array([[1 - s, 1 + s, 0, 0], [0, 0, 1 - r, 1 + r]]) / 2


TRIANGLE_MEMBRANE = np.array([[0, 4.0, 0, 0, 0], [0, 0, 0, 4, 0], [0, 2, -2, 2, 0]])
"""A triangle's constant membrane strain along its first and last edge from the samples."""


def triangle_shear(r: float, s: float) -> Array:
    """The MITC3 shears (2, 4) along the first and last edge from the shear samples."""
    xi, eta = (1 + r) * (1 - s) / 4, (1 + s) / 2
    return np.array([[2 - 2 * eta, 0, 2 * eta, -2 * eta], [2 * xi, 0, 2 - 2 * xi, 2 * xi]])
