"""Springs and contact: their forces are their energy's, and what they carry is what presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shells
from hypothesis import given
from hypothesis import strategies as st
from shells import NO_TENSION, at_rest, clamped, guided, plate, sheet

from cosim.port import rotation_matrix
from fe_solver.contact import REACH, Contact, contact_forces, joined, ramp
from fe_solver.fields import contact_pressure, fields
from fe_solver.newton import NewtonOptions, solve
from fe_solver.shell import Array
from fe_solver.springs import PointForces, Springs, spring_forces
from fe_solver.shapes import Capsule, HalfSpace, Sphere

TIGHT = NewtonOptions(tolerance=1e-11)
POSITION = np.array([[1e-3, -2e-3, 0.5e-3], [-3e-3, 0.0, 1e-3]])
ROTATION = rotation_matrix(np.array([[0.3, -0.2, 0.5], [-0.6, 0.1, 0.2]]))
DEPTHS = st.floats(-3e-4, 3e-4)
SMOOTHINGS = st.floats(1e-5, 2e-4)


@given(DEPTHS, SMOOTHINGS)
def test_ramps_integral_value_and_slope(depth, smoothing):
    h = 1e-3 * smoothing
    depth = np.array([depth])
    low, high = ramp(depth - h, smoothing), ramp(depth + h, smoothing)
    _, value, slope = ramp(depth, smoothing)
    assert (high[0] - low[0]) / (2 * h) == pytest.approx(value, rel=1e-5, abs=1e-6 * smoothing)
    assert (high[1] - low[1]) / (2 * h) == pytest.approx(slope, abs=1e-3)


@given(DEPTHS, SMOOTHINGS)
def test_ramp_is_that_of_a_gap_beyond_the_smoothing(depth, smoothing):
    integral, value, slope = ramp(np.array([depth]), smoothing)
    assert 0 <= value[0] - max(depth, 0.0) <= smoothing / 4 + 1e-18
    assert integral[0] >= 0
    if abs(depth) > smoothing:
        assert value[0] == max(depth, 0.0)
        assert slope[0] == (depth > 0)


def random_springs(rng: np.random.Generator) -> tuple[Springs, Array]:
    """Nine springs of all kinds between six nodes and two bodies, and the nodes' places (m)."""
    x = 4e-3 * rng.normal(size=(6, 3))
    springs = Springs(
        rng.integers(0, 6, 9),
        rng.integers(0, 2, 9),
        4e-3 * rng.normal(size=(9, 3)),
        rng.uniform(100, 300, 9),
        rng.uniform(1e-3, 12e-3, 9),
        np.arange(9) % 2 == 0,
        np.zeros(9, dtype=np.intp),
    )
    return springs, x


def touching(rng: np.random.Generator) -> tuple[Contact, Array]:
    """Nodes around a sphere's contact level, in it, in its smoothing and out of it."""
    direction = rng.normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    away = 5e-3 + 0.5e-3 + np.linspace(-3e-4, 2e-4, 12)
    centre = np.array([1e-3, 0.0, 2e-3])
    x = POSITION[1] + (centre + away[:, None] * direction) @ ROTATION[1].T
    area = rng.uniform(0.5e-6, 2e-6, 12)
    sphere = Sphere(centre, 5e-3)
    return Contact(1, sphere, np.arange(12), np.full(12, 0.5e-3), area, 1e10, 1e-4), x


def by_node(forces: PointForces, n: int) -> Array:
    out = np.zeros((n, 3))
    np.add.at(out, forces.node, forces.gradient)
    return out


