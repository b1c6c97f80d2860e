"""The one Newton and the tangents that it and the port's jacobian rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import ConvergenceError
from cosim.port import Array
from fe_solver.materials.linear import Isotropic
from fe_solver.materials.tension_field import State, TensionField
from fe_solver.solver import linear_algebra, newton
from fe_solver.solver import newton_step as steps
from fe_solver.solver.linear_algebra import Nearby
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, is_equilibrium, solve
from fe_solver.solver.newton_step import LONG, descent_step, factorise, limit_step, newton_step
from fe_solver.solver.residual import residual_norm
from fe_solver.supports import springs_of
from fe_solver.surfaces.spline_distance import Sphere
from tests.helpers.straps import TENSION, TIGHT, perturb, springs, strap
from tests.proofs.fe import sheets
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp, guide, plate, sheet


@pytest.fixture(scope="module")
def model() -> ShellModel:
    return strap()


@pytest.fixture(scope="module")
def solved(model: ShellModel) -> Solution:
    return solve(model, at_rest(model), TENSION, TIGHT)


def test_every_part_of_the_strap_is_at_work(model, solved):
    points = solved.evaluation.points
    force = np.linalg.norm(points.gradient, axis=1)
    assert [force[points.group == g].max(initial=0) > 0.01 for g in (-1, 0, 1, 2)] == [1, 1, 1, 0]
    compressed = points.gradient[points.group == 0] @ [0, 0, 1]
    assert (compressed < 0).any()
    assert np.abs(model.slide(solved.configuration)).max() > 1e-5


def test_convergence_is_quadratic(model, solved):
    c = perturb(model, solved.configuration, 2e-6)
    order, norms = model.free, []
    for _ in range(4):
        e = model.evaluate(c, TENSION, tangent=True)
        norms.append(residual_norm(model, e)[0])
        step = np.zeros(model.pattern.size)
        step[order] = -factorise(model, e.data).solve(e.reduced[order])
        c = model.take_step(c, e.bases, step)
    first, second = np.log(norms[1] / norms[2]), np.log(norms[2] / norms[3])
    assert second / first > 1.7
    assert norms[3] < 1e-10


def test_an_equilibrium_has_its_tied_nodes_where_the_bodies_have_them():
    """One that is tied, with all of its elements' nodes, bears on its body alone."""
    points, quads = plate(20e-3, 5e-3, 4, 1)
    strip = clamp(sheet(points, quads, 100e6, 0.0, 0.5e-3), np.flatnonzero(points[:, 0] < 6e-3))
    model = guide(strip, [np.array([8, 9])], [(1.0, 0.0, 0.0)])
    found = solve(model, at_rest(model), np.array([2.5]), TIGHT)
    assert is_equilibrium(found, TIGHT.tolerance)
    for name in ("x", "d"):
        places = getattr(found.configuration, name).copy()
        places[0] += [0, 1e-6, 0]
        c = replace(found.configuration, **{name: places})
        moved = replace(found, configuration=c, evaluation=model.evaluate(c, found.tension, True))
        assert residual_norm(model, moved.evaluation)[0] == pytest.approx(found.residual, abs=1e-9)
        assert not is_equilibrium(moved, TIGHT.tolerance)


@pytest.mark.parametrize(
    ("load", "modes"), [(19.0, 0), (21.5, 1), (55.0, 1), (64.0, 2), (110.0, 2), (130.0, 3)]
)
def test_a_straight_strut_is_unstable_in_as_many_ways_as_euler_says(load, modes):
    """Clamped at one end and pinned at the other it buckles at 20.19, 59.68 and 118.9 EI / L^2, the
    roots of tan x = x squared."""
    length, width, thickness, modulus = 20e-3, 1e-3, 0.1e-3, 1e8
    X, quads = plate(length, width, 40, 2)
    strut = sheet(X, quads, modulus, 0.0, thickness)
    strut = clamp(strut, np.flatnonzero(X[:, 0] == 0))
    strut = guide(strut, [np.flatnonzero(np.isclose(X[:, 0], length))], [(-1.0, 0.0, 0.0)])
    push = load * modulus * width * thickness**3 / 12 / length**2
    straight = solve(strut, at_rest(strut), np.array([push]), NewtonOptions())
    assert np.abs(straight.configuration.x[:, 2]).max() < 1e-12
    assert straight.factor.negative == modes


def along(model: ShellModel, c: Configuration, v: Array, t: float) -> float:
    there = model.take_step(c, model.bases(c), t * v)
    return model.potential(there, model.evaluate(there, TENSION, False).energy, TENSION)


