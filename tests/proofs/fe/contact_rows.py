"""A strip over a cylinder, with friction and without, against closed forms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cosim.port import Array
from fe_solver.forces.contact import contact_state
from fe_solver.solver.augmented_contact import next_increment, solve_augmented
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution
from fe_solver.surfaces.shapes import Cylinder
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.sheets import at_rest, clamp, guide, sheet

NEWTON = NewtonOptions(tolerance=1e-10)
RADIUS, ANGLE, WIDTH, TAIL = 8e-3, np.deg2rad(120), 4e-3, 6e-3
DOWN = np.array([np.cos(ANGLE / 2), 0.0, -np.sin(ANGLE / 2)])
UP = DOWN * [-1, 1, 1]
FRICTION = 0.3
STATICS = "statics of a string over a cylinder"


def lay(uv: Array) -> Array:
    """The unit square as a strip over a cylinder about y: an arc and straight tangents."""
    s = (uv[:, 0] - 0.5) * (RADIUS * ANGLE + 2 * TAIL)
    turn = np.clip(s / RADIUS, -ANGLE / 2, ANGLE / 2)
    rest = s - RADIUS * turn
    x = RADIUS * np.sin(turn) + rest * np.cos(turn)
    z = RADIUS * np.cos(turn) - rest * np.sin(turn)
    return np.column_stack([x, WIDTH * (uv[:, 1] - 0.5), z])


def strip(elements: int, stiffness: float, friction: float) -> ShellModel:
    """A strip laid over a cylinder, its start pulled by a tendon, its end held by a second body."""
    X, quads = sheets.map_grid(elements, 2, lay)
    first, last = (np.flatnonzero(np.isclose(X[:, 0], x)) for x in (X[0, 0], X[-1, 0]))
    model = sheet(X, quads, 1e9, 0.0, 0.1e-3, bodies=("drum", "hand"))
    model = guide(clamp(model, last, body=1), [first], [UP.tolist()])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([first, last]))
    drum = Cylinder(np.zeros(3), np.array([0.0, 1, 0]), RADIUS)
    touching = sheets.contact(model, drum, inner, stiffness, 1e-5)
    return replace(model, contacts=(replace(touching, friction=friction),))


def wrap_strap(friction: float, pulls: tuple[float, ...], elements: int = 64) -> Solution:
    """The strip pulled over the cylinder by `pulls` (m) in turn, against a tension of 1 N."""
    model = strip(elements, 1e11, friction)
    c = at_rest(model)
    for pull in pulls:
        c = model.move_bodies(c, np.stack([np.zeros(3), pull * DOWN]), c.rotation)
        solution = solve_augmented(model, c, np.ones(1), NEWTON)
        c, model = solution.configuration, next_increment(solution)
    return solution


def far_tension(solution: Solution) -> float:
    """Force of the strip on the body that holds its end, N."""
    wrench = wrenches(solution.model, solution.configuration, solution.evaluation, solution.tension)
    return float(np.linalg.norm(wrench["tie"][1, :3]))


def rows() -> Iterator[Row]:
    """A string without friction and with it."""
    smooth = wrap_strap(0.0, (0.0,))
    c, contact = smooth.configuration, smooth.model.contacts[0]
    state = contact_state(contact, c.x, c.position, c.rotation)
    force = wrenches(smooth.model, c, smooth.evaluation, smooth.tension)["contact"][0, :3]
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
    fine = far_tension(wrap_strap(FRICTION, (0.3e-3, 0.6e-3)))
    target = float(np.exp(FRICTION * ANGLE))
    yield Row(
        "strip with friction", "T2 / T1 = exp(mu theta)", target, fine, 1e-2, "Euler, Eytelwein"
    )
