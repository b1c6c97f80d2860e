"""Faults of a shell mesh and of a job, told before anything is solved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.elements.mesh_geometry import check_middles
from fe_solver.job.job import Job

Name = Callable[[int], str]

SAME_PLACE = 1e-9
"""Share of the mesh's size: nodes nearer than that lie at one place."""
THIN = 1e-10
"""Share of the square of an element's longest edge: less is no area."""
THICKNESS = (1e-8, 100.0)
"""Least and largest share of the mesh's size: a sheet beyond that is a mistake of units, and its
stiffness loses all its digits."""
TILT = 0.02
"""Least sine of the angle between fibre and normal."""


def check_job(job: Job) -> None:
    """Check a job before it is solved.  Raises InputError for the first fault, naming its node or
    element as the file does."""
    _check_shapes(job)
    with within(job.name):
        check_mesh(job.sheet.points, job.sheet.quads, job.sheet.node, job.sheet.element)
        _check_values(job)
        _check_pieces(job)
        _check_bodies(job)


@contextmanager
def within(where: str) -> Iterator[None]:
    """Errors are told with the file or job in which they are."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _check_pieces(job: Job) -> None:
    pairs = (
        [s.nodes[s.other >= 0] for s in job.springs],
        [s.other[s.other >= 0] for s in job.springs],
    )
    joined = np.stack([np.concatenate([np.zeros(0, dtype=np.intp), *p]) for p in pairs], axis=1)
    holds = [t.nodes for t in job.ties] + [h.nodes for h in job.held]
    holds += [s.nodes[s.body >= 0] for s in job.springs]
    held = np.concatenate([np.zeros(0, dtype=np.intp), *holds])
    check_supports(job.sheet.quads, held, joined, job.sheet.node)


def _check_bodies(job: Job) -> None:
    """No body whose motion is to be found is alone, and no rotation is given in part."""
    held = {t.body for t in job.ties} | {c.body for c in job.contacts}
    held |= {int(b) for s in job.springs for b in s.body}
    for i, b in enumerate(job.bodies):
        if any(b.free) and i not in held:
            raise InputError(
                f"the rigid body {b.name!r} is free, and nothing holds it: no tie, spring or "
                "contact; fix it, prescribe its motion, or tie it to the sheet"
            )
        turns = zip(b.rotation, b.free[3:], strict=True)
        if any(b.free[3:]) and any(d.value and not is_free for d, is_free in turns):
            raise InputError(
                f"the rotation of the body {b.name!r} is free in part, and turns in part as it is "
                "told: its components do not add up; give all of them, or hold those that are not "
                "free"
            )


def check_mesh(points: Array, quads: Ints, node: Name, element: Name) -> None:
    """Points (n, 3) and quads (ne, 4), triangles as (a, b, c, c), or (ne, 9).

    Raises InputError for values that are not finite, node indices out of range, elements without
    area, reflex or crossing corners, a node named twice, two elements with the same nodes,
    neighbours wound against each other, two nodes at one place, and middles of nine-node quads that
    are not between their corners."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"{node(bad[0])} has coordinates that are not finite numbers")
    if not len(quads):
        raise InputError("the shell has no elements")
    bad = np.flatnonzero(((quads < 0) | (quads >= len(points))).any(axis=1))
    if len(bad):
        raise InputError(
            f"{element(bad[0])} names the node indices {quads[bad[0]].tolist()}, expected 0 to "
            f"{len(points) - 1}"
        )
    _check_places(points, quads, node)
    _check_names(quads, node, element)
    _check_corners(points, quads, element)
    _check_winding(quads, element)
    check_middles(points, quads, element)


def _check_names(quads: Ints, node: Name, element: Name) -> None:
    """No element names a node twice, but for a triangle's last, and no two have the same nodes."""
    corners = quads.copy()
    corners[corners[:, 2] == corners[:, 3], 3] = -1
    corners.sort(axis=1)
    bad = np.flatnonzero((corners[:, 1:] == corners[:, :-1]).any(axis=1))
    if len(bad):
        twice = corners[bad[0], 1:][corners[bad[0], 1:] == corners[bad[0], :-1]][0]
        raise InputError(
            f"{element(bad[0])} names {node(twice)} twice: give a triangle three nodes"
        )
    _, number, times = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    if (times > 1).any():
        same = np.flatnonzero(number.reshape(-1) == np.argmax(times > 1))
        raise InputError(
            f"{element(same[0])} and {element(same[1])} have the same nodes: remove one of them"
        )


def _check_corners(points: Array, quads: Ints, element: Name) -> None:
    quads = quads[:, :4]
    x = points[quads]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    area = np.linalg.norm(normal, axis=1)
    edge = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)
    least = THIN * edge.max(axis=1) ** 2
    corner = np.cross(np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x)
    bad = np.flatnonzero(~(np.linalg.norm(corner, axis=2).max(axis=1) > least))
    if len(bad):
        raise InputError(
            f"{element(bad[0])} has no area: its nodes lie on a line; move them or remove it"
        )
    normal /= np.maximum(area, least)[:, None]
    turn = np.einsum("eak,ek->ea", corner, normal)
    triangle = quads[:, 2] == quads[:, 3]
    turn[triangle, 2:] = area[triangle, None]
    bad = np.flatnonzero((area <= least) | (turn <= THIN * area[:, None]).any(axis=1))
    if len(bad):
        raise InputError(
            f"{element(bad[0])} is inverted: it has a reflex corner or crosses itself; order its "
            "nodes around it"
        )


