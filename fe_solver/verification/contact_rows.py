"""Contact, friction and springs against closed forms, differences and themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cosim.port import Motion, rotation_matrix

from ..augment import AugmentOptions, settled, solve_augmented
from ..contact import Contact, Grip, contact_forces, contact_state, partition
from ..model import Configuration, ShellModel
from ..newton import NewtonOptions, Solution, solve
from ..shapes import Capsule, Cylinder, RoundCone
from ..shell import Array
from ..springs import ForceCurve, NodeSprings, PointForces, Springs, node_springs, spring_forces
from . import sheets
from .row import Row
from .sheets import at_rest, clamped, guided, sheet

NEWTON = NewtonOptions(tolerance=1e-10)
RADIUS, ANGLE, WIDTH, TAIL = 8e-3, np.deg2rad(120), 4e-3, 6e-3
DOWN = np.array([np.cos(ANGLE / 2), 0.0, -np.sin(ANGLE / 2)])
UP = DOWN * [-1, 1, 1]
FRICTION = 0.3
STATICS = "statics of a string over a cylinder"
OWN = "central differences"


def laid(uv: Array) -> Array:
    """The unit square as a strip over a cylinder about y: an arc and straight tangents."""
    s = (uv[:, 0] - 0.5) * (RADIUS * ANGLE + 2 * TAIL)
    turn = np.clip(s / RADIUS, -ANGLE / 2, ANGLE / 2)
    rest = s - RADIUS * turn
    x = RADIUS * np.sin(turn) + rest * np.cos(turn)
    z = RADIUS * np.cos(turn) - rest * np.sin(turn)
    return np.column_stack([x, WIDTH * (uv[:, 1] - 0.5), z])


def strip(elements: int, stiffness: float, friction: float) -> ShellModel:
    """A strip laid over a cylinder, its start pulled by a tendon, its end held by a second body."""
    X, quads = sheets.mapped(elements, 2, laid)
    first, last = (np.flatnonzero(np.isclose(X[:, 0], x)) for x in (X[0, 0], X[-1, 0]))
    model = sheet(X, quads, 1e9, 0.0, 0.1e-3, bodies=("drum", "hand"))
    model = guided(clamped(model, last, body=1), [first], [UP.tolist()])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([first, last]))
    drum = Cylinder(np.zeros(3), np.array([0.0, 1, 0]), RADIUS)
    touching = sheets.contact(model, drum, inner, stiffness, 1e-5)
    return replace(model, contacts=(replace(touching, friction=friction),))


def wrapped(friction: float, pulls: tuple[float, ...], elements: int = 64) -> Solution:
    """The strip pulled over the cylinder by `pulls` (m) in turn, against a tension of 1 N."""
    model = strip(elements, 1e11, friction)
    c = at_rest(model)
    for pull in pulls:
        c = model.posed(c, np.stack([np.zeros(3), pull * DOWN]), c.rotation)
        solution = solve_augmented(model, c, np.ones(1), NEWTON)
        c, model = solution.configuration, settled(solution)
    return solution


def far_tension(solution: Solution) -> float:
    """Force of the strip on the body that holds its end, N."""
    wrench = solution.model.wrenches(solution.configuration, solution.evaluation, solution.tension)
    return float(np.linalg.norm(wrench["tie"][1, :3]))


def strip_rows() -> Iterator[Row]:
    """A string without friction and with it."""
    smooth = wrapped(0.0, (0.0,))
    c, contact = smooth.configuration, smooth.model.contacts[0]
    state = contact_state(contact, c.x, c.position, c.rotation)
    force = smooth.model.wrenches(c, smooth.evaluation, smooth.tension)["contact"][0, :3]
    middle = np.abs(np.arctan2(c.x[contact.nodes, 0], c.x[contact.nodes, 2])) < ANGLE / 3
    pressure = (state.pressure @ (contact.area * middle)) / contact.area[middle].sum()
    name = "strip over a cylinder"
    yield Row(name, "tension at the far end (N)", 1.0, far_tension(smooth), 1e-3, STATICS)
    resultant = 2 * np.sin(ANGLE / 2)
    yield Row(name, "contact resultant (N)", resultant, float(-force[2]), 1e-3, STATICS)
    exact = 1 / (RADIUS * WIDTH)
    yield Row(name, "pressure T / R w (Pa)", exact, float(pressure), 5e-3, STATICS)
    deepest = float(np.abs(state.gap[state.pressure > 0]).max())
    yield Row(name, "gap of pressed nodes (m)", 1e-6, deepest, 0.0, "as asked for", "bound")
    fine = far_tension(wrapped(FRICTION, (0.3e-3, 0.6e-3)))
    target = float(np.exp(FRICTION * ANGLE))
    yield Row(
        "strip with friction", "T2 / T1 = exp(mu theta)", target, fine, 1e-2, "Euler, Eytelwein"
    )


LENGTH, BONE, HEIGHT = 40e-3, 4e-3, 0.3e-3
ARM = LENGTH / 2


def two_bones(stiffness: float) -> tuple[ShellModel, Array]:
    """A flat sheet over two capsules along x whose joint is at the origin, pulled proximally and
    tied to the distal one; and how much of each node the distal one carries (n,)."""
    X, quads = sheets.plate(LENGTH, 8e-3, 41, 8)
    X = X - [LENGTH / 2, 4e-3, -BONE - HEIGHT]
    model = sheet(X, quads, 2e7, 0.4, 0.6e-3, bodies=("proximal", "distal"))
    first, last = (np.flatnonzero(np.isclose(X[:, 0], s * LENGTH / 2)) for s in (-1, 1))
    model = guided(clamped(model, last, body=1), [first], [(-1.0, 0, 0)])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([first, last]))
    bones = [Capsule(np.zeros(3), np.array([s * LENGTH, 0, 0]), BONE) for s in (-1, 1)]
    distances = np.stack([bone.distance(X[inner]).value for bone in bones], axis=1)
    shares = partition(distances, 1e-5)
    contacts = []
    for body, bone in enumerate(bones):
        touching = sheets.contact(model, bone, inner, stiffness, 2e-5)
        offset = touching.offset + HEIGHT
        contacts.append(replace(touching, body=body, offset=offset, share=shares[:, body]))
    carried = np.clip(X[:, 0] / 8e-3 + 0.5, 0, 1)
    return replace(model, contacts=tuple(contacts)), carried


def flexed(model: ShellModel, c: Configuration, carried: Array, angle: float) -> Configuration:
    """The sheet carried along by a flexion (rad) of the distal bone."""
    turn = np.array([0.0, angle, 0.0]) * carried[:, None]
    R = rotation_matrix(turn)
    x, d = (np.einsum("nij,nj->ni", R, v) for v in (c.x, c.d))
    rotation = np.stack(
        [c.rotation[0], rotation_matrix(np.array([0.0, angle, 0.0])) @ c.rotation[1]]
    )
    return model.posed(Configuration(x, d, c.position, c.rotation), c.position, rotation)


def bent_hood() -> tuple[ShellModel, Configuration]:
    """The sheet under 2 N with its joint flexed to 60 degrees, by penalty."""
    model, carried = two_bones(1e10)
    c = at_rest(model)
    for angle in (0.0, 20.0, 20.0, 20.0):
        c = flexed(model, c, carried, np.deg2rad(angle))
        c = solve(model, c, np.array([2.0]), NEWTON).configuration
    return model, c


def hood_rows() -> Iterator[Row]:
    """The same joint moment from penalties a decade apart, and the condensed tangent."""
    model, c = bent_hood()
    name, tension = "hood over two capsules at 60 deg", np.array([2.0])
    solutions = []
    for stiffness in (1e11, 1e10, 1e9):
        contacts = tuple(replace(k, stiffness=stiffness) for k in model.contacts)
        solutions.append(solve_augmented(replace(model, contacts=contacts), c, tension, NEWTON))
    first, *others = (float(joint_wrench(s)[4]) for s in solutions)
    for k, moment in zip(("1e10", "1e9"), others, strict=True):
        what = f"joint moment by {k} N/m3 (N m), target by 1e11"
        yield Row(name, what, first, moment, 1e-3, "the same problem")
    gaps = [contact_state(k, *_places(solutions[-1])) for k in solutions[-1].model.contacts]
    deepest = float(max(np.abs(g.gap[g.pressure > 0]).max() for g in gaps))
    yield Row(name, "gap of pressed nodes (m)", 1e-6, deepest, 0.0, "as asked for", "bound")
    error = condensed_error(solutions[0])
    yield Row(name, "condensed tangent", 1e-5, error, 0.0, "re-solved differences", "bound")


def condensed(solution: Solution) -> Array:
    """(12, 12) wrenches on the bodies by their twists."""
    model, free = solution.model, solution.model.free
    by_motion, wrench, _, _ = model.coupling(
        solution.configuration, solution.evaluation, solution.tension
    )
    return wrench + by_motion[free].T @ solution.factor.solve(by_motion[free])


def condensed_error(solution: Solution, step: float = 3e-5) -> float:
    """Of the condensed tangent by the distal bone's six motions, against differences of solutions
    at poses moved by `step` (rad, and as much of ARM); relative to each column's largest entry,
    forces times ARM beside moments."""
    tight, newton = AugmentOptions(penetration=2e-13), replace(NEWTON, tolerance=1e-11)
    here = solve_augmented(solution.model, solution.configuration, solution.tension, newton, tight)
    tangent, scales = condensed(here)[:, 6:], np.array([ARM] * 3 + [1.0] * 3)
    c = here.configuration
    motion, worst = Motion(here.model.bodies, c.position, c.rotation), 0.0
    for i, scale in enumerate(step * scales):
        wrench = []
        for sign in (1, -1):
            twist = np.zeros((2, 6))
            twist[1, i] = sign * scale
            moved = motion.displaced(twist)
            start = here.model.posed(c, moved.position, moved.rotation)
            there = solve_augmented(here.model, start, here.tension, newton, tight)
            wrench.append(_total(there))
        change = (wrench[0] - wrench[1]) / (2 * scale) * scales
        error = np.abs(tangent[:, i].reshape(2, 6) * scales - change).max()
        worst = max(worst, float(error / np.abs(change).max()))
    return worst


def _total(solution: Solution) -> Array:
    """(2, 6) force and moment of the whole hood on the bodies."""
    parts = solution.model.wrenches(solution.configuration, solution.evaluation, solution.tension)
    return sum(parts.values(), start=np.zeros((2, 6)))


def joint_wrench(solution: Solution) -> Array:
    """(6,) force and moment about the joint of the whole hood on the distal bone."""
    return _total(solution)[1]


def _places(solution: Solution) -> tuple[Array, Array, Array]:
    c = solution.configuration
    return c.x, c.position, c.rotation


POSE = (
    np.array([[1e-3, -2e-3, 0.5e-3], [-3e-3, 0.0, 1e-3]]),
    rotation_matrix(np.array([[0.3, -0.2, 0.5], [-0.6, 0.1, 0.2]])),
)
TOE = ForceCurve(np.arange(4), np.array([-2e-3, 0, 1e-3, 3e-3]), np.array([-0.2, 0, 0.05, 1.0]))


def some_springs(rng: np.random.Generator) -> tuple[Springs, Array]:
    """Springs of all kinds between eight nodes and two bodies, and the nodes' places (m)."""
    x, slack = 4e-3 * rng.normal(size=(8, 3)), rng.uniform(1e-3, 12e-3, 9)
    node, body = np.arange(9) % 8, np.arange(9) % 2
    anchor, stiffness = 4e-3 * rng.normal(size=(9, 3)), rng.uniform(100, 300, 9)
    only, group = np.arange(9) % 3 > 0, np.zeros(9, dtype=np.intp)
    return Springs(node, body, anchor, stiffness, slack, only, group, (TOE,)), x


