"""The roughness of curves whose answer is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.roughness import FEWEST, WINDOW, Roughness, pool, roughness, windows

X = np.linspace(-5.0, 75.0, 81)
ANGLES = np.arange(10.0, 101.0, 2.0)
IN_WINDOW = int(WINDOW / 2) + 1
"""Of the angles."""
WINDOWS = len(ANGLES) - IN_WINDOW + 1
SAW = (-1.0) ** np.arange(len(ANGLES))


def cubic(x):
    return 2.0 - 0.3 * x + 0.02 * x**2 - 1e-4 * x**3


def test_a_cubic_has_none_in_any_order_spacing_and_with_gaps():
    places = np.random.default_rng(1).permutation(X**2 / 75.0 * np.sign(X))
    values = cubic(places)
    values[::7] = np.nan
    assert roughness(places, values).rms < 1e-12
    assert roughness(places, values).largest < 1e-12


def test_a_quartic_leaves_its_chebyshev_part():
    """On many even points x^4 over (-1, 1) leaves the monic Legendre polynomial, whose mean square
    is (8 / 35)^2 / 9 and whose largest value is 8 / 35, at the ends."""
    x = np.linspace(-1.0, 1.0, 4001)
    found = roughness(x, x**4, window=2.0)
    assert found.rms == pytest.approx(8 / 35 / 3, rel=1e-3)
    assert found.largest == pytest.approx(8 / 35, rel=2e-3)


def test_a_wave_is_seen_whole_and_scales():
    wave = 0.01 * np.sin(2 * np.pi * X / 3.3)
    found = roughness(X, cubic(X) + wave)
    assert found.rms == pytest.approx(0.01 / np.sqrt(2), rel=0.1)
    scaled = roughness(10 * X, 7 * wave, window=200.0)
    assert scaled.rms == pytest.approx(7 * roughness(X, wave).rms)


def test_the_worst_window_counts_to_the_last_point():
    values = cubic(X)
    values[-1] += 1.0
    end = roughness(X, values)
    assert end.largest > 0.3
    assert end.worst > roughness(X[:60], values[:60]).worst + 0.1
    alone = roughness(X[-21:], values[-21:])
    assert end.worst == pytest.approx(alone.rms)
    assert end.rms == pytest.approx(alone.rms / np.sqrt(61))  # of 61 windows it is in one


def test_a_step_is_between_neighbours_and_never_across_a_gap():
    assert roughness([0, 1, 2, 3], [0.0, 0.5, 0.25, 4.0]).step == 3.75
    assert roughness([3, 1, 2, 0], [4.0, 0.5, np.nan, 0.0]).step == 0.5


def test_windows_with_few_points_are_not_judged():
    few = roughness(X[:5], X[:5] ** 4)
    assert np.isnan([few.rms, few.largest]).all()
    assert np.isnan(roughness(X, np.sin(X), window=4.0).rms)
    nothing = roughness([], [])
    assert isinstance(nothing, Roughness)
    assert np.isnan([nothing.rms, nothing.largest, nothing.step]).all()


def measured(values, sizes=None, floor=0.0):
    return pool(windows(ANGLES, values, sizes=sizes, floor=floor))


def test_a_cubic_leaves_nothing_and_has_its_steps():
    x = (ANGLES - 50) / 50
    found = measured(3 - x + 2 * x**2 + x**3)
    assert (found.rms, found.largest) == pytest.approx((0, 0), abs=1e-12)
    assert found.step == pytest.approx(np.abs(np.diff(3 - x + 2 * x**2 + x**3)).max())
    assert [w.residuals.size for w in windows(ANGLES, x)] == [IN_WINDOW] * WINDOWS


def test_a_saw_leaves_its_amplitude_less_what_a_cubic_follows():
    # Of +1, -1, ... at 11 points, an even function, the cubic follows the part in 1 and x^2 - 10,
    # whose squares sum up to 11 and 858.
    x = np.arange(-5, 6)
    followed = 1 / 11 + ((-1.0) ** x @ (x**2 - 10)) ** 2 / 858
    rms = np.sqrt(1 - followed / 11)
    assert measured(0.3 * SAW + ANGLES).rms == pytest.approx(0.3 * rms, rel=1e-12)
    assert rms > 0.95


def test_a_kink_and_a_step_show_where_they_are():
    kink, step = np.abs(ANGLES - 60), np.where(ANGLES > 60, 1.0, 0.0)
    for curve in (kink, step):
        rough = {w.middle: np.abs(w.residuals).max() for w in windows(ANGLES, curve)}
        assert max(rough.values()) == measured(curve).largest > 0.2
        assert all(abs(m - 60) <= 10 for m, most in rough.items() if most > 1e-9)
    assert measured(step).step == 1
    assert measured(step).largest == pytest.approx(0.5, abs=0.2)


def test_relative_numbers_are_percent_of_the_windows_own_size_and_at_least_of_the_floor():
    curve = 2.0 + 0.02 * SAW
    absolute, relative = measured(curve), measured(curve, curve)
    assert relative.rms == pytest.approx(100 * absolute.rms / 2.0, rel=1e-2)
    assert measured(5 * curve, 5 * curve).rms == pytest.approx(relative.rms)
    idle = 1e-9 * SAW
    assert measured(idle, idle).rms > 90
    assert measured(idle, idle, floor=0.1).rms < 1e-5
    for window in windows(ANGLES, idle, sizes=idle, floor=0.1):
        assert window.size == pytest.approx(0.1)


def test_a_gap_leaves_out_points_and_windows_that_have_too_few():
    curve = ANGLES**2 / 100
    curve[[10, 11]] = np.nan
    assert measured(curve).rms == pytest.approx(0, abs=1e-12)
    assert sum(w.residuals.size > 0 for w in windows(ANGLES, curve)) == WINDOWS
    curve[5:30] = np.nan
    judged = [w for w in windows(ANGLES, curve) if w.residuals.size]
    assert all(w.residuals.size >= FEWEST for w in judged)
    assert 0 < len(judged) < WINDOWS
    assert np.isnan(roughness(ANGLES[:10], curve[:10]).rms)
