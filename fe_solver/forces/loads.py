"""What loads the sheet: inertia, and the pressure that follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array, skew
from fe_solver.elements.kinds import kind_of


@dataclass(frozen=True)
class Inertia:
    """Springs that hold the nodes where inertia would take them; a mass over the square of a time
    step is one."""

    stiffness: Array
    """(n,) N/m."""
    position: Array
    """(n, 3) m, where inertia takes each node."""
    turning: Array
    """(n,) N m."""
    director: Array
    """(n, 3), where it takes each director."""

    def pull(self, x: Array, d: Array) -> tuple[float, Array, Array]:
        """Energy, J, and its gradients by position and director (n, 3)."""
        x, d = x - self.position, d - self.director
        gx, gd = self.stiffness[:, None] * x, self.turning[:, None] * d
        return float(np.vdot(gx, x) + np.vdot(gd, d)) / 2, gx, gd


def node_volumes(x: Array, thickness: Array) -> Array:
    """The shares (ne, k) m3 of an even body force that go to the nodes of elements with a
    mid-surface x (ne, k, 3) and a thickness (ne, k) at them: the integrals of their shape
    functions."""
    element, out = kind_of(x), np.zeros(x.shape[:2])
    for factor, (r, s) in zip(element.factors, element.gauss, strict=True):
        n, nr, ns = element.shape(r, s)
        area = np.cross(np.einsum("a,nak->nk", nr, x), np.einsum("a,nak->nk", ns, x))
        volume = factor * np.linalg.norm(area, axis=1) * (thickness @ n)
        out += volume[:, None] * n
    return out


def pressure_forces(x: Array, pressure: Array) -> Array:
    """The forces (ne, k, 3) N of the pressure (ne,) on the nodes of elements x (ne, k, 3)."""
    element, out = kind_of(x), np.zeros_like(x)
    for factor, (r, s) in zip(element.factors, element.gauss, strict=True):
        n, nr, ns = element.shape(r, s)
        area = np.cross(np.einsum("a,nak->nk", nr, x), np.einsum("a,nak->nk", ns, x))
        out -= factor * n[:, None] * (pressure[:, None] * area)[:, None]
    return out


def pressure_tangent(x: Array, pressure: Array) -> Array:
    """The derivative (ne, k, 3, k, 3) of `pressure_forces`; not symmetric at a free edge."""
    element = kind_of(x)
    out = np.zeros((*x.shape, *x.shape[1:]))
    for factor, (r, s) in zip(element.factors, element.gauss, strict=True):
        n, nr, ns = element.shape(r, s)
        xr, xs = np.einsum("a,nak->nk", nr, x), np.einsum("a,nak->nk", ns, x)
        slope = skew(xr)[:, :, None] * ns[:, None] - skew(xs)[:, :, None] * nr[:, None]
        out -= factor * n[:, None, None, None] * (pressure[:, None, None, None] * slope)[:, None]
    return out
