"""The muscle's curves: their defining facts, their derivatives, and the table made of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from rigid.muscle import curves
from rigid.muscle.curves import Curve, Knot, NotConverged, increasing_root
from rigid.muscle.parameters import DAMPED, CurveTable
from tests.proofs.fingers.index_muscles import WITHOUT_DAMPING

ALL = {
    "active": DAMPED.active,
    "active above 0.1": WITHOUT_DAMPING.active,
    "passive": DAMPED.passive,
    "velocity": DAMPED.velocity,
    "velocity with slopes": WITHOUT_DAMPING.velocity,
    "tendon": DAMPED.tendon,
    "soft tendon": curves.tendon_force_length(0.1, 15.0, 0.5, 0.8),
}
RISING = {name: curve for name, curve in ALL.items() if not name.startswith("active")}


def around(curve: Curve, n: int = 400) -> np.ndarray:
    """Points over the curve's domain and as far again on both sides, none of them a knot."""
    lower, upper = curve.domain
    span = upper - lower
    return np.linspace(lower - span, upper + span, n) + 1e-5 * span


@pytest.mark.parametrize("curve", ALL.values(), ids=ALL)
def test_derivatives_are_those_of_differences(curve: Curve) -> None:
    x = around(curve)
    lower, upper = curve.domain
    h = 1e-6 * (upper - lower)
    value, slope, curvature = curve.evaluate(x)
    (up, up_slope, _), (down, down_slope, _) = curve.evaluate(x + h), curve.evaluate(x - h)
    assert slope == pytest.approx((up - down) / (2 * h), abs=2e-6 * np.abs(slope).max())
    differences = (up_slope - down_slope) / (2 * h)
    assert curvature == pytest.approx(differences, abs=2e-5 * np.abs(curvature).max())
    assert value == pytest.approx((up + down) / 2, abs=1e-8 * np.abs(value).max())


@pytest.mark.parametrize("curve", ALL.values(), ids=ALL)
def test_second_derivative_is_continuous_and_vanishes_at_each_knot(curve: Curve) -> None:
    x = curve.knots[0]
    largest = np.abs(curve.evaluate(around(curve))[2]).max()
    for near in (np.nextafter(x, -np.inf), np.nextafter(x, np.inf)):
        assert curve.evaluate(near)[2] == pytest.approx(0.0, abs=1e-9 * largest)
        assert curve.value(near) == pytest.approx(curve.knots[1], abs=1e-12)


@pytest.mark.parametrize("curve", ALL.values(), ids=ALL)
def test_continues_straight_beyond_its_ends(curve: Curve) -> None:
    for end, slope, way in zip(curve.domain, curve.end_slopes, (-1.0, 1.0), strict=True):
        beyond = end + way * np.array([0.5, 3.0])
        value, slopes, curvature = curve.evaluate(beyond)
        assert slopes == pytest.approx(slope, rel=1e-11, abs=0.0)
        assert value == pytest.approx(curve.value(np.array(end)) + slope * (beyond - end))
        assert (curvature == 0.0).all()


@pytest.mark.parametrize("curve", RISING.values(), ids=RISING)
def test_inverse_undoes_a_rising_curve(curve: Curve) -> None:
    x = around(curve)
    value, slope, _ = curve.evaluate(x)
    assert slope.min() >= 0.0
    clear = slope > 1e-3
    assert curve.inverse(value)[clear] == pytest.approx(x[clear], abs=1e-11)


def test_inverse_of_a_level_continuation_is_the_end() -> None:
    assert DAMPED.tendon.inverse(np.array([-1.0, 0.0])) == pytest.approx(1.0, abs=1e-6)
    assert DAMPED.velocity.inverse(np.array([-0.5, 2.0])) == pytest.approx([-1.0, 1.0], abs=2e-5)


def test_active_curve_is_greatest_at_optimal_length_and_shares_its_tails() -> None:
    x = np.linspace(0.3, 2.0, 3001)
    y = DAMPED.active.value(x)
    assert y.min() == 0.0
    assert y.max() == pytest.approx(1.0, abs=1e-9)
    assert x[np.argmax(y)] == pytest.approx(1.0, abs=1e-3)
    raised = WITHOUT_DAMPING.active.value(np.array([0.2, 1.0, 1.9]))
    assert raised == pytest.approx([0.1, 1.0, 0.1], abs=1e-12)


