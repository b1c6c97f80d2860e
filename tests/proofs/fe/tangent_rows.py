"""Tangents of supports, loads, springs and contacts against differences: each by itself, and on a
shell that they hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from cosim.port import Array, rotation_matrix
from fe_solver.forces.contact import Contact, Grip, contact_forces
from fe_solver.forces.guides import Ropes
from fe_solver.forces.loads import Inertia
from fe_solver.forces.springs import (
    ForceCurve,
    NodeSprings,
    PointForces,
    Springs,
    node_springs,
    spring_forces,
)
from fe_solver.solver.model import ShellModel
from fe_solver.surfaces.shapes import Capsule, Cone, Cylinder, HalfSpace, RoundCone, Sphere
from fe_solver.surfaces.spline_distance import SplineDistance, Surface
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.element_rows import OWN, SIDE, THICK, distort
from tests.proofs.fe.element_rows import tangent_error as model_error
from tests.proofs.fe.ellipsoid import Ellipsoid
from tests.proofs.fe.sheets import clamp, guide, mirror_plane

Part = Callable[[ShellModel], ShellModel]
POSE = (
    np.array([[1e-3, -2e-3, 0.5e-3], [-3e-3, 0.0, 1e-3]]),
    rotation_matrix(np.array([[0.3, -0.2, 0.5], [-0.6, 0.1, 0.2]])),
)
TOE = (1e-3 * np.array([-2.0, 0, 1, 3]), np.array([-0.2, 0, 0.05, 1.0]))
"""Stretch (m) and force (N) of a table."""
NINE = "nine-node quads"
KINDS = ("tension-only", "bilateral", "by a table", "by a table, tension-only")
"""Of springs to a body or between nodes; those to a body may have a toe too."""
TOED = "with a toe, tension-only"
FRICTION, STICKS, SLIDES = 0.2, 1e-5, 1e-3
"""Coefficient; distances (m) from the anchors at which nodes stick and slide."""
PRESSURE = 2e5
"""Pa, a multiplier."""


def curves(kind: str, count: int) -> tuple[ForceCurve, ...]:
    """The table of `count` springs of the kind, where it has one."""
    return (ForceCurve(np.arange(count), *TOE),) if "table" in kind else ()


def some_springs(kind: str) -> tuple[Springs, Array]:
    """Springs of one of KINDS, or TOED, between eight nodes and two bodies, some of them slack, and
    the nodes' places (m)."""
    rng = np.random.default_rng(0)
    x, slack = 4e-3 * rng.normal(size=(8, 3)), rng.uniform(1e-3, 12e-3, 9)
    node, body = np.arange(9) % 8, np.arange(9) % 2
    anchor, stiffness = 4e-3 * rng.normal(size=(9, 3)), rng.uniform(100, 300, 9)
    only, group = np.full(9, kind.endswith("tension-only")), np.zeros(9, dtype=np.intp)
    toe = np.full(9, 3e-3) if kind == TOED else None
    return Springs(node, body, anchor, stiffness, slack, only, group, curves(kind, 9), toe), x


def between_nodes(s: Springs, partner: np.ndarray) -> NodeSprings:
    """The springs from their nodes to others (k,) instead of to bodies."""
    nodes = np.stack([s.node, partner], axis=1)
    return NodeSprings(nodes, s.stiffness, s.length, s.tension_only, s.group, s.curves)


def make_block() -> SplineDistance:
    """A block of 14 x 8 x 8 mm as triangles, baked."""
    corner = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, 8).T
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3".split()
    vertices = (corner - [0.0, 0.5, 0.5]) * [14e-3, 8e-3, 8e-3]
    return SplineDistance.bake(vertices, np.array(faces, dtype=np.intp).reshape(12, 3), 1e-3)


def surfaces() -> dict[str, Surface]:
    """One of every kind."""
    start, end, z = np.zeros(3), np.array([12e-3, 2e-3, 0]), np.array([0.1, 0.2, 1.0])
    turn = rotation_matrix(np.array([0.2, 0.5, -0.3]))
    return {
        "sphere": Sphere(start, 5e-3),
        "capsule": Capsule(start, end, 4e-3),
        "cylinder": Cylinder(start, end, 4e-3),
        "round cone": RoundCone(start, end, 5e-3, 3e-3),
        "cone": Cone(start, end, 5e-3, 3e-3),
        "half-space": HalfSpace(start, z),
        "ellipsoid": Ellipsoid(start, np.array([9e-3, 5e-3, 4e-3]), turn),
        "baked triangles": make_block(),
    }


