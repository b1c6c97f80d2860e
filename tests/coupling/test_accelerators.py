"""Accelerated fixed points of affine maps, whose solutions are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.coupling.accelerators import (
    Accelerator,
    Aitken,
    ConstantRelaxation,
    History,
    QuasiNewton,
    accelerate,
    independent,
    initial_history,
    reset_history,
    start_step,
)
from cosim.errors import InputError
from cosim.port import Array

SLOPE = np.array([[-3.0, 1.0, 0.2], [0.5, -8.0, 0.1], [0.0, 2.0, -1.5]])
"""A map that runs away from its fixed point in every direction."""
OFFSET = np.array([1.0, -2.0, 0.5])
SOLUTION = np.linalg.solve(np.eye(3) - SLOPE, OFFSET)


def runs(
    accelerator: Accelerator, rounds: int, history: History | None = None
) -> tuple[list[float], History]:
    """Errors before each of so many evaluations of the map, and the history after them."""
    x, errors = np.zeros(3), []
    history = (
        initial_history(accelerator, 3) if history is None else start_step(accelerator, history)
    )
    for _ in range(rounds):
        errors.append(float(np.abs(x - SOLUTION).max()))
        x, history = accelerate(accelerator, history, x, SLOPE @ x + OFFSET)
    return [*errors, float(np.abs(x - SOLUTION).max())], history


def scalar(accelerator: Accelerator, slope: float, rounds: int) -> float:
    x, history = np.zeros(1), initial_history(accelerator, 1)
    for _ in range(rounds):
        x, history = accelerate(accelerator, history, x, slope * x + 1.0)
    return float(abs(x[0] - 1 / (1 - slope)))


def test_a_constant_share_is_what_it_says():
    x, image = np.array([1.0, 2.0]), np.array([3.0, -2.0])
    history = initial_history(ConstantRelaxation(0.25), 2)
    moved, history = accelerate(ConstantRelaxation(0.25), history, x, image)
    np.testing.assert_allclose(moved, [1.5, 1.0], rtol=1e-15)
    np.testing.assert_allclose(accelerate(ConstantRelaxation(0.25), history, x, image)[0], moved)
    plain, _ = accelerate(ConstantRelaxation(), initial_history(ConstantRelaxation(), 2), x, image)
    np.testing.assert_allclose(plain, image)


@pytest.mark.parametrize("slope", [-50.0, -2.0, 0.5])
@pytest.mark.parametrize("accelerator", [Aitken(), QuasiNewton()])
def test_one_unknown_takes_two_evaluations(accelerator, slope):
    assert scalar(accelerator, slope, 1) > 1e-3
    assert scalar(accelerator, slope, 2) < 1e-12


def test_aitken_converges_where_the_plain_iteration_runs_away():
    assert runs(ConstantRelaxation(), 12)[0][-1] > 1e6
    assert runs(Aitken(), 60)[0][-1] < 1e-6


def test_aitken_learns_from_the_step_that_was_made_and_not_from_the_one_it_wished():
    """A caller may shorten the step."""
    accelerator, slope = Aitken(), -20.0
    history, x = initial_history(accelerator, 1), np.zeros(1)
    aim, history = accelerate(accelerator, history, x, slope * x + 1.0)
    x = 0.1 * aim
    x, history = accelerate(accelerator, history, x, slope * x + 1.0)
    assert x[0] == pytest.approx(1 / 21, rel=1e-12)


def test_aitken_goes_on_with_the_share_of_the_step_before():
    accelerator, x = Aitken(), np.zeros(1)
    history = initial_history(accelerator, 1)
    for _ in range(2):
        x, history = accelerate(accelerator, history, x, -9 * x + 1.0)
    assert history.factor == pytest.approx(0.1)
    again, _ = accelerate(accelerator, start_step(accelerator, history), 0 * x, 0 * x + 5.0)
    assert again[0] == pytest.approx(0.5)
    fresh, _ = accelerate(accelerator, reset_history(accelerator, history), 0 * x, 0 * x + 5.0)
    assert fresh[0] == pytest.approx(2.5)


def test_quasi_newton_solves_n_unknowns_in_n_plus_one_evaluations():
    errors, history = runs(QuasiNewton(filter=1e-6), 4)
    assert errors[3] > 1e-3
    assert errors[4] < 1e-11
    assert history.residuals.shape == history.images.shape == (3, 3)


def test_there_are_never_more_columns_than_unknowns():
    rng, accelerator = np.random.default_rng(0), QuasiNewton()
    history = initial_history(accelerator, 3)
    for _ in range(12):
        _, history = accelerate(accelerator, history, *rng.normal(size=(2, 3)))
        assert history.residuals.shape[1] <= 3
    assert history.residuals.shape[1] == 3


def test_columns_of_the_step_before_save_evaluations():
    accelerator = QuasiNewton(filter=1e-6)
    _, history = runs(accelerator, 4)
    reused, _ = runs(accelerator, 1, history)
    assert reused[-1] < 1e-11
    alone = replace(accelerator, reuse=False)
    again, _ = runs(alone, 1, runs(alone, 4)[1])
    assert again[-1] > 1e-2
    emptied = reset_history(accelerator, history)
    assert emptied.residuals.shape == emptied.images.shape == (3, 0)
    assert emptied.last.size == 0


def test_differences_are_not_taken_over_the_end_of_a_step():
    accelerator = QuasiNewton()
    _, history = accelerate(accelerator, initial_history(accelerator, 3), np.zeros(3), OFFSET)
    moved = start_step(accelerator, history)
    _, after = accelerate(accelerator, moved, np.ones(3), 7 * OFFSET)
    assert after.residuals.shape[1] == 0


def test_a_column_along_newer_ones_is_dropped():
    a, b = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    nearly = a + b + 5e-3 * np.array([0, 0, 1.0])
    assert independent(np.column_stack([a, b, nearly]), 1e-2) == [0, 1]
    assert independent(np.column_stack([a, b, nearly]), 1e-3) == [0, 1, 2]
    assert independent(np.column_stack([a, 1e-9 * b]), 1e-2) == [0, 1], "short, but not along a"
    assert independent(np.column_stack([a, 0 * a, b]), 1e-2) == [0, 2]
    many = np.random.default_rng(0).normal(size=(3, 6))
    assert independent(many, 0.0) == [0, 1, 2], "without a filter too"


def test_the_newest_column_is_the_one_that_stays():
    """A map that has changed: the old difference along the same line gives way."""
    accelerator = QuasiNewton()
    old = replace(
        initial_history(accelerator, 2),
        residuals=np.array([[1.0], [0.0]]),
        images=np.array([[9.0], [0.0]]),
    )
    _, history = accelerate(accelerator, old, np.zeros(2), np.array([1.0, 0.0]))
    _, history = accelerate(accelerator, history, np.array([1.0, 0]), np.array([-1.0, 0.0]))
    np.testing.assert_allclose(history.residuals, [[-3.0], [0.0]])
    np.testing.assert_allclose(history.images, [[-2.0], [0.0]])


def test_noise_makes_no_column():
    accelerator = QuasiNewton(least=1e-6)
    _, history = accelerate(accelerator, initial_history(accelerator, 1), np.zeros(1), np.ones(1))
    _, noisy = accelerate(accelerator, history, np.zeros(1), np.ones(1) + 1e-7)
    assert noisy.residuals.shape[1] == 0
    _, told = accelerate(accelerator, history, np.zeros(1), np.ones(1) + 1e-5)
    assert told.residuals.shape[1] == 1


@pytest.mark.parametrize("accelerator", [ConstantRelaxation(0.5), Aitken(), QuasiNewton()])
def test_a_history_is_a_value(accelerator):
    _, history = runs(accelerator, 3)
    x, image = OFFSET, SLOPE @ OFFSET

    def once() -> Array:
        return accelerate(accelerator, history, x, image)[0]

    first = once()
    runs(accelerator, 3, history)
    assert np.array_equal(first, once())


@pytest.mark.parametrize(
    "accelerator", [ConstantRelaxation(0.0), Aitken(-0.5), QuasiNewton(np.nan)]
)
def test_a_share_that_is_not_positive_is_refused(accelerator):
    with pytest.raises(InputError, match="positive share"):
        initial_history(accelerator, 3)
