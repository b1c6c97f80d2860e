"""Schemes of coupling in time, on pairs whose equations are known."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from cosim.coupling import schemes
from cosim.coupling.accelerators import Aitken, ConstantRelaxation, QuasiNewton
from cosim.coupling.schemes import (
    Explicit,
    Implicit,
    Linear,
    Newton,
    Scheme,
    begin,
    explicit_limit,
    step,
)
from cosim.coupling.state import (
    CoupledState,
    advance_state,
    energy_defect,
    hood_point,
    interface_residual,
)
from cosim.errors import ConvergenceError
from cosim.port import STATIC, Array
from tests.helpers.moving_hinge import MovingHinge
from tests.helpers.recording_hood import recording_pair
from tests.proofs.coupling.pairs import (
    DAMPING,
    FULL,
    INERTIA,
    RADIUS,
    REST,
    STIFFNESS,
    pulls_on_cables,
    pulls_on_drum,
    soft_pair,
    stability_limit,
    stiff_pair,
)
from tests.proofs.coupling.scheme_rows import (
    SCHEMES,
    TIGHT,
    angles_of,
    drive,
    limit_row,
    order_row,
)

EACH = [pytest.param(scheme, id=name) for name, scheme in SCHEMES.items()]
TOGETHER = [Implicit(Aitken(), TIGHT), Implicit(QuasiNewton(), TIGHT), Newton(TIGHT), Linear()]


def cables(scheme: Scheme, steps: int = 20, dt: float = 1e-3) -> list[CoupledState]:
    return drive(scheme, *soft_pair(), REST, pulls_on_cables, dt, steps)


def drum(scheme: Scheme, dt: float, steps: int, joints: int = 1) -> list[CoupledState]:
    return drive(scheme, *stiff_pair(joints), np.zeros(joints), pulls_on_drum, dt, steps)


def full_pull(time: float) -> tuple[Array, Array]:
    return np.array([FULL]), np.zeros(0)


@pytest.mark.parametrize("name", ["explicit, Gauss-Seidel", "explicit, Jacobi", "linear"])
def test_the_order_is_one(name):
    assert order_row(name, SCHEMES[name], 1, 5e-4).passed


def test_a_finger_of_order_two_makes_linear_of_order_two():
    assert order_row("linear", Linear(), 2, 2.5e-4).passed


def test_the_two_staggered_schemes_differ():
    serial, parallel = (angles_of(cables(Explicit(p))) for p in (False, True))
    assert 1e-6 < np.abs(serial - parallel).max() < 0.1 * np.abs(serial - REST).max()


@pytest.mark.parametrize("scheme", EACH)
def test_counts_of_hood_solves_and_tangents_are_true(scheme):
    finger, hood = recording_pair(3)
    states = drive(scheme, finger, hood, np.zeros(3), pulls_on_drum, 2e-4, 15)
    assert states[-1].solves == len(hood.asked)
    assert states[-1].hood == 1 + 15, "each solve of a step begins with the step's first state"
    with_tangent = isinstance(scheme, (Newton, Linear))
    assert hood.tangents == (len(hood.asked) if with_tangent else 0)
    assert [dt for *_, dt in hood.asked] == [STATIC] + [2e-4] * (len(hood.asked) - 1)
    if isinstance(scheme, (Explicit, Linear)):
        assert len(hood.asked) == 16
    assert states[-1].time == pytest.approx(15 * 2e-4)
    assert states[-1].tension[0] == pulls_on_drum(states[-1].time)[0]
    assert hood.asked[-1][1] == states[-1].tension[0]


def test_an_explicit_step_holds_the_load_though_its_tangent_is_known():
    finger, hood = soft_pair()
    start = finger.begin({"MCP": 0.5, "PIP": 0.5})
    after = []
    for first in (Linear(), Explicit()):
        state = begin(first, finger, hood, start, pulls_on_cables)
        after.append(step(Explicit(), finger, hood, state, pulls_on_cables, 1e-3))
    assert np.array_equal(*(s.finger.angles for s in after))


def test_where_the_hood_is_asked():
    """Serial: where the finger is; parallel and linear: at q + h v of the step's start."""
    for scheme, ahead in ((Explicit(), False), (Explicit(parallel=True), True), (Linear(), True)):
        finger, hood = recording_pair()
        last, now = drive(scheme, finger, hood, np.zeros(1), full_pull, 1e-4, 5)[-2:]
        expected = last.finger.angles + 1e-4 * last.finger.rates if ahead else now.finger.angles
        gap = hood.asked[-1][0].twist_to(finger.motion(expected))
        assert np.abs(gap).max() < 1e-12
        assert np.abs(now.finger.angles - last.finger.angles).max() > 1e-6


