"""Contact within elements: what acts at points of an element is what acts on its nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.elements import kernels
from fe_solver.elements.kinds import KINDS
from fe_solver.elements.mesh_geometry import element_areas, node_areas
from fe_solver.forces.contact import Contact, contact_fields, contact_forces, contact_state
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import worst_place
from fe_solver.surfaces.shapes import HalfSpace, Sphere
from tests.helpers.poses import POSITION, ROTATION
from tests.proofs.fe.sheets import (
    NO_TENSION,
    at_rest,
    clamp,
    contact,
    plate,
    sheet,
    with_nine_nodes,
)

SIDE = 2e-3
RADIUS, DEPTH = 5e-3, 0.4e-3


def flat(nx: int, ny: int) -> ShellModel:
    return sheet(*with_nine_nodes(*plate(nx * SIDE, ny * SIDE, nx, ny)), 1e7, 0.3, 0.5e-3)


def warp(seed: int) -> tuple[Array, np.ndarray]:
    X, quads = with_nine_nodes(*plate(3 * SIDE, 2 * SIDE, 3, 2))
    return X + 0.1 * SIDE * np.random.default_rng(seed).normal(size=X.shape), quads


@pytest.mark.parametrize("in_line", [2, 3, 4, 5])
def test_points_are_where_their_weights_say_and_share_the_area(in_line):
    X, quads = with_nine_nodes(*plate(3 * SIDE, 2 * SIDE, 3, 2))
    points = ElementPoints.of(quads, np.array([1, 4]), in_line)
    assert len(points.nearest) == 2 * in_line**2
    areas = points.areas(X).reshape(2, -1)
    assert areas.sum(axis=1) == pytest.approx(element_areas(X, quads)[[1, 4]], rel=1e-12)
    assert (areas > 0).all()
    field = 1 + 3 * X[:, 0] - 2 * X[:, 1] + 500 * X[:, 0] * X[:, 1] ** 2
    x, y, _ = points.mean(X).T
    assert points.mean(field) == pytest.approx(1 + 3 * x - 2 * y + 500 * x * y**2, rel=1e-12)
    off = np.linalg.norm(points.mean(X) - X[points.nearest], axis=1)
    every = np.linalg.norm(points.mean(X)[:, None] - X[quads[[1, 4]].repeat(in_line**2, 0)], axis=2)
    assert off == pytest.approx(every.min(axis=1), abs=1e-12)


def test_an_even_pressure_loads_the_nodes_as_the_element_shares_it():
    """1/36 of it a corner, 4/36 a middle of an edge, 16/36 the centre: the work of an even pressure
    in quadratic shape functions."""
    model = flat(1, 1)
    floor = contact(model, HalfSpace(np.zeros(3), np.array([0, 0, 1.0])), np.arange(9), 1e9, 1e-6)
    x = model.reference - [0, 0, 0.1e-3]
    forces = contact_forces(floor, x, np.zeros((1, 3)), np.eye(3)[None], True)
    total = 1e9 * 0.1e-3 * SIDE**2
    on_nodes = -forces.on_nodes(forces.gradient, 9)[model.quads[0]]
    assert on_nodes[:, 2] == pytest.approx(total * KINDS[9].share, rel=1e-12)
    seen = contact_fields([floor], x, np.zeros((1, 3)), np.eye(3)[None])
    assert seen.pressure[:, 0] == pytest.approx(1e5, rel=1e-12)
    assert seen.gap[:, 0] == pytest.approx(-0.1e-3, rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_forces_within_elements_are_their_energys(seed):
    X, quads = warp(seed)
    points = ElementPoints.of(quads, np.array([0, 2, 3, 5]))
    area, none = points.areas(X), np.zeros(len(points.nearest))
    ball = Sphere(np.array([1.5 * SIDE, SIDE, -0.95 * RADIUS]), RADIUS)
    act = Contact(1, ball, points.nearest, none, area, 1e10, 1e-4, within=points)
    x, n, h = POSITION[1] + X @ ROTATION[1].T, len(X), 1e-7
    here = contact_forces(act, x, POSITION, ROTATION, True)
    assert 20 < np.count_nonzero(here.gradient.any(axis=1)) < len(none)
    for v in np.random.default_rng(seed).normal(size=(3, n, 3)):
        low, high = (contact_forces(act, x + s * h * v, POSITION, ROTATION, True) for s in (-1, 1))
        slope = (high.energy - low.energy) / (2 * h)
        assert np.vdot(here.on_nodes(here.gradient, n), v) == pytest.approx(slope, rel=1e-6)
        change = (high.on_nodes(high.gradient, n) - low.on_nodes(low.gradient, n)) / (2 * h)
        product = np.einsum("kij,kj->ki", here.hessian, here.at_points(v))
        assert here.on_nodes(product, n) == pytest.approx(change, abs=1e-5 * np.abs(change).max())


def test_the_compiled_spread_is_the_plain_one(monkeypatch):
    rng = np.random.default_rng(0)
    which, weights = np.array([0, 2, 2, 1, 0]), rng.normal(size=(5, 9))
    hessian = rng.normal(size=(5, 3, 3))
    fast = kernels.spread(which, weights, hessian, 3)
    monkeypatch.setattr(kernels, "COMPILED", False)
    assert kernels.spread(which, weights, hessian, 3) == pytest.approx(fast, abs=1e-14)


def ball_force(points: ElementPoints | None, model: ShellModel, shift: Array) -> float:
    """N, of a ball that has sunk into the sheet by DEPTH."""
    X, middle = model.reference, np.array([2.5 * SIDE, 2.5 * SIDE, DEPTH - RADIUS])
    ball = Sphere(middle + shift, RADIUS)
    nodes = np.arange(len(X)) if points is None else points.nearest
    area = node_areas(X, model.quads) if points is None else points.areas(X)
    touch = Contact(0, ball, nodes, 0 * area, area, 1e10, 1e-9, within=points)
    return float(contact_state(touch, X, np.zeros((1, 3)), np.eye(3)[None]).pressure @ area)


def test_a_balls_force_hardly_depends_on_where_in_an_element_it_presses():
    """Against the integral of stiffness times depth over the circle in which a ball of RADIUS meets
    the plane; a fifth of the nodes' error is left."""
    model = flat(5, 5)
    z = RADIUS - DEPTH
    circle = RADIUS**2 - z**2
    exact = 2e10 * np.pi * (RADIUS * circle / 2 - (RADIUS**3 - z**3) / 3)
    places = SIDE * np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3)) * [1, 1, 0]
    points = ElementPoints.of(model.quads, np.arange(len(model.quads)))
    errors = {}
    for name, at in (("nodes", None), ("points", points)):
        off = [ball_force(at, model, shift) / exact - 1 for shift in places]
        errors[name] = float(np.sqrt(np.mean(np.square(off))))
    assert errors["points"] < 0.01
    assert errors["points"] < 0.2 * errors["nodes"]


def test_a_stalled_solve_says_what_presses_within_an_element():
    """An unbalanced sheet pressed into the floor: the worst node is an element's centre."""
    model = clamp(flat(3, 3), np.arange(4))
    floor = HalfSpace(np.zeros(3), np.array([0, 0, 1.0]))
    pressed = model.with_changes(
        contacts=(contact(model, floor, np.arange(len(model.reference)), 1e9, 1e-6),)
    )
    c = replace(at_rest(model), x=model.reference - [0, 0, 0.1e-3])
    place = worst_place(pressed, c, pressed.evaluate(c, NO_TENSION, tangent=True))
    assert place.count(f"in contact with the body {model.bodies[0]}") == 1  # of many points
    assert any(place.startswith(f"{model.node_name(n)} ") for n in model.quads[:, 8])


def test_shares_of_points_are_checked():
    model = flat(1, 1)
    floor = contact(model, HalfSpace(np.zeros(3), np.array([0, 0, 1.0])), np.arange(9), 1e9, 1e-6)
    with pytest.raises(InputError, match="between 0 and 1"):
        Contact(
            0, floor.surface, floor.nodes, floor.offset, floor.area, 1e9, 1e-6, share=-floor.area
        )
