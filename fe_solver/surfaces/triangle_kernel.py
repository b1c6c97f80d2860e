"""Exact distances of grid nodes to triangles, compiled by numba where it is installed.

Without numba `fe_solver.surfaces.triangle_distance` does the same in numpy."""

from __future__ import annotations

import numpy as np

from cosim.port import Array
from fe_solver.elements.kernels import compile_kernel


@compile_kernel
def lower_distances(
    begin: int,
    end: int,
    triangles: Array,
    centre: Array,
    normal: Array,
    radius: Array,
    origin: Array,
    spacing: float,
    reach: float,
    squared: Array,
) -> None:
    """Lower the squared distances (nx, ny, nz) of a grid's nodes, those from `begin` to before
    `end` along x, to those of the triangles (n, 3, 3) that are nearer, for nodes whose distance is
    `reach` or less; the discs about the triangles (centre, unit normal or zero, radius) tell which
    may be."""
    low = np.empty(3, dtype=np.intp)
    high = np.empty(3, dtype=np.intp)
    p = np.empty(3)
    for n in range(len(triangles)):
        a, b, c = triangles[n, 0], triangles[n, 1], triangles[n, 2]
        for i in range(3):
            least = min(a[i], b[i], c[i]) - reach
            most = max(a[i], b[i], c[i]) + reach
            low[i] = max(0, int(np.ceil((least - origin[i]) / spacing)))
            high[i] = min(squared.shape[i] - 1, int(np.floor((most - origin[i]) / spacing)))
        low[0], high[0] = max(begin, low[0]), min(end - 1, high[0])
        ball = (reach + radius[n]) ** 2
        for i in range(low[0], high[0] + 1):
            p[0] = origin[0] + spacing * i
            x = p[0] - centre[n, 0]
            for j in range(low[1], high[1] + 1):
                p[1] = origin[1] + spacing * j
                y = p[1] - centre[n, 1]
                room = ball - x * x - y * y
                if room < 0.0:
                    continue
                middle, half = (centre[n, 2] - origin[2]) / spacing, np.sqrt(room) / spacing
                first = max(low[2], int(np.ceil(middle - half)))
                last = min(high[2], int(np.floor(middle + half)))
                for k in range(first, last + 1):
                    so_far = squared[i, j, k]
                    if so_far <= 0.0:
                        continue
                    p[2] = origin[2] + spacing * k
                    z = p[2] - centre[n, 2]
                    height = x * normal[n, 0] + y * normal[n, 1] + z * normal[n, 2]
                    if height * height >= so_far:
                        continue
                    apart = x * x + y * y + z * z
                    beside = np.sqrt(max(apart - height * height, 0.0)) - radius[n]
                    if beside > 0.0 and height * height + beside * beside >= so_far:
                        continue
                    squared[i, j, k] = min(so_far, _distance_squared(a, b, c, p))


@compile_kernel
def _distance_squared(a, b, c, p):  # type: ignore[no-untyped-def]
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    r0, r1, r2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    n0, n1, n2 = ab1 * ac2 - ab2 * ac1, ab2 * ac0 - ab0 * ac2, ab0 * ac1 - ab1 * ac0
    u = (ab1 * r2 - ab2 * r1) * n0 + (ab2 * r0 - ab0 * r2) * n1 + (ab0 * r1 - ab1 * r0) * n2
    v = (r1 * ac2 - r2 * ac1) * n0 + (r2 * ac0 - r0 * ac2) * n1 + (r0 * ac1 - r1 * ac0) * n2
    area = n0 * n0 + n1 * n1 + n2 * n2
    abab = ab0 * ab0 + ab1 * ab1 + ab2 * ab2
    acac = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    if area > 1e-20 * abab * acac and u >= 0 and v >= 0 and u + v <= area:
        h = r0 * n0 + r1 * n1 + r2 * n2
        return h * h / area
    return min(_to_segment(a, b, p), _to_segment(b, c, p), _to_segment(c, a, p))


@compile_kernel
def _to_segment(a, b, p):  # type: ignore[no-untyped-def]
    x0, x1, x2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    r0, r1, r2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    length = x0 * x0 + x1 * x1 + x2 * x2
    t = 0.0
    if length > 0:
        t = min(max((r0 * x0 + r1 * x1 + r2 * x2) / length, 0.0), 1.0)
    g0, g1, g2 = r0 - t * x0, r1 - t * x1, r2 - t * x2
    return g0 * g0 + g1 * g1 + g2 * g2
