"""The length of a path that is pulled tight over surfaces, by the rules of OpenSim.

OpenSim takes the wrap objects of a path in turn; each bends the one segment of its range that it
makes longer by least, and all are taken again until the length stands still.  Over an ellipsoid the
way lies in a plane through both ends; here it is the shortest of these, which is OpenSim's to some
0.02 mm.  Where OpenSim's own path jumps (an end of a torus's cylinder that meets another segment,
a half of a sphere that the line leaves) this one need not.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array

PLANES = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
"""Turns about the line between both ends of the planes that are tried over an ellipsoid, rad."""
ABSCISSAE, WEIGHTS = np.polynomial.legendre.leggauss(12)
"""The points and weights of the integral along an arc of an ellipse."""
MOST_ROUNDS, STILL = 8, 1e-7
"""Times that all surfaces of a path are taken, and the change of its length (m) at rest."""
PLACES = 60
"""Places on a segment among which the nearest to a torus's circle is sought."""


class Arc(NamedTuple):
    """A way over a surface: by how much (m) it makes the segment longer, where it meets and leaves
    the surface (3,) m, and its length on it (m)."""

    extra: float
    start: Array
    end: Array
    length: float


def over_ellipsoid(a: Array, b: Array, radii: Array, side: Array | None) -> Arc | None:
    """The way from a to b (3,) m round an ellipsoid at the origin, on a side of the line between
    them; None where the straight line misses it or an end is within."""
    start, along = a / radii, (b - a) / radii
    square, middle, rest = along @ along, start @ along, start @ start - 1
    root = middle * middle - square * rest
    if rest < 0 or (start + along) @ (start + along) < 1 or root <= 0:
        return None
    near, far = (-middle - np.sqrt(root)) / square, (-middle + np.sqrt(root)) / square
    if not (near > 0 and far < 1):
        return None
    axes = _across(b - a)
    up = np.outer(np.cos(PLANES), axes[0]) + np.outer(np.sin(PLANES), axes[1])
    if side is not None:
        up = up[up @ side > 0]
    size = np.sqrt(square)
    ahead = along / size
    up = up / radii
    up -= np.outer(up @ ahead, ahead)
    up /= np.linalg.norm(up, axis=1)[:, None]
    x, y = -start @ ahead, -up @ start
    radius = np.sqrt(1 - ((start + x * ahead + y[:, None] * up) ** 2).sum(axis=1))
    first = np.arctan2(-y, -x) - np.arccos(np.minimum(radius / np.hypot(x, y), 1))
    last = np.arctan2(-y, size - x) + np.arccos(np.minimum(radius / np.hypot(size - x, y), 1))
    sweep = (first - last) % (2 * np.pi)
    angles = first[:, None] - sweep[:, None] * (ABSCISSAE + 1) / 2
    speed = np.cos(angles)[..., None] * up[:, None] - np.sin(angles)[..., None] * ahead
    lengths = np.linalg.norm(speed * radii, axis=2) @ WEIGHTS * sweep / 2 * radius

    def at(angle: Array) -> Array:
        ahead_of = (x + radius * np.cos(angle))[:, None] * ahead
        return np.asarray((start + ahead_of + (y + radius * np.sin(angle))[:, None] * up) * radii)

    meets, leaves = at(first), at(first - sweep)
    whole = np.linalg.norm(meets - a, axis=1) + lengths + np.linalg.norm(leaves - b, axis=1)
    k = int(np.argmin(whole))
    extra = float(whole[k] - np.linalg.norm(b - a))
    return Arc(extra, meets[k], leaves[k], float(lengths[k]))


def over_sphere(a: Array, b: Array, radius: float, side: Array | None) -> Arc | None:
    """The way from a to b (3,) m round a sphere at the origin, in the plane of all three: the other
    way about where it is not on a side; None where the straight line misses it."""
    first = a / np.linalg.norm(a)
    second = b - b @ first * first
    size = float(np.linalg.norm(second))
    second = second / size if size > 0 else _across(first)[0]
    frame = np.array([first, second, np.cross(first, second)])
    arc = over_cylinder(frame @ a, frame @ b, radius, np.inf, None)
    if arc is None:
        return None
    middle = arc.start + arc.end
    if side is not None and (middle @ frame) @ side < 0:
        arc = over_cylinder(frame @ a, frame @ b, radius, np.inf, -middle)
        assert arc is not None
    return arc._replace(start=arc.start @ frame, end=arc.end @ frame)


def over_cylinder(
    a: Array, b: Array, radius: float, half_length: float, side: Array | None
) -> Arc | None:
    """The way from a to b (3,) m round a cylinder about z, on a side of it (also where the line
    misses it on another side); None where there is none, or where it touches beyond both ends."""
    flat = np.array([a[:2], b[:2]])
    far = np.linalg.norm(flat, axis=1)
    along = flat[1] - flat[0]
    if (far < radius).any() or not along.any():
        return None
    t = np.clip(-(flat[0] @ along) / (along @ along), 0.0, 1.0)
    nearest = flat[0] + t * along
    hits = bool(np.linalg.norm(nearest) < radius)
    if not hits and (side is None or nearest @ side[:2] >= 0):
        return None
    angles = np.arctan2(flat[:, 1], flat[:, 0])
    cut = np.arccos(radius / far)
    ends = [angles + turn * cut * (1, -1) for turn in (1.0, -1.0)]
    sweeps = [(ends[0][1] - ends[0][0]) % (2 * np.pi), (ends[1][0] - ends[1][1]) % (2 * np.pi)]
    left = _goes_left(ends, sweeps, side)
    (first, last), sweep = ends[0 if left else 1], sweeps[0 if left else 1]
    before, after = np.sqrt(far**2 - radius**2)
    whole = before + radius * sweep + after
    rise = b[2] - a[2]
    heights = a[2] + rise * before / whole, b[2] - rise * after / whole
    if min(abs(z) for z in heights) > half_length:
        return None
    meets, leaves = (
        np.array([radius * np.cos(angle), radius * np.sin(angle), z])
        for angle, z in zip((first, last), heights, strict=True)
    )
    extra = float(np.hypot(whole, rise) - np.linalg.norm(b - a))
    return Arc(extra, meets, leaves, float(np.hypot(radius * sweep, heights[1] - heights[0])))


