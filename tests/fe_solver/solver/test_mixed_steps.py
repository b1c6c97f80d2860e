"""Whole steps with predicted forces: where they lead, and what they predict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from cosim.errors import ConvergenceError
from cosim.port import Array
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.solver import mixed_steps
from fe_solver.solver.mixed_steps import (
    END_RESIDUAL,
    _predict,
    _reverses,
    _travel,
    take_mixed_steps,
)
from fe_solver.solver.model import Configuration, Forces, ShellModel
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.solver.residual import is_folded, residual_norm
from fe_solver.supports import springs_of
from tests.helpers.straps import TENSION, TIGHT, perturb, springs, strap
from tests.proofs.fe.sheets import (
    NO_TENSION,
    at_rest,
    clamp,
    guide,
    plate,
    sheet,
    with_nine_nodes,
)

LONGEST = 3e-3, 0.6
"""m and rad, the longest step."""
REACH = 10e-3
"""m, length of the springs of the swing."""


@pytest.fixture(scope="module")
def model() -> ShellModel:
    return strap()


def swing(stiffness: float, angle: float) -> ShellModel:
    """A sheet without weight of its own on four springs, as long as they hang, pulled by
    1 N along a direction that leans by `angle` from the vertical."""
    X, quads = plate(20e-3, 10e-3, 4, 2)
    corners = np.flatnonzero(np.isin(X[:, 0], [0, 20e-3]) & np.isin(X[:, 1], [0, 10e-3]))
    strings = springs(corners, 0, X[corners] + [0, 0, REACH], stiffness, REACH, only=False)
    held = springs_of([strings])
    dead = np.zeros_like(X)
    dead[:] = np.array([np.sin(angle), 0, -np.cos(angle)]) / len(X)
    return replace(sheet(X, quads, 1e9, 0.3, 1e-3), springs=held, dead=dead)


def test_a_swing_on_stiff_springs_turns_in_few_steps(monkeypatch):
    """It moves along the springs' circle.  A search for less energy follows that circle in short
    steps, the shorter the stiffer the springs are."""
    angle = 1.0
    upright, model = swing(1e8, 0.0), swing(1e8, angle)
    options = NewtonOptions(tolerance=1e-8)
    start = solve(upright, at_rest(upright), NO_TENSION, options).configuration
    found = solve(model, start, NO_TENSION, options)
    moved = (found.configuration.x - model.reference)[model.springs.node].mean(axis=0)
    circle = REACH * np.array([np.sin(angle), 0, 1 - np.cos(angle)])
    assert moved == pytest.approx(circle, abs=1e-4 * REACH)
    assert found.iterations < 25
    monkeypatch.setattr(mixed_steps, "MOST_STEPS", 0)
    with pytest.raises(ConvergenceError):
        solve(model, start, NO_TENSION, NewtonOptions(1e-8, 3 * found.iterations))


def squeezed(stiffness: float, shift: float) -> tuple[ShellModel, int]:
    """A nine-node element of 2 x 1 mm, clamped but for the node in its middle, which a spring with
    its rest `shift` (m) further along x moves on a guide; and that node."""
    X, quads = with_nine_nodes(*plate(2e-3, 1e-3, 1, 1))
    middle = int(quads[0, 8])
    element = sheet(X, quads, 1e6, 0.3, 1e-3, law=NeoHookean(1e6, 0.3))
    element = clamp(element, np.delete(np.arange(len(X)), middle))
    model = guide(element, [np.array([middle])], [(1.0, 0.0, 0.0)])
    anchor = X[[middle]] + [REACH + shift, 0, 0]
    held = springs_of([springs(np.array([middle]), 0, anchor, stiffness, REACH, only=False)])
    return replace(model, springs=held), middle


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("shift", [0.5e-3, 0.7e-3, 0.9e-3])
def test_a_sheet_that_a_stiff_spring_squeezes_is_not_turned_inside_out(stiffness, shift):
    """To first order the spring goes where the sheet's points have no strain that the law admits:
    they would push no more, and what is left be in balance without them."""
    model, middle = squeezed(stiffness, shift)
    start = at_rest(model)
    found = solve(model, start, np.zeros(1), NewtonOptions())

    def energy(x: float) -> float:
        c = replace(start, x=start.x.copy())
        c.x[middle, 0] = x
        return model.evaluate(c, np.zeros(1), False).energy

    assert np.isfinite(found.evaluation.energy)
    least = minimize_scalar(energy, bounds=(1e-3, 1.376e-3), options={"xatol": 1e-10})
    assert found.configuration.x[middle, 0] == pytest.approx(least.x, abs=2e-8)


def test_a_start_with_a_crushed_element_is_refused_and_named():
    """Without its crushed points the sheet is nearly in balance there, to a thousandth."""
    model, middle = squeezed(1e5, 0.5e-3)
    start = at_rest(model)
    start.x[middle, 0] = 1.48633e-3
    assert residual_norm(model, model.evaluate(start, np.zeros(1), False))[0] < 1e-3
    with pytest.raises(ConvergenceError, match=r"crushed at node 0 in the region sheet\. Try"):
        solve(model, start, np.zeros(1), NewtonOptions())


def test_the_equilibrium_is_that_of_the_search(model, monkeypatch):
    found = solve(model, at_rest(model), TENSION, TIGHT)
    monkeypatch.setattr(mixed_steps, "MOST_STEPS", 0)
    searched = solve(model, at_rest(model), TENSION, TIGHT)
    assert found.configuration.x == pytest.approx(searched.configuration.x, abs=1e-10)
    assert found.configuration.d == pytest.approx(searched.configuration.d, abs=1e-7)


def test_the_steps_end_close_to_equilibrium(model):
    found = take_mixed_steps(model, at_rest(model), TENSION, 40, 0.0, *LONGEST)
    residual, force = residual_norm(model, model.evaluate(found.configuration, TENSION, False))
    assert residual <= END_RESIDUAL * force
    assert 0 < found.iterations <= found.solves
    assert not is_folded(model, found.configuration)


def test_no_more_steps_are_taken_than_allowed(model):
    """Where they do not arrive, nothing is worse than at the start."""
    start = at_rest(model)
    found = take_mixed_steps(model, start, TENSION, 2, 0.0, *LONGEST)
    assert found.iterations == 2

    def potential(c: Configuration) -> float:
        return model.potential(c, model.evaluate(c, TENSION, False).energy, TENSION)

    assert potential(found.configuration) <= potential(start)


def test_forces_are_predicted_to_first_order(model):
    """The error falls with the square of the step; one-sided springs and contacts act throughout
    or not at all."""
    c = solve(model, at_rest(model), TENSION, TIGHT).configuration
    e = model.evaluate(c, TENSION, tangent=False)
    step = np.zeros(model.pattern.size)
    step[model.free] = 1e-6 * np.random.default_rng(1).standard_normal(len(model.free))
    acts = mixed_steps._acts(e.points.depth) & (e.points.depth > 1e-4)
    errors = []
    for part in (1.0, 0.5):
        there = model.evaluate(model.take_step(c, e.bases, part * step), TENSION, False)
        foreseen = _predict(model, c, e, part * step, _travel(e, part * step))
        errors.append(
            [
                np.abs(foreseen.elements - there.elements.force).max(),
                np.abs(foreseen.points - there.points.force)[acts].max(),
            ]
        )
    assert np.array(errors[1]) == pytest.approx(np.array(errors[0]) / 4, rel=0.1)


def test_its_own_forces_make_the_consistent_tangent(model):
    c = perturb(model, at_rest(model), 1e-5)
    e = model.evaluate(c, TENSION, tangent=True)
    own = Forces(e.elements.force, e.points.force)
    assert e.data is not None
    assert np.array_equal(model.tangent(c, e, own), e.data)

    def doubled(part: float) -> Array:
        return model.tangent(c, e, Forces(part * own.elements, part * own.points))

    assert doubled(2.0) - e.data == pytest.approx(e.data - doubled(0.0), rel=1e-6, abs=1e-3)


def test_a_step_back_is_seen(model):
    """A spring that a step has made taut and the next would slacken, and one that stays."""
    c = solve(model, at_rest(model), TENSION, TIGHT).configuration
    e = model.evaluate(c, TENSION, tangent=False)
    step = np.zeros(model.pattern.size)
    before = _predict(model, c, e, step, _travel(e, step))
    keys = before.acting
    assert len(keys) > 1
    assert not _reverses(model, e, step, before)
    p = e.points
    depth, node = (a[mixed_steps._acts(p.depth)] for a in (p.depth, p.node))
    i = int(np.argmin(depth))
    away = step.reshape(-1, 5)
    direction = p.direction[mixed_steps._acts(p.depth)][i]
    away[node[i], :3] = -2 * depth[i] * e.bases[0][node[i]].T @ direction
    opened = before._replace(acting=np.setdiff1d(keys, keys[i]))
    assert _reverses(model, e, step, opened)
    assert not _reverses(model, e, step, before)


@pytest.mark.parametrize(
    ("potentials", "circles"),
    [
        ([24.20, 25.10, 24.30, 24.19, 25.09, 24.29, 24.18, 25.08, 24.28, 24.18], True),
        ([400.0, 35.0, 90.0, 36.0, 9.0, 7.0, 6.0, 9.0, 4.0, 3.0], False),
        ([5.0, np.inf, np.inf, 6.0, np.inf, np.inf, 4.0, np.inf, np.inf, np.inf], False),
        ([1.0, 0.9, 0.85, 0.851, 0.8502, 0.8501, 0.85, 0.85, 0.85, 0.85], False),
    ],
    ids=["back at each third step", "downhill by ups and downs", "crushed again", "slowly to rest"],
)
def test_only_steps_that_leave_a_potential_and_come_back_to_it_go_in_a_circle(
    model, potentials, circles
):
    walk = mixed_steps._Walk(model, TENSION, at_rest(model), LONGEST, None)
    returns = []
    for potential in potentials:
        walk.potential = potential
        returns.append(walk._returns())
        walk.met.append(potential)
    assert all(returns[-mixed_steps.CIRCLES :]) is circles


@pytest.mark.parametrize(
    ("shares", "over"),
    [([1.0, 0.02, 0.01, 1.0], True), ([1.0, 0.2, 1.0], False), ([1.0, 0.02, 0.09], False)],
    ids=["thrown from where it almost arrived", "not so near", "back a little"],
)
def test_a_step_far_from_where_the_walk_almost_arrived_ends_it(model, monkeypatch, shares, over):
    walk = mixed_steps._Walk(model, TENSION, at_rest(model), LONGEST, None)
    for share in shares:
        monkeypatch.setattr(mixed_steps, "residual_norm", lambda *_, share=share: (share, 1.0))
        walk.note_place()
        walk.taken += 1
    assert walk.is_over(END_RESIDUAL) is over
