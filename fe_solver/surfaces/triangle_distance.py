"""Exact signed distance of grid nodes to a watertight triangle surface, by numpy and a k-d tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.elements import kernels
from fe_solver.surfaces.triangle_kernel import lower_distances

Ints = NDArray[np.integer]

EDGE = 2.0
"""Grid spacings between samples of the surface."""
TRIED = 3
"""Nearest samples whose faces bound a node's distance from above."""
REACH = 10.0
"""Grid spacings within which distances are exact."""
SLACK = 4.0
"""Grid spacings by which an interpolated distance is off at most."""
GOLDEN = (5**0.5 - 1) / 2
"""Multiples of it, modulo 1, are spread evenly: neighbours that follow one another would each come
a little nearer to a node, and none be passed over."""
SLABS = 16
"""Planes of the grid from which a second thread pays."""
BORDER = 3
"""Coarse nodes beyond the grid, or the spline would feel its end."""
BEYOND = 12
"""Values repeated beyond those, after which the spline's end is no longer felt."""
BATCH = 100_000
"""Nodes at a time, to bound the memory."""
PAIRED = 2_000
"""As many where each is paired with all faces about it."""
SURE = 1e-6
"""Area over the radius squared below which a triangle's normal is rounding."""


def check_surface(vertices: Array, faces: Ints) -> tuple[Array, Ints]:
    """The surface with identical vertices welded and collapsed faces dropped.

    Raises InputError where it is empty, holds a value that is not finite, or is not watertight."""
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces)
    if (
        vertices.ndim != 2
        or vertices.shape[1:] != (3,)
        or faces.ndim != 2
        or faces.shape[1:] != (3,)
    ):
        raise InputError(
            f"surface: expected vertices (nv, 3) and triangles (nf, 3), got {vertices.shape} and "
            f"{faces.shape}; split faces with more corners into triangles"
        )
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError("surface is empty: it has no triangles; check the file it was read from")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(
            f"surface: {len(bad)} vertices are not finite, the first is number {bad[0]}; "
            "repair the file or export it again"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"surface: a face names vertex {faces.max() if faces.min() >= 0 else faces.min()}, "
            f"expected 0 to {len(vertices) - 1}; repair the file or export it again"
        )
    vertices, index = np.unique(vertices, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _require_watertight(faces)
    return vertices, faces


def _require_watertight(faces: Ints) -> None:
    """Every edge must belong to an even number of faces: only then does a ray change sides at each
    crossing."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T.astype(np.int64)
    number = ends.min(axis=0) * (ends.max(initial=0) + 1) + ends.max(axis=0)  # of each edge
    _, count = np.unique(number, return_counts=True)
    loose = int((count % 2).sum())
    if loose or len(faces) == 0:
        raise InputError(
            f"surface is not watertight: {loose} of {len(count)} edges border an odd number of "
            "triangles; close its holes (MeshLab: Close Holes; trimesh: repair.fill_holes) "
            "and export it again"
        )


def distances_on_grid(
    vertices: Array, faces: Ints, origin: Array, spacing: float, shape: tuple[int, ...]
) -> Array:
    """Signed distance (m, negative inside) at the nodes of a uniform grid, `shape`.

    Up to REACH spacings from the surface it is exact, and so moves no farther than the vertices do;
    farther away it is interpolated from every second node each way."""
    triangles = vertices[faces]
    axes = [o + spacing * np.arange(n) for o, n in zip(origin, shape, strict=True)]
    value = np.abs(_far(triangles, origin, spacing, shape))
    near = value <= REACH * spacing
    if kernels.COMPILED:
        near = _make_exact(triangles, origin, spacing, value, near)
    nodes = np.stack(np.nonzero(near), axis=1) * spacing + origin
    value[near] = _exact(triangles, nodes, _upper_bound(triangles, nodes, EDGE * spacing))
    return np.where(_inside(triangles, *axes), -1.0, 1.0) * value


def _make_exact(
    triangles: Array, origin: Array, spacing: float, value: Array, near: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Make the distances (nx, ny, nz) of the nodes `near` exact, from values that are off by less
    than SLACK spacings; the nodes where that is not so are left, and returned."""
    squared = np.where(near, (value + SLACK * spacing) ** 2, 0.0)
    at_start = squared.copy()
    reach = (REACH + SLACK) * spacing
    mixed = np.argsort(np.arange(len(triangles)) * GOLDEN % 1)
    triangles = triangles[mixed]
    grid = (*_discs(triangles), origin, spacing, reach, squared)
    kernels.in_parallel(lambda a, b: lower_distances(a, b, triangles, *grid), len(value), SLABS)
    done = squared < at_start
    value[done] = np.sqrt(squared[done])
    return near & ~done


def _far(triangles: Array, origin: Array, spacing: float, shape: tuple[int, ...]) -> Array:
    """Signed distance at all nodes by cubic interpolation from a grid twice as coarse."""
    coarse = [2 * np.arange(-BORDER, -(-n // 2) + BORDER) for n in shape]
    axes = [o + spacing * i for o, i in zip(origin, coarse, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    value = _upper_bound(triangles, nodes.reshape(-1, 3), EDGE * spacing).reshape(nodes.shape[:3])
    value = np.where(_inside(triangles, *axes), -value, value)
    for axis, n in enumerate(shape):
        value = np.moveaxis(_refine(np.moveaxis(value, axis, 0), n), 0, axis)
    return value


def _refine(value: Array, count: int) -> Array:
    """The cubic spline (count, ...) through values (m, ...) at every half of their spacing, from
    number BORDER on."""
    from scipy.ndimage import spline_filter1d

    beyond = [(BEYOND, BEYOND), *[(0, 0)] * (value.ndim - 1)]
    c = spline_filter1d(np.pad(value, beyond, mode="edge"), axis=0, mode="nearest")
    first, last = BORDER + BEYOND, BORDER + BEYOND + -(-count // 2)
    a, b, d, e = (c[first + i : last + i] for i in (-1, 0, 1, 2))
    out = np.empty((2 * len(b), *value.shape[1:]))
    out[::2] = (a + 4 * b + d) / 6
    out[1::2] = (a + 23 * b + 23 * d + e) / 48
    return out[:count]


def _upper_bound(triangles: Array, nodes: Array, edge: float) -> Array:
    """The distance (n,) of nodes (n, 3) to the faces of the TRIED nearest samples, which lie `edge`
    or less apart: that of the surface or more, by less than edge squared over twice it."""
    from scipy.spatial import cKDTree

    samples, owner = _samples(triangles, edge)
    tree, k = cKDTree(samples), range(1, min(TRIED, len(samples)) + 1)
    out = np.empty(len(nodes))
    for i in range(0, len(nodes), BATCH):
        some = slice(i, i + BATCH)
        _, nearest = tree.query(nodes[some], k=k, workers=-1)
        out[some] = _nearest_of(triangles, nodes[some], owner[nearest])
    return out


def _nearest_of(triangles: Array, points: Array, candidates: Ints) -> Array:
    """Smallest distance of each point (n, 3) to its candidate triangles (n, k)."""
    best = np.full(len(points), np.inf)
    for column in np.sort(candidates, axis=1).T:
        best = np.minimum(best, distance_squared(triangles[column], points))
    return np.sqrt(best)


def _exact(triangles: Array, nodes: Array, most: Array) -> Array:
    """The distance (n,) of nodes (n, 3) to the surface, which is `most` (n,) or less.

    Every face that may be nearer is tried.  Faces are looked for by the discs about them, those of
    like size together, so that a few large ones do not make all be looked at."""
    from scipy.spatial import cKDTree

    centre, normal, radius = _discs(triangles)
    size = np.frexp(radius)[1]
    out, order = most.copy(), np.argsort(most)
    for alike in (np.flatnonzero(size == s) for s in np.unique(size)):
        tree, widest = cKDTree(centre[alike]), radius[alike].max()
        for i in range(0, len(nodes), PAIRED):
            some = order[i : i + PAIRED]
            reach = out[some].max() + widest
            pairs = cKDTree(nodes[some]).sparse_distance_matrix(tree, reach, output_type="ndarray")
            node, face, apart = some[pairs["i"]], alike[pairs["j"]], pairs["v"]
            may = np.flatnonzero(apart - radius[face] < out[node])
            node, face, apart = node[may], face[may], apart[may]
            height = _dot(nodes[node] - centre[face], normal[face])
            beside = np.sqrt(np.maximum(apart**2 - height**2, 0.0)) - radius[face]
            may = np.flatnonzero(height**2 + np.maximum(beside, 0.0) ** 2 < out[node] ** 2)
            node, face = node[may], face[may]
            np.minimum.at(out, node, np.sqrt(distance_squared(triangles[face], nodes[node])))
    return out


def _discs(triangles: Array) -> tuple[Array, Array, Array]:
    """Centre (n, 3), unit normal (n, 3) and radius (n,) of a disc that holds each triangle; a
    sliver without a sure normal has none, and a ball in its place."""
    centre = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1)[:, None]
    sure = area > SURE * radius[:, None] ** 2
    return centre, np.divide(cross, area, out=np.zeros_like(cross), where=sure), radius


def _samples(triangles: Array, spacing: float) -> tuple[Array, Ints]:
    """Points of the triangles no farther apart than `spacing`, in rows along the longest edge of
    each, and whose they are."""
    edge = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    first, rows = edge.argmax(axis=1), np.arange(len(triangles))
    a, b, c = (triangles[rows, (first + i) % 3] for i in range(3))
    length = edge.max(axis=1)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / length
    along, across = (np.maximum(1, np.ceil(v / spacing)).astype(int) for v in (length, height))
    count = along * across
    owner = np.repeat(rows, count)
    k = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    s, t = (k % along[owner] + 0.5) / along[owner], (k // along[owner] + 0.5) / across[owner]
    base = a[owner] + s[:, None] * (b - a)[owner]
    return base + t[:, None] * (c[owner] - base), owner


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ij,ij->i", a, b)


def _to_segment(start: Array, end: Array, points: Array) -> Array:
    axis, arm = end - start, points - start
    length = _dot(axis, axis)
    t = np.divide(_dot(arm, axis), length, out=np.zeros_like(length), where=length > 0)
    t = np.clip(t, 0, 1)
    gap = arm - t[:, None] * axis
    return _dot(gap, gap)


def distance_squared(triangles: Array, points: Array) -> Array:
    """The squared distance (n,) of points (n, 3) to triangles (n, 3, 3), pair by pair: to the plane
    where the foot lies inside, else to the nearest edge.  A sliver without a sure normal is its
    edges."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac, arm = b - a, c - a, points - a
    normal = np.cross(ab, ac)
    u, v = _dot(np.cross(ab, arm), normal), _dot(np.cross(arm, ac), normal)
    area = _dot(normal, normal)
    inside = (area > 1e-20 * _dot(ab, ab) * _dot(ac, ac)) & (u >= 0) & (v >= 0) & (u + v <= area)
    out = np.divide(_dot(arm, normal) ** 2, area, out=np.empty(len(points)), where=inside)
    i = np.flatnonzero(~inside)
    ends = [(a[i], b[i]), (b[i], c[i]), (c[i], a[i])]
    out[i] = np.minimum.reduce([_to_segment(s, e, points[i]) for s, e in ends])
    return out


def _inside(triangles: Array, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
    """Which grid nodes lie inside: an odd number of crossings of the ray along -x.

    Whether a ray hits a triangle is told by where its y-z outline is crossed, computed from the
    ends of each edge in a fixed order, so that neighbours agree to the last bit."""
    out = np.zeros((len(x), len(y), len(z)), dtype=bool)
    low, high = triangles[..., 2].min(axis=1), triangles[..., 2].max(axis=1)
    for k, height in enumerate(z):
        cut = triangles[(low <= height) & (high > height)]
        left, right = _span(cut, height)
        hit, row = np.nonzero((left[:, :1] <= y) & (y < right[:, :1]))
        t = (y[row] - left[hit, 0]) / (right[hit, 0] - left[hit, 0])
        crossing = left[hit, 1] + t * (right[hit, 1] - left[hit, 1])
        first = np.searchsorted(x, crossing)
        flips = np.zeros((len(x) + 1, len(y)), dtype=int)
        np.add.at(flips, (first, row), 1)
        out[:, :, k] = np.cumsum(flips[:-1], axis=0) % 2 == 1
    return out


def _span(triangles: Array, height: float) -> tuple[Array, Array]:
    """Where the plane z = height cuts triangles that straddle it: the two ends (y, x), sorted."""
    ends = np.full((len(triangles), 3, 2), np.inf)
    for i in range(3):
        a, b = triangles[:, i], triangles[:, (i + 1) % 3]
        crosses = (a[:, 2] <= height) != (b[:, 2] <= height)
        swap = (a[:, 2] > b[:, 2])[:, None]
        low, high = np.where(swap, b, a)[crosses], np.where(swap, a, b)[crosses]
        t = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
        ends[crosses, i] = (low + t[:, None] * (high - low))[:, 1::-1]
    order = np.argsort(ends[..., 0], axis=1)[:, :, None]
    ends = np.take_along_axis(ends, order, axis=1)
    return ends[:, 0], ends[:, 1]
