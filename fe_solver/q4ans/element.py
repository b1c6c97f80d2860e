"""FEBio's `q4ans` shell, from its documentation: the element that `cosim solve` takes where it can.

Each node is a pair, one on either face of the sheet; the element is the solid between the faces,
linear through the thickness (FEBio theory manual 3.4, section 4.2; user manual 3.4, section 3.6.2:
"assumed natural strain").  Total Lagrangian, with the natural strains assumed

    transverse shears E13, E23    linear between the edges' midpoints (Dvorkin and Bathe 1984, Eng
                                  Comput 1:77)
    thickness strain E33          bilinear between the corners (Betsch and Stein 1995, Commun Numer
                                  Meth Eng 11:899)

the others as the displacements have them; 2 x 2 x 2 Gauss points, all six strains in the law.  A
triangle is a quad whose last two corners are one node.

Every natural strain at a Gauss point is a quadratic form of the nodes' positions, the same for all
elements (`FORMS`), so that the tangent is exact and symmetric.

E33 is constant through the thickness and depends on the nodes alone.  Poisson's contraction, linear
through it in bending, is held back, so that a sheet of nu = 0.4 bends (lambda + 2 mu) (1 - nu^2) /
E = 1.8 times too stiffly (thickness locking); and where a point load leaves the strains of an
element uneven, the thickness cannot follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from fe_solver.elements.mitc4 import CORNERS, GAUSS, shape
from fe_solver.materials.linear import Law
from fe_solver.q4ans.laws import (
    FIRST,
    PAIRS,
    SECOND,
    SHEAR,
    in_situ_strain,
    solid_stress,
)

POINTS = tuple((r, s, t) for r, s in GAUSS.tolist() for t in (-(3**-0.5), 3**-0.5))


def base_weights(r: float, s: float, t: float) -> Array:
    """The base vectors' weights (3, 8) of the nodes: four on the file's face (t = -1), then four on
    the other (t = 1)."""
    n, nr, ns = shape(r, s)
    low, high = (1 - t) / 2, (1 + t) / 2
    return np.stack(
        [
            np.concatenate([low * nr, high * nr]),
            np.concatenate([low * ns, high * ns]),
            np.concatenate([-n, n]) / 2,
        ]
    )


def _form(point: tuple[float, float, float], i: int, j: int) -> Array:
    """M (8, 8) with y.M.y / 2 = g_i.g_j, halved where i = j: a strain with engineering shears."""
    weights = base_weights(*point)
    both = np.outer(weights[i], weights[j])
    return both if i == j else both + both.T


def _assumed_shear(r: float, s: float, t: float) -> Array:
    """The forms (6, 8, 8) of one point's natural strains."""
    corners = zip(shape(r, s)[0], CORNERS, strict=True)
    thickness = sum(n * _form((a, b, 0), 2, 2) for n, (a, b) in corners)
    along_r = ((1 - s) * _form((0, -1, 0), 0, 2) + (1 + s) * _form((0, 1, 0), 0, 2)) / 2
    along_s = ((1 - r) * _form((-1, 0, 0), 1, 2) + (1 + r) * _form((1, 0, 0), 1, 2)) / 2
    assumed = {(2, 2): thickness, (0, 2): along_r, (1, 2): along_s}
    return np.stack([assumed.get(pair, _form((r, s, t), *pair)) for pair in PAIRS])


FORMS = np.stack([_assumed_shear(*point) for point in POINTS])
"""(8, 6, 8, 8): natural strain c at point g is y.FORMS[g, c].y / 2, less that at rest."""
_FLAT = FORMS.reshape(-1, 8)


@dataclass(frozen=True)
class SolidTables:
    """Constants of a mesh of solid-shell elements."""

    rest: Array
    """(ne, 48, 1), the forms' values without stress."""
    local: Array
    """(ne, 8, 6, 6), local Cartesian strains from the natural ones."""
    volume: Array
    """(ne, 8) m3, of the points."""


def _bases(Y: Array) -> Array:
    """The base vectors, as rows (ne, 8, 3, 3), at the Gauss points of elements Y (ne, 8, 3) m."""
    weights = np.stack([base_weights(*point) for point in POINTS])
    return np.asarray(np.einsum("gia,nak->ngik", weights, Y))


def cross_matrix(Y: Array, side: float) -> NDArray[np.bool_]:
    """Whether (ne,) the faces of elements Y (ne, 8, 3) m cross, as those of a sheet do that is
    thicker than its radius; `side` is positive where the last four nodes lie on the side of the
    first four's normal, else negative."""
    return np.asarray((np.linalg.det(_bases(Y)) * side <= 0).any(axis=1))