def test_what_the_finger_is_stepped_with():
    """The applied load is the old answer, or the answer at the finger's own pose."""
    for scheme, *_ in (p.values for p in EACH):
        states = cables(scheme, 5)
        last, now = states[-2:]
        if isinstance(scheme, Explicit):
            assert np.array_equal(now.applied, last.answer.response.load.total())
            continue
        finger, hood = soft_pair()
        motion = finger.motion(now.finger.angles)
        true = hood.advance(hood.start(motion), motion, now.tension[0], 1.0).load.total()
        allowed = 1e-4 if isinstance(scheme, Linear) else 1e-9
        assert np.abs(now.applied - true).max() < allowed * np.abs(true).max()


@pytest.mark.parametrize("scheme", EACH)
def test_a_step_repeats_and_a_stored_state_resumes_with_the_same_bits(scheme):
    finger, hood = soft_pair()
    states = cables(scheme, 4)
    stored = pickle.loads(pickle.dumps(states[2]))
    for _ in range(2):
        stored = step(scheme, finger, hood, stored, pulls_on_cables, 1e-3)
    step(scheme, finger, hood, states[2], pulls_on_cables, 3e-3)
    again = step(scheme, finger, hood, states[2], pulls_on_cables, 1e-3)
    again = step(scheme, finger, hood, again, pulls_on_cables, 1e-3)
    for other in (stored, again):
        assert np.array_equal(other.finger.angles, states[4].finger.angles)
        assert np.array_equal(other.applied, states[4].applied)
        assert (other.energy, other.solves) == (states[4].energy, states[4].solves)


@pytest.mark.parametrize("scheme", [*TOGETHER, Explicit(), Explicit(parallel=True)])
def test_the_books_say_what_the_hoods_spring_holds(scheme):
    """All of it linear, so that the trapezoidal rule is exact."""
    states = drum(scheme, 1e-4, 100)
    energy, finger = states[-1].energy, stiff_pair()[0]
    twist = finger.motion(np.zeros(1)).twist_to(states[-1].point.motion)
    stored = 0.5 * STIFFNESS * twist[1, 4] ** 2
    assert energy.tendons - energy.hood == pytest.approx(stored, rel=1e-9)
    assert stored > 1e-8
    assert energy.effort >= abs(energy.tendons) > 0
    assert energy.most >= energy.hood


@pytest.mark.parametrize("scheme", [*TOGETHER, Explicit()])
def test_the_applied_loads_work_is_what_the_finger_has_and_lost(scheme):
    """Backward Euler: I v dv less I dv^2 / 2 is kinetic, c v^2 h the damper's."""
    dt, finger = 1e-4, stiff_pair()[0]
    states = drum(scheme, dt, 100)
    v = np.array([s.finger.rates[0] for s in states])
    lost = dt * DAMPING * (v**2).sum() + 0.5 * INERTIA * (np.diff(v) ** 2).sum()
    energy = states[-1].energy
    assert energy.load == pytest.approx(finger.energy(states[-1].finger) + lost, rel=1e-9)
    assert energy_defect(finger, states[-1]) == pytest.approx(energy.artificial - lost, rel=1e-9)
    w = np.array([RADIUS * s.tension[0][0] - STIFFNESS * s.finger.angles[0] for s in states])
    q = np.diff(angles_of(states)[:, 0])
    sign = -1 if isinstance(scheme, Explicit) else 1
    assert energy.artificial == pytest.approx(sign * 0.5 * (np.diff(w) * q).sum(), rel=1e-6)


def test_the_most_that_a_hood_has_given():
    """A released spring gives, takes back and gives less."""
    finger, hood = stiff_pair()
    still = lambda t: (np.zeros(1), np.zeros(0))  # noqa: E731
    states = drive(Newton(), finger, hood, np.array([0.1]), still, 2e-4, 12)
    given = np.array([s.energy.hood for s in states])
    assert given[-1] < 0.9 * given.max()
    np.testing.assert_array_equal([s.energy.most for s in states], np.maximum.accumulate(given))
    assert given.max() == pytest.approx(0.5 * STIFFNESS * 0.1**2, rel=0.05)


