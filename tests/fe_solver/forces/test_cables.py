"""Cables: their law, closed forms of strings, what a net may not be, and its last resort."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.port import Motion, rotation_matrix
from fe_solver.forces.cables import Cables, cable_forces, cable_masses, cable_state, law
from fe_solver.hood.build import ContactLaw, HoodSupports, Net, TendonEnd, cable_hood
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.solver.relaxation import relax
from fe_solver.supports import Tied
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp
from tests.proofs.hoods import cable_rows

EA = cable_rows.MODULUS * cable_rows.SECTION
T0, TOE = cable_rows.RESIDUAL, cable_rows.TOE
PAIR = np.array([[0, 1]])


def one(length: float = 1e-3) -> Cables:
    return cable_rows.cables(PAIR, np.array([length]))


def at_strain(strain: float) -> tuple[float, float, float]:
    """Energy, force and slope of a cell of 1 mm."""
    pull = law(one(), np.array([1e-3 * (1 + strain)]))
    return float(pull.energy[0]), float(pull.force[0]), float(pull.slope[0])


def test_a_slack_cable_pulls_with_the_residual_tension_alone() -> None:
    for strain in (-0.9, -0.3, -0.01):
        assert at_strain(strain)[1] == pytest.approx(T0 * (1 + strain))
        assert at_strain(strain)[2] == pytest.approx(T0 / 1e-3)


def test_beyond_the_toe_the_law_is_straight() -> None:
    assert at_strain(0.05)[1] == pytest.approx(EA * (0.05 - TOE / 2) + 1.05 * T0)
    assert at_strain(0.05)[2] == pytest.approx((EA + T0) / 1e-3)


@pytest.mark.parametrize("strain", [0.0, TOE])
def test_force_and_slope_go_on_over_the_ends_of_the_toe(strain: float) -> None:
    before, after = at_strain(strain - 1e-9), at_strain(strain + 1e-9)
    assert before[1] == pytest.approx(after[1], rel=1e-5)
    assert before[2] == pytest.approx(after[2], rel=1e-3)


@pytest.mark.parametrize("strain", [-0.5, 0.7 * TOE, 3 * TOE])
def test_the_force_is_the_slope_of_the_energy(strain: float) -> None:
    h = 1e-6
    rise = (at_strain(strain + h)[0] - at_strain(strain - h)[0]) / (2 * h * 1e-3)
    assert rise == pytest.approx(at_strain(strain)[1], rel=1e-7)


def test_a_cell_of_no_length_resists_in_every_direction() -> None:
    pair = cable_forces(one(), np.zeros((2, 3)))
    assert pair.gradient == pytest.approx(np.zeros((1, 2, 3)))
    assert pair.hessian[0, :3, :3] == pytest.approx(T0 / 1e-3 * np.eye(3))


def test_a_slack_net_is_no_mechanism() -> None:
    """A chain of slack cells folded at random: its stiffness is positive with its ends held."""
    model = clamp(
        cable_rows.net(np.linspace([0, 0, 0], [0.02, 0, 0], 9), cable_rows.chain(8)), [0, 8]
    )
    c = at_rest(model)
    c.x[1:-1] += 1e-3 * np.random.default_rng(0).normal(size=(7, 3))
    longer = replace(model, cables=replace(model.cables, length=3 * model.cables.length))
    e = longer.evaluate(c, NO_TENSION, tangent=True)
    K = longer.pattern.full(e.data).toarray()[np.ix_(longer.free, longer.free)]
    assert len(longer.free) == 21  # positions alone: no directors
    assert np.linalg.eigvalsh(K).min() > 0.1 * T0 / (3 * model.cables.length.max())


def test_forces_and_moments_balance() -> None:
    s = cable_rows.bend_net()
    total = np.sum(
        list(wrenches(s.model, s.configuration, s.evaluation, s.tension).values()), axis=0
    )
    pulls = s.model.pulls(s.configuration, s.tension)
    at = s.configuration.x[s.model.guides.node]
    position = s.configuration.position
    moment = total[:, 3:] + np.cross(position, total[:, :3])
    scale = float(cable_rows.hood_rows.TENSION[0])
    assert np.abs(total[:, :3].sum(0) - pulls.sum(0)).max() < 1e-9 * scale
    assert np.abs(moment.sum(0) - np.cross(at, pulls).sum(0)).max() < 1e-9 * scale * 0.02


def test_a_turned_string_hangs_as_the_string_does() -> None:
    s = cable_rows.solve_string(0.1)
    R = rotation_matrix(np.array([0.4, 0.9, -0.3]))
    m = s.model
    ties = replace(m.ties, position=m.ties.position @ R.T)
    turned = replace(m, reference=m.reference @ R.T, dead=m.dead @ R.T, ties=ties)
    start = at_rest(turned)
    x = s.configuration.x @ R.T + 1e-4 * np.sin(np.arange(start.x.size)).reshape(-1, 3)
    x[[0, -1]] = start.x[[0, -1]]
    again = solve(turned, replace(start, x=x), NO_TENSION, cable_rows.NEWTON)
    assert again.configuration.x == pytest.approx(s.configuration.x @ R.T, abs=1e-12)


def test_tension_grows_along_a_string_that_its_own_weight_loads() -> None:
    """Of a catenary the tension differs by weight times height."""
    s = cable_rows.solve_string(0.2)
    force = cable_state(s.model.cables, s.configuration.x).force
    z = s.configuration.x[:, 2]
    middle = (z[1:] + z[:-1]) / 2
    weight = cable_rows.WEIGHT / (s.model.cables.length.sum())
    rise = weight * (middle[0] - middle.min())
    assert force[0] - force.min() == pytest.approx(rise, rel=0.03)


def test_a_damped_motion_finds_the_string_too() -> None:
    model = cable_rows.string(0.1)
    c = relax(model, at_rest(model))
    found = solve(model, c, NO_TENSION, cable_rows.NEWTON)
    assert -found.configuration.x[:, 2].min() == pytest.approx(-cable_rows.funicular(0.1)[1].min())


def test_masses_are_those_of_the_cells() -> None:
    mass = cable_masses(
        cable_rows.cables(cable_rows.chain(3), np.array([1.0, 2.0, 4.0])), 1000.0, 5
    )
    assert mass == pytest.approx(1000.0 * cable_rows.SECTION * np.array([0.5, 1.5, 3.0, 2.0, 0.0]))


@pytest.mark.parametrize("name", ["length", "modulus", "section", "toe", "residual"])
def test_what_is_not_positive_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=rf"{name} of cell 0 must be positive, got 0"):
        replace(one(), **{name: np.zeros(1)})
    with pytest.raises(InputError, match=rf"expected 1 values of {name}"):
        replace(one(), **{name: np.ones(2)})


def hood_of(points: np.ndarray, cells: np.ndarray, *ties: Tied) -> None:
    rest = Motion(("bone",), np.zeros((1, 3)), np.eye(3)[None])
    length = np.linalg.norm(points[cells[:, 1]] - points[cells[:, 0]], axis=1)
    supports = HoodSupports(
        rest,
        np.ones((len(points), 1)),
        (),
        ties,
        "bone",
        np.array([-1.0, 0, 0]),
        {"T": TendonEnd(np.array([0]), np.ones(1))},
        ContactLaw(1e10, 1e-5, {}, {}),
        NewtonOptions(),
    )
    cable_hood(Net(points, cable_rows.cables(cells, length)), supports)


def test_a_net_that_nothing_holds_or_reaches_is_refused() -> None:
    points = np.linspace([0, 0, 0], [0.03, 0, 0], 4)
    with pytest.raises(InputError, match="no insertion holds the hood"):
        hood_of(points, cable_rows.chain(3))
    with pytest.raises(InputError, match="node 3 is of no cable"):
        hood_of(points, cable_rows.chain(2), Tied(np.array([2]), 0))
