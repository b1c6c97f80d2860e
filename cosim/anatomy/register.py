"""A packaged bone laid onto a user's: turned, scaled, stretched, bent; and what it carries along.

Three fits, each from where the one before ends: a similarity and an affine map by points to planes
(Chen and Medioni 1992, Image Vis Comput 10:145), then thin-plate splines through some hundred of
the bone's points (Bookstein 1989, IEEE PAMI 11:567).  A mesh of neither bone enters, only points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cosim.port import Array, Triangles

SAMPLES, COARSE, TEMPLATE = 24000, 400, 3000
"""Points taken from a user's surface, of the packaged bone's while it is turned about, and of it
in the fits."""
ROLLS = 16
"""Turns about the long axis from which a fit starts, for either end first."""
CENTRES = 300
"""Points through which the spline runs."""
ROUNDS = 8
"""Rounds of the spline, each from closest points anew."""
SMOOTHING = 2.0
"""The spline's stiffness, in its own measure: how much beside points at random it passes."""
CLEARLY = 2.0
"""Times worse, of a similarity with the other end first, beyond which that end is not looked at
again."""
ACROSS = 0.5
"""Cosine of a point's normal and that of the surface there, below which they are no pair."""


@dataclass(frozen=True)
class Cloud:
    """Points (n, 3) m spread evenly over a closed surface, with normals outward."""

    points: Array
    normals: Array

    @cached_property
    def tree(self) -> Any:
        """For closest points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    def gaps(self, points: Array) -> tuple[Array, np.ndarray]:
        """How far (n,) m points lie over the tangent plane at the nearest point; its number."""
        _, near = self.tree.query(points)
        return np.einsum("nk,nk->n", points - self.points[near], self.normals[near]), near

    def take(self, count: int) -> Cloud:
        """About so many of them."""
        step = max(1, len(self.points) // count)
        return Cloud(self.points[::step], self.normals[::step])


def cloud_of(surface: Triangles, count: int) -> Cloud:
    """Points on triangles by their area, the same at every time; normals are means over
    neighbours, so that a rough surface has those of a smooth one."""
    from scipy.spatial import cKDTree

    vertices, faces = surface
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    rng = np.random.default_rng(0)
    which = rng.choice(len(faces), size=count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    points = np.einsum("nk,nkd->nd", weights, vertices[faces[which]])
    normals = (normal / np.where(area > 0, area, 1.0)[:, None])[which]
    _, near = cKDTree(points).query(points, k=12)
    mean = normals[near].mean(axis=1) + 1e-6 * normals  # of two that face each other
    return Cloud(points, mean / np.linalg.norm(mean, axis=1, keepdims=True))


@dataclass(frozen=True)
class Fit:
    """A packaged bone (its frame) on a user's (their file's, in m)."""

    matrix: Array
    """(3, 3) of the affine map."""
    offset: Array
    """(3,) m."""
    distance: dict[str, tuple[float, float]]
    """Mean and 95th percentile (m) of the distances between the surfaces after each fit."""
    flipped: float
    """How many times worse the bone fits with the other end first, in the mean."""
    surface: Array = field(repr=False)
    """Points (k, 3) m all over the packaged bone."""
    template: Array = field(repr=False)
    moved: Array = field(repr=False)
    """The spline's points (n, 3) m on the packaged bone and on the user's."""

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) of the affine map's polar decomposition: the packaged bone's axes in the file."""
        u, _, vt = np.linalg.svd(self.matrix)
        return u @ vt

    @cached_property
    def stretch(self) -> Array:
        """(3,) how much longer, wider and deeper the user's bone is, along the packaged one's
        axes."""
        return np.asarray(np.diag(self.rotation.T @ self.matrix))

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import RBFInterpolator

        straight = self.template @ self.matrix.T + self.offset
        return RBFInterpolator(1e3 * self.template, self.moved - straight, smoothing=1e-3)

    def carry(self, points: Array) -> Array:
        """Where points (n, 3) m of the packaged bone are on the user's."""
        points = np.atleast_2d(points)
        return np.asarray(points @ self.matrix.T + self.offset + self._spline(1e3 * points))

    def carry_axis(self, axis: Array) -> Array:
        """Where an axis (3,) of the packaged bone points in the user's file, of length 1."""
        way = self.matrix @ axis
        return np.asarray(way / np.linalg.norm(way))

    def foot(self, points: Array) -> Array:
        """The packaged bone's points (n, 3) m next to points (n, 3)."""
        from scipy.spatial import cKDTree

        return np.asarray(self.surface[cKDTree(self.surface).query(points)[1]])

    def carry_near(self, points: Array) -> Array:
        """As `carry`, of points (n, 3) m outside the bone: a spline runs away there."""
        points = np.atleast_2d(points)
        foot = self.foot(points)
        return np.asarray(self.carry(foot) + (points - foot) @ self.matrix.T)


