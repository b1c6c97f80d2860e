"""A sheet over two capsules whose joint is flexed: its moment whatever the penalty, and the
condensed derivatives against solutions near by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from cosim.port import Array, HoodJacobian, Motion, rotation_matrix
from fe_solver.forces.contact import contact_state, partition
from fe_solver.forces.springs import Springs
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.solver.augmented_contact import AugmentOptions, solve_augmented
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from fe_solver.surfaces.shapes import Capsule, HalfSpace
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.sheets import at_rest, clamp, guide, sheet

NEWTON = NewtonOptions(tolerance=1e-10)
TIGHT, CLOSED = NewtonOptions(tolerance=1e-11), AugmentOptions(penetration=2e-13)
LENGTH, BONE, HEIGHT = 40e-3, 4e-3, 0.3e-3
ARM = LENGTH / 2
TENSION = np.array([2.0])
BODIES = ("proximal", "distal")
Solver = Callable[[ShellModel, Configuration, Array], Solution]
COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
SCALES = np.tile([ARM] * 3 + [1.0] * 3, 2)
"""Scales of the bodies' twists and wrenches: lengths count in ARM, forces as moments with it."""
STEP = 1e-5
"""rad, and of ARM."""
NAME = "hood over two capsules at 60 deg"
DIFFERENCES = "central differences of solutions"


def two_bones(stiffness: float, nine: bool = False) -> tuple[ShellModel, Array]:
    """A flat sheet over two capsules along x whose joint is at the origin, pulled proximally, tied
    to the distal one and sprung to both; and how much of each node the distal one carries (n,).
    With `nine` its elements have nine nodes."""
    X, quads = sheets.plate(LENGTH, 8e-3, *((21, 4) if nine else (41, 8)))
    X, quads = sheets.with_nine_nodes(X, quads) if nine else (X, quads)
    X = X - [LENGTH / 2, 4e-3, -BONE - HEIGHT]
    model = sheet(X, quads, 2e7, 0.4, 0.6e-3, bodies=BODIES)
    first, last = (np.flatnonzero(np.isclose(X[:, 0], s * LENGTH / 2)) for s in (-1, 1))
    model = guide(clamp(model, last, body=1), [first], [(-1.0, 0, 0)])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([first, last]))
    bones = [Capsule(np.zeros(3), np.array([s * LENGTH, 0, 0]), BONE) for s in (-1, 1)]
    alike = [sheets.contact(model, bone, inner, stiffness, 2e-5) for bone in bones]
    distances = [bone.distance(k.at(X)).value for bone, k in zip(bones, alike, strict=True)]
    shares = partition(np.stack(distances, axis=1), 1e-5)
    contacts = [
        replace(k, body=body, offset=k.offset + HEIGHT, share=shares[:, body])
        for body, k in enumerate(alike)
    ]
    carried = np.clip(X[:, 0] / 8e-3 + 0.5, 0, 1)
    return replace(model, contacts=tuple(contacts), springs=bands(X)), carried


def bands(X: Array) -> Springs:
    """Tension-only springs: on either edge of each bone's half, from the sheet to the bone's side
    below it, 1 mm too short; and one across the joint, from a node that is tied to the distal bone
    to the proximal one, 10 mm too short."""
    places = np.array([[x, y] for x in (-1, 1) for y in (-1, 1)])
    at = np.column_stack([places * [LENGTH / 4, 4e-3], np.zeros(4)])
    node = np.linalg.norm(X[:, None, :2] - at[:, :2], axis=2).argmin(axis=0)
    node, at = np.append(node, X[:, 0].argmax()), np.vstack([at, [-LENGTH / 4, 2e-3, 0]])
    length = np.linalg.norm(X[node] - at, axis=1) - [1e-3, 1e-3, 1e-3, 1e-3, 10e-3]
    body, only = np.array([0, 0, 1, 1, 0]), np.ones(5, dtype=bool)
    return Springs(node, body, at, np.full(5, 100.0), length, only, np.zeros(5, dtype=np.intp))


