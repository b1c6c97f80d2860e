"""Rigid shapes that a shell touches, as signed distances with two exact derivatives.

All lengths in m, all points in the frame of the body that carries the shape; distances are negative
inside.  On a shape's medial axis, where no direction exists, what has no value there is zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from cosim.errors import InputError
from cosim.port import Array


class Distance(NamedTuple):
    """Signed distance of n points."""

    value: Array
    """(n,) m."""
    gradient: Array
    """(n, 3)."""
    hessian: Array
    """(n, 3, 3) 1/m, symmetric."""


class Surface(Protocol):
    """A closed or unbounded smooth surface of a rigid body."""

    @property
    def outside(self) -> float:
        """The distance (m) up to which distances are right; inf of an exact shape."""
        ...

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3) of the body frame."""
        ...

    def slopes(self, points: Array) -> tuple[Array, Array]:
        """The signed distances (n,) and gradients (n, 3) alone."""
        return self.distance(points)[:2]


def vector(value: object, what: str) -> Array:
    """Three finite numbers, or InputError."""
    out = np.asarray(value, dtype=float)
    if out.shape != (3,) or not np.isfinite(out).all():
        raise InputError(f"{what} must be three finite numbers (m, body frame), got {value!r}")
    return out


def positive(value: float, what: str) -> None:
    """InputError where `value` is not a positive number."""
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{what} must be a positive number (m), got {value!r}")


def _unit(value: object, what: str) -> Array:
    out = vector(value, what)
    positive(float(np.linalg.norm(out)), f"length of the {what}")
    return out / np.linalg.norm(out)


def _ball(arm: Array, radius: Array | float) -> Distance:
    """Distance to balls whose centres are at -arm (n, 3)."""
    length = np.linalg.norm(arm, axis=1)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    gradient = arm * inverse[:, None]
    hessian = (np.eye(3) - gradient[:, :, None] * gradient[:, None, :]) * inverse[:, None, None]
    return Distance(length - radius, gradient, hessian)


def _sweep_distance(
    arm: Array, axis: Array, radius: float, taper: float, low: float, high: float
) -> Distance:
    """Distance to the hull of balls with centres q axis, low <= q <= high, and radii radius -
    taper q: the least over q of |arm - q axis| - radius + taper q.

    Inside the range the least is at q = a - b taper / c (a along the axis, b from it, c the cosine
    of the half-angle), where it is b c + a taper - radius; beyond it that of the last ball.  The
    Hessian jumps from the one to the other; the gradient does not."""
    along = arm @ axis
    beside = arm - along[:, None] * axis
    away = np.linalg.norm(beside, axis=1)
    cosine = np.sqrt(1 - taper**2)
    q = along - away * taper / cosine
    inverse = np.divide(1.0, away, out=np.zeros_like(away), where=away > 0)
    out = beside * inverse[:, None]
    value = away * cosine + along * taper - radius
    gradient = cosine * out + taper * axis
    free = np.eye(3) - np.outer(axis, axis) - out[:, :, None] * out[:, None, :]
    hessian = (cosine * inverse)[:, None, None] * free
    last = np.flatnonzero((q <= low) | (q >= high))
    end = np.clip(q[last], low, high)
    cap = _ball(arm[last] - end[:, None] * axis, radius - taper * end)
    value[last], gradient[last], hessian[last] = cap
    return Distance(value, gradient, hessian)


@dataclass(frozen=True)
class Sphere(Surface):
    """The ball of a centre (3,) and a radius, m.  Raises InputError for a radius that is not
    positive.

    >>> import numpy as np
    >>> from fe_solver.surfaces.shapes import Sphere
    >>> ball = Sphere(np.zeros(3), 0.01)
    >>> d = ball.distance(np.array([[0.012, 0.0, 0.0], [0.0, 0.0, 0.009]]))
    >>> d.value.round(6), d.gradient[0].round(6)  # m, negative inside; outwards
    (array([ 0.002, -0.001]), array([1., 0., 0.]))
    """

    outside: ClassVar[float] = np.inf
    centre: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", vector(self.centre, "sphere centre"))
        positive(self.radius, "sphere radius")

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3)."""
        return _ball(np.asarray(points) - self.centre, self.radius)


@dataclass(frozen=True)
class Capsule(Surface):
    """All points within `radius` (m) of the segment from `start` (3,) to `end` (3,).  Raises
    InputError for a radius that is not positive and ends in one place.

    >>> import numpy as np
    >>> from fe_solver.surfaces.shapes import Capsule
    >>> bone = Capsule(np.zeros(3), np.array([0.03, 0.0, 0.0]), 0.005)
    >>> bone.distance(np.array([[0.01, 0.0, 0.007], [0.037, 0.0, 0.0]])).value.round(6)
    array([0.002, 0.002])
    """

    outside: ClassVar[float] = np.inf
    start: Array
    end: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", vector(self.start, "capsule start"))
        object.__setattr__(self, "end", vector(self.end, "capsule end"))
        positive(self.radius, "capsule radius")
        positive(float(np.linalg.norm(self.end - self.start)), "capsule length (else a sphere)")

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3).

        The Hessian jumps where the cylinder meets its end spheres; elsewhere it is exact."""
        span = self.end - self.start
        length = float(np.linalg.norm(span))
        return _sweep_distance(
            np.asarray(points) - self.start, span / length, self.radius, 0, 0, length
        )