def test_work_of_the_fingers_own_tendons():
    class WithTendon(MovingHinge):
        def path_lengths(self, angles: Array) -> Array:
            return 0.1 - 0.004 * angles

    inner, hood = stiff_pair()
    finger = WithTendon(inner.links, inner.law)
    pulls = lambda t: (np.array([2.0]), np.array([1.0 + 10 * t]))  # noqa: E731
    state = begin(Linear(), finger, hood, finger.begin({}), lambda t: (pulls(t)[0], np.ones(1)))
    moved = finger.begin({"MCP": 0.1})
    started = energy_defect(finger, state)
    point = hood_point(state.answer, finger.motion(finger.angles(moved)))
    after = advance_state(finger, state, moved, state.answer, point, state.applied, pulls(0.1), 0.1)
    assert after.energy.own == pytest.approx(0.5 * (1.0 + 2.0) * 0.004 * 0.1)
    gained = finger.energy(moved) - after.energy.hood - after.energy.own
    assert energy_defect(finger, after) - started == pytest.approx(gained)
    twist = state.answer.motion.twist_to(finger.motion(np.array([0.1])))
    assert after.energy.load == pytest.approx(float((state.applied * twist).sum()))
    assert after.energy.effort == pytest.approx(after.energy.own + 2.0 * RADIUS * 0.1)


def test_what_the_linearisation_did_falls_with_the_step():
    """Nothing on a linear hood; on cables the load is missed by the square of the way."""
    linear = drum(Linear(), 5e-4, 40)[-1]
    assert abs(linear.energy.predicted) < 1e-12 * linear.energy.tendons
    assert linear.residual < 1e-12
    coarse, fine = (cables(Linear(), n, 0.02 / n) for n in (10, 20))
    residuals = [max(s.residual for s in run) for run in (coarse, fine)]
    assert residuals[0] / residuals[1] == pytest.approx(4.0, rel=0.3)
    works = [np.abs(np.diff([s.energy.predicted for s in run])).sum() for run in (coarse, fine)]
    assert works[0] / works[1] == pytest.approx(4.0, rel=0.3)


def test_the_interface_residual_bounds_the_disagreement():
    for scheme in (Implicit(Aitken(), 1e-6), Implicit(QuasiNewton(), 1e-6), Newton(1e-6)):
        finger, hood = stiff_pair(3)
        for now in drum(scheme, 5e-4, 30, 3)[5:]:
            motion = finger.motion(now.finger.angles)
            answer = hood.advance(None, motion, now.tension[0], 1.0)
            true = interface_residual(
                now.applied, replace(now.answer, response=answer), schemes.LENGTH
            )
            assert now.residual < 1e-2
            assert true < 30 * now.residual + 1e-12


def test_moments_count_over_a_length():
    finger, hood = stiff_pair()
    state = begin(Explicit(), finger, hood, finger.begin({}), full_pull)
    load = state.answer.response.load
    force = replace(load, wrench=np.zeros((2, 2, 6)), pull=np.array([[4.0, 0, 0, 9, 9, 9]]))
    answer = replace(state.answer, response=state.answer.response._replace(load=force))
    gap = np.zeros((2, 6))
    gap[1, 4] = 0.1
    assert interface_residual(gap, answer, 0.05) == pytest.approx(0.1 / 0.05 / 4.0)
    gap[0, 2] = 3.0
    assert interface_residual(gap, answer, 0.05) == pytest.approx(3.0 / 4.0)
    nothing = replace(force, pull=np.zeros((1, 6)))
    answer = replace(answer, response=answer.response._replace(load=nothing))
    assert interface_residual(gap, answer, 0.05) == pytest.approx(3.0)
    assert interface_residual(0 * gap, answer, 0.05) == 0.0


def test_explicit_fails_above_its_limit_and_names_it():
    assert limit_row(0.95).passed
    assert limit_row(1.1).passed
    match = r"unstable at a step of 0.002 s. It is stable below about 2 sqrt\(I/K\) = 0.0015 s"
    with pytest.raises(ConvergenceError, match=match):
        drum(Explicit(), 2e-3, 20)
    with pytest.raises(ConvergenceError, match="parallel needs damping"):
        drum(Explicit(parallel=True), 1e-3, 60)