@pytest.mark.parametrize("kind", ["springs", "contact"])
@pytest.mark.parametrize("seed", range(3))
def test_forces_are_their_energys(kind, seed):
    """Gradient and Hessian by the nodes, and force and moment on the bodies, by differences."""
    rng = np.random.default_rng(seed)
    thing, x = random_springs(rng) if kind == "springs" else touching(rng)
    act = spring_forces if kind == "springs" else contact_forces
    here = act(thing, x, POSITION, ROTATION, True)
    n, h = len(x), 1e-7
    assert (np.linalg.norm(here.gradient, axis=1) > 0).sum() > 4
    for v in rng.normal(size=(3, n, 3)):
        low, high = (act(thing, x + s * h * v, POSITION, ROTATION, True) for s in (-1, 1))
        slope = (high.energy - low.energy) / (2 * h)
        assert np.vdot(by_node(here, n), v) == pytest.approx(slope, rel=1e-6)
        change = (by_node(high, n) - by_node(low, n)) / (2 * h)
        product = np.zeros((n, 3))
        np.add.at(product, here.node, np.einsum("kij,kj->ki", here.hessian, v[here.node]))
        assert product == pytest.approx(change, abs=1e-5 * np.abs(change).max())
    for twist in rng.normal(size=(3, 2, 6)):
        twist[:, :3] *= 1e-2
        energy = [
            act(
                thing,
                x,
                POSITION + s * h * twist[:, :3],
                rotation_matrix(s * h * twist[:, 3:]) @ ROTATION,
                True,
            ).energy
            for s in (-100, 100)
        ]
        wrench = np.zeros((2, 6))
        moments = np.cross(here.arm, here.gradient)
        np.add.at(wrench, here.body, np.hstack([here.gradient, moments]))
        slope = (energy[1] - energy[0]) / (200 * h)
        assert -np.vdot(wrench, twist) == pytest.approx(slope, rel=1e-5)


def test_a_slack_spring_pulls_not_and_a_two_sided_one_pushes():
    one = Springs(*(np.array([v]) for v in (0, 0, [0.0, 0, 0], 100.0, 2e-3, True, 0)))
    both = replace(one, tension_only=np.array([False]))
    at = np.array([[1e-3, 0.0, 0.0]])
    slack, pushed = (spring_forces(s, at, *shells.GROUND, True) for s in (one, both))
    assert slack.energy == 0
    assert (slack.gradient == 0).all()
    assert (slack.hessian == 0).all()
    assert pushed.gradient[0] == pytest.approx([-0.1, 0, 0])
    assert pushed.energy == pytest.approx(0.5e-4)
    for spring in (one, both):
        convex = spring_forces(spring, at, *shells.GROUND, False)
        assert np.linalg.eigvalsh(convex.hessian[0]).min() >= 0


def test_a_spring_of_no_length_holds_a_node_in_every_direction():
    spring = Springs(*(np.array([v]) for v in (0, 0, [0.0, 0, 0], 100.0, 0.0, False, 0)))
    here = spring_forces(spring, np.zeros((1, 3)), *shells.GROUND, True)
    assert here.hessian[0] == pytest.approx(100 * np.eye(3))
    assert (here.gradient == 0).all()


def test_nodes_out_of_reach_are_left_out():
    contact, x = touching(np.random.default_rng(0))
    far = x + 2 * REACH * (x - x.mean(axis=0)) / np.linalg.norm(x - x.mean(axis=0), axis=1)[:, None]
    assert len(contact_forces(contact, x + 1.0, POSITION, ROTATION, True).node) == 0
    both = [contact_forces(contact, p, POSITION, ROTATION, True) for p in (x, far)]
    assert len(both[1].node) < len(both[0].node) == 12
    assert joined(both).energy == pytest.approx(both[0].energy + both[1].energy)


@pytest.mark.parametrize("surface", ["half-space", "sphere"])
def test_a_pressed_sheet_hands_on_the_load(surface):
    """A sheet pressed down by its guided corners: the bone feels the tendon's force, and no node
    sinks in deeper than the smoothing."""
    X, quads = plate(12e-3, 12e-3, 12, 12)
    X = X - [6e-3, 6e-3, 0]
    model = sheet(X, quads, 1e8, 0.3, 0.6e-3)
    corners = np.flatnonzero((np.abs(X[:, :2]) > 5.9e-3).all(axis=1))
    model = guided(model, [corners], [(0.0, 0, -1)])
    bone = {
        "half-space": HalfSpace(np.zeros(3), np.array([0.0, 0, 1])),
        "sphere": Sphere(np.array([0.0, 0, -12e-3]), 12e-3),
    }[surface]
    free = np.setdiff1d(np.arange(len(X)), corners)
    smoothing = 5e-5
    touching = shells.contact(model, bone, free, 2e11, smoothing)
    model = replace(model, contacts=(touching,))
    force = np.array([4.0])
    solution = solve(model, at_rest(model), force, TIGHT)
    c = solution.configuration
    wrench = model.wrenches(c, solution.evaluation, force)["contact"][0]
    assert wrench == pytest.approx([0, 0, -4.0, 0, 0, 0], abs=1e-8)
    gap = touching.gap(c.x, *shells.GROUND)
    assert abs(gap.min()) < smoothing
    pressure = np.zeros(len(X))
    pressure[free] = contact_pressure(model, c)[free]
    normal = -bone.distance(c.x)[1] * (pressure[:, None] * node_area(touching, len(X)))
    assert normal.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-8)


