"""A layer of tissue: its law, its fields, and a strip over a cylinder that is covered with one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq

from cosim.port import Array
from fe_solver.elements.mesh_geometry import node_areas
from fe_solver.forces.contact import Contact, compression, contact_forces, contact_state
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.layer import TOE, USED_UP, Layer, layer_response, pressure_law
from fe_solver.solver import newton_step
from fe_solver.solver.augmented_contact import solve_augmented
from fe_solver.solver.newton import solve
from fe_solver.solver.newton_step import DEEPER, limit_depth
from fe_solver.surfaces.shapes import Distance, Surface
from tests.fe_solver.forces.test_contact import by_node, touching
from tests.helpers.poses import POSITION, ROTATION
from tests.proofs.fe.contact_rows import (
    ANGLE,
    NEWTON,
    RADIUS,
    WIDTH,
    far_tension,
    strip,
)
from tests.proofs.fe.sheets import at_rest, in_basis

SHARES = st.floats(-0.5, 1.5)
THICKNESS, MODULUS = 0.5e-3, 2e6


@dataclass(frozen=True)
class Field(Surface):
    """A quadratic of the place."""

    outside: ClassVar[float] = np.inf
    value: float
    slope: Array
    bend: Array

    def distance(self, points: Array) -> Distance:
        gradient = self.slope + points @ self.bend
        value = self.value + points @ self.slope
        value = value + np.einsum("ni,ij,nj->n", points, self.bend, points) / 2
        return Distance(value, gradient, np.broadcast_to(self.bend, (len(points), 3, 3)))

    @classmethod
    def even(cls, value: float) -> Field:
        return cls(value, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def uneven(cls, value: float, seed: int) -> Field:
        rng = np.random.default_rng(seed)
        bend = rng.normal(size=(3, 3))
        return cls(value, 20 * value * rng.normal(size=3), 2e3 * value * (bend + bend.T))


@given(SHARES)
def test_the_pressure_is_the_works_slope_and_has_a_slope_of_its_own(share):
    h = 1e-6
    low, high = (pressure_law(np.array([share + s * h])) for s in (-1, 1))
    _, pressure, slope = pressure_law(np.array([share]))
    assert (high[0] - low[0]) / (2 * h) == pytest.approx(pressure, rel=1e-6, abs=1e-6)
    if abs(share - USED_UP) > h:
        assert (high[1] - low[1]) / (2 * h) == pytest.approx(slope, rel=1e-5, abs=1e-5)
    assert pressure[0] >= 0
    assert slope[0] >= 0
    if share <= 0:
        assert pressure[0] == slope[0] == 0


def test_a_layer_sets_in_smoothly_is_as_stiff_as_its_modulus_and_stiffens():
    share = np.array([TOE / 100, 0.3, 0.9 * USED_UP])
    secant = pressure_law(share)[1] / share
    assert secant[0] < 0.02
    assert secant[1] == pytest.approx(1.0, abs=0.1)
    assert secant[2] > 2


@given(st.floats(-0.2, 1.2), st.floats(2e-4, 2e-3), st.floats(1e5, 1e7))
def test_all_derivatives_of_a_layers_energy(share, thickness, modulus):
    """By depth, thickness and modulus, each in units of its own."""
    assume(abs(share - USED_UP) > 1e-3)
    at, unit = np.array([share * thickness, thickness, modulus]), [thickness, thickness, modulus]
    here, energy = layer_response(*at[:, None]), modulus * thickness
    for i, scale in enumerate(unit):
        step = 1e-5 * scale * np.eye(3)[i]
        low, high = (layer_response(*(at + s * step)[:, None]) for s in (-1, 1))
        slope = (high.energy - low.energy)[0] / 2e-5
        assert here.slopes[0, i] * scale == pytest.approx(slope, abs=1e-5 * energy)
        second = (high.slopes - low.slopes)[0] / 2e-5 * unit
        assert here.second[0, i] * scale * unit == pytest.approx(second, abs=2e-3 * energy)


@pytest.mark.parametrize("seed", range(3))
def test_forces_on_an_uneven_layer_are_their_energys(seed):
    """Gradient and Hessian by the nodes where thickness and modulus vary from place to place, and
    the moment that a body feels."""
    rng = np.random.default_rng(seed)
    contact, x = touching(rng)
    fields = Field.uneven(THICKNESS, 5 + seed), Field.uneven(MODULUS, 9 + seed)
    layer = Layer(*fields, (THICKNESS, MODULUS))
    contact = replace(contact, layer=layer)
    act = lambda p: contact_forces(contact, p, POSITION, ROTATION, True)  # noqa: E731
    here, n, h = act(x), len(x), 1e-8
    assert (np.linalg.norm(here.gradient, axis=1) > 0).sum() > 4
    for v in rng.normal(size=(3, n, 3)):
        low, high = act(x - h * v), act(x + h * v)
        slope = (high.energy - low.energy) / (2 * h)
        assert np.vdot(by_node(here, n), v) == pytest.approx(slope, rel=1e-5)
        change = (by_node(high, n) - by_node(low, n)) / (2 * h)
        product = np.zeros((n, 3))
        np.add.at(product, here.node, np.einsum("kij,kj->ki", here.hessian, v[here.node]))
        assert product == pytest.approx(change, abs=1e-4 * np.abs(change).max())


def covered_strip(elements: int, within: bool, friction: float = 0.0):
    """The strip over a drum, on whose surface it is laid, the outer THICKNESS of which gives."""
    model = strip(elements, 1e11, friction)
    contact, X = model.contacts[0], model.reference
    layer = Layer(Field.even(THICKNESS), Field.even(MODULUS), (THICKNESS, MODULUS))
    if not within:
        return replace(model, contacts=(replace(contact, layer=layer),))
    on = np.flatnonzero(np.isin(model.quads, contact.nodes).any(axis=1))
    points = ElementPoints.of(model.quads, on)
    area = points.areas(X)
    assert area.sum() == pytest.approx(node_areas(X, model.quads).sum(), rel=1e-6)
    felt = Contact(
        contact.body, contact.surface, points.nearest, np.zeros(len(area)), area,
        *(contact.stiffness, contact.smoothing), friction=friction, within=points, layer=layer,
    )  # fmt: skip
    return replace(model, contacts=(felt,))


@pytest.mark.parametrize("within", [False, True], ids=["nodes", "within"])
def test_a_strip_over_a_covered_cylinder(within):
    """It sinks until the layer bears T / (w r) on what is left of the radius r."""
    model = covered_strip(48, within)
    s = solve(model, at_rest(model), np.ones(1), NEWTON)
    c, contact = s.configuration, model.contacts[0]

    def unbalance(sink: float) -> float:
        pressure = MODULUS * pressure_law(np.array([sink / THICKNESS]))[1][0]
        return float(pressure - 1 / (WIDTH * (RADIUS - sink)))

    sink = brentq(unbalance, 0.0, 0.9 * THICKNESS)
    place = contact.at(c.x)
    middle = np.abs(np.arctan2(place[:, 0], place[:, 2])) < ANGLE / 4
    state = contact_state(contact, c.x, c.position, c.rotation)
    mean = lambda v: np.average(v[middle], weights=contact.area[middle])  # noqa: E731
    assert mean(-state.gap) == pytest.approx(sink, rel=0.02)
    assert mean(state.pressure) == pytest.approx(1 / (WIDTH * (RADIUS - sink)), rel=0.01)
    assert far_tension(s) == pytest.approx(1.0, rel=1e-3)
    share = compression(contact, c.x, c.position, c.rotation)
    assert share[middle] == pytest.approx(-state.gap[middle] / THICKNESS, abs=1e-12)


def lifted_strip(gap: float):
    """The strip of points within elements, laid `gap` (m) above the layer."""
    model = covered_strip(48, True)
    (felt,) = model.contacts
    return replace(model, contacts=(replace(felt, offset=felt.offset - gap),))


@pytest.mark.parametrize("gap", [0.3e-3, -0.1e-3], ids=["above", "pressed"])
def test_a_step_goes_a_share_of_the_thickness_into_a_layer_at_most(gap):
    model = lifted_strip(gap)
    c, contact = at_rest(model), model.contacts[0]
    e = model.evaluate(c, np.ones(1), False)
    down = np.outer(np.abs(c.x[:, 0]) < RADIUS / 10, [0, 0, -2e-3])  # at the top
    step = in_basis(model, down, 0 * c.d).ravel()
    short = limit_depth(model, e, step)
    before, after = (
        compression(contact, x, c.position, c.rotation).max()
        for x in (c.x, model.take_step(c, e.bases, short).x)
    )
    assert after == pytest.approx(before + DEEPER, rel=0.01)
    assert np.array_equal(limit_depth(model, e, short / 2), short / 2)
    penalty = replace(model, contacts=(replace(contact, layer=None),))
    assert np.array_equal(limit_depth(penalty, e, step), step)


def test_a_strip_comes_to_rest_on_a_layer_below_it_in_fewer_steps_so(monkeypatch):
    model = lifted_strip(1e-3)
    found = solve(model, at_rest(model), np.ones(1), NEWTON)
    monkeypatch.setattr(newton_step, "DEEPER", np.inf)
    whole = solve(model, at_rest(model), np.ones(1), NEWTON)
    assert found.configuration.x == pytest.approx(whole.configuration.x, abs=1e-9)
    assert found.solves < 0.7 * whole.solves


def test_friction_goes_by_the_layers_pressure():
    """Coulomb's law over a drum that gives: exp(mu theta), and no multiplier is sought."""
    model = covered_strip(64, False, friction=0.3)
    c = at_rest(model)
    down = np.array([np.cos(ANGLE / 2), 0.0, -np.sin(ANGLE / 2)])
    pulled = model.move_bodies(c, np.stack([np.zeros(3), 0.8e-3 * down]), c.rotation)
    solution = solve_augmented(model, pulled, np.ones(1), NEWTON)
    assert far_tension(solution) == pytest.approx(np.exp(0.3 * ANGLE), rel=0.03)
    assert solution.model.contacts[0].pressure is None


