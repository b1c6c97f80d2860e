"""Small shells to verify with: meshes, and models of a sheet alone, held by bodies or mirrored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cosim.port import Array
from fe_solver.elements.kinds import kind_of
from fe_solver.elements.mesh_geometry import node_areas
from fe_solver.forces.contact import Contact
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.guides import Guides, Ties
from fe_solver.materials.linear import Isotropic, Law
from fe_solver.materials.tension_field import TensionField
from fe_solver.sheet import even_sheet, grid
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.solver.newton_step import factorise
from fe_solver.surfaces.spline_distance import Surface

GROUND = (np.zeros((1, 3)), np.eye(3)[None])
"""Pose of one body at the world's origin."""
NO_TENSION = np.zeros(0)
BENCHMARK = NewtonOptions(tolerance=1e-9, max_step=1.0)
"""For benchmarks whose lengths are of the order of ten."""
Map = Callable[[Array], Array]


def plate(length: float, width: float, nx: int, ny: int) -> tuple[Array, np.ndarray]:
    """A flat sheet in the x-y plane: points (n, 3), quads."""
    uv, quads = grid(nx, ny)
    return np.column_stack([uv * [length, width], np.zeros(len(uv))]), quads


def with_nine_nodes(points: Array, quads: np.ndarray) -> tuple[Array, np.ndarray]:
    """The sheet with a node in the middle of each quad's edges and in its own."""
    edges = np.sort(quads[:, [[0, 3], [1, 2], [0, 1], [3, 2]]].reshape(-1, 2), axis=1)
    edges, middle = np.unique(edges, axis=0, return_inverse=True)
    on_edges = len(points) + middle.reshape(-1, 4)
    middles = len(points) + len(edges) + np.arange(len(quads))
    points = np.vstack([points, points[edges].mean(axis=1), points[quads].mean(axis=1)])
    return points, np.column_stack([quads, on_edges, middles])


def elements(
    nx: int, ny: int, nodes: int, shift: float = 0.0, seed: int = 0
) -> tuple[Array, np.ndarray]:
    """Nodes (n, 2) of the unit square and nx x ny elements of four or nine `nodes`; the corners
    inside it moved at random by up to `shift` of an element's sides."""
    uv, quads = grid(nx, ny)
    if shift:
        inside = ((uv > 0) & (uv < 1)).all(axis=1, keepdims=True)
        moved = np.random.default_rng(seed).uniform(-shift, shift, uv.shape) / [nx, ny]
        uv = uv + moved * inside
    return with_nine_nodes(uv, quads) if nodes == 9 else (uv, quads)


def line_weights(s: Array, nodes: int, density: Callable[[Array], Array] = np.ones_like) -> Array:
    """The consistent nodal forces (k,) of a load per length on an edge of elements of four or nine
    `nodes` whose own nodes lie at s (k,)."""
    order, out = np.argsort(s), np.zeros(len(s))
    points, factors = np.polynomial.legendre.leggauss(3)
    step = 2 if nodes == 9 else 1
    for first in range(0, len(s) - 1, step):
        node = order[first : first + step + 1]
        half = (s[node[-1]] - s[node[0]]) / 2
        at = s[node[0]] + half * (1 + points)
        for a in node:
            others = node[node != a]
            shape = np.prod([(at - s[b]) / (s[a] - s[b]) for b in others], axis=0)
            out[a] += half * factors @ (shape * density(at))
    return out


def surface_weights(model: ShellModel) -> Array:
    """The consistent nodal forces (n,) of a unit load per area of the mid-surface."""
    element = kind_of(model.quads)
    shape = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
    shares = (model.tables.weight @ shape).ravel()
    total = np.bincount(model.quads.ravel(), weights=shares, minlength=len(model.reference))
    return total.astype(float, copy=False)


def map_grid(nx: int, ny: int, shape: Map) -> tuple[Array, np.ndarray]:
    """A sheet whose points are `shape` (n, 2) -> (n, 3) of the unit square's."""
    uv, quads = grid(nx, ny)
    return shape(uv), quads


def sheet(
    points: Array,
    quads: np.ndarray,
    modulus: float,
    poisson: float,
    thickness: float | Array,
    *,
    directors: Array | None = None,
    growth: float = 0.0,
    law: Law | TensionField | None = None,
    bodies: tuple[str, ...] = ("ground",),
    **more: Any,
) -> ShellModel:
    """A sheet that nothing holds, isotropic or of another law, as `even_sheet` makes it; its parts
    are added with `clamp`, `guide`, `mirror_plane` and `replace`."""
    law, grown = law or Isotropic(modulus, poisson), np.tile([growth, 0.0], (len(quads), 1))
    laid = even_sheet(points, quads, law, thickness, normals=directors, growth=grown, **more)
    return laid.model(bodies=bodies)


