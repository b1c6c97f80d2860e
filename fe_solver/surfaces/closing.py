"""Closing open surfaces of rigid bodies, so that a signed distance to them exists."""

from __future__ import annotations

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints

MOST_CENTRES = 200
FLAT = 1e-9
"""Share of the cube of the surface's size: less volume is none."""


def close_surface(vertices: Array, triangles: Ints) -> tuple[Array, Ints]:
    """A watertight surface, wound outwards (positive volume), from one that may have holes.

    vertices (nv, 3) m, triangles (nt, 3) wound alike.  Each hole is closed by a fan from points on
    its long axis: each edge of the hole is joined to the nearest of them, so that a half pipe
    becomes a half cylinder with flat ends, and a round hole a disc.  A flat surface, which encloses
    nothing so, is the front of a block behind it.

    Raises InputError where holes touch one another, where the surface is not wound alike, and
    where a closed one encloses nothing."""
    vertices, triangles = merge_vertices(vertices, triangles)
    if is_flat(vertices, triangles):
        vertices, triangles = _block_behind(vertices, triangles)
    points, faces = [vertices], [triangles]
    count = len(vertices)
    for loop in boundary_loops(triangles):
        centres, fan = _fan(vertices, loop, count)
        points.append(centres)
        faces.append(fan)
        count += len(centres)
    vertices, triangles = np.concatenate(points), np.concatenate(faces)
    return vertices, triangles if _is_outwards(vertices, triangles) else triangles[:, ::-1]


def merge_vertices(vertices: Array, triangles: Ints) -> tuple[Array, Ints]:
    """The surface with one vertex in each place, without triangles that have two alike."""
    vertices, index = np.unique(np.asarray(vertices, dtype=float), axis=0, return_inverse=True)
    triangles = index.reshape(-1)[np.asarray(triangles)]
    return vertices, triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]


def outwards(vertices: Array, triangles: Ints) -> Ints:
    """The triangles (nt, 3), turned over where they are a closed surface wound inwards.  Raises
    InputError where they are not wound alike, and where a closed surface encloses nothing."""
    merged = merge_vertices(vertices, triangles)
    is_open = bool(border_edges(merged[1])[1])
    return triangles if is_open or _is_outwards(*merged) else triangles[:, ::-1]


def _is_outwards(vertices: Array, triangles: Ints) -> bool:
    """How a closed surface is wound.  Raises InputError where it encloses nothing."""
    inside = volume(vertices, triangles)
    if not abs(inside) > FLAT * np.linalg.norm(np.ptp(vertices, axis=0)) ** 3:
        raise InputError(
            "surface: it encloses no volume, so that it has no inside; give the body a surface "
            "with a thickness"
        )
    return inside > 0


def is_flat(vertices: Array, triangles: Ints) -> bool:
    """Whether an open surface lies in a plane."""
    if not len(triangles) or not border_edges(triangles)[1]:
        return False
    used = vertices[np.unique(triangles)]
    spread = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= FLAT * spread[0])


def _block_behind(vertices: Array, triangles: Ints) -> tuple[Array, Ints]:
    """A flat surface as the front of a block, as deep as the surface is wide."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normal = np.cross(b - a, c - a).sum(axis=0) / 2
    area = float(np.linalg.norm(normal))
    back = vertices - normal / max(area, 1e-300) * area**0.5
    edges, single = border_edges(triangles)
    rim = np.array([e for e in edges.tolist() if tuple(sorted(e)) in single])
    i, j, n = rim[:, 0], rim[:, 1], len(vertices)
    sides = [np.stack([j, i, n + i], axis=1), np.stack([j, n + i, n + j], axis=1)]
    return np.concatenate([vertices, back]), np.concatenate(
        [triangles, triangles[:, ::-1] + n, *sides]
    )


def volume(vertices: Array, triangles: Ints) -> float:
    """m3 enclosed by a closed surface, positive where it is wound outwards."""
    a, b, c = np.moveaxis(vertices[triangles] - vertices.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def boundary_loops(triangles: Ints) -> list[Ints]:
    """Closed loops of vertices along the edges that only one triangle has, in its direction."""
    edges, single = border_edges(triangles)
    following: dict[int, int] = {}
    for a, b in edges.tolist():
        if (min(a, b), max(a, b)) in single:
            if a in following:
                raise InputError(
                    "surface: its holes touch one another, or its triangles are not wound alike; "
                    "close it before it is used for contact"
                )
            following[a] = b
    loops = []
    while following:
        first, at = following.popitem()
        loop = [first]
        while at != first:
            loop.append(at)
            if at not in following:
                raise InputError("surface: its triangles are not wound alike along a hole")
            at = following.pop(at)
        loops.append(np.array(loop))
    return loops


def border_edges(triangles: Ints) -> tuple[Ints, set[tuple[int, int]]]:
    """The triangles' edges (3 nt, 2) in their directions, and those that only one triangle has,
    smaller vertex first.  Raises InputError where the triangles are not wound alike."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    both, number, times = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    sense = np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)
    if (np.abs(np.bincount(number.reshape(-1), weights=sense)) > 1).any():
        raise InputError(
            "surface: its triangles are not wound alike, so that it has no inside; make their "
            "normals all point outwards"
        )
    return edges, {tuple(e) for e in both[times == 1].tolist()}


def _fan(vertices: Array, loop: Ints, start: int) -> tuple[Array, Ints]:
    """Centres (m, 3), numbered from `start`, and triangles that close a loop."""
    centres, nearest = _centres(vertices[loop])
    fan = []
    for i, a in enumerate(loop):
        j = (i + 1) % len(loop)
        b, first, last = loop[j], nearest[i], nearest[j]
        fan.append((b, a, start + first))
        step = 1 if last > first else -1
        fan += [(b, start + k, start + k + step) for k in range(first, last, step)]
    return centres, np.array(fan, dtype=np.intp)


def _centres(rim: Array) -> tuple[Array, Ints]:
    """Points (m, 3) on a straight line along a rim (k, 3), half its width apart, and the nearest of
    them for each point of the rim.  The line is fitted to the rim's long sides, so that it lies in
    the plane of straight ones."""
    middle = (rim.max(axis=0) + rim.min(axis=0)) / 2
    _, _, axes = np.linalg.svd(rim - rim.mean(axis=0), full_matrices=False)
    along, across, off = ((rim - middle) @ axis for axis in axes)
    count = int(np.clip(round(2 * np.ptp(along) / max(np.ptp(across), 1e-300)), 0, MOST_CENTRES))
    if count < 2:
        return rim.mean(axis=0)[None], np.zeros(len(rim), dtype=np.intp)
    places = np.linspace(along.min(), along.max(), count + 1)
    nearest = np.abs(along[:, None] - places).argmin(axis=1)
    sides = (nearest > 0) & (nearest < count)
    if not sides.any():
        sides[:] = True
    order = min(1, len(np.unique(nearest[sides])) - 1)
    line = [np.polynomial.Polynomial.fit(along[sides], v[sides], order) for v in (across, off)]
    centres = np.stack([places, line[0](places), line[1](places)], axis=1)
    return middle + centres @ axes, nearest
