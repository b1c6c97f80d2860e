"""A tricubic spline and its derivatives at many points, compiled by numba where it is installed.

Without numba `fe_solver.surfaces.spline_distance.SplineDistance` does the same in numpy."""

from __future__ import annotations

from cosim.port import Array
from fe_solver.elements.kernels import compile_kernel, compile_part


@compile_part
def _weights(t: float) -> tuple[float, ...]:
    """Those of four coefficients at a place t in [0, 1] of a cell, then their first and their
    second derivatives."""
    s = 1.0 - t
    return (
        s * s * s / 6,
        (t / 2 - 1) * t * t + 2.0 / 3,
        (s / 2 - 1) * s * s + 2.0 / 3,
        t * t * t / 6,
        -s * s / 2,
        (1.5 * t - 2) * t,
        (2 - 1.5 * s) * s,
        t * t / 2,
        s,
        3 * t - 2,
        3 * s - 2,
        t,
    )


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
    """Values (n,) and gradients (n, 3) at points (n, 3) m of the spline with `coefficients` (nx +
    2, ny + 2, nz + 2) on a grid.  Outside of it the value is `outside`, and that of what is no
    number is none; gradients stay as they are."""
    nx, ny, nz = coefficients.shape
    for n in range(len(points)):
        x, y, z = (
            (points[n, 0] - origin[0]) / spacing,
            (points[n, 1] - origin[1]) / spacing,
            (points[n, 2] - origin[2]) / spacing,
        )
        if not (0.0 <= x <= nx - 3 and 0.0 <= y <= ny - 3 and 0.0 <= z <= nz - 3):
            value[n] = outside + 0.0 * (x + y + z)
            continue
        i0, j0, k0 = min(int(x), nx - 4), min(int(y), ny - 4), min(int(z), nz - 4)
        a, b, c = _weights(x - i0), _weights(y - j0), _weights(z - k0)
        v = vx = vy = vz = 0.0
        for i in range(4):
            c00 = c01 = c10 = 0.0
            for j in range(4):
                z0 = z1 = 0.0
                for k in range(4):
                    at = coefficients[i0 + i, j0 + j, k0 + k]
                    z0 += c[k] * at
                    z1 += c[4 + k] * at
                c00 += b[j] * z0
                c01 += b[j] * z1
                c10 += b[4 + j] * z0
            v += a[i] * c00
            vx += a[4 + i] * c00
            vy += a[i] * c10
            vz += a[i] * c01
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
    nx, ny, nz = coefficients.shape
    h = spacing * spacing
    for n in range(len(points)):
        x, y, z = (
            (points[n, 0] - origin[0]) / spacing,
            (points[n, 1] - origin[1]) / spacing,
            (points[n, 2] - origin[2]) / spacing,
        )
        if not (0.0 <= x <= nx - 3 and 0.0 <= y <= ny - 3 and 0.0 <= z <= nz - 3):
            value[n] = outside + 0.0 * (x + y + z)
            continue
        i0, j0, k0 = min(int(x), nx - 4), min(int(y), ny - 4), min(int(z), nz - 4)
        a, b, c = _weights(x - i0), _weights(y - j0), _weights(z - k0)
        v = vx = vy = vz = vxx = vxy = vxz = vyy = vyz = vzz = 0.0
        for i in range(4):
            # c_jk: contracted in y with derivative j and in z with derivative k
            c00 = c01 = c02 = c10 = c11 = c20 = 0.0
            for j in range(4):
                z0 = z1 = z2 = 0.0
                for k in range(4):
                    at = coefficients[i0 + i, j0 + j, k0 + k]
                    z0 += c[k] * at
                    z1 += c[4 + k] * at
                    z2 += c[8 + k] * at
                c00 += b[j] * z0
                c01 += b[j] * z1
                c02 += b[j] * z2
                c10 += b[4 + j] * z0
                c11 += b[4 + j] * z1
                c20 += b[8 + j] * z0
            v += a[i] * c00
            vx += a[4 + i] * c00
            vy += a[i] * c10
            vz += a[i] * c01
            vxx += a[8 + i] * c00
            vxy += a[4 + i] * c10
            vxz += a[4 + i] * c01
            vyy += a[i] * c20
            vyz += a[i] * c11
            vzz += a[i] * c02
        value[n] = v
        gradient[n, 0], gradient[n, 1], gradient[n, 2] = vx / spacing, vy / spacing, vz / spacing
        hessian[n, 0, 0], hessian[n, 1, 1], hessian[n, 2, 2] = vxx / h, vyy / h, vzz / h
        hessian[n, 0, 1] = hessian[n, 1, 0] = vxy / h
        hessian[n, 0, 2] = hessian[n, 2, 0] = vxz / h
        hessian[n, 1, 2] = hessian[n, 2, 1] = vyz / h