def _goes_left(ends: Sequence[Array], sweeps: Sequence[float], side: Array | None) -> bool:
    """Whether the way turns left about z: on a side as OpenSim's, by which of the points where
    lines touch the circle lie there; the shorter one where that says nothing."""
    if side is not None:
        there = [np.cos(e) * side[0] + np.sin(e) * side[1] >= 0 for e in ends]
        for left, right in zip(*there, strict=True):
            if left != right:
                return bool(left)
    return sweeps[0] <= sweeps[1]


def torus_cylinder(a: Array, b: Array, circle: float) -> tuple[Array, Array] | None:
    """The frame (rows x, y, z, with x towards the middle and z along the circle) and the place
    (3,) m on a torus's circle that is nearest to the segment from a to b; None where that does not
    cross the torus's plane."""
    if a[2] * b[2] >= 0:
        return None
    low, high = 0.0, 1.0
    while high - low > 1e-7:
        t = np.linspace(low, high, PLACES)
        places = a + t[:, None] * (b - a)
        off = np.hypot(np.hypot(places[:, 0], places[:, 1]) - circle, places[:, 2])
        k = int(np.argmin(off))
        low, high = t[max(k - 1, 0)], t[min(k + 1, PLACES - 1)]
    size = float(np.linalg.norm(places[k, :2]))
    away = places[k, :2] / size if size > 0 else np.array([1.0, 0.0])
    x, y = np.array([*-away, 0.0]), np.array([0.0, 0.0, -1.0])
    return np.array([x, y, np.cross(x, y)]), np.array([*circle * away, 0.0])


def over_torus(a: Array, b: Array, circle: float, tube: float) -> Arc | None:
    """The way from a to b (3,) m through a torus about z: over an endless cylinder along its tube
    at the nearest place, on the side of the middle."""
    found = torus_cylinder(a, b, circle)
    if found is None:
        return None
    frame, place = found
    arc = over_cylinder(
        frame @ (a - place), frame @ (b - place), tube, np.inf, np.array([1.0, 0.0, 0.0])
    )
    if arc is None:
        return None
    return arc._replace(start=arc.start @ frame + place, end=arc.end @ frame + place)


def _across(line: Array) -> Array:
    """Two unit vectors (2, 3) across a line and each other."""
    ahead = line / np.linalg.norm(line)
    first = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(ahead, first)])


@dataclass(frozen=True)
class Stop:
    """A place of a tight path in the world: the segment that begins or goes on there, and where an
    arc begins its length and the surface."""

    place: Array
    segment: int
    arc: float | None = None
    surface: int | None = None


OverSurface = Callable[[Array, Array], Arc | None]


class Laid(NamedTuple):
    """A surface as it stands: a function of both ends of a segment in its own frame, its rotation
    (3, 3) and place (3,) m in the world, and the segments that it may bend, from `first` up to
    but without `last`."""

    over: OverSurface
    rotation: Array
    place: Array
    first: int
    last: int


class Touched(NamedTuple):
    """A surface that bends a segment, by how much (m) it is longer, and the middle (3,) m between
    the places where it meets and leaves the surface, in this one's frame."""

    surface: int
    segment: int
    extra: float
    middle: Array


def tight_length(points: Array, surfaces: Sequence[Laid]) -> tuple[float, list[Touched]]:
    """The length (m) of a path through points (n, 3) m over surfaces, and what it touches."""
    path = [Stop(place, k) for k, place in enumerate(points)]
    touched: dict[int, Touched] = {}
    before = np.inf
    for _ in range(MOST_ROUNDS if len(surfaces) > 1 else 1):
        for number, surface in enumerate(surfaces):
            path = [stop for stop in path if stop.surface != number]
            touched.pop(number, None)
            found = _bent(path, surface)
            if found is None:
                continue
            k, arc = found
            turned = [surface.rotation @ end + surface.place for end in (arc.start, arc.end)]
            segment = path[k].segment
            path[k + 1 : k + 1] = [
                Stop(turned[0], segment, arc.length, number),
                Stop(turned[1], segment, None, number),
            ]
            touched[number] = Touched(number, segment, arc.extra, (arc.start + arc.end) / 2)
        length = sum(
            float(np.linalg.norm(b.place - a.place)) if a.arc is None else a.arc
            for a, b in itertools.pairwise(path)
        )
        if abs(length - before) < STILL:
            break
        before = length
    return length, list(touched.values())


def _bent(path: Sequence[Stop], surface: Laid) -> tuple[int, Arc] | None:
    """Which segment of a path a surface bends, and how: that which gets longer by least."""
    best = None
    for k, (start, end) in enumerate(itertools.pairwise(path)):
        if start.arc is None and surface.first <= start.segment < surface.last:
            a, b = ((stop.place - surface.place) @ surface.rotation for stop in (start, end))
            arc = surface.over(a, b)
            if arc is not None and (best is None or arc.extra < best[1].extra):
                best = k, arc
    return best
