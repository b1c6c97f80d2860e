"""The signed distance of any watertight triangle surface, baked once to a C2 spline and cached.

All lengths in m, all points in the frame of the body that carries the surface; distances are
negative inside.  The exact shapes are in `fe_solver.surfaces.shapes`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.array_cache import ArrayCache
from cosim.content_key import content_key
from cosim.errors import InputError
from cosim.port import Array
from fe_solver.elements import kernels
from fe_solver.surfaces.shapes import Distance, Sphere, Surface, positive
from fe_solver.surfaces.spline_kernel import spline_at, spline_slopes
from fe_solver.surfaces.triangle_distance import check_surface, distances_on_grid

__all__ = ["Sphere", "SplineDistance", "Surface"]


VERSION = 3
"""Part of the cache key: raise it when the same surface would bake to other coefficients."""
MOST_NODES = 20_000_000
SAMPLES = 4
"""Vertices beside which a distance that was kept is computed anew."""
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Where xx, xy, xz, yy, yz, zz stand in a Hessian."""


def _basis(t: Array) -> Array:
    """Uniform cubic B-spline weights of four coefficients and their first and second derivatives,
    (3, 4, *t.shape), at t in [0, 1] (de Boor, A Practical Guide to Splines, 1978)."""
    s = 1 - t
    ss, tt = s * s, t * t
    weight = np.empty((3, 4, *t.shape))
    weight[0] = ss * s / 6, (t / 2 - 1) * tt + 2 / 3, (s / 2 - 1) * ss + 2 / 3, tt * t / 6
    weight[1] = ss / -2, (1.5 * t - 2) * t, (2 - 1.5 * s) * s, tt / 2
    weight[2] = s, 3 * t - 2, 3 * s - 2, t
    return weight


def _coefficients(values: Array) -> Array:
    """Coefficients (n + 2, ...) of the natural cubic spline through `values` (n, ...) in axis 0."""
    from scipy.linalg import solveh_banded

    out = np.empty((len(values) + 2, *values.shape[1:]))
    rhs = 6 * values[1:-1]
    rhs[0] -= values[0]
    rhs[-1] -= values[-1]
    bands = np.tile([[1.0], [4.0]], len(rhs))
    out[1], out[-2] = values[0], values[-1]
    out[2:-2] = solveh_banded(bands, rhs.reshape(len(rhs), -1)).reshape(rhs.shape)
    out[0], out[-1] = 2 * out[1] - out[2], 2 * out[-2] - out[-3]
    return out