def test_a_layer_that_is_used_up_goes_on_straight():
    """Of a trial step that runs through the bone nothing is infinite."""
    work, pressure, slope = pressure_law(np.array([USED_UP, 5.0]))
    assert np.isfinite([work, pressure, slope]).all()
    assert slope[0] == slope[1]


@pytest.mark.parametrize(
    "layer", [None, Layer(Field.even(THICKNESS), Field.uneven(MODULUS, 3), (1e-3, 1e6))]
)
def test_a_softened_contact_presses_with_that_share_of_its_force(layer: Layer | None):
    contact, x = touching(np.random.default_rng(0))
    contact = replace(contact, layer=layer)
    whole, soft = (
        contact_forces(k, x, POSITION, ROTATION, True) for k in (contact, contact.softened(0.01))
    )
    assert whole.force.max() > 0
    assert soft.energy == pytest.approx(0.01 * whole.energy)
    for name in ("force", "gradient", "stiffness"):
        assert getattr(soft, name) == pytest.approx(0.01 * getattr(whole, name), rel=1e-12)
    hessians = [f.bend(f.force) for f in (whole, soft)]
    assert hessians[1] == pytest.approx(0.01 * hessians[0], rel=1e-12)
    pressures = [
        contact_state(k, x, POSITION, ROTATION).pressure for k in (contact, contact.softened(0.01))
    ]
    assert pressures[1] == pytest.approx(0.01 * pressures[0])
