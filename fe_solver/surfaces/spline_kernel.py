"""A tricubic spline and its derivatives at many points, compiled by numba where it is installed.

Without numba `fe_solver.surfaces.spline_distance.SplineDistance` does the same in numpy."""

from __future__ import annotations

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.kernels import compile_kernel, compile_part


@compile_part
def _find_cell(
    shape: tuple[int, int, int],
    origin: Array,
    spacing: float,
    point: Array,
    cell: Ints,
    w: Array,
    derivatives: int,
) -> bool:
    """Whether a point (3,) m lies in the grid; sets its `cell` (3,) and the weights w (3, 3, 4) of
    four coefficients, by axis and derivative, of so many derivatives."""
    for axis in range(3):
        at, last = (point[axis] - origin[axis]) / spacing, shape[axis] - 3
        if not 0.0 <= at <= last:
            return False
        cell[axis] = min(int(at), last - 1)
        t = at - cell[axis]
        s = 1.0 - t
        w[axis, 0, 0] = s * s * s / 6
        w[axis, 0, 1] = (t / 2 - 1) * t * t + 2.0 / 3
        w[axis, 0, 2] = (s / 2 - 1) * s * s + 2.0 / 3
        w[axis, 0, 3] = t * t * t / 6
        if derivatives > 0:
            w[axis, 1, 0] = -s * s / 2
            w[axis, 1, 1] = (1.5 * t - 2) * t
            w[axis, 1, 2] = (2 - 1.5 * s) * s
            w[axis, 1, 3] = t * t / 2
        if derivatives > 1:
            w[axis, 2, 0] = s
            w[axis, 2, 1] = 3 * t - 2
            w[axis, 2, 2] = 3 * s - 2
            w[axis, 2, 3] = t
    return True


@compile_kernel
def spline_values(
    coefficients: Array,
    origin: Array,
    spacing: float,
    outside: float,
    points: Array,
    value: Array,
) -> None:
    """Values (n,) at points (n, 3) m of the spline with `coefficients` (nx + 2, ny + 2, nz + 2) on
    a grid; outside of it the value is `outside`, and that of what is no number is none."""
    cell, w = np.empty(3, dtype=np.intp), np.empty((3, 3, 4))
    for n in range(len(points)):
        point = points[n]
        if not _find_cell(coefficients.shape, origin, spacing, point, cell, w, 0):
            value[n] = outside + 0.0 * (point[0] + point[1] + point[2])
            continue
        v = 0.0
        for i in range(4):
            c00 = 0.0
            for j in range(4):
                z0 = 0.0
                for k in range(4):
                    z0 += w[2, 0, k] * coefficients[cell[0] + i, cell[1] + j, cell[2] + k]
                c00 += w[1, 0, j] * z0
            v += w[0, 0, i] * c00
        value[n] = v


@compile_kernel
def spline_slopes(
    coefficients: Array,
    origin: Array,
    spacing: float,
    outside: float,
    points: Array,
    value: Array,
    gradient: Array,
) -> None:
    """Values as `spline_values` has them and gradients (n, 3), which stay as they are outside of
    the grid."""
    cell, w = np.empty(3, dtype=np.intp), np.empty((3, 3, 4))
    for n in range(len(points)):
        point = points[n]
        if not _find_cell(coefficients.shape, origin, spacing, point, cell, w, 1):
            value[n] = outside + 0.0 * (point[0] + point[1] + point[2])
            continue
        v = vx = vy = vz = 0.0
        for i in range(4):
            c00 = c01 = c10 = 0.0
            for j in range(4):
                z0 = z1 = 0.0
                for k in range(4):
                    c = coefficients[cell[0] + i, cell[1] + j, cell[2] + k]
                    z0 += w[2, 0, k] * c
                    z1 += w[2, 1, k] * c
                c00 += w[1, 0, j] * z0
                c01 += w[1, 0, j] * z1
                c10 += w[1, 1, j] * z0
            v += w[0, 0, i] * c00
            vx += w[0, 1, i] * c00
            vy += w[0, 0, i] * c10
            vz += w[0, 0, i] * c01
        value[n] = v
        gradient[n, 0], gradient[n, 1], gradient[n, 2] = vx / spacing, vy / spacing, vz / spacing


@compile_kernel
def spline_at(
    coefficients: Array,
    origin: Array,
    spacing: float,
    outside: float,
    points: Array,
    value: Array,
    gradient: Array,
    hessian: Array,
) -> None:
    """Values and gradients as `spline_slopes` has them, and Hessians (n, 3, 3)."""
    cell, w = np.empty(3, dtype=np.intp), np.empty((3, 3, 4))
    for n in range(len(points)):
        point = points[n]
        if not _find_cell(coefficients.shape, origin, spacing, point, cell, w, 2):
            value[n] = outside + 0.0 * (point[0] + point[1] + point[2])
            continue
        v = vx = vy = vz = vxx = vxy = vxz = vyy = vyz = vzz = 0.0
        for i in range(4):
            # c_jk: contracted in y with derivative j and in z with derivative k
            c00 = c01 = c02 = c10 = c11 = c20 = 0.0
            for j in range(4):
                z0 = z1 = z2 = 0.0
                for k in range(4):
                    c = coefficients[cell[0] + i, cell[1] + j, cell[2] + k]
                    z0 += w[2, 0, k] * c
                    z1 += w[2, 1, k] * c
                    z2 += w[2, 2, k] * c
                c00 += w[1, 0, j] * z0
                c01 += w[1, 0, j] * z1
                c02 += w[1, 0, j] * z2
                c10 += w[1, 1, j] * z0
                c11 += w[1, 1, j] * z1
                c20 += w[1, 2, j] * z0
            a, b, c = w[0, 0, i], w[0, 1, i], w[0, 2, i]
            v += a * c00
            vx += b * c00
            vy += a * c10
            vz += a * c01
            vxx += c * c00
            vxy += b * c10
            vxz += b * c01
            vyy += a * c20
            vyz += a * c11
            vzz += a * c02
        value[n] = v
        gradient[n, 0], gradient[n, 1], gradient[n, 2] = vx / spacing, vy / spacing, vz / spacing
        h = spacing * spacing
        hessian[n, 0, 0], hessian[n, 1, 1], hessian[n, 2, 2] = vxx / h, vyy / h, vzz / h
        hessian[n, 0, 1] = hessian[n, 1, 0] = vxy / h
        hessian[n, 0, 2] = hessian[n, 2, 0] = vxz / h
        hessian[n, 1, 2] = hessian[n, 2, 1] = vyz / h