@pytest.mark.parametrize("seed", range(4))
def test_residual_and_tangent_are_the_potentials(model, solved, seed):
    """Slope and curvature of the potential along a path, away from equilibrium."""
    c = perturb(model, solved.configuration, 2e-6, seed)
    e = model.evaluate(c, TENSION, tangent=True)
    v = np.zeros(model.pattern.size)
    v[model.free] = np.random.default_rng(seed).normal(size=len(model.free))
    v.reshape(-1, 5)[:, 3:] *= 1e3
    h = 1e-6
    f = [along(model, c, v, t * h) for t in (-2, -1, 0, 1, 2)]
    slope = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h)
    curvature = (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h**2)
    assert e.reduced @ v == pytest.approx(slope, rel=1e-6)
    assert v @ (model.pattern.full(e.data) @ v) == pytest.approx(curvature, rel=1e-5)


@pytest.mark.parametrize("weight", [0.0, 1e-4])
def test_follow_solves_for_every_body(model, weight):
    """A strap that the world does not hold turns with its bodies; one that has weight does not."""
    dead = np.tile([0.0, 0, -weight], (len(model.reference), 1)) if weight else None
    held = solve(model.with_changes(dead=dead), at_rest(model), TENSION, TIGHT)
    every = -held.factor.solve(held.residual_derivative)
    assert held.sensitivity == pytest.approx(every, abs=1e-8 * np.abs(every).max())


@pytest.mark.parametrize("convex", [False, True])
def test_the_tangent_is_symmetric(model, solved, convex):
    c = perturb(model, solved.configuration, 1e-4)
    K = model.pattern.full(model.evaluate(c, TENSION, True, convex).data).toarray()
    assert np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize("seed", range(3))
def test_the_convex_tangent_is_positive(model, solved, seed):
    c = perturb(model, solved.configuration, 3e-4, seed)
    order = model.free

    def lowest(convex: bool) -> float:
        K = model.pattern.full(model.evaluate(c, TENSION, True, convex).data)[order][
            :, order
        ].toarray()
        values = np.linalg.eigvalsh(K)
        assert len(values) == len(order)
        return float(values[0] / values[-1])

    assert lowest(convex=False) < -1e-6  # the state is one where it matters
    assert lowest(convex=True) > -1e-14


def test_a_repeated_solve_gives_the_same_bits(model, solved):
    again = solve(strap(), at_rest(model), TENSION, TIGHT)
    assert np.array_equal(again.configuration.x, solved.configuration.x)
    assert np.array_equal(again.configuration.d, solved.configuration.d)
    assert again.iterations == solved.iterations


def test_the_start_does_not_matter(model, solved):
    other = solve(model, perturb(model, at_rest(model), 1e-4), TENSION, TIGHT)
    assert other.configuration.x == pytest.approx(solved.configuration.x, abs=1e-9)
    assert solve(model, solved.configuration, TENSION, TIGHT, near=True).iterations == 0


def test_a_failed_solve_names_the_place(model, solved):
    with pytest.raises(ConvergenceError, match=r"in 2 iterations.* node \d+ at \(.*\) mm"):
        solve(model, at_rest(model), TENSION, replace(TIGHT, max_iterations=2))
    enough = replace(TIGHT, max_iterations=solved.iterations)
    assert solve(model, at_rest(model), TENSION, enough).iterations == solved.iterations


@pytest.mark.parametrize(("limits", "ends"), [(20, True), (40, False)])
def test_where_no_step_descends_thirty_limits_are_rounding(
    model, solved, monkeypatch, limits, ends
):
    c = perturb(model, solved.configuration, 1e-8)
    residual, force = residual_norm(model, model.evaluate(c, TENSION, False))
    options = NewtonOptions(tolerance=residual / force / limits)
    monkeypatch.setattr(newton._Search, "descend", lambda *_: False)
    if ends:
        assert solve(model, c, TENSION, options, near=True).residual == residual
    else:
        with pytest.raises(ConvergenceError, match="did not reach equilibrium"):
            solve(model, c, TENSION, options, near=True)


def test_moments_of_the_residual_count_by_the_length_of_an_element():
    """The same sheet a thousand times as large, with the same forces, has the same residual."""
    norms = []
    for scale in (1.0, 1e3):
        X, quads = plate(20e-3 * scale, 5e-3 * scale, 4, 1)
        strip = clamp(sheet(X, quads, 1e8 / scale**2, 0.3, 0.5e-3 * scale), np.array([0, 1]))
        c, turns = at_rest(strip), np.zeros((len(X), 5))
        turns[2:, 3:] = 1e-2 * np.sin(np.arange(16.0)).reshape(8, 2)
        c = strip.take_step(c, strip.bases(c), turns.ravel())
        norms.append(residual_norm(strip, strip.evaluate(c, NO_TENSION, False))[0])
    assert norms[0] > 0.01
    assert norms[1] == pytest.approx(norms[0], rel=1e-9)