@dataclass(frozen=True)
class Cylinder(Surface):
    """All points within `radius` (m) of the line through `point` (3,) m along `direction` (3,), of
    any length; without ends."""

    outside: ClassVar[float] = np.inf
    point: Array
    direction: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "cylinder point"))
        object.__setattr__(self, "direction", _unit(self.direction, "cylinder direction"))
        positive(self.radius, "cylinder radius")

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3)."""
        arm = np.asarray(points) - self.point
        return _sweep_distance(arm, self.direction, self.radius, 0, -np.inf, np.inf)


def _tapering(shape: RoundCone | Cone, what: str) -> tuple[Array, float]:
    """Checked ends and radii of a cone: the vector between its centres and what must be longer."""
    object.__setattr__(shape, "start", vector(shape.start, f"{what} start"))
    object.__setattr__(shape, "end", vector(shape.end, f"{what} end"))
    positive(shape.start_radius, f"{what} start radius")
    positive(shape.end_radius, f"{what} end radius")
    span = shape.end - shape.start
    positive(float(np.linalg.norm(span)), f"{what} length")
    return span, shape.start_radius - shape.end_radius


@dataclass(frozen=True)
class RoundCone(Surface):
    """A capsule with two radii, a phalanx's shape: the hull of a sphere of `start_radius` (m) about
    `start` (3,) and one of `end_radius` about `end`; its side is tangent to both (C1)."""

    outside: ClassVar[float] = np.inf
    start: Array
    end: Array
    start_radius: float
    end_radius: float

    def __post_init__(self) -> None:
        span, narrowing = _tapering(self, "round cone")
        if abs(narrowing) >= np.linalg.norm(span):
            raise InputError(
                f"round cone: spheres of radii {self.start_radius:g} and {self.end_radius:g} m, "
                f"{np.linalg.norm(span):g} m apart: one holds the other; expected a distance of "
                "the centres above the difference of the radii (else take a sphere)"
            )

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3); the Hessian jumps where the side
        meets the end spheres."""
        span = self.end - self.start
        length = float(np.linalg.norm(span))
        taper = (self.start_radius - self.end_radius) / length
        arm = np.asarray(points) - self.start
        return _sweep_distance(arm, span / length, self.start_radius, taper, 0, length)


@dataclass(frozen=True)
class Cone(Surface):
    """The solid cone whose side passes through the circles of `start_radius` (m) about `start` (3,)
    and of `end_radius` about `end`, their planes normal to the line between them.  Its side goes on
    without end on the wide side and to the apex on the narrow one; equal radii make a cylinder."""

    outside: ClassVar[float] = np.inf
    start: Array
    end: Array
    start_radius: float
    end_radius: float

    def __post_init__(self) -> None:
        _tapering(self, "cone")

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and Hessian at points (n, 3)."""
        span = self.end - self.start
        length = float(np.linalg.norm(span))
        slope = (self.start_radius - self.end_radius) / length
        cosine, sine = 1 / np.hypot(1, slope), slope / np.hypot(1, slope)
        radius = self.start_radius * cosine
        apex = radius / sine if slope else np.inf
        low, high = (apex, np.inf) if slope < 0 else (-np.inf, apex)
        return _sweep_distance(
            np.asarray(points) - self.start, span / length, radius, sine, low, high
        )


@dataclass(frozen=True)
class HalfSpace(Surface):
    """Everything behind the plane through `point` (3,) m with outward `normal` (3,), any length."""

    outside: ClassVar[float] = np.inf
    point: Array
    normal: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "half-space point"))
        object.__setattr__(self, "normal", _unit(self.normal, "half-space normal"))

    def distance(self, points: Array) -> Distance:
        """Signed distance, gradient and (zero) Hessian at points (n, 3)."""
        value = (np.asarray(points) - self.point) @ self.normal
        n = len(value)
        return Distance(value, np.tile(self.normal, (n, 1)), np.zeros((n, 3, 3)))
