"""The muscle in motion: activation, fibre velocity, and the step in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cosim.errors import ConvergenceError, InputError
from rigid.muscle import curves, millard
from rigid.muscle.dynamics import (
    MuscleState,
    advance_activation,
    at_rest,
    fibre_velocity,
    step,
)
from rigid.muscle.millard import equilibrium, path_length
from rigid.muscle.parameters import DAMPED, Muscles
from tests.proofs.fingers.index_muscles import (
    WITHOUT_DAMPING,
    activation_rate,
    index_muscles,
    rigid_force,
)

INDEX = index_muscles()
RIGID = index_muscles(rigid_tendon=True)
UNDAMPED = replace(INDEX, damping=0.0, curves=WITHOUT_DAMPING)
PATH = path_length(INDEX, 1.0, 0.1)
levels = st.floats(0.01, 1.0)


def total_force(muscles: Muscles, a: np.ndarray, length: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The fibre's pull along the tendon over F0, by the exact curves."""
    x = length / muscles.optimal_fibre_length
    cosine = np.sqrt(1.0 - (muscles.width / length) ** 2)
    active = a * muscles.curves.active.value(x) * muscles.curves.velocity.value(v)
    return (active + muscles.curves.passive.value(x) + muscles.damping * v) * cosine


def tendon_force(muscles: Muscles, path: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The tendon's pull over F0, by the exact curve."""
    s = np.sqrt(length**2 - muscles.width**2)
    return muscles.curves.tendon.value((path - s) / muscles.tendon_slack_length)


def test_deactivation_follows_its_closed_form_to_second_order() -> None:
    """da/dt = -a (0.5 + 1.5 a) / t_d from 1: a = 0.5 / (2 exp(t / 2 t_d) - 1.5)."""
    muscles = replace(INDEX, min_activation=0.0)
    exact = 0.5 / (2.0 * np.exp(0.5 * 0.1 / 0.040) - 1.5)
    errors = []
    for n in (20, 40):
        a = np.ones(8)
        for _ in range(n):
            a = advance_activation(muscles, a, np.zeros(8), 0.1 / n)
        errors.append(abs(a[0] - exact))
    assert errors[1] < 5e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


@given(levels, levels, st.floats(1e-6, 10.0))
def test_activation_never_passes_the_excitation(a: float, u: float, dt: float) -> None:
    after = advance_activation(INDEX, np.full(8, a), np.full(8, u), dt)
    assert (min(a, u) - 1e-15 <= after).all()
    assert (after <= max(a, u) + 1e-15).all()


@pytest.mark.parametrize("muscles", [INDEX, UNDAMPED], ids=["damped", "undamped"])
def test_fibre_velocity_balances_the_forces(muscles: Muscles) -> None:
    rng = np.random.default_rng(4)
    a, x = rng.uniform(0.01, 1.0, (200, 8)), rng.uniform(0.46, 1.7, (200, 8))
    length = x * muscles.optimal_fibre_length
    s = np.sqrt(length**2 - muscles.width**2)
    path = s + muscles.tendon_slack_length * rng.uniform(0.98, 1.06, (200, 8))
    v = fibre_velocity(muscles, a, length, path)
    normalised = v / (muscles.max_velocity * muscles.optimal_fibre_length)
    pulls = total_force(muscles, a, length, normalised)
    assert pulls == pytest.approx(tendon_force(muscles, path, length), abs=1e-9)
    assert np.abs(normalised).max() > 1.0
    rest = equilibrium(muscles, a, path)
    free = rest.normalised_length > 0.45
    v = fibre_velocity(muscles, a, rest.fibre_length, path)
    assert v[free] / muscles.optimal_fibre_length.max() == pytest.approx(0.0, abs=1e-5)


def test_the_shortest_fibre_does_not_shorten() -> None:
    path = UNDAMPED.tendon_slack_length * 0.9
    assert (fibre_velocity(UNDAMPED, 1.0, UNDAMPED.shortest_fibre, path) == 0.0).all()
    longer = 1.01 * UNDAMPED.shortest_fibre
    assert (fibre_velocity(UNDAMPED, 1.0, longer, path) < -UNDAMPED.optimal_fibre_length).all()


@example(1.0, 1.0, 1.0, 0.039, -5.0)  # a short step sees the curvature of the force-velocity curve
@given(levels, levels, st.floats(0.45, 1.6), st.floats(-0.02, 0.08), st.floats(-5.0, -1.0))
def test_a_step_balances_forces_at_its_end(
    a: float, u: float, x: float, strain: float, power: float
) -> None:
    """From any state, to any path, damped or not, in 10 us or in 0.1 s."""
    dt = 10.0**power
    length = x * INDEX.optimal_fibre_length
    path = np.sqrt(length**2 - INDEX.width**2) + INDEX.tendon_slack_length * (1.0 + strain)
    before = MuscleState(np.full(8, a), length, np.zeros(8), np.zeros(8))
    for muscles in (INDEX, UNDAMPED):
        state, force, _ = step(muscles, before, np.full(8, u), path, dt)
        v = (state.fibre_length - length) / dt
        assert state.fibre_velocity == pytest.approx(v)
        share = force / muscles.max_force
        assert (force >= 0.0).all()
        tendon = tendon_force(muscles, path, state.fibre_length)
        assert share == pytest.approx(tendon, abs=1e-7)
        normalised = v / (muscles.max_velocity * muscles.optimal_fibre_length)
        pulls = total_force(muscles, state.activation, state.fibre_length, normalised)
        free = state.fibre_length > muscles.shortest_fibre * (1.0 + 1e-12)
        assert pulls[free] == pytest.approx(share[free], abs=2e-6)


def test_the_safeguarded_iteration_takes_the_same_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the fibre stays longer than a slack tendon would let it be."""
    state, u = at_rest(INDEX, 0.5, PATH), np.full(8, 0.5)
    for shift in (0.02, -0.3, -0.7):
        path = PATH + shift * INDEX.optimal_fibre_length
        with monkeypatch.context() as patch:
            plain = step(INDEX, state, u, path, 1e-4)
            patch.setattr(millard, "ROUNDS", 0)
            bracketed = step(INDEX, state, u, path, 1e-4)
        lengths = plain.state.fibre_length, bracketed.state.fibre_length
        assert lengths[0] == pytest.approx(lengths[1], rel=1e-8)
        assert plain.force == pytest.approx(bracketed.force, abs=1e-6)
    assert (lengths[0] > path - INDEX.tendon_slack_length).all()


def test_the_step_converges_to_the_differential_equation() -> None:
    """First order, under a path that moves and a held excitation."""

    def path(t: float) -> np.ndarray:
        return PATH + 0.1 * INDEX.optimal_fibre_length * np.sin(20.0 * t)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        a, length = y[:8], y[8:]
        speed = fibre_velocity(INDEX, a, length, path(t))
        return np.concatenate([activation_rate(INDEX, a, np.full(8, 0.5)), speed])

    start = at_rest(INDEX, 0.1, PATH)
    y0 = np.concatenate([start.activation, start.fibre_length])
    exact = solve_ivp(rates, (0.0, 0.05), y0, method="LSODA", rtol=1e-6, atol=1e-8).y[8:, -1]
    errors = []
    for n in (50, 100):
        state = start
        for i in range(n):
            state, _, _ = step(INDEX, state, np.full(8, 0.5), path(0.05 * (i + 1) / n), 0.05 / n)
        gap = (state.fibre_length - exact) / INDEX.optimal_fibre_length
        errors.append(np.linalg.norm(gap))
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("muscles", [INDEX, UNDAMPED, RIGID], ids=["damped", "undamped", "rigid"])
def test_stepping_to_rest_gives_the_static_answer(muscles: Muscles) -> None:
    path = path_length(muscles, np.array([0.3, 0.6, 0.7, 0.9, 1.0, 1.1, 1.3, 1.5]).clip(0.46), 0.1)
    state = at_rest(muscles, 1.0, path)
    for _ in range(1500):
        state, force, _ = step(muscles, state, np.full(8, 0.2), path, 2e-3)
    still = equilibrium(muscles, 0.2, path)
    assert force / muscles.max_force == pytest.approx(still.force / muscles.max_force, abs=1e-7)
    assert state.activation == pytest.approx(0.2, abs=1e-9)


def test_a_muscle_at_rest_stays_at_rest() -> None:
    state = at_rest(INDEX, 0.3, PATH)
    after, force, _ = step(INDEX, state, np.full(8, 0.3), PATH, 1e-3)
    assert after.fibre_length == pytest.approx(state.fibre_length, rel=1e-10)
    assert force == pytest.approx(equilibrium(INDEX, 0.3, PATH).force, rel=1e-9)


@pytest.mark.parametrize("muscles", [INDEX, UNDAMPED, RIGID], ids=["damped", "undamped", "rigid"])
def test_stiffness_of_a_step_is_that_of_differences(muscles: Muscles) -> None:
    state = at_rest(muscles, 0.3, PATH)
    moved, u, dt = PATH + 0.01 * muscles.optimal_fibre_length, np.full(8, 0.6), 1e-3
    h = 1e-5 * muscles.tendon_slack_length
    up, down = (step(muscles, state, u, moved + d, dt).force for d in (h, -h))
    stiffness = step(muscles, state, u, moved, dt).stiffness
    assert stiffness == pytest.approx((up - down) / (2 * h), rel=2e-3)
    assert (stiffness > equilibrium(muscles, 0.3, PATH).stiffness).all()


def test_a_path_that_goes_slack_and_taut_again() -> None:
    """No force while slack; afterwards the equilibrium comes back."""
    state, u = at_rest(INDEX, 0.5, PATH), np.full(8, 0.5)
    slack = PATH - 0.8 * INDEX.optimal_fibre_length
    _, force, _ = step(INDEX, state, u, slack, 1e-3)
    assert (force == 0.0).all()
    for path, n in ((slack, 300), (PATH, 1000)):
        for _ in range(n):
            state, force, _ = step(INDEX, state, u, path, 1e-3)
    still = equilibrium(INDEX, 0.5, PATH).force
    assert force / INDEX.max_force == pytest.approx(still / INDEX.max_force, abs=1e-7)


def test_a_rigid_tendon_pulls_with_the_fibres_force_velocity() -> None:
    path = path_length(RIGID, 1.0, 1.0)
    top = RIGID.max_velocity * RIGID.optimal_fibre_length
    for v in (-2.0, -0.4, 0.0, 0.3):
        force = rigid_force(RIGID, 1.0, path, v * top / np.cos(RIGID.pennation))
        wanted = (DAMPED.velocity.value(np.array(v)) + 0.1 * v) * np.cos(RIGID.pennation)
        assert force / RIGID.max_force == pytest.approx(np.maximum(wanted, 0.0), abs=1e-9)
    assert rigid_force(RIGID, 0.4, PATH, 0.0) == pytest.approx(equilibrium(RIGID, 0.4, PATH).force)


def test_a_rigid_step_is_the_rigid_force_at_the_mean_rate() -> None:
    state, dt = at_rest(RIGID, 0.4, PATH), 1e-5
    moved = PATH + 0.2 * dt
    _, force, _ = step(RIGID, state, np.full(8, 0.4), moved, dt)
    assert force == pytest.approx(rigid_force(RIGID, 0.4, moved, 0.2), rel=1e-4)


STATE = at_rest(INDEX, 0.1, PATH)
FDS = np.arange(8) == 1


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: step(INDEX, STATE, np.full(8, 1.2), PATH, 1e-3), "FDP, excitation: expected 0"),
        (lambda: step(INDEX, STATE, np.where(FDS, np.nan, 0.1), PATH, 1e-3), "FDS, excitation"),
        (lambda: step(INDEX, STATE, STATE[0], np.where(FDS, np.nan, PATH), 1), "FDS, path length"),
        (lambda: fibre_velocity(RIGID, 0.1, PATH, PATH), "with a rigid tendon it follows"),
        (lambda: fibre_velocity(INDEX, 0.1, np.full(8, np.nan), PATH), "FDP, fibre length"),
    ],
)
def test_bad_input_is_named(wrong: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        wrong()


def test_a_velocity_that_does_not_converge_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = np.where(FDS, 1.2, 1.0) * equilibrium(INDEX, 0.1, PATH).fibre_length
    curve = DAMPED.velocity  # its own iteration is left alone
    assert curve.value(np.array(0.0)) == pytest.approx(1.0)
    monkeypatch.setattr("rigid.muscle.dynamics.increasing_root", _never)
    with pytest.raises(ConvergenceError, match="muscle FDS: its fibre velocity"):
        fibre_velocity(INDEX, 0.1, slow, PATH)


def _never(*_: object) -> np.ndarray:
    raise curves.NotConverged("1 did not converge", FDS)


def test_rounds_of_newton_in_a_smooth_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first guess is good: hardly more than one balance a step."""
    calls = []
    balance = millard.balance

    def counted(*arguments: object) -> millard.ForceBalance:
        calls.append(1)
        return balance(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(millard, "balance", counted)
    state = at_rest(INDEX, 0.1, PATH)
    calls.clear()
    for i in range(300):
        path = PATH + 0.002 * np.sin(2 * np.pi * 3 * (i + 1) * 1e-3)
        state, _, _ = step(INDEX, state, np.full(8, 0.1), path, 1e-3)
    assert len(calls) < 1.2 * 300