def some_contact(surface: Surface, pressure: float, slip: float | None) -> tuple[Contact, Array]:
    """Nodes about the level of a surface, in and out of it, with a multiplier (Pa), and where
    `slip` (m) is given with friction, its anchors about so far off; and their places."""
    rng = np.random.default_rng(1)
    local = rng.uniform([-2e-3, -6e-3, -6e-3], [15e-3, 8e-3, 6e-3], size=(16, 3))
    for _ in range(20):
        value, normal, _ = surface.distance(local)
        local += (np.linspace(-0.9e-4, 1.5e-4, 16) - value)[:, None] * normal
    x = POSE[0][1] + local @ POSE[1][1].T
    none, area = np.zeros(16), rng.uniform(0.5e-6, 2e-6, 16)
    held = Contact(
        1, surface, np.arange(16), none, area, 1e10, 5e-5, pressure=np.full(16, pressure)
    )
    if slip is None:
        return held, x
    normal = surface.distance(local).gradient
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    anchor = local + slip * rng.normal(size=(16, 3))
    grip = Grip(anchor, normal, FRICTION * rng.uniform(0.5, 1.5, 16), none)
    return replace(held, friction=FRICTION, shear=1e9, grip=grip), x


def forces_error(act: Callable[[Array], PointForces], x: Array) -> float:
    """The error of gradient and Hessian at x (n, 3) along a random way, against central differences
    of energy and gradient."""
    way = 1e-8 * np.random.default_rng(2).normal(size=x.shape)
    low, centre, high = (act(x + s * way) for s in (-1, 0, 1))
    slope = 2 * float(np.sum(centre.gradient * way[centre.node]))
    first = abs((high.energy - low.energy) / slope - 1)
    change = high.gradient - low.gradient
    product = 2 * np.einsum("kij,kj->ki", centre.hessian, way[centre.node])
    return max(first, float(np.abs(product - change).max() / np.abs(change).max()))


def pair_error(springs: NodeSprings, x: Array) -> float:
    """The error of springs between nodes, as in `forces_error`."""
    way = 1e-8 * np.random.default_rng(2).normal(size=x.shape)
    low, centre, high = (node_springs(springs, x + s * way, True) for s in (-1, 0, 1))
    pair_way = 2 * way[springs.nodes]
    first = abs((high.energy - low.energy) / float(np.sum(centre.gradient * pair_way)) - 1)
    change = (high.gradient - low.gradient).reshape(-1, 6)
    product = np.einsum("kij,kj->ki", centre.hessian, pair_way.reshape(-1, 6))
    return max(first, float(np.abs(product - change).max() / np.abs(change).max()))


def spring_rows() -> Iterator[Row]:
    """Every kind, to bodies and between nodes."""
    for kind in (*KINDS, TOED):
        springs, x = some_springs(kind)
        error = forces_error(partial(_pull_by, springs), x)
        yield Row("springs to bodies: tangent", kind, 1e-6, error, 0.0, OWN, "bound")
    for kind in KINDS:
        springs, x = some_springs(kind)
        error = pair_error(between_nodes(springs, (springs.node + 3) % 8), x)
        yield Row("springs between nodes: tangent", kind, 1e-6, error, 0.0, OWN, "bound")


def surface_rows() -> Iterator[Row]:
    """Every surface by penalty and augmented, with friction that holds and that slides."""
    ways = {
        "penalty": (0.0, None),
        "augmented": (PRESSURE, None),
        "sticking": (PRESSURE, STICKS),
        "sliding": (PRESSURE, SLIDES),
    }
    for name, surface in surfaces().items():
        for way, (pressure, slip) in ways.items():
            contact, x = some_contact(surface, pressure, slip)
            error = forces_error(partial(_press_by, contact), x)
            yield Row(f"contact, {name}: tangent", way, 1e-6, error, 0.0, OWN, "bound")


def _pull_by(springs: Springs, x: Array) -> PointForces:
    return spring_forces(springs, x, *POSE, True)


def _press_by(contact: Contact, x: Array) -> PointForces:
    return contact_forces(contact, x, *POSE, True)


def _with_springs(kind: str, model: ShellModel) -> ShellModel:
    """Every other spring is slack, or pushes."""
    X = model.reference
    node = np.arange(len(X))
    body, k = np.zeros(len(X), dtype=np.intp), np.full(len(X), 2e3)
    anchor = X + np.random.default_rng(6).normal(size=X.shape) * SIDE
    length = np.where(node % 2, 0.9, 1.1) * np.linalg.norm(anchor - X, axis=1)
    only = np.full(len(X), kind.endswith("tension-only"))
    toe = np.full(len(X), 0.2 * SIDE) if kind == TOED else None
    springs = Springs(node, body, anchor, k, length, only, body, curves(kind, len(X)), toe)
    return replace(model, springs=springs)


def _with_links(kind: str, model: ShellModel) -> ShellModel:
    springs, X = _with_springs(kind, model).springs, model.reference
    links = between_nodes(springs, (springs.node + 5) % len(X))
    reach = np.linalg.norm(X[links.nodes[:, 1]] - X[links.nodes[:, 0]], axis=1)
    return replace(model, links=replace(links, length=np.where(springs.node % 2, 0.9, 1.1) * reach))


