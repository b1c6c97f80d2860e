"""What shell elements have in common: a kind of element, and its strains as quadratic forms.

With y = (x1..xk, d1..dk) the positions and directors of an element's nodes every covariant strain
is a quadratic form of y,

    membrane   e_ab = (x,a . x,b - X,a . X,b) / 2
    bending    k_ab = (x,a . d,b + x,b . d,a - reference) / 2
    shear      g_a  =  x,a . d - reference

An element samples each of them at a few points (`Element.samples`); what becomes of the samples is
its assumed strain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array

Shape = Callable[[float, float], tuple[Array, Array, Array]]
"""Shape functions at (r, s) and their derivatives by r and by s, each (k,)."""


@dataclass(frozen=True)
class Element:
    """A kind of quadrilateral element over -1 <= r, s <= 1, its first four nodes the corners."""

    nodes: Array
    """(k, 2) r and s of the nodes."""
    shape: Shape
    """The shape functions and their derivatives at r and s."""
    gauss: Array
    """(g, 2) r and s of the integration points."""
    factors: Array
    """(g,) weights of the integration points."""
    share: Array
    """(k,) of its area for each node."""
    samples: Array
    """(m, 2k, 2k) forms: sample i is y.samples[i].y / 2, first of the membrane, then 3 g of
    bending, point by point, then of shear."""
    shear_samples: int
    """How many of the samples, the last, are of shear."""
    shown: NDArray[np.intp]
    """(h, 4) nodes of the flat quads that show it."""

    @cached_property
    def parts(self) -> tuple[slice, slice, slice]:
        """The samples of membrane, bending and shear."""
        m, b = len(self.samples) - self.shear_samples, 3 * len(self.gauss)
        return slice(0, m - b), slice(m - b, m), slice(m, len(self.samples))

    def base_vectors(self, X: Array, r: float, s: float) -> Array:
        """The covariant base vectors r and s, as rows (ne, 2, 3), of the elements X (ne, k, 3)."""
        _, nr, ns = self.shape(r, s)
        return np.stack([np.einsum("a,nak->nk", nr, X), np.einsum("a,nak->nk", ns, X)], axis=1)


def xx(a: Array, b: Array) -> Array:
    """The form M (2k, 2k) with y.M.y / 2 = (sum a x) . (sum b x), of the positions' half of y."""
    k = len(a)
    out = np.zeros((2 * k, 2 * k))
    out[:k, :k] = np.outer(a, b) + np.outer(b, a)
    return out


def xd(a: Array, b: Array) -> Array:
    """The form M (2k, 2k) with y.M.y / 2 = (sum a x) . (sum b d)."""
    k = len(a)
    out = np.zeros((2 * k, 2 * k))
    out[:k, k:] = np.outer(a, b)
    out[k:, :k] = np.outer(b, a)
    return out


def membrane(shape: Shape, r: float, s: float) -> Array:
    """The forms (3, 2k, 2k) of e_rr, e_ss, e_rs (tensor components) at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([xx(nr, nr) / 2, xx(ns, ns) / 2, xx(nr, ns) / 2])


def bending(shape: Shape, r: float, s: float) -> Array:
    """The forms (3, 2k, 2k) of k_rr, k_ss, k_rs at one point."""
    _, nr, ns = shape(r, s)
    return np.stack([xd(nr, nr), xd(ns, ns), (xd(nr, ns) + xd(ns, nr)) / 2])


def shear(shape: Shape, r: float, s: float) -> Array:
    """The forms (2, 2k, 2k) of g_r, g_s at one point."""
    n, nr, ns = shape(r, s)
    return np.stack([xd(nr, n), xd(ns, n)])


def covariant(J: Array, tensor: Array) -> Array:
    """Covariant tensors (rr, ss, rs) in another basis: J (ne, 2, 2) holds the components there of
    the base vectors r and s, its columns; tensor (ne, 3, m)."""
    P = np.linalg.inv(J)
    a, b, c, d = P[:, 0, 0], P[:, 0, 1], P[:, 1, 0], P[:, 1, 1]
    T = [[a * a, c * c, 2 * a * c], [b * b, d * d, 2 * b * d], [a * b, c * d, a * d + b * c]]
    return np.einsum("ijn,njm->nim", np.array(T), tensor)


def to_cartesian(J: Array, tensor: Array) -> Array:
    """Covariant tensors (rr, ss, rs) to local Cartesian (11, 22, 2 x 12), J as in `covariant`."""
    return covariant(J, tensor) * np.array([1.0, 1.0, 2.0])[:, None]


def to_centre(element: Element, X: Array, points: Array) -> tuple[Array, Array]:
    """Return the components (p, ne, 2, 2) of the base vectors at points (p, 2) of the elements X
    (ne, k, 3), as columns, along those of the element's centre, and their area factors (p, ne)."""
    centre = element.base_vectors(X, 0, 0)
    dual = np.linalg.solve(centre @ np.swapaxes(centre, 1, 2), centre)
    bases = np.stack([element.base_vectors(X, r, s) for r, s in points])
    area = np.linalg.norm(np.cross(bases[:, :, 0], bases[:, :, 1]), axis=2)
    return np.einsum("nak,pnbk->pnab", dual, bases), area