def test_a_sheet_that_nothing_holds_is_refused():
    X, quads = plate(1.0, 1.0, 2, 2)
    model = replace(sheet(X, quads, 1.0, 0.0, 0.5), dead=np.tile([0.0, 0, -1e-3], (9, 1)))
    with pytest.raises(ConvergenceError, match="free to move"):
        solve(model, at_rest(model), NO_TENSION, sheets.BENCHMARK)


def test_a_sheet_hangs_on_its_taut_springs():
    """Four springs above, exactly as long as the gap, four below that can only go slack."""
    X, quads = plate(20e-3, 10e-3, 4, 2)
    corners = np.flatnonzero(np.isin(X[:, 0], [0, 20e-3]) & np.isin(X[:, 1], [0, 10e-3]))
    up = np.array([0.0, 0, 10e-3])
    held = springs_of(
        [springs(corners, 0, X[corners] + z, 1e3, 10e-3, only=True) for z in (up, -up)]
    )
    dead = np.tile([0.0, 0, -0.01], (len(X), 1))
    model = replace(sheet(X, quads, 1e8, 0.3, 0.5e-3), springs=held, dead=dead)
    solution = solve(model, at_rest(model), NO_TENSION, TIGHT)
    force = solution.evaluation.points.gradient
    assert force[:4, 2] == pytest.approx(np.full(4, dead[:, 2].sum() / 4))
    assert (force[4:] == 0).all()
    assert (solution.evaluation.points.depth[4:] < 0).all()


def solve_next(model: ShellModel, solved: Solution, kept: bool) -> Solution:
    """The strap under a little more tension, from where its tangent foresees it."""
    more, c = 1.001 * TENSION, solved.configuration
    step = np.zeros(model.pattern.size)
    step[model.free] = solved.sensitivity[:, -len(TENSION) :] @ (more - TENSION)
    start = model.take_step(c, solved.evaluation.bases, step)
    return solve(model, start, more, TIGHT, True, solved if kept else None)


def factors(monkeypatch) -> list[int]:
    """Grows by one with every new tangent that Newton factorises."""
    made: list[int] = []
    real = steps.newton_step

    def step(*args):
        made.append(1)
        return real(*args)

    monkeypatch.setattr(steps, "newton_step", step)
    return made


def test_an_old_factor_serves_where_it_lowers_the_residual_fast(model, solved, monkeypatch):
    new = solve_next(model, solved, kept=False)
    made = factors(monkeypatch)
    old = solve_next(model, solved, kept=True)
    assert len(made) < new.iterations
    assert old.configuration.x == pytest.approx(new.configuration.x, abs=1e-11)
    residual, force = residual_norm(model, old.evaluation)
    assert residual <= 1e-11 * force
    assert old.evaluation.data is not None


def test_an_old_factor_that_does_not_serve_is_given_up(model, solved):
    """A wrong factor costs iterations, not the answer."""
    wrong = replace(solved)
    vars(wrong)["factor"] = factorise(model, 100.0 * solved.evaluation.data)
    start = perturb(model, solved.configuration, 1e-9)
    found = solve(model, start, TENSION, TIGHT, True, wrong)
    assert found.configuration.x == pytest.approx(solved.configuration.x, abs=1e-11)


@pytest.mark.parametrize("products", [0, 10])
def test_the_factor_of_before_stands_for_new_ones(model, solved, products, monkeypatch):
    """Far from the equilibrium that it follows: the answer is the same with it and without it."""
    near: list[bool] = []
    real = steps.newton_step

    def step(*args):
        out = real(*args)
        near.append(isinstance(out[1], Nearby))
        return out

    monkeypatch.setattr(steps, "newton_step", step)
    monkeypatch.setattr(linear_algebra, "MOST_PRODUCTS", products)
    monkeypatch.setattr(type(model.pattern.analysis), "dear", True)
    more = 1.1 * TENSION
    found = solve(model, solved.configuration, more, TIGHT, True, solved)
    assert near
    assert any(near) == (products > 0)
    alone = solve(model, solved.configuration, more, TIGHT, True)
    assert found.configuration.x == pytest.approx(alone.configuration.x, abs=1e-11)


def test_follow_is_how_the_nodes_follow_the_tensions(model, solved):
    h = 1e-4
    ahead, behind = (
        solve(model, solved.configuration, TENSION + s * h * np.eye(2)[0], TIGHT, True)
        for s in (1, -1)
    )
    slope = (ahead.configuration.x - behind.configuration.x) / (2 * h)
    step = np.zeros(model.pattern.size)
    step[model.free] = solved.sensitivity[:, -2]
    moved = np.einsum("nij,nj->ni", solved.evaluation.bases[0], step.reshape(-1, 5)[:, :3])
    assert moved == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("convex", [False, True])