def some_contact(rng: np.random.Generator, friction: float) -> tuple[Contact, Array]:
    """Nodes about the level of a round cone, in and out of it, that stick and slide."""
    cone = RoundCone(np.zeros(3), np.array([12e-3, 2e-3, 0]), 5e-3, 3e-3)
    local = rng.uniform([-2e-3, -6e-3, -6e-3], [15e-3, 8e-3, 6e-3], size=(16, 3))
    value, normal, _ = cone.distance(local)
    local += (np.linspace(-1e-4, 1.5e-4, 16) - value)[:, None] * normal
    x = POSE[0][1] + local @ POSE[1][1].T
    none, area = np.zeros(16), rng.uniform(0.5e-6, 2e-6, 16)
    held = Contact(1, cone, np.arange(16), none, area, 1e10, 5e-5, pressure=np.full(16, 2e5))
    if friction == 0:
        return held, x
    anchor = local + np.geomspace(3e-5, 1e-3, 16)[:, None] * rng.normal(size=(16, 3))
    grip = Grip(anchor, normal, friction * rng.uniform(0.5, 1.5, 16), none)
    return replace(held, friction=friction, shear=1e9, grip=grip), x


def tangent_error(forces: PointForces, low: PointForces, high: PointForces, way: Array) -> float:
    """Of gradient and Hessian along `way` (n, 3), which leads from `low` to `high`, against their
    differences."""
    slope = float(np.sum(forces.gradient * way[forces.node]))
    first = abs((high.energy - low.energy) / slope - 1)
    change = high.gradient - low.gradient
    product = np.einsum("kij,kj->ki", forces.hessian, way[forces.node])
    return max(first, float(np.abs(product - change).max() / np.abs(change).max()))


