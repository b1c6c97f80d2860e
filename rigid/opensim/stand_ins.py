"""Cylinders and spheres of MuJoCo in the place of surfaces over which its tendons cannot wrap.

A segment over an ellipsoid or a torus gets the sphere or cylinder, on a side or not, whose lengths
are nearest to the surface's at the sampled postures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cosim.port import Array
from rigid.opensim.wrapping import torus_cylinder

STARTS = (1.0, 0.5)
"""Radii at which a fit begins, of the surface's own radius of curvature along the path."""
LENGTH_SCALE = 0.01
"""m, of places and radii in a fit."""
MOST_STEPS = 30
GOOD = 1e-5
"""m, the error of a fit that needs no other beside it."""
WITHIN = 1e-9
"""Relative, by which a point on the surface is taken to be outside."""
TINY = 1e-15
HALVINGS = 40
"""Steps of the search for where a way touches the rim of a hole."""
KEEP_OUT = 10.0
"""How much more than a length the depth of an end within a surface counts in a fit."""
LEAST_HOLE = 1e-5
"""m, the radius of a hole at least."""


@dataclass(frozen=True)
class StandIn:
    """A sphere at `place` (3,) m, or a cylinder there about the column z of `rotation` (3, 3), or
    a sphere through which the path goes; its radius (m), and the direction (3,) in its own frame of
    the half that the path keeps to."""

    rotation: Array
    place: Array
    radius: float
    shape: Literal["sphere", "cylinder", "hole"]
    side: Array | None


def sphere_lengths(a: Array, b: Array, radius: float, side: Array | None) -> Array:
    """The lengths (n,) m of ways from a to b (n, 3) m round a sphere at the origin, as MuJoCo's
    tendons take them: straight where an end is within."""
    far_a, far_b = (np.linalg.norm(ends, axis=1) for ends in (a, b))
    is_out = np.minimum(far_a, far_b) > radius
    far_a, far_b = (np.maximum(far, radius * (1 + WITHIN)) for far in (far_a, far_b))
    nearest = _nearest(a, b)
    turn = np.arccos(np.clip((a * b).sum(axis=1) / (far_a * far_b), -1, 1))
    lines = np.sqrt(far_a**2 - radius**2) + np.sqrt(far_b**2 - radius**2)
    cut = np.arccos(radius / far_a) + np.arccos(radius / far_b)
    hits = is_out & (np.linalg.norm(nearest, axis=1) < radius)
    straight = np.linalg.norm(b - a, axis=1)
    short = np.where(hits, lines + radius * np.maximum(turn - cut, 0), straight)
    if side is None:
        return short
    far = lines + radius * np.maximum(2 * np.pi - turn - cut, 0)
    return np.where(is_out & (nearest @ side < 0), far, short)


def cylinder_lengths(a: Array, b: Array, radius: float, side: Array | None) -> Array:
    """The lengths (n,) m of ways from a to b (n, 3) m round a cylinder about z."""
    flat = sphere_lengths(a * (1, 1, 0), b * (1, 1, 0), radius, side)
    return np.hypot(flat, b[:, 2] - a[:, 2])


def hole_lengths(a: Array, b: Array, radius: float) -> Array:
    """The lengths (n,) m of ways from a to b (n, 3) m that come within a sphere at the origin."""
    nearest = _nearest(a, b)
    off = np.linalg.norm(nearest, axis=1)
    out = nearest / np.maximum(off, TINY)[:, None]
    along = b - a - ((b - a) * out).sum(axis=1)[:, None] * out
    along /= np.maximum(np.linalg.norm(along, axis=1), TINY)[:, None]

    def through(angle: Array) -> Array:
        place = radius * (np.cos(angle)[:, None] * out + np.sin(angle)[:, None] * along)
        return np.asarray(np.linalg.norm(place - a, axis=1) + np.linalg.norm(place - b, axis=1))

    low, high = np.full(len(a), -np.pi / 2), np.full(len(a), np.pi / 2)
    for _ in range(HALVINGS):
        third = (high - low) / 3
        is_left = through(low + third) < through(high - third)
        low, high = np.where(is_left, low, low + third), np.where(is_left, high - third, high)
    straight = np.asarray(np.linalg.norm(b - a, axis=1))
    return np.where(off < radius, straight, through((low + high) / 2))


def _nearest(a: Array, b: Array) -> Array:
    """The places (n, 3) m of segments from a to b that are nearest to the origin."""
    along = b - a
    t = np.clip(-(a * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), TINY), 0, 1)
    return np.asarray(a + t[:, None] * along)


def stand_in_ellipsoid(a: Array, b: Array, lengths: Array, radii: Array, touched: Array) -> StandIn:
    """The sphere or cylinder for an ellipsoid of three radii (m), from the ends of a segment (n, 3)
    m and its lengths (n,) m, at whose `touched` (m, 3) the path lies on it."""
    middle = touched.mean(axis=0)
    middle /= np.linalg.norm(middle / radii)
    slope = middle / radii**2
    normal = slope / np.linalg.norm(slope)
    along = (b - a).mean(axis=0)
    along -= along @ normal * normal
    along /= np.linalg.norm(along)
    own = float(np.linalg.norm(slope) / (along**2 / radii**2).sum())
    across = np.cross(normal, along)
    starts = [(share * own, side) for share in STARTS for side in (normal, None)]

    def fits() -> Iterator[tuple[float, StandIn]]:
        for radius, side in starts:
            centre = middle - radius * normal
            yield _fit_sphere(a, b, lengths, centre, radius, side)
            yield _fit_cylinder(a, b, lengths, centre, across, radius, side)

    return _best(fits())