def test_a_tangent_made_later_is_the_same(model, solved, convex):
    c = perturb(model, solved.configuration, 1e-5)
    at_once = model.evaluate(c, TENSION, True, convex)
    later = model.with_tangent(c, model.evaluate(c, TENSION, False, convex))
    assert np.array_equal(at_once.data, later.data)
    assert np.array_equal(at_once.reduced, later.reduced)


def test_a_node_that_leaves_a_bone_is_put_where_its_force_holds_it():
    """One node of a floating sheet on a floor, pressed at depth b with c b^2 and let go to a force
    of a hundredth: Newton halves b, b/10 is the answer."""
    X, quads = sheets.map_grid(2, 2, lambda uv: np.column_stack([0.01 * uv, 0 * uv[:, 0]]))
    model = sheet(X, quads, 1e3, 0.3, 0.1e-3)
    contact = sheets.contact(model, Sphere(np.array([0, 0, -1.0]), 1.0), np.array([0]), 1e9, 1e-4)
    model = replace(model, contacts=(contact,))
    start = at_rest(model)
    e = model.evaluate(start, NO_TENSION, tangent=False)
    b = e.points.depth[0] + 1e-4
    force, slope = np.linalg.norm(e.points.gradient[0]), e.points.stiffness[0] * b / 2e-4
    step = np.zeros(model.pattern.size)
    step[2] = 0.99 * force / slope
    pressed = newton.limit_to_contact(model, e, step)
    assert b - step[2] == pytest.approx(b * 0.505)
    assert b - pressed[2] == pytest.approx(b / 10, rel=1e-6)
    assert np.array_equal(pressed[3:], step[3:])
    near = newton.limit_to_contact(model, e, 0.1 * step)
    assert np.array_equal(near, 0.1 * step)


def slack_web() -> tuple[ShellModel, Configuration]:
    """A sheet without compression between two rails, one of them moved along the other; its other
    two sides are free, so that its corners hang slack."""
    X, quads = plate(0.3, 0.1, 24, 8)
    rails = np.flatnonzero(np.isclose(X[:, 1], 0) | np.isclose(X[:, 1], 0.1))
    model = clamp(sheet(X, quads, 0, 0, 1e-3, law=TensionField(Isotropic(1e8, 0.3))), rails)
    moved = model.ties.position + 1e-2 * X[rails, 1:2] * [1.0, 0, 0]
    model = replace(model, ties=replace(model.ties, position=moved))
    start = at_rest(model)
    return model, model.move_bodies(start, start.position, start.rotation)


def test_a_web_with_slack_corners_is_in_equilibrium():
    model, start = slack_web()
    found = solve(model, start, NO_TENSION, NewtonOptions(tolerance=1e-9))
    c = found.configuration
    state = model.section.tension_state(
        model.tables.strain(np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1))
    )
    assert {State.WRINKLED, State.SLACK} <= set(state)
    assert 0.15 < 2 * found.evaluation.energy / (1e-4 * 1e8 * 0.3 * 0.1 * 1e-3) < 0.25


def test_a_damped_step_does_not_run_away_in_slack_parts():
    model, start = slack_web()
    c = solve(model, start, NO_TENSION, NewtonOptions(tolerance=1e-9)).configuration
    e = model.evaluate(c, NO_TENSION, tangent=True)
    gradient = np.zeros_like(e.reduced)
    gradient[model.free] = np.random.default_rng(2).normal(size=len(model.free))
    longest = 1e-6, 1e-3
    whole = newton_step(model, e.data, gradient)[0]
    damped, factor = descent_step(model, e.data, gradient, *longest)
    assert limit_step(whole, *longest)[1] > 1e3 * LONG
    assert limit_step(damped, *longest)[1] < limit_step(whole, *longest)[1] / 5
    assert damped @ gradient < 0
    assert factor is None
    assert np.array_equal(descent_step(model, e.data, gradient, 1e9, 1e9)[0], whole)


@pytest.mark.parametrize("share", [0.01, 0.5])
def test_what_comes_near_is_sought_with_smoother_tension_fields(share, monkeypatch):
    model, start = slack_web()
    tried, once = [], newton._solve

    def stuck_at_first(m, *rest):
        tried.append(m.section.smoothing)
        if len(tried) == 1:
            raise newton._StuckError("stuck", share)
        return once(m, *rest)

    monkeypatch.setattr(newton, "_solve", stuck_at_first)
    if share > newton.NEARLY:
        with pytest.raises(ConvergenceError, match="stuck"):
            solve(model, start, NO_TENSION, NewtonOptions(tolerance=1e-9))
        return
    found = solve(model, start, NO_TENSION, NewtonOptions(tolerance=1e-9))
    assert tried == [1e-6, *newton.SMOOTHER, 1e-6]
    assert found.model is model
    assert residual_norm(model, found.evaluation)[0] == found.residual