def _with_dead_loads(model: ShellModel) -> ShellModel:
    return replace(model, dead=np.random.default_rng(9).normal(size=model.reference.shape))


def _with_pressure(model: ShellModel) -> ShellModel:
    return replace(model, pressure=np.linspace(1e3, 3e3, len(model.quads)))


def _with_inertia(model: ShellModel) -> ShellModel:
    X, n = model.reference, len(model.reference)
    k = np.linspace(1e3, 2e3, n)
    return replace(model, inertia=Inertia(k, X + 1e-3, k * SIDE**2, np.tile([0, 0.6, 0.8], (n, 1))))


def _with_contact(pressure: float, slip: float | None, model: ShellModel) -> ShellModel:
    ball, X = Sphere(np.array([1.5 * SIDE, SIDE, -5 * SIDE]), 5 * SIDE), model.reference
    contact = sheets.contact(model, ball, np.arange(len(X)), 1e9, 1e-3)
    at = contact.at(X)
    if slip is not None:
        none, normal = np.zeros(len(at)), ball.distance(at).gradient
        anchor = at + slip * np.random.default_rng(4).normal(size=at.shape)
        limit = FRICTION * contact.area * pressure
        grip = Grip(anchor, normal, limit, none)
        contact = replace(contact, friction=FRICTION, shear=1e9, grip=grip)
    return replace(model, contacts=(replace(contact, pressure=np.full(len(at), pressure)),))


def _with_ropes(model: ShellModel) -> ShellModel:
    """Two ropes of one tendon, and one of another."""
    node, body = np.array([0, 1, 4]), np.zeros(3, dtype=np.intp)
    eyelet = model.reference[node] + SIDE * np.array([[-1.0, 0.2, 0.4], [-1, 0, 1], [0.3, 2, -1]])
    pull, share = np.tile([-1.0, 0, 0], (3, 1)), np.array([[0.4, 0.6, 0], [0, 0, 1]])
    ropes = Ropes(node, body, eyelet, pull, np.zeros(3), share)
    return replace(model, ropes=ropes, share=np.zeros((2, len(model.guides.node))))


def _clamp(model: ShellModel) -> ShellModel:
    return clamp(model, np.arange(3))


def _guide(model: ShellModel) -> ShellModel:
    return guide(model, [np.arange(3), np.array([9, 10])], [(-1.0, 0, 0.2), (1.0, 0.3, 0)])


def _guide_beyond(model: ShellModel) -> ShellModel:
    return guide(model, [np.array([9, 10, 11])], [(1.0, 0.3, 0)])


def _mirror(model: ShellModel) -> ShellModel:
    planes = np.zeros((len(model.reference), 3), dtype=bool)
    planes[:3, 0], planes[[0, 3, 6, 9], 1] = True, True
    return mirror_plane(model, planes, np.eye(12, dtype=bool)[:, [11, 11, 10]])


def model_rows() -> Iterator[Row]:
    """Supports and loads on a shell, each alone and all that go together."""
    touching = {
        "penalty": partial(_with_contact, 0.0, None),
        "augmented": partial(_with_contact, PRESSURE, None),
        "sticking": partial(_with_contact, PRESSURE, STICKS),
        "sliding": partial(_with_contact, PRESSURE, SLIDES),
    }
    together = (partial(_with_springs, "tension-only"), _with_pressure, touching["penalty"])
    cases: dict[str, tuple[Part, ...]] = {
        **{f"springs, {kind}": (partial(_with_springs, kind),) for kind in (*KINDS, TOED)},
        **{f"springs between nodes, {kind}": (partial(_with_links, kind),) for kind in KINDS},
        "dead loads": (_with_dead_loads,),
        "follower pressure": (_with_pressure,),
        "inertia": (_with_inertia,),
        **{f"contact, {kind}": (part,) for kind, part in touching.items()},
        "ties": (_clamp,),
        "guides and tendons": (_guide,),
        "ropes": (_with_ropes,),
        "mirror planes": (_mirror,),
        **{f"contact, {kind}, {NINE}": (part,) for kind, part in touching.items()},
        "ties, springs, pressure, contact": (_clamp, *together),
        f"ties, guides, contact, {NINE}": (_clamp, _guide_beyond, touching["penalty"]),
        "mirror planes, springs, pressure, contact": (_mirror, *together),
    }
    for name, parts in cases.items():
        shape = NINE if NINE in name else "flat quads" if _mirror in parts else "warped quads"
        model = distort(shape, height=THICK / 2)
        for part in parts:
            model = part(model)
        tension = np.array([3.0, 2.0])[: len(model.share)] if len(model.share) else None
        error = model_error(model, 1e-4, tension)
        yield Row("model tangent", name, 1e-6, error, 0.0, OWN, "bound")


def rows() -> Iterator[Row]:
    """Yield the rows of this table."""
    yield from spring_rows()
    yield from surface_rows()
    yield from model_rows()