def _edges(quads: Ints) -> tuple[Ints, Ints]:
    """Directed edges (m, 2) between corners and their elements (m,), without those of no length."""
    quads = quads[:, :4]
    edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
    owner = np.repeat(np.arange(len(quads)), 4)
    real = edges[:, 0] != edges[:, 1]
    return edges[real], owner[real]


def _check_winding(quads: Ints, element: Name) -> None:
    """Two elements that alone share an edge must run along it in opposite directions."""
    edges, owner = _edges(quads)
    _, number, times = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    number = number.reshape(-1)
    forward = np.bincount(number, weights=edges[:, 0] < edges[:, 1])
    bad = np.flatnonzero((times == 2) & (forward != 1))
    if len(bad):
        i, j = owner[np.flatnonzero(number == bad[0])]
        raise InputError(
            f"{element(i)} and its neighbour, {element(j)}, are wound in opposite senses: turn one "
            "of them over, so that their normals agree"
        )


def _check_places(points: Array, quads: Ints, node: Name) -> None:
    used = np.unique(quads)
    x = points[used]
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    twins = cKDTree(x).query_pairs(SAME_PLACE * size, output_type="ndarray")
    if len(twins):
        i, j = used[twins[0]]
        raise InputError(
            f"{node(i)} lies where {node(j)} does ({len(twins)} such pairs), so that what is "
            "between them is not joined; merge the mesh's duplicate nodes"
        )


def _check_shapes(job: Job) -> None:
    sheet, (ne, k) = job.sheet, job.sheet.quads.shape
    shapes = {"thickness": (ne, k), "height": (ne, k), "fibre": (ne, 3), "part": (ne,)}
    for name, shape in shapes.items():
        if getattr(sheet, name).shape != shape:
            raise InputError(
                f"{job.name}: {name} has shape {getattr(sheet, name).shape}, expected {shape}"
            )


def _check_values(job: Job) -> None:
    s = job.sheet
    bad = np.flatnonzero(~((s.thickness > 0) & np.isfinite(s.thickness)).all(axis=1))
    if len(bad):
        raise InputError(
            f"{s.element(bad[0])} has the thickness {s.thickness[bad[0]].min():g} m: it must "
            "be positive at every node"
        )
    size = float(np.linalg.norm(np.ptp(s.points, axis=0)))
    least, most = (share * size for share in THICKNESS)
    bad = np.flatnonzero(~((s.thickness >= least) & (s.thickness <= most)).all(axis=1))
    if len(bad):
        raise InputError(
            f"{s.element(bad[0])} has the thickness {s.thickness[bad[0]].max():g} m in a mesh "
            f"of {size:g} m: that is no sheet; check the units"
        )
    x = s.points[s.quads]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    flat = s.fibre - np.einsum("ek,ek->e", s.fibre, normal)[:, None] * normal
    length = np.linalg.norm(s.fibre, axis=1)
    bad = np.flatnonzero(~((length > 0) & (np.linalg.norm(flat, axis=1) > TILT * length)))
    if len(bad):
        raise InputError(
            f"{s.element(bad[0])} has the fibre direction {s.fibre[bad[0]].tolist()}, which is "
            "zero or normal to the shell: it must lie in it"
        )
    nodes = [c.nodes for c in job.ties] + [c.nodes for c in job.held]
    nodes += [c.nodes for c in job.held_directors] + [c.nodes for c in job.forces]
    nodes += [c.nodes for c in job.springs] + [c.other[c.other != -1] for c in job.springs]
    quads = [c.quads for c in job.pressures] + [c.quads for c in job.body_forces]
    quads += [c.quads for c in job.contacts]
    bodies = [np.array([c.body for c in job.ties] + [c.body for c in job.contacts], dtype=np.intp)]
    bodies += [c.body[c.body != -1] for c in job.springs]
    bodies += [np.array([c.body for c in job.rigid_loads], dtype=np.intp)]
    _check_range("node", nodes, len(s.points))
    _check_range("element", quads, len(s.quads))
    _check_range("body", bodies, len(job.bodies))


def _check_range(what: str, named: Sequence[Ints], count: int) -> None:
    for index in named:
        bad = index[(index < 0) | (index >= count)]
        if len(bad):
            raise InputError(
                f"a condition names {what} index {bad[0]}, and there are {count}, from 0 on"
            )


def check_supports(quads: Ints, held: Ints, joined: Ints, node: Name) -> None:
    """Whether each connected piece has one of the nodes `held` (k,); `joined` (m, 2) nodes hang on
    each other.

    Raises InputError naming a node of a piece that nothing holds."""
    n = int(max(quads.max(), held.max(initial=0), joined.max(initial=0))) + 1
    spokes = [quads[:, [0, i]] for i in range(1, quads.shape[1])]
    edges = np.concatenate([*spokes, joined])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    _, piece = connected_components(graph, directed=False)
    used = np.unique(quads)
    loose = used[~np.isin(piece[used], piece[held])]
    if len(loose):
        count = len(np.unique(piece[used]))
        what = "the shell" if count == 1 else f"its piece of the shell ({count} pieces in all)"
        raise InputError(
            f"{node(loose[0])}: nothing holds {what}; give it a tie, a held displacement or a "
            "spring to a body, or join it to the rest"
        )