def solid_tables(Y: Array, fibre: Array, stretch: float = 1.0) -> SolidTables:
    """Tables for elements with nodes Y (ne, 8, 3) m; local axis 1 is `fibre` (ne, 3) brought into
    the sheet's plane, axis 3 its normal.

    Fibres are stretched in situ by `stretch`, with the volume kept (FEBio's `uncoupled prestrain
    elastic`): strains, and with them forces and tangents, are those from the stress-free sheet,
    E_e = p (E of Y) + E0 (`in_situ_strain`)."""
    G = _bases(Y)
    volume = np.linalg.det(G)
    normal = np.cross(G[..., 0, :], G[..., 1, :])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    along = fibre[:, None] - np.einsum("nk,ngk->ng", fibre, normal)[..., None] * normal
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    axes = np.stack([along, np.cross(normal, along), normal], axis=2)
    factors, initial = in_situ_strain(stretch)
    local = factors[:, None] * _to_local(axes @ np.linalg.inv(G))
    rest = _gradient(Y) @ Y.reshape(-1, 24, 1) / 2
    rest -= np.linalg.solve(local, initial[:, None]).reshape(-1, 48, 1)
    return SolidTables(rest, local, np.abs(volume))


def _to_local(P: Array) -> Array:
    """The matrix (..., 6, 6) to local strains by engineering components from P (..., 3, 3), the
    local components (rows) of the dual base vectors (columns)."""
    a, b, i, j = FIRST[:, None], SECOND[:, None], FIRST, SECOND
    both = P[..., a, i] * P[..., b, j] + P[..., a, j] * P[..., b, i]
    return np.asarray(both * np.where(SHEAR, 1.0, 0.5)[:, None])


def _gradient(y: Array) -> Array:
    """The derivatives (ne, 48, 24) of the natural strains by the positions y (ne, 8, 3)."""
    return (_FLAT @ y).reshape(len(y), 48, 24)


def solid_strain(tables: SolidTables, y: Array) -> Array:
    """The local Green-Lagrange strains (ne, 8, 6) from the stress-free sheet, engineering shears,
    at nodes y (ne, 8, 3) m."""
    natural = _gradient(y) @ y.reshape(-1, 24, 1) / 2 - tables.rest
    return np.asarray((tables.local @ natural.reshape(-1, 8, 6, 1))[..., 0])


class Stressed(NamedTuple):
    """What elements at some place bear, and how it follows: S (ne, 8, 6) Pa and dS/dE times the
    strains' derivatives by the natural ones (ne, 8, 6, 6) Pa, and these by the positions (ne, 48,
    24) 1/m."""

    stress: Array
    stiffness: Array
    gradient: Array

    def after(self, moved: Array) -> Array:
        """The stress (ne, 8, 6) to first order after the nodes have moved by (ne, 8, 3) m."""
        natural = (self.gradient @ moved.reshape(-1, 24, 1)).reshape(-1, 8, 6, 1)
        return np.asarray(self.stress + (self.stiffness @ natural)[..., 0])


def solid_response(
    tables: SolidTables, law: Law, y: Array, predicted: Array | None = None
) -> tuple[Array, Array, Stressed]:
    """Internal forces (ne, 24) N and tangents (ne, 24, 24) N/m at nodes y (ne, 8, 3) m, and what
    they bear there.  The tangents' geometric part is of the stress `predicted` (ne, 8, 6) Pa where
    it is given.

    Raises InputError for a law that is not known."""
    ne, T = len(y), tables.local
    B = _gradient(y)
    natural = B @ y.reshape(ne, 24, 1) / 2 - tables.rest
    stress, stiff = solid_stress(law, (T @ natural.reshape(ne, 8, 6, 1))[..., 0])
    back, volume = np.swapaxes(T, 2, 3), tables.volume[..., None, None]
    pull = ((back @ stress[..., None]) * volume).reshape(ne, 1, 48)
    along = stiff @ T
    inner = (back @ along) * volume @ B.reshape(ne, 8, 6, 24)
    blocks = (np.swapaxes(B, 1, 2) @ inner.reshape(ne, 48, 24)).reshape(ne, 8, 3, 8, 3)
    turned = pull
    if predicted is not None:
        turned = ((back @ predicted[..., None]) * volume).reshape(ne, 1, 48)
    geometric = (turned[:, 0] @ FORMS.reshape(48, 64)).reshape(ne, 8, 8)
    for k in range(3):
        blocks[:, :, k, :, k] += geometric
    return (pull @ B)[:, 0], blocks.reshape(ne, 24, 24), Stressed(stress, along, B)