def register(template: Triangles, user: Triangles) -> Fit:
    """Lay a packaged bone onto a user's surface that lies anywhere, in any unit of length but of
    the same hand."""
    target, source = cloud_of(user, SAMPLES), cloud_of(template, TEMPLATE)
    (matrix, offset, affine, similarity), flipped = _affine(source, target)
    centres, moved, bent = _bend(source, target, matrix, offset)
    distance = {
        "similarity": _spread(similarity),
        "affine": _spread(affine),
        "spline": _spread(np.abs(target.gaps(bent)[0])),
    }
    return Fit(matrix, offset, distance, flipped, source.points, centres, moved)


Affine = tuple[Array, Array, Array, Array]
"""Matrix, offset, distances (n,) m of an affine map, and those of the similarity before it."""


def _affine(source: Cloud, target: Cloud) -> tuple[Affine, float]:
    """The best affine map, and how many times worse the best one fits with the other end first."""
    coarse = source.take(COARSE)
    starts = [_start(coarse, target, turn) for turn in _turns(source, target)]
    ends = sorted(
        (min(starts[way::2], key=lambda start: start[0]) for way in (0, 1)),
        key=lambda start: start[0],
    )
    if ends[1][0] > CLEARLY * ends[0][0]:
        return _refined(source, target, ends[0]), ends[1][0] / max(ends[0][0], 1e-9)
    best, other = sorted(
        (_refined(source, target, end) for end in ends), key=lambda fit: float(fit[2].mean())
    )
    return best, float(other[2].mean() / max(best[2].mean(), 1e-9))


def _refined(source: Cloud, target: Cloud, start: tuple[float, Array, Array]) -> Affine:
    matrix, offset, similarity = _closest(source, target, *start[1:], similar=True)
    return (*_closest(source, target, matrix, offset, similar=False), similarity)


def _spread(gaps: Array) -> tuple[float, float]:
    return float(gaps.mean()), float(np.percentile(gaps, 95))


def _turns(source: Cloud, target: Cloud) -> Iterator[Array]:
    """Rotations (3, 3) that lay the long axis on the long axis, either way round, rolled about
    it."""
    mine, theirs = _axes(source.points), _axes(target.points)
    for angle in np.arange(ROLLS) * 2 * np.pi / ROLLS:
        c, s = np.cos(angle), np.sin(angle)
        roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        for way in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
            yield theirs @ roll @ way @ mine.T


def _axes(points: Array) -> Array:
    """Principal axes (3, 3), the longest first, right-handed."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2].T
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return np.asarray(axes)


def _start(source: Cloud, target: Cloud, turn: Array) -> tuple[float, Array, Array]:
    """A turn's mean distance, matrix and offset after some rounds of a similarity."""
    mine, theirs = source.points, target.points
    scale = np.ptp(theirs @ _axes(theirs)[:, 0]) / np.ptp(mine @ _axes(mine)[:, 0])
    matrix = scale * turn
    offset = theirs.mean(axis=0) - matrix @ mine.mean(axis=0)
    matrix, offset, gaps = _closest(source, target.take(6000), matrix, offset, True, rounds=8)
    return float(gaps.mean()), matrix, offset


