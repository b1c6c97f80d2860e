"""Least cost under equations and bounds: against closed forms, and the conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest

from rigid.muscle.least_cost import ACCURATE, Programme, least, optimality


def one_equation(arms, torque, most=np.inf):
    arms = np.array([arms], dtype=float)
    n = arms.shape[1]
    return Programme(arms, np.array([torque]), np.zeros(n), np.full(n, most))


@pytest.mark.parametrize("power", [2, 3])
def test_shares_of_one_torque_are_those_of_lagrange(power):
    """p c_i x_i^(p-1) = y r_i, so that x_i goes with (r_i / c_i)^(1 / (p - 1))."""
    arms, cost = np.array([0.01, 0.02, 0.005]), np.array([1.0, 3.0, 0.2])
    found = least(one_equation(arms, 0.3), cost, power)
    way = (arms / cost) ** (1.0 / (power - 1))
    assert found.x == pytest.approx(0.3 * way / (arms @ way), rel=1e-7)
    assert power * cost * found.x ** (power - 1) == pytest.approx(
        found.multiplier[0] * arms, rel=1e-6
    )


def test_the_linear_programme_takes_the_cheapest_by_the_torque():
    found = least(one_equation([0.01, 0.02, 0.005], 0.3), np.array([1.0, 3.0, 0.6]), 1)
    assert found.x == pytest.approx([30.0, 0.0, 0.0])
    assert found.multiplier == pytest.approx([100.0])


@pytest.mark.parametrize("power", [1, 2, 3])
def test_bounds_bear_and_the_multiplier_is_the_price(power):
    arms, cost = [0.01, 0.02, 0.005], np.array([1.0, 0.5, 2.0])
    programme = one_equation(arms, 0.3, most=11.0)
    found = least(programme, cost, power)
    assert programme.gap(found.x) < 1e-12
    assert (found.x <= 11.0).all()
    assert found.x[1] == pytest.approx(11.0, abs=1e-12)
    price = [
        cost @ least(one_equation(arms, t, 11.0), cost, power).x ** power for t in (0.301, 0.299)
    ]
    assert found.multiplier[0] == pytest.approx((price[0] - price[1]) / 2e-3, rel=1e-3)


@pytest.mark.parametrize("power", [1, 2, 3])
def test_what_bears_no_cost_is_free_to_help(power):
    """Bands beside muscles: F = B1 + B2, of which the torque wants one alone."""
    A = np.array([[1.0, -1.0, -1.0], [0.0, 2.0, 1.0]])
    programme = Programme(A, np.array([0.0, 4.0]), np.zeros(3), np.full(3, np.inf))
    found = least(programme, np.array([1.0, 0.0, 0.0]), power)
    assert found.x == pytest.approx([2.0, 2.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("power", [1, 2, 3])
def test_nothing_is_found_where_there_is_nothing(power):
    assert least(one_equation([0.01, 0.02], -0.1), np.ones(2), power) is None
    assert least(one_equation([0.01, 0.02], 1.0, most=3.0), np.ones(2), power) is None


@pytest.mark.parametrize("power", [1, 2, 3])
def test_random_programmes_keep_their_conditions_and_nothing_near_is_cheaper(power):
    rng = np.random.default_rng(power)
    for _ in range(25):
        n, m = int(rng.integers(4, 9)), int(rng.integers(1, 4))
        A = rng.normal(size=(m, n))
        most = np.where(rng.random(n) < 0.5, rng.uniform(1.0, 20.0, n), np.inf)
        inside = rng.random(n) * np.minimum(most, 20.0)
        cost = np.exp(rng.normal(size=n))
        programme = Programme(A, A @ inside, np.zeros(n), most)
        found = least(programme, cost, power)
        assert found.miss <= ACCURATE
        assert cost @ found.x**power <= cost @ inside**power * (1 + 1e-9)


def test_the_check_sees_what_is_not_the_best():
    programme = one_equation([1.0, 1.0], 2.0)
    _, best = optimality(programme, np.array([2.0, 2.0]), np.array([1.0, 1.0]))
    _, other = optimality(programme, np.array([3.0, 1.0]), np.array([1.5, 0.5]))
    assert best < 1e-12
    assert other > 0.3


@pytest.mark.parametrize("power", [1, 2, 3])
def test_an_equation_of_which_rounding_alone_is_left_is_met(power):
    A = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    programme = Programme(A, np.array([2.0, -1e-15]), np.zeros(3), np.full(3, np.inf))
    found = least(programme, np.array([1.0, 2.0, 1.0]), power)
    assert found.x[2] == pytest.approx(0.0, abs=1e-9)
    assert found.miss < 1e-9