def _best(fits: Iterable[tuple[float, StandIn]]) -> StandIn:
    """The fit with the least error, of those up to the first that is good."""
    best: tuple[float, StandIn] | None = None
    for fit in fits:
        if best is None or fit[0] < best[0]:
            best = fit
        if best[0] < GOOD:
            break
    assert best is not None
    return best[1]


def stand_in_torus(a: Array, b: Array, lengths: Array, size: tuple[float, float]) -> StandIn:
    """The cylinder, or the hole, for a torus whose circle and tube have two radii (m)."""
    circle, tube = size
    found = [torus_cylinder(*ends, circle) for ends in zip(a, b, strict=True)]
    mean = np.mean([place for _, place in filter(None, found)], axis=0)
    inward = -mean / np.linalg.norm(mean)
    along = np.cross(inward, (0.0, 0.0, -1.0))
    small = mean * (1 - tube / circle)

    def fits() -> Iterator[tuple[float, StandIn]]:
        yield _fit_cylinder(a, b, lengths, -circle * inward, along, tube, inward)
        yield _fit_hole(a, b, lengths, np.zeros(3), circle - tube)
        yield _fit_hole(a, b, lengths, small, LEAST_HOLE)

    return _best(fits())


def _fit_hole(
    a: Array, b: Array, lengths: Array, centre: Array, radius: float
) -> tuple[float, StandIn]:
    def made(x: Array) -> Array:
        return hole_lengths(a - x[:3], b - x[:3], max(abs(x[3]), LEAST_HOLE))

    error, x = _least(made, None, lengths, np.array([*centre, radius]), LENGTH_SCALE)
    return error, StandIn(np.eye(3), x[:3], max(abs(float(x[3])), LEAST_HOLE), "hole", None)


def _fit_sphere(
    a: Array, b: Array, lengths: Array, centre: Array, radius: float, side: Array | None
) -> tuple[float, StandIn]:
    def made(x: Array) -> Array:
        return sphere_lengths(a - x[:3], b - x[:3], abs(x[3]), side)

    def within(x: Array) -> Array:
        ends = np.concatenate([a, b]) - x[:3]
        return np.asarray(abs(x[3]) - np.linalg.norm(ends, axis=1))

    error, x = _least(made, within, lengths, np.array([*centre, radius]), LENGTH_SCALE)
    return error, StandIn(np.eye(3), x[:3], float(abs(x[3])), "sphere", side)


def _fit_cylinder(
    a: Array,
    b: Array,
    lengths: Array,
    centre: Array,
    axis: Array,
    radius: float,
    side: Array | None,
) -> tuple[float, StandIn]:
    def turned(x: Array) -> tuple[Array, Array | None]:
        rotation = _about(axis + x[3] * first + x[4] * second)
        if side is None:
            return rotation, None
        flat = (side @ rotation) * (1, 1, 0)
        return rotation, flat / max(float(np.linalg.norm(flat)), TINY)

    def made(x: Array) -> Array:
        rotation, flat = turned(x)
        start, end = ((ends - x[:3]) @ rotation for ends in (a, b))
        return cylinder_lengths(start, end, abs(x[5]), flat)

    def within(x: Array) -> Array:
        ends = (np.concatenate([a, b]) - x[:3]) @ turned(x)[0]
        return np.asarray(abs(x[5]) - np.linalg.norm(ends[:, :2], axis=1))

    _, first, second = np.roll(_about(axis).T, 1, axis=0)
    scale = np.array([*[LENGTH_SCALE] * 3, 1, 1, LENGTH_SCALE])
    error, x = _least(made, within, lengths, np.array([*centre, 0, 0, radius]), scale)
    rotation, flat = turned(x)
    return error, StandIn(rotation, x[:3], float(abs(x[5])), "cylinder", flat)


def _about(axis: Array) -> Array:
    """A rotation (3, 3) whose column z is along an axis."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _least(
    made: Callable[[Array], Array],
    within: Callable[[Array], Array] | None,
    lengths: Array,
    start: Array,
    scale: Array | float,
) -> tuple[float, Array]:
    """The largest error (m) of the fit, and its numbers; ends are kept from being `within` (m)."""
    from scipy.optimize import least_squares

    def residuals(x: Array) -> Array:
        off = made(x) - lengths
        parts = [off] if within is None else [off, KEEP_OUT * np.maximum(within(x), 0)]
        return np.concatenate(parts) / LENGTH_SCALE

    x = least_squares(residuals, start, x_scale=scale, max_nfev=MOST_STEPS).x
    return float(np.abs(made(x) - lengths).max()), x