def clamp(model: ShellModel, nodes: np.ndarray, body: int = 0) -> ShellModel:
    """The model with nodes tied to a body whose frame is the world's at rest."""
    t, X, D = model.ties, model.reference, model.directors
    ties = Ties(
        np.concatenate([t.node, nodes]),
        np.concatenate([t.body, np.full(len(nodes), body)]),
        np.vstack([t.position, X[nodes]]),
        np.vstack([t.director, D[nodes]]),
    )
    return replace(model, ties=ties)


def guide(
    model: ShellModel, ends: Sequence[np.ndarray], pulls: Sequence[Sequence[float]], body: int = 0
) -> ShellModel:
    """The model with one tendon on each group of nodes, shared evenly, pulling along `pulls`."""
    nodes = np.concatenate(ends)
    unit = np.array(pulls, dtype=float) / np.linalg.norm(pulls, axis=1, keepdims=True)
    direction = np.repeat(unit, [len(e) for e in ends], axis=0)
    share = np.stack([np.isin(nodes, e) / len(e) for e in ends])
    at = Guides.along(nodes, np.full(len(nodes), body), model.reference[nodes], direction)
    return replace(model, guides=at, share=share)


def mirror_plane(
    model: ShellModel, mirror: np.ndarray, held: np.ndarray | bool = False
) -> ShellModel:
    """The model with nodes on mirror planes normal to the axes that `mirror` (n, 3) marks, and
    nodes held along the axes that `held` (n, 3) marks with their directors free."""
    move = mirror | held
    node = np.flatnonzero(move.any(axis=1))
    planes = mirror[node]
    at = Guides.on_body_axes(node, np.zeros_like(node), model.reference[node], move[node])
    level = np.eye(3)[np.argmax(planes, axis=1)]
    still = np.stack([planes.any(axis=1), planes.sum(axis=1) > 1], axis=1)
    guides = replace(at, level=level, still=still)
    return replace(model, guides=guides, share=np.zeros((0, len(node))))


def contact(
    model: ShellModel, surface: Surface, nodes: np.ndarray, stiffness: float, smoothing: float
) -> Contact:
    """Contact of nodes' mid-surface with a surface of body 0; of nine-node elements, the points
    within those that such nodes have."""
    X, quads = model.reference, model.quads
    if quads.shape[1] == 4:
        area = node_areas(X, quads)[nodes]
        return Contact(0, surface, nodes, np.zeros(len(nodes)), area, stiffness, smoothing)
    points = ElementPoints.of(quads, np.flatnonzero(np.isin(quads, nodes).any(axis=1)))
    area, at = points.areas(X), points.nearest
    return Contact(0, surface, at, 0 * area, area, stiffness, smoothing, within=points)


def at_rest(model: ShellModel) -> Configuration:
    """The reference configuration, all bodies at the world's origin."""
    nb = len(model.bodies)
    return Configuration(
        model.reference.copy(),
        model.directors.copy(),
        np.zeros((nb, 3)),
        np.tile(np.eye(3), (nb, 1, 1)),
    )


def disturb(model: ShellModel, size: float, seed: int) -> Configuration:
    """The reference shape, its free degrees of freedom moved at random by about `size` (m, rad)."""
    c = at_rest(model)
    step = np.zeros(model.pattern.size)
    step[model.free] = size * np.random.default_rng(seed).normal(size=len(model.free))
    return model.take_step(c, model.bases(c), step)


def linear_response(
    model: ShellModel, load: Array, values: Array | None = None
) -> tuple[Array, Array]:
    """Small displacements (n, 3) and turns of the directors' tips (n, 3) in the linear limit under
    nodal forces `load` (n, 3); what is not free has `values` (n, 5) in the nodes' bases, or 0."""
    c = at_rest(model)
    e = model.evaluate(c, np.zeros(len(model.share)), tangent=True)
    assert e.data is not None
    A, T = e.bases
    u, free = np.zeros(model.pattern.size), model.free
    right = np.hstack([np.einsum("nij,ni->nj", A, load), np.zeros((len(load), 2))]).ravel()
    if values is not None:
        u = values.ravel().copy()
        u[free] = 0.0
        right -= model.pattern.full(e.data) @ u
    u[free] = factorise(model, e.data).solve(right[free])
    step = u.reshape(-1, 5)
    return np.einsum("nij,nj->ni", A, step[:, :3]), np.einsum("nij,nj->ni", T, step[:, 3:])


def in_basis(model: ShellModel, displacement: Array, turn: Array) -> Array:
    """The components (n, 5) of displacements (n, 3) and changes of directors (n, 3)."""
    A, T = model.bases(at_rest(model))
    return np.hstack([np.einsum("nij,ni->nj", A, displacement), np.einsum("nij,ni->nj", T, turn)])