def flex(model: ShellModel, c: Configuration, carried: Array, angle: float) -> Configuration:
    """The sheet carried along by a flexion (rad) of the distal bone."""
    turn = np.array([0.0, angle, 0.0]) * carried[:, None]
    R = rotation_matrix(turn)
    x, d = (np.einsum("nij,nj->ni", R, v) for v in (c.x, c.d))
    rotation = np.stack(
        [c.rotation[0], rotation_matrix(np.array([0.0, angle, 0.0])) @ c.rotation[1]]
    )
    return model.move_bodies(Configuration(x, d, c.position, c.rotation), c.position, rotation)


def bend_hood(nine: bool = False) -> tuple[ShellModel, Configuration]:
    """The sheet under 2 N with its joint flexed to 60 degrees, by penalty; `nine` as of
    `two_bones`."""
    model, carried = two_bones(1e10, nine)
    c = at_rest(model)
    for angle in (0.0, 20.0, 20.0, 20.0):
        c = flex(model, c, carried, np.deg2rad(angle))
        c = solve(model, c, TENSION, NEWTON).configuration
    return model, c


def add_wall(model: ShellModel, c: Configuration) -> ShellModel:
    """The model with a wall of the proximal bone that the nodes tied to the distal one press on, as
    a bone may whose neighbour the sheet is tied to."""
    nodes, normal = model.ties.node, np.array([0.36, 0.48, 0.8])
    wall = HalfSpace(c.x[nodes].mean(axis=0), normal)
    return model.with_changes(
        contacts=(*model.contacts, sheets.contact(model, wall, nodes, 1e9, 2e-5)),
    )


def total_wrench(solution: Solution) -> Array:
    """The force and moment (12,) of the whole hood on the bodies."""
    parts = wrenches(solution.model, solution.configuration, solution.evaluation, solution.tension)
    return np.sum(list(parts.values()), axis=0).ravel()


def motion(solution: Solution) -> Motion:
    """The bodies' poses."""
    c = solution.configuration
    return Motion(BODIES, c.position, c.rotation)


def jacobian(solution: Solution) -> HoodJacobian:
    """As a hood behind the port answers it."""
    model, pose = solution.model, motion(solution)
    none = np.zeros((len(model.reference), 2))
    hood = ShellHood(replace(model, groups=("bands",)), ("tendon",), pose, none)
    return hood.jacobian(HoodState(pose, solution.configuration, solution))


def by_penalty(model: ShellModel, start: Configuration, tension: Array) -> Solution:
    """Solved to rounding error."""
    return solve(model, start, tension, TIGHT, near=True)


def augment(model: ShellModel, start: Configuration, tension: Array) -> Solution:
    """Solved until no node is off its level, to rounding error."""
    return solve_augmented(model, start, tension, TIGHT, CLOSED)


def displace(solution: Solution, solver: Solver, twist: Array) -> Solution:
    """Solved again with the bodies moved by `twist` (12,)."""
    c, pose = solution.configuration, motion(solution).displace(twist)
    start = solution.model.move_bodies(c, pose.position, pose.rotation)
    return solver(solution.model, start, solution.tension)


def by_motion(solution: Solution, solver: Solver) -> tuple[Array, Array]:
    """The derivatives of the wrenches (12, 12) and the excursion (12,) by the bodies' twists,
    scaled: central differences of solutions."""
    wrench, excursion = np.empty((12, 12)), np.empty(12)
    for i, way in enumerate(np.eye(12)):
        ahead, behind = (displace(solution, solver, s * STEP * SCALES * way) for s in (1, -1))
        wrench[:, i] = (total_wrench(ahead) - total_wrench(behind)) * SCALES / (2 * STEP)
        slid = (s.model.excursion(s.configuration)[0] for s in (ahead, behind))
        excursion[i] = float(np.subtract(*slid)) / (2 * STEP)
    return wrench, excursion


def by_tension(solution: Solution, solver: Solver, step: float = 1e-4) -> Array:
    """The wrenches' derivative (12,) by the tension, scaled: central differences of solutions."""
    c, model = solution.configuration, solution.model
    ahead, behind = (total_wrench(solver(model, c, TENSION + s * step)) for s in (1, -1))
    return np.asarray((ahead - behind) / (2 * step) * SCALES)


def own_pull(solution: Solution) -> Array:
    """The wrench (12,) of the tendon, for 1 N, on the body that guides it, scaled: there the muscle
    would hold on, and reciprocity is of what remains."""
    c, model = solution.configuration, solution.model
    at, out = model.guides, np.zeros((2, 6))
    force = model.pulls(c, np.ones(1))
    arm = c.x[at.node] - c.position[at.body]
    np.add.at(out, at.body, np.hstack([force, np.cross(arm, force)]))
    return out.ravel() * SCALES