def _closest(
    source: Cloud, target: Cloud, matrix: Array, offset: Array, similar: bool, rounds: int = 40
) -> tuple[Array, Array, Array]:
    """A similarity or affine map by points to planes: matrix, offset, distances both ways."""
    for _ in range(rounds):
        moved = source.points @ matrix.T + offset
        gap, near = target.gaps(moved)
        normal = target.normals[near]
        weight = np.minimum(1.0, 3 * np.median(np.abs(gap)) / np.maximum(np.abs(gap), 1e-12))
        middle = moved.mean(axis=0)
        arm = moved - middle
        columns = (
            [np.cross(arm, normal), np.einsum("nk,nk->n", arm, normal)[:, None], normal]
            if similar
            else [(normal[:, :, None] * arm[:, None, :]).reshape(-1, 9), normal]
        )
        rows = weight[:, None] * np.hstack(columns)
        step = np.linalg.lstsq(rows, -weight * gap, rcond=1e-9)[0]
        change = _similarity(step[:4]) if similar else np.eye(3) + step[:9].reshape(3, 3)
        matrix, offset = change @ matrix, change @ (offset - middle) + middle + step[-3:]
        if np.abs(gap).mean() < 1e-9 or np.abs(change - np.eye(3)).max() < 1e-6:
            break
    normals = source.normals @ np.linalg.inv(matrix)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    laid = Cloud(source.points @ matrix.T + offset, normals)
    return matrix, offset, _both_ways(laid, target)


def _similarity(step: Array) -> Array:
    """(3, 3) of a small turn and a growth."""
    from scipy.spatial.transform import Rotation

    growth = np.exp(np.clip(step[3], -0.2, 0.2))
    return np.asarray(growth * Rotation.from_rotvec(step[:3]).as_matrix())


def _both_ways(moved: Cloud, target: Cloud) -> Array:
    """Distances (n,) m from each surface to the other; from the user's to planes at the packaged
    bone's points, so that a bone whose end is off the other is seen."""
    there, near = target.gaps(moved.points)
    far = np.linalg.norm(moved.points - target.points[near], axis=1)
    some = target.take(len(moved.points))
    back, nearest = moved.gaps(some.points)
    off = np.linalg.norm(some.points - moved.points[nearest], axis=1)
    apart = np.median(off)  # between points of one surface
    return np.concatenate(
        [
            np.where(far > 3 * apart, far, np.abs(there)),
            np.where(off > 3 * apart, off, np.abs(back)),
        ]
    )


def _bend(source: Cloud, target: Cloud, matrix: Array, offset: Array) -> tuple[Array, Array, Array]:
    """Some points (n, 3) of the packaged bone, where splines that are drawn onto the user's surface
    take them, and where they take all its points."""
    at = _spaced(source.points, CENTRES)
    moved = source.points @ matrix.T + offset
    normals = source.normals @ np.linalg.inv(matrix)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for _ in range(ROUNDS):
        gap, near = target.gaps(moved)
        pair = np.einsum("nk,nk->n", normals, target.normals[near]) > ACROSS
        step = -np.where(pair, gap, 0.0)[:, None] * target.normals[near]
        moved = moved + _smooth(moved, step, at)
    return source.points[at], moved[at], moved


def _spaced(points: Array, count: int) -> np.ndarray:
    """Numbers (count,) of points far from each other."""
    out = [0]
    far = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        far = np.minimum(far, np.linalg.norm(points - points[out[-1]], axis=1))
        out.append(int(far.argmax()))
    return np.array(out)


def _smooth(points: Array, step: Array, at: np.ndarray) -> Array:
    """A smooth field (n, 3) near steps (n, 3): a thin-plate spline through their means about the
    points `at`."""
    from scipy.interpolate import RBFInterpolator
    from scipy.spatial import cKDTree

    _, near = cKDTree(points).query(points[at], k=10)
    return np.asarray(
        RBFInterpolator(1e3 * points[at], step[near].mean(axis=1), smoothing=SMOOTHING)(
            1e3 * points
        )
    )


def lay(template: Triangles, user: Triangles) -> float:
    """The mean distance (m) of a packaged bone, stretched to fit, from a user's."""
    target, source = cloud_of(user, SAMPLES), cloud_of(template, TEMPLATE)
    return float(_affine(source, target)[0][2].mean())