def tangent_rows() -> Iterator[Row]:
    """Gradients and Hessians against differences."""
    rng = np.random.default_rng(0)
    springs, x = some_springs(rng)
    way = rng.normal(size=x.shape)
    h = 1e-8
    low, here, high = (spring_forces(springs, x + s * h * way, *POSE, True) for s in (-1, 0, 1))
    error = tangent_error(here, low, high, 2 * h * way)
    yield Row("springs", "force and tangent", 1e-6, error, 0.0, OWN, "bound")
    for name, friction in (("contact", 0.0), ("contact with friction", 0.2)):
        contact, x = some_contact(rng, friction)
        way = rng.normal(size=x.shape)
        low, here, high = (
            contact_forces(contact, x + s * h * way, *POSE, True) for s in (-1, 0, 1)
        )
        error = tangent_error(here, low, high, 2 * h * way)
        yield Row(name, "force and tangent", 1e-6, error, 0.0, OWN, "bound")
    yield Row("node springs", "force and tangent", 1e-6, pair_error(rng), 0.0, OWN, "bound")


def pair_error(rng: np.random.Generator) -> float:
    """Of springs between nodes, as `tangent_error`."""
    springs, x = some_springs(rng)
    nodes = np.stack([springs.node, (springs.node + 3) % 8], axis=1)
    pairs = NodeSprings(
        nodes, springs.stiffness, springs.length, springs.tension_only, springs.group, (TOE,)
    )
    way, h = rng.normal(size=x.shape), 1e-8
    low, here, high = (node_springs(pairs, x + s * h * way, True) for s in (-1, 0, 1))
    first = (high.energy - low.energy) / (2 * h * np.sum(here.gradient * way[nodes])) - 1
    change = (high.gradient - low.gradient) / (2 * h)
    product = np.einsum("kij,kj->ki", here.hessian, way[nodes].reshape(-1, 6)).reshape(-1, 2, 3)
    return max(abs(float(first)), float(np.abs(product - change).max() / np.abs(change).max()))


def rows() -> Iterator[Row]:
    """All of them; about five seconds."""
    yield from tangent_rows()
    yield from strip_rows()
    yield from hood_rows()