@dataclass(frozen=True, eq=False)
class SplineDistance:
    """Tricubic uniform B-spline (C2) over a grid of exact signed distances.

    Outside the grid the value is the constant `outside` with zero derivatives: no point there is
    nearer to the surface than that, so it is for contact laws whose reach is shorter.
    """

    origin: Array
    """(3,) m, the first grid node."""
    spacing: float
    coefficients: Array
    """(nx + 2, ny + 2, nz + 2) m, for nx * ny * nz grid nodes."""
    outside: float

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3)."""
        points = np.asarray(points, dtype=float)
        gradient, hessian = np.zeros(points.shape), np.zeros((len(points), 3, 3))
        if kernels.COMPILED:
            value = np.empty(len(points))
            spline_at(*self._grid, points, value, gradient, hessian)
            return Distance(value, gradient, hessian)
        at = (points - self.origin) / self.spacing
        value = self.outside + 0.0 * at.sum(axis=1)  # what is not finite must not pass for far
        cells = np.array(self.coefficients.shape) - 3
        inside = np.flatnonzero(((at >= 0) & (at <= cells)).all(axis=1))
        at = at[inside].T
        cell = np.minimum(at.astype(np.intp), cells[:, None] - 1)
        v, g, h = self._evaluate(cell, at - cell)
        value[inside], gradient[inside] = v, g.T / self.spacing
        hessian[inside] = (h / self.spacing**2)[SYMMETRIC].transpose(2, 0, 1)
        return Distance(value, gradient, hessian)

    def slopes(self, points: Array) -> tuple[Array, Array]:
        """The signed distances (n,) and gradients (n, 3) alone."""
        if not kernels.COMPILED:
            return self.distance(points)[:2]
        value, gradient = np.empty(len(points)), np.zeros(points.shape)
        spline_slopes(*self._grid, points, value, gradient)
        return value, gradient

    @property
    def _grid(self) -> tuple[Array, Array, float, float]:
        return self.coefficients, self.origin, self.spacing, self.outside

    def _evaluate(self, cell: Array, t: Array) -> tuple[Array, Array, Array]:
        """Value (n,), gradient (3, n) and upper Hessian (6, n) per grid spacing, for `cell` (3, n)
        and the place `t` (3, n) in it.  Points run along the last axis, where numpy is fastest."""
        shape = self.coefficients.shape
        i = np.arange(4)
        steps = np.ravel_multi_index(np.meshgrid(i, i, i, indexing="ij"), shape)
        first = np.ravel_multi_index(tuple(cell), shape)
        near = self.coefficients.ravel().take(steps.reshape(64, 1) + first).reshape(4, 4, 4, -1)
        x, y, z = _basis(t).transpose(2, 0, 1, 3)
        # c[a] = near contracted in x with derivative a, and so on for y and z.
        c0, c1, c2 = np.einsum("aip,ijkp->ajkp", x, near)
        c00, c01, c02 = np.einsum("bjp,jkp->bkp", y, c0)
        c10, c11 = np.einsum("bjp,jkp->bkp", y[:2], c1)
        c20 = np.einsum("jp,jkp->kp", y[0], c2)
        v, vz, vzz = np.einsum("ckp,kp->cp", z, c00)
        vy, vyz = np.einsum("ckp,kp->cp", z[:2], c01)
        vx, vxz = np.einsum("ckp,kp->cp", z[:2], c10)
        vxx, vxy, vyy = ((z[0] * c).sum(0) for c in (c20, c11, c02))
        return v, np.stack([vx, vy, vz]), np.stack([vxx, vxy, vxz, vyy, vyz, vzz])

    @classmethod
    def bake(
        cls,
        vertices: Array,
        faces: NDArray[np.integer],
        spacing: float = 0.5e-3,
        margin: float = 4e-3,
        cache: ArrayCache | None = None,
    ) -> SplineDistance:
        """The distance of a watertight triangle surface: vertices (nv, 3) m, faces (nf, 3).

        The grid reaches `margin` beyond the surface.  `cache` keeps baked grids (see
        `cosim.array_cache.user_cache`); None bakes afresh.  Raises InputError for a surface that is
        empty, not watertight or not finite, and for a grid of more than MOST_NODES nodes.
        """
        positive(spacing, "grid spacing")
        positive(margin, "grid margin")
        vertices, faces = check_surface(vertices, faces)
        origin, shape = _grid(vertices, spacing, margin)
        key = _key(vertices, faces, spacing, margin) if cache else ""
        kept = cache.read("distances", key) if cache else None
        if cache and kept is not None:
            found = cls(origin, spacing, kept.get("coefficients", np.zeros(0)), margin)
            if _is_distance_of(found, vertices, faces, shape):
                return found
            cache.drop("distances", key)
        values = distances_on_grid(vertices, faces, origin, spacing, shape)
        baked = cls.from_grid(origin, spacing, values, margin)
        if cache:
            cache.write("distances", key, {"coefficients": baked.coefficients})
        return baked

    def fields(self, values: Callable[[Array], Sequence[Array]]) -> list[SplineDistance]:
        """Return the splines on the same grid through several `values` (n,) at points (n, 3), of
        any unit."""
        cells = np.array(self.coefficients.shape) - 2
        places = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1)
        sampled = values((self.origin + self.spacing * places).reshape(-1, 3))
        return [
            self.from_grid(self.origin, self.spacing, each.reshape(cells), self.outside)
            for each in sampled
        ]

    @classmethod
    def from_grid(
        cls, origin: Array, spacing: float, values: Array, outside: float
    ) -> SplineDistance:
        """The spline through distances (m) at grid nodes, values (nx, ny, nz), three or more each
        way; its second derivative across the border of the grid is zero there."""
        for axis in range(3):
            values = np.moveaxis(_coefficients(np.moveaxis(values, axis, 0)), 0, axis)
        return cls(origin, spacing, np.ascontiguousarray(values), outside)


def _is_distance_of(
    kept: SplineDistance, vertices: Array, faces: NDArray[np.integer], shape: tuple[int, ...]
) -> bool:
    """Whether a distance that was written elsewhere is of the surface: positive at the grid's first
    node, and exact at nodes beside some of the vertices."""
    values, h = kept.coefficients, kept.spacing
    if values.shape != tuple(n + 2 for n in shape) or not np.isfinite(values).all():
        return False
    middle = vertices[faces].mean(axis=1)
    radius = np.linalg.norm(vertices[faces] - middle[:, None], axis=2).max(axis=1)
    cube = np.stack(np.meshgrid(*3 * [[0, 1]], indexing="ij"), axis=-1).reshape(-1, 3)
    for vertex in vertices[np.linspace(0, len(vertices) - 1, SAMPLES).astype(int)]:
        corner = kept.origin + h * np.floor((vertex - kept.origin) / h)
        near = faces[np.linalg.norm(middle - vertex, axis=1) <= radius + 4 * h]
        exact = np.abs(distances_on_grid(vertices, near, corner, h, (2, 2, 2)))
        off = np.abs(kept.distance(corner + h * cube).value) - exact.ravel()
        if np.abs(off).max() > 1e-6 * h:
            return False
    return bool(kept.distance(kept.origin[None]).value[0] > 0)


def _grid(vertices: Array, spacing: float, margin: float) -> tuple[Array, tuple[int, ...]]:
    """First node and node counts of a grid reaching at least `margin` beyond the surface."""
    low, high = vertices.min(0) - margin, vertices.max(0) + margin
    cells = np.ceil((high - low) / spacing)
    if np.prod(cells + 1) > MOST_NODES:
        size = " x ".join(f"{s:.3g}" for s in high - low)
        raise InputError(
            f"distance grid of {size} m at a spacing of {spacing:g} m has more than "
            f"{MOST_NODES:,} nodes; expected a bone in metres: scale the surface (mm are 0.001 m) "
            "or take a larger spacing"
        )
    origin = (low + high - cells * spacing) / 2
    return origin, tuple(int(c) + 1 for c in cells)


def _key(vertices: Array, faces: NDArray[np.integer], spacing: float, margin: float) -> str:
    corners = np.ascontiguousarray(vertices, dtype="<f8")
    return content_key((VERSION, spacing, margin, corners, np.ascontiguousarray(faces, "<i8")))