def moment_rows(solutions: dict[str, Solution]) -> Iterator[Row]:
    """The joint's moment from penalties a decade apart; the target is that of the first."""
    moments = {name: float(total_wrench(s)[10]) for name, s in solutions.items()}
    first = next(iter(moments))
    for name in list(moments)[1:]:
        what = f"joint moment by {name} N/m3 (N m)"
        source = f"the same problem by {first} N/m3"
        yield Row(NAME, what, moments[first], moments[name], 1e-3, source)
    for name, s in solutions.items():
        c = s.configuration
        states = [contact_state(k, c.x, c.position, c.rotation) for k in s.model.contacts]
        deepest = float(max(np.abs(k.gap[k.pressure > 0]).max() for k in states))
        what = f"gap of pressed nodes by {name} N/m3 (m)"
        yield Row(NAME, what, 1e-6, deepest, 0.0, "as asked for", "bound")


def tangent_rows(solution: Solution, of: str = "") -> Iterator[Row]:
    """Every component of the wrench on every body by all twelve motions, relative to the largest
    derivative of that very component; and the moment arms by force and by excursion."""
    exact, (wrench, excursion) = jacobian(solution), by_motion(solution, by_penalty)
    yield from component_rows(f"condensed tangent{of}", exact, wrench)
    muscle, slides = own_pull(solution), exact.excursion_motion[0] * SCALES
    arms = exact.load_tension[:, 0] * SCALES - muscle
    for what, bound, seen, source in (
        ("d tau / d T = d x / d q", 1e-8, slides, "reciprocity, both by back-substitution"),
        ("d x / d q", 1e-5, excursion, DIFFERENCES),
        ("d tau / d T", 1e-5, by_tension(solution, by_penalty) - muscle, DIFFERENCES),
    ):
        off = float(np.abs(arms - seen).max() / np.abs(arms).max())
        yield Row(NAME, f"{what}{of}, all motions", bound, off, 0.0, source, "bound")


def component_rows(what: str, exact: HoodJacobian, wrench: Array) -> Iterator[Row]:
    """Yield a row for each component of the wrench on each body, relative to its own largest
    derivative."""
    error = np.abs(exact.load_motion * np.outer(SCALES, SCALES) - wrench)
    for i, worst in enumerate(error.max(axis=1) / np.abs(wrench).max(axis=1)):
        which = f"{what}, {COMPONENTS[i % 6]} on the {BODIES[i // 6]} body"
        source = f"{DIFFERENCES}, by the six motions of either body"
        yield Row(NAME, which, 1e-5, float(worst), 0.0, source, "bound")


def augmented_rows(solution: Solution) -> Iterator[Row]:
    """Yield the rows of the constrained problem, whose pressed nodes are held by springs
    `augment.PIN` times as stiff as any other."""
    augmented = augment(solution.model, solution.configuration, TENSION)
    exact, (wrench, _) = jacobian(augmented), by_motion(augmented, augment)
    yield from component_rows("condensed tangent, augmented", exact, wrench)
    arms = exact.load_tension[:, 0] * SCALES - own_pull(augmented)
    off = float(np.abs(arms - exact.excursion_motion[0] * SCALES).max() / np.abs(arms).max())
    what = "d tau / d T = d x / d q, augmented, all motions"
    source = "reciprocity, both by back-substitution"
    yield Row(NAME, what, 1e-8, off, 0.0, source, "bound")


def rows() -> Iterator[Row]:
    """All of them; about ten seconds."""
    model, c = bend_hood()
    solutions = {}
    for name in ("1e11", "1e10", "1e9"):
        contacts = tuple(replace(k, stiffness=float(name)) for k in model.contacts)
        solutions[name] = solve_augmented(model.with_changes(contacts=contacts), c, TENSION, NEWTON)
    yield from moment_rows(solutions)
    yield from tangent_rows(by_penalty(add_wall(model, c), c, TENSION))
    nine, pose = bend_hood(nine=True)
    yield from tangent_rows(by_penalty(add_wall(nine, pose), pose, TENSION), ", nine nodes")
    yield from augmented_rows(solutions["1e11"])
