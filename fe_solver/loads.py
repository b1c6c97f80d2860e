"""What loads the sheet: inertia, and the pressure that follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.port import skew

from .assumed_strain import GAUSS, shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inertia:
    """Springs that hold the nodes where inertia would take them: stiffness (n,) N/m to position (n,
    3), turning (n,) N m to director (n, 3).  A mass over the square of a time step is one."""

    stiffness: Array
    position: Array
    turning: Array
    director: Array

    def pull(self, x: Array, d: Array) -> tuple[float, Array, Array]:
        """Energy, J, and its gradients by position and director (n, 3)."""
        x, d = x - self.position, d - self.director
        gx, gd = self.stiffness[:, None] * x, self.turning[:, None] * d
        return float(np.vdot(gx, x) + np.vdot(gd, d)) / 2, gx, gd


def pressure_forces(x: Array, pressure: Array) -> Array:
    """(ne, 4, 3) N forces of the pressure (ne,) on the corners of quads x (ne, 4, 3)."""
    out = np.zeros_like(x)
    for r, s in GAUSS:
        n, nr, ns = shape(r, s)
        area = np.cross(np.einsum("a,nak->nk", nr, x), np.einsum("a,nak->nk", ns, x))
        out -= n[:, None] * (pressure[:, None] * area)[:, None]
    return out


def pressure_tangent(x: Array, pressure: Array) -> Array:
    """(ne, 4, 3, 4, 3) derivative of `pressure_forces`; not symmetric at a free edge."""
    out = np.zeros((len(x), 4, 3, 4, 3))
    for r, s in GAUSS:
        n, nr, ns = shape(r, s)
        xr, xs = np.einsum("a,nak->nk", nr, x), np.einsum("a,nak->nk", ns, x)
        slope = skew(xr)[:, :, None] * ns[:, None] - skew(xs)[:, :, None] * nr[:, None]
        out -= n[:, None, None, None] * (pressure[:, None, None, None] * slope)[:, None]
    return out