def node_area(contact: Contact, n: int) -> Array:
    out = np.zeros((n, 1))
    out[contact.nodes, 0] = contact.area
    return out


def belt(angle: float, radius: float) -> tuple[Array, np.ndarray]:
    """A strip laid over a cylinder about y: an arc of `angle` (rad) and straight tangents."""
    width, tail = 4e-3, 6e-3

    def laid(uv: Array) -> Array:
        s = (uv[:, 0] - 0.5) * (radius * angle + 2 * tail)
        turn = np.clip(s / radius, -angle / 2, angle / 2)
        rest = s - radius * turn
        x = radius * np.sin(turn) + rest * np.cos(turn)
        z = radius * np.cos(turn) - rest * np.sin(turn)
        return np.column_stack([x, width * (uv[:, 1] - 0.5), z])

    return shells.mapped(48, 2, laid)


@pytest.mark.parametrize("degrees", [60, 120])
def test_a_belt_over_a_cylinder(degrees):
    """Without friction both ends carry the same tension and the cylinder 2 T sin(angle / 2)."""
    angle, radius = np.deg2rad(degrees), 8e-3
    X, quads = belt(angle, radius + 1e-5)
    model = sheet(X, quads, 1e8, 0.0, 0.1e-3)
    held, pulled = (np.flatnonzero(np.isclose(X[:, 0], x)) for x in (X[0, 0], X[-1, 0]))
    down = np.array([np.cos(angle / 2), 0.0, -np.sin(angle / 2)])
    model = guided(clamped(model, held), [pulled], [down])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([held, pulled]))
    cylinder = Capsule(np.array([0, -0.1, 0]), np.array([0, 0.1, 0]), radius)
    model = replace(model, contacts=(shells.contact(model, cylinder, inner, 1e12, 1e-5),))
    tension = np.array([2.0])
    solution = solve(model, at_rest(model), tension, TIGHT)
    c = solution.configuration
    wrench = model.wrenches(c, solution.evaluation, tension)
    normal = 4.0 * np.sin(angle / 2)
    assert wrench["contact"][0] == pytest.approx([0, 0, -normal, 0, 0, 0], abs=0.02 * normal)
    assert wrench["tie"][0, :3] == pytest.approx(2 * down * [1, 0, -1], abs=0.04)
    moving = fields(model, c)
    stretch = np.sqrt(1 + 2 * moving.strain[:, 0])
    tensions = (moving.stress[:, 0] * stretch * 0.1e-3).reshape(48, 2).sum(axis=1) * 2e-3
    assert tensions == pytest.approx(np.full(48, 2.0), rel=0.02)


def test_without_contact_force_there_is_no_load():
    X, quads = plate(10e-3, 10e-3, 4, 4)
    model = clamped(sheet(X, quads, 1e8, 0.3, 0.6e-3), np.arange(5))
    floor = HalfSpace(np.array([0.0, 0, -1e-3]), np.array([0.0, 0, 1]))
    model = replace(model, contacts=(shells.contact(model, floor, np.arange(5, 25), 1e11, 5e-5),))
    solution = solve(model, at_rest(model), NO_TENSION, TIGHT)
    wrench = model.wrenches(at_rest(model), solution.evaluation, NO_TENSION)
    assert solution.iterations == 0
    assert (wrench["contact"] == 0).all()
    assert np.abs(wrench["tie"]).max() < 1e-12