def test_the_estimated_limit_is_the_pairs():
    finger, hood = stiff_pair()
    state = begin(Explicit(), finger, hood, finger.begin({}), full_pull)
    found = [explicit_limit(finger, hood, state, dt) for dt in (1e-6, 1e-3)]
    assert found[0] == pytest.approx(2 * np.sqrt(INERTIA / STIFFNESS), rel=1e-4)
    assert found[1] == pytest.approx(stability_limit(), rel=0.02)
    slack = replace(hood, stiffness=np.zeros((1, 1)))
    assert explicit_limit(finger, slack, state, 1e-3) == np.inf


def test_a_stable_explicit_run_of_a_released_hood_is_not_stopped():
    """What moves it was stored; no tendon pulls."""
    finger, hood = stiff_pair()
    still = lambda t: (np.zeros(1), np.zeros(0))  # noqa: E731
    states = drive(Explicit(), finger, hood, np.array([0.2]), still, 1e-3, 60)
    assert np.abs(angles_of(states)).max() < 0.3
    with pytest.raises(ConvergenceError, match="from no source"):
        drive(Explicit(), finger, hood, np.array([0.2]), still, 1.6e-3, 60)


def test_no_agreement_is_an_error_and_the_state_survives():
    finger, hood = stiff_pair()
    state = begin(Newton(), finger, hood, finger.begin({}), full_pull)
    plain = Implicit(ConstantRelaxation(), most_solves=12)
    match = r"from t = 0 s to 0.002 s: after 12 hood solves a joint would still turn by .*IQN-ILS"
    with pytest.raises(ConvergenceError, match=match):
        step(plain, finger, hood, state, full_pull, 2e-3)
    after = step(Newton(), finger, hood, state, full_pull, 2e-3)
    assert after.solves == state.solves + 2


def test_a_constant_share_small_enough_converges():
    share = 1 / (1 + (1e-3) ** 2 * STIFFNESS / INERTIA)
    exact = drum(Newton(TIGHT), 1e-3, 20)[-1].finger.angles
    found = drum(Implicit(ConstantRelaxation(share), TIGHT), 1e-3, 20)[-1].finger.angles
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11)


def test_an_iteration_asks_the_hood_only_near_where_it_has_been():
    finger, hood = recording_pair()
    state = begin(Implicit(), finger, hood, finger.begin({}), full_pull)
    step(Implicit(), finger, hood, state, full_pull, 2e-2)
    turns = [a[0].twist_to(b[0])[1, 4] for a, b in zip(hood.asked, hood.asked[1:], strict=False)]
    assert np.abs(turns).max() == pytest.approx(schemes.MOST_TURN)


def test_a_tendon_going_slack_clears_the_history(monkeypatch):
    calls: list[float] = []
    clear = schemes.reset_history

    def counted(accelerator, history):
        calls.append(state.time)
        return clear(accelerator, history)

    monkeypatch.setattr(schemes, "reset_history", counted)
    finger, hood = stiff_pair(3)
    on_off = lambda t: (np.array([FULL * (t > 0.0025) * (t < 0.0065)]), np.zeros(0))  # noqa: E731
    scheme = Implicit(QuasiNewton())
    start = finger.begin({"MCP": 0.01, "PIP": 0.02, "DIP": 0.03})
    state = begin(scheme, finger, hood, start, on_off)
    for _ in range(10):
        state = step(scheme, finger, hood, state, on_off, 1e-3)
    assert np.round(calls, 6).tolist() == [0.002, 0.006]
    assert state.history.residuals.shape[1] > 0


def test_the_start_is_the_hoods_static_answer():
    finger, hood = soft_pair()
    state = begin(Linear(), finger, hood, finger.begin({"MCP": 0.5}), pulls_on_cables, 0.3)
    assert (state.time, state.solves, state.residual) == (0.3, 1, 0.0)
    assert np.array_equal(state.answer.tension, pulls_on_cables(0.3)[0])
    assert np.array_equal(state.applied, state.answer.response.load.total())
    assert state.hood is state.answer.response.state
