"""The roughness of curves whose answer is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.roughness import Roughness, roughness

X = np.linspace(-5.0, 75.0, 81)


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
    assert end.rms > roughness(X[:60], values[:60]).rms + 0.1


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
