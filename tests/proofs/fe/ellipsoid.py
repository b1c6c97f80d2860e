"""The ellipsoid as a rigid shape: signed distance with two exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.surfaces.shapes import Distance, Surface, positive, vector

MOST_ITERATIONS = 60
"""Most iterations for the ellipsoid's multiplier; some five are usual, and bisection alone would
need about 55."""
ALMOST_ZERO = 1e-150
"""Share of a semi-axis that stands for a coordinate of zero, to choose a side of the medial
plane."""


@dataclass(frozen=True)
class Ellipsoid(Surface):
    """An ellipsoid."""

    outside: ClassVar[float] = np.inf
    centre: Array
    """(3,) m."""
    semi_axes: Array
    """(3,) m."""
    axes: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3), a rotation: its columns are the directions of the semi-axes."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", vector(self.centre, "ellipsoid centre"))
        object.__setattr__(self, "semi_axes", vector(self.semi_axes, "ellipsoid semi-axes"))
        positive(float(self.semi_axes.min()), "the least semi-axis of the ellipsoid")
        axes = np.asarray(self.axes, dtype=float)
        object.__setattr__(self, "axes", axes)
        if axes.shape != (3, 3) or not np.allclose(axes.T @ axes, np.eye(3), rtol=0, atol=1e-9):
            raise InputError(
                "the ellipsoid's axes must be a (3, 3) matrix with orthonormal columns, "
                f"got {self.axes!r}"
            )

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3).

        The gradient is the normal at the nearest point of the surface; with the curvatures k there
        and the distance d, those of the level surface are k / (1 + k d)."""
        local = (np.asarray(points, dtype=float) - self.centre) @ self.axes
        foot = _foot(local, self.semi_axes)
        slope = foot / self.semi_axes**2
        steep = np.linalg.norm(slope, axis=1)
        normal = slope / steep[:, None]
        value = np.einsum("ni,ni->n", local - foot, normal)
        hessian = _level_hessian(normal, steep, self.semi_axes, value)
        return Distance(value, normal @ self.axes.T, self.axes @ hessian @ self.axes.T)


def _foot(points: Array, semi: Array) -> Array:
    """The nearest points (n, 3) of an axis-aligned ellipsoid about the origin.

    They are semi_i^2 x_i / (semi_i^2 + t) with the largest root t of |semi_i x_i / (semi_i^2 + t)|
    = 1 (Eberly, Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid, Geometric
    Tools 2013).  Newton on one less the norm's reciprocal, which is almost linear, kept in Eberly's
    bracket; the unknown is t + least^2, so that no digit is lost near the medial plane."""
    size = np.maximum(np.abs(points), ALMOST_ZERO * semi)
    weighted = size * semi
    least = int(np.argmin(semi))
    over = (semi - semi[least]) * (semi + semi[least])
    low, high = (weighted - over).max(axis=1), np.linalg.norm(weighted, axis=1)
    root = low.copy()
    for _ in range(MOST_ITERATIONS):
        part = weighted / (root[:, None] + over)
        square = np.einsum("ni,ni->n", part, part)
        outside = square > 1
        low, high = np.where(outside, root, low), np.where(outside, high, root)
        fall = np.einsum("ni,ni->n", part / (root[:, None] + over), part)
        newer = root + (np.sqrt(square) - 1) * square / fall
        newer = np.where((newer >= low) & (newer <= high), newer, (low + high) / 2)
        done = np.abs(newer - root) <= 4 * np.finfo(float).eps * newer
        root = newer
        if (done | np.isnan(root)).all():
            break
    foot = weighted / (root[:, None] + over) * semi
    return np.copysign(foot, points)


def _level_hessian(normal: Array, steep: Array, semi: Array, value: Array) -> Array:
    """The Hessian S (1 + d S)^-1 (n, 3, 3) with the shape operator S of the ellipsoid at its
    normals, in the two directions of the tangent plane."""
    t1 = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    t2 = np.cross(normal, t1)
    a, b, c = (
        np.einsum("ni,i,ni->n", u, semi**-2, v) / steep for u, v in ((t1, t1), (t1, t2), (t2, t2))
    )
    gauss = a * c - b * b
    determinant = 1 + value * (a + c) + value**2 * gauss
    regular = np.abs(determinant) > 1e-9  # else a focal point, where the level surface has an edge
    scale = np.divide(1.0, determinant, out=np.zeros_like(a), where=regular)
    a, b, c = (a + value * gauss) * scale, b * scale, (c + value * gauss) * scale
    first = a[:, None] * t1 + b[:, None] * t2
    second = b[:, None] * t1 + c[:, None] * t2
    return first[:, :, None] * t1[:, None, :] + second[:, :, None] * t2[:, None, :]
