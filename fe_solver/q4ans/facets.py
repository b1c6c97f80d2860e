"""FEBio's frictionless `sliding-elastic` contact made anew from its documentation, one pass, by a
penalty alone, or augmented: the contact of `q4ans` sheets.

At the Gauss points of the sheet's facets the pressure is the penalty times the depth; depth is
measured along the facet's normal to the body's flat triangles, and the pressure acts along that
normal (FEBio theory manual 3.4, section 7.1.9; user manual, Contact: sliding-elastic).  Pressure
begins with a kink.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from cosim.port import Array, Ints
from fe_solver.elements.mitc4 import GAUSS, shape

SEARCH_TOLERANCE = 0.01
"""Share of a triangle's edges by which a point may lie beyond them (FEBio's search_tol)."""
SEARCH_RADIUS = 2e-3
"""m along the normal within which a triangle is met (FEBio's search_radius, of the models)."""
ALIKE = 0.5
"""Cosine between normals that look the same way."""
NEAREST = 16
"""Triangles, by their middles, that are looked at for each Gauss point."""
SHAPES = np.stack([shape(r, s) for r, s in GAUSS])
"""(4, 3, 4) shape functions of a quad and their derivatives by r and s, at its Gauss points."""


@dataclass(frozen=True)
class Facets:
    """k quads whose face slides on the triangles of a body and keeps a gap from them."""

    quads: Ints
    """(k, 4)."""
    side: Ints
    """(k,) of the quads' normals on which the face lies."""
    penalty: Array
    """(k,) N/m3."""
    body: int
    triangles: Array
    """(nt, 3, 3) m, body frame."""
    gap: float = 0.0
    """m."""

    def take(self, rows: Ints) -> Facets:
        """Some of the quads."""
        out = replace(self, quads=self.quads[rows], side=self.side[rows])
        out.__dict__["tree"] = self.tree
        return out

    @cached_property
    def tree(self) -> cKDTree:
        """The triangles' middles."""
        return cKDTree(self.triangles.mean(axis=1))

    @cached_property
    def reach(self) -> float:
        """The distance (m) from a middle within which a point may meet a triangle."""
        edge = np.linalg.norm(np.roll(self.triangles, -1, axis=1) - self.triangles, axis=2)
        return SEARCH_RADIUS + float(edge.max(initial=0.0))


class Pressed(NamedTuple):
    """What contact does."""

    gradient: Array
    """(k, 12) N that the quads' corners resist with."""
    blocks: Array
    """(k, 12, 12) N/m, its derivative."""
    force: Array
    """(3,) N, on the body."""
    pressure: Array
    """(k, 4) Pa, at the Gauss points."""
    depth: Array
    """(k, 4) m, at the Gauss points, positive inside the body (or the gap)."""


def pressures(
    facets: Facets,
    x: Array,
    position: Array,
    rotation: Array,
    multiplier: Array | float = 0.0,
    met: Ints | None = None,
) -> Pressed:
    """Contact of nodes x (n, 3) m with the body at its position (3,) m and rotation (3, 3); the
    pressure is the positive part of multiplier (k, 4) Pa + penalty * depth.  Each Gauss point
    presses on the plane of the triangle that it has `met` (see `find_triangles`), which is looked
    for where None.

    The derivative is that at normals which do not turn, symmetric: what it leaves out is of the
    order of depth over element size, and Newton needs no more."""
    at, normal, size = _gauss_points(facets, x)
    local, turned = (at - position) @ rotation, normal @ rotation
    if met is None:
        met = _find_triangle(facets, local, turned)
    depth = facets.gap + _depth(facets, local, turned, met)
    pressure = np.maximum(multiplier + facets.penalty[:, None] * depth, 0)
    stiffness = facets.penalty[:, None] * size * (pressure > 0)
    push = (pressure * size)[..., None] * normal
    spread = SHAPES[:, 0, :, None] * normal[:, :, None]
    spread = spread.reshape(*depth.shape, 12)
    return Pressed(
        np.einsum("kg,kgi->ki", pressure * size, spread),
        np.einsum("kg,kgi,kgj->kij", stiffness, spread, spread, optimize=True),
        push.sum(axis=(0, 1)),
        pressure,
        depth,
    )


def find_triangles(facets: Facets, x: Array, position: Array, rotation: Array) -> Ints:
    """The triangle (k, 4) that each Gauss point meets along its normal, the nearest of those that
    face it; -1 where it meets none."""
    at, normal, _ = _gauss_points(facets, x)
    return _find_triangle(facets, (at - position) @ rotation, normal @ rotation)


def facet_gaps(facets: Facets, x: Array, position: Array, rotation: Array) -> Array:
    """The gaps (k, 4) m of the Gauss points along their normals, negative inside the body; infinite
    where they meet nothing of it."""
    at, normal, _ = _gauss_points(facets, x)
    local, turned = (at - position) @ rotation, normal @ rotation
    met = _find_triangle(facets, local, turned)
    return np.where(met < 0, np.inf, -facets.gap - _depth(facets, local, turned, met))


def nearest(depth: Array) -> float:
    """The smallest gap (m) of Gauss points at depths (k, 4) m; infinite where none meets the
    body."""
    return float(-depth[depth > -SEARCH_RADIUS].max(initial=-np.inf))


Placed = tuple[Array, Array, Array]
"""Nodes (n, 3) m, and the body's position (3,) m and rotation (3, 3)."""


def facet_ways(facets: Facets, before: Placed, after: Placed) -> Array:
    """How far the facets' Gauss points go towards the body at most, (k,) m, along their normals."""
    (at, normal, _), (p, r) = _gauss_points(facets, before[0]), before[1:]
    moved = (_gauss_points(facets, after[0])[0] - after[1]) @ after[2] - (at - p) @ r
    return np.asarray(np.einsum("kgi,kgi->kg", moved, normal @ r).max(axis=1))


def looks_away(facets: Facets, x: Array, position: Array, rotation: Array, near: float) -> bool:
    """Whether the face turns its back to the body where it is nearest, and `near` (m) beyond: the
    triangles there look the same way, and in FEBio's contact do not touch it."""
    at, normal, _ = _gauss_points(facets, x)
    q, n = (at.reshape(-1, 3) - position) @ rotation, normal.reshape(-1, 3) @ rotation
    distance, found = facets.tree.query(q)
    close = distance <= distance.min() + near
    a, b, c = np.moveaxis(facets.triangles[found[close]], 1, 0)
    face = np.cross(b - a, c - a)
    along = np.einsum("ki,ki->k", face, n[close]) / np.linalg.norm(face, axis=1)
    return bool((along > ALIKE).any() and not (along < -ALIKE).any())


def _gauss_points(facets: Facets, x: Array) -> tuple[Array, Array, Array]:
    """Places (k, 4, 3) m, unit normals (k, 4, 3) towards the body and area ratios (k, 4)."""
    at, by_r, by_s = np.moveaxis(np.einsum("gda,kai->kgdi", SHAPES, x[facets.quads]), 2, 0)
    area = np.cross(by_r, by_s)
    size = np.linalg.norm(area, axis=2)
    return at, area / size[..., None] * facets.side[:, None, None], size


def cut(triangles: Array, longest: float) -> Array:
    """The same flat triangles (m, 3, 3) as (nt, 3, 3), halved across their longest edges until none
    is longer than `longest`, m, so that the nearest middle tells the nearest triangle."""
    done = []
    while len(triangles):
        edge = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long, first = edge.max(axis=1) > longest, edge.argmax(axis=1)
        done.append(triangles[~long])
        order = (first[long, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[long], order[:, :, None], 1), 1, 0)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles = np.concatenate(halves)
    return np.concatenate(done)


def _find_triangle(facets: Facets, points: Array, normals: Array) -> Ints:
    """The triangles (k, 4) as `find_triangles`, of points and normals (k, 4, 3), body frame."""
    q, n = points.reshape(-1, 3), normals.reshape(-1, 3)
    count = min(NEAREST, len(facets.triangles))
    nearest, _ = facets.tree.query(q, distance_upper_bound=facets.reach)
    watched = np.flatnonzero(np.isfinite(nearest))
    out = np.full(len(q), -1)
    if len(watched):
        _, near = facets.tree.query(q[watched], k=np.arange(1, count + 1))
        distance = _distances(facets.triangles[near], q[watched, None], n[watched, None])
        best = np.abs(distance).argmin(axis=1)
        row = np.arange(len(watched))
        out[watched] = np.where(np.isfinite(distance[row, best]), near[row, best], -1)
    return out.reshape(points.shape[:2])


def _distances(triangles: Array, q: Array, n: Array) -> Array:
    """The distances (m, t) m along normals n (m, 1, 3) from points q (m, 1, 3) to triangles (m, t,
    3, 3); infinite where one does not face the point or is not met within the search radius.

    A point q meets a triangle a, a + u, a + v at q + t n = a + b u + c v (Cramer's rule)."""
    a, u, v = np.moveaxis(triangles, 2, 0)
    u, v, w = u - a, v - a, q - a
    face = np.cross(u, v)
    facing = np.einsum("mki,mki->mk", face, np.broadcast_to(n, face.shape))
    scale = 1 / np.where(facing < 0, facing, -1.0)
    across = np.cross(n, w)
    b = np.einsum("mki,mki->mk", v, across) * scale
    c = np.einsum("mki,mki->mk", u, across) * -scale
    t = -np.einsum("mki,mki->mk", face, w) * scale
    met = (facing < 0) & (b >= -SEARCH_TOLERANCE) & (c >= -SEARCH_TOLERANCE)
    met &= (b + c <= 1 + SEARCH_TOLERANCE) & (np.abs(t) < SEARCH_RADIUS)
    return np.where(met, t, np.inf)


def _depth(facets: Facets, points: Array, normals: Array, met: Ints) -> Array:
    """The depth (k, 4) m by which points (k, 4, 3) have passed the planes of the triangles that
    they have met, along their normals; minus the search radius where they have met none."""
    on = met >= 0
    a, b, c = np.moveaxis(facets.triangles[met[on]], 1, 0)
    face = np.cross(b - a, c - a)
    ahead = np.einsum("mi,mi->m", face, normals[on])
    out = np.full(met.shape, -SEARCH_RADIUS)
    out[on] = np.einsum("mi,mi->m", face, points[on] - a) / np.where(ahead < 0, ahead, np.inf)
    return out