def test_published_stiffness_defaults() -> None:
    """Passive 2 / 0.7, tendon 1.375 / 0.049 with a toe up to two thirds of F0."""
    assert DAMPED.passive.end_slopes[1] == pytest.approx(2 / 0.7)
    assert DAMPED.tendon.end_slopes[1] == pytest.approx(1.375 / 0.049)
    assert DAMPED.tendon.knots[1, -1] == pytest.approx(2 / 3)
    assert DAMPED.tendon.value(np.array(1.049)) == pytest.approx(1.0, abs=1e-12)


def test_the_undamped_force_velocity_curve_has_half_its_near_slopes_at_its_ends() -> None:
    assert WITHOUT_DAMPING.velocity.end_slopes == pytest.approx([0.25 / 2, 0.15 / 2])
    assert DAMPED.velocity.end_slopes.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("curviness", [0.0, 0.4, 1.0])
def test_middle_of_a_symmetric_corner(curviness: float) -> None:
    """Its control points are (-1, 1), twice (-b, b), twice (b, b), (1, 1)."""
    curve = Curve.through([Knot(-1.0, 1.0, -1.0), Knot(1.0, 1.0, 1.0)], curviness)
    b = 1.0 - (0.1 + 0.8 * curviness)
    value, slope, _ = curve.evaluate(np.array(0.0))
    assert value == pytest.approx((1.0 + 15.0 * b) / 16.0, abs=1e-13)
    assert slope == pytest.approx(0.0, abs=1e-13)


def test_corner_between_parallel_tangents_is_their_line() -> None:
    line = Curve.through([Knot(0.0, 1.0, 2.0), Knot(3.0, 7.0, 2.0)], 0.5)
    x = np.linspace(-1.0, 4.0, 11)
    value, slope, _ = line.evaluate(x)
    assert value == pytest.approx(1.0 + 2.0 * x, abs=1e-12)
    assert slope == pytest.approx(2.0, abs=1e-11)


@pytest.mark.parametrize(
    ("knots", "curviness", "said"),
    [
        ([Knot(0, 0, 0), Knot(1, 1, 2)], 1.5, "curviness 1.5: expected 0 to 1"),
        ([Knot(0, 0, 0), Knot(1, 1, 0.5)], 0.5, "must meet between them"),
        ([Knot(1, 0, 0), Knot(0, 1, 2)], 0.5, "must meet between them"),
        ([Knot(0, 0, 0), Knot(1, float("nan"), 2)], 0.5, "must meet between them"),
    ],
)
def test_a_corner_that_is_no_function_is_refused(
    knots: list[Knot], curviness: float, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        Curve.through(knots, curviness)


def test_table_holds_what_it_says() -> None:
    table = CurveTable.of(list(ALL.values()))
    x = np.stack([around(curve, 20000) for curve in ALL.values()])
    values, slopes = table(x.reshape(len(ALL), 50, 400))
    exact = [curve.evaluate(row) for curve, row in zip(ALL.values(), x, strict=True)]
    assert values.reshape(x.shape) == pytest.approx(np.array([e[0] for e in exact]), abs=1e-11)
    assert slopes.reshape(x.shape) == pytest.approx(np.array([e[1] for e in exact]), abs=2e-7)


def test_table_stays_straight_far_away() -> None:
    table = DAMPED.table
    far = np.full((4, 1), 1e4)
    values, slopes = table(far)
    assert values[3] == pytest.approx(1.0 + 1.375 / 0.049 * (1e4 - 1.049), rel=1e-12)
    assert slopes[[0, 2], 0] == pytest.approx(0.0, abs=1e-9)
    assert table(-far)[0] == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=5))
def test_root_of_a_rising_function_wherever_it_lies(roots: list[float]) -> None:
    """Inside the bracket the root, else the nearer end; no kink or level part stops it."""
    at = np.array(roots)

    def kinked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = x - at
        steep = np.where(d > 0, 100.0, 1.0)
        return steep * d**3, 3 * steep * d**2

    low, high = np.full_like(at, -10.0), np.full_like(at, 10.0)
    for start in (0.0, 100.0):
        found = increasing_root(kinked, low, high, 0 * at + start, np.full_like(at, 1e-12))
        assert found == pytest.approx(np.clip(at, -10.0, 10.0), abs=1e-9)


def test_a_root_that_is_not_found_is_marked() -> None:
    def broken(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([1.0, np.nan]) * x, np.ones(2)

    with pytest.raises(NotConverged, match="1 of 2") as error:
        increasing_root(broken, -np.ones(2), np.ones(2), 0.5 * np.ones(2), np.full(2, 1e-12))
    assert error.value.where.tolist() == [False, True]
