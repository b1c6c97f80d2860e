"""Samples of a study: moments of the laws, seeds, balance; and answers against closed forms."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.study.answers import (
    MOST_LOST,
    WIDE,
    Indices,
    band,
    indices,
    slopes,
    surface,
    too_few_for_ends,
    too_few_for_indices,
    too_few_for_slopes,
)
from cosim.study.distributions import (
    GridAxis,
    Lognormal,
    Normal,
    TruncatedNormal,
    Uniform,
    axis,
    middle,
)
from cosim.study.sampling import KINDS, block, points, unit_points

EVEN = (np.arange(20000) + 0.5) / 20000
ISHIGAMI = (7.0, 0.1)
"""a and b of sin x1 + a sin^2 x2 + b x3^4 sin x1 on (-pi, pi)."""


@pytest.mark.parametrize(
    ("law", "mean", "sd"),
    [
        (Normal(100.0, 10.0), 100.0, 10.0),
        (Lognormal(105.38, 85.06), 105.38, 85.06),
        (Uniform(-2.0, 4.0), 1.0, 6 / 12**0.5),
        # half a normal: mean sqrt(2 / pi), variance 1 - 2 / pi
        (TruncatedNormal(0.0, 1.0, 0.0, 1e3), (2 / pi) ** 0.5, (1 - 2 / pi) ** 0.5),
    ],
)
def test_a_law_has_the_moments_that_it_states(law, mean, sd):
    values = law.quantile(EVEN)
    assert values.mean() == pytest.approx(mean, rel=2e-3)
    assert values.std() == pytest.approx(sd, rel=1e-2)


def test_a_truncated_normal_stays_inside_and_keeps_its_shape():
    law = TruncatedNormal(0.0, 1.0, -1.0, 0.5)
    values = law.quantile(EVEN)
    assert values.min() >= -1.0
    assert values.max() <= 0.5
    whole = Normal(0.0, 1.0).quantile(EVEN)
    kept = whole[(whole > -1.0) & (whole < 0.5)]
    assert np.median(values) == pytest.approx(np.median(kept), abs=1e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Normal(1.0, 0.0),
        lambda: Lognormal(-1.0, 1.0),
        lambda: Uniform(2.0, 1.0),
        lambda: TruncatedNormal(0.0, 1.0, 1.0, 1.0),
        lambda: axis(0.0, 1.0, 3, "log"),
    ],
)
def test_a_law_that_is_none_is_refused(make):
    with pytest.raises(InputError):
        make()


def test_ranges_and_middles():
    assert axis(1.0, 100.0, 3, "log").values == pytest.approx((1.0, 10.0, 100.0))
    assert axis(0.0, 1.0, 3, "linear").values == (0.0, 0.5, 1.0)
    assert middle(Uniform(2.0, 4.0)) == 3.0
    assert middle(GridAxis((5.0, 1.0))) == 5.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_sample(kind):
    first, again, other = (unit_points(kind, 3, 16, seed, False) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert ((first > 0) & (first < 1)).all()


def test_latin_hypercube_and_sobol_fill_every_stratum():
    for kind in ("latin_hypercube", "sobol"):
        strata = np.sort((16 * unit_points(kind, 4, 16, 3, False)).astype(int), axis=0)
        assert np.array_equal(strata, np.tile(np.arange(16)[:, None], 4))


def test_saltelli_changes_one_column_at_a_time():
    for second_order in (False, True):
        size = block(3, second_order)
        found = unit_points("saltelli", 3, 8, 1, second_order).reshape(8, size, 3)
        first, last = found[:, 0], found[:, -1]
        for j in range(3):
            mixed = first.copy()
            mixed[:, j] = last[:, j]
            assert np.array_equal(found[:, 1 + j], mixed)


@pytest.mark.parametrize("kind", ["sobol", "saltelli"])
def test_a_sequence_needs_a_power_of_two(kind):
    with pytest.raises(InputError, match="64 or 128"):
        unit_points(kind, 2, 100, 1, False)


def test_points_cross_samples_with_axes_in_the_files_order():
    laws = (GridAxis(("a", "b")), Uniform(0.0, 10.0), GridAxis((1.0, 2.0)))
    found = points(laws, np.array([[0.1], [0.9]]))
    assert found[:4] == [("a", 1.0, 1.0), ("a", 1.0, 2.0), ("b", 1.0, 1.0), ("b", 1.0, 2.0)]
    assert found[4] == ("a", 9.0, 1.0)
    assert points((GridAxis((1.0, 2.0)),), None) == [(1.0,), (2.0,)]


def ishigami(n: int, second_order: bool) -> np.ndarray:
    x = 2 * pi * unit_points("saltelli", 3, n, 1, second_order) - pi
    a, b = ISHIGAMI
    return np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])


def closed_form_indices() -> tuple[np.ndarray, np.ndarray, float]:
    """First-order and total indices of Ishigami and Homma's function, and that of x1 with x3."""
    a, b = ISHIGAMI
    one, two = 0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8
    both = b**2 * pi**8 * (1 / 18 - 1 / 50)
    whole = one + two + both
    return np.array([one, two, 0]) / whole, np.array([one + both, two, both]) / whole, both / whole


@pytest.mark.parametrize("second_order", [False, True])
def test_indices_are_those_of_the_closed_form(second_order):
    found = indices(ishigami(4096, second_order), 3, second_order)
    assert isinstance(found, Indices)
    first, total, both = closed_form_indices()
    assert found.first == pytest.approx(first, abs=0.02)
    assert found.total == pytest.approx(total, abs=0.02)
    assert (np.abs(found.first - first) < 2 * found.first_conf + 1e-3).all()
    if second_order:
        assert found.second is not None
        assert found.second[0, 2] == pytest.approx(both, abs=0.03)


def test_a_failed_run_takes_its_block_with_it_and_no_more():
    values = ishigami(1024, False)
    values[7] = np.nan  # of the second block of five
    found, without = indices(values, 3, False), indices(np.delete(values, np.s_[5:10]), 3, False)
    assert isinstance(found, Indices)
    assert isinstance(without, Indices)
    assert (found.blocks, found.planned) == (1023, 1024)
    assert np.array_equal(found.first, without.first)
    assert np.array_equal(found.total_conf, without.total_conf)


def test_indices_say_why_there_are_none():
    values = ishigami(64, False)
    values[:: round(5 / (2 * MOST_LOST))] = np.nan
    assert "blocks of the sample hold a run without a value" in str(indices(values, 3, False))
    assert "the same in every run" in str(indices(np.ones(5 * 16), 3, False))
    assert "too few" in str(indices(ishigami(4, False), 3, False))


def test_slopes_of_a_line():
    x = unit_points("sobol", 2, 256, 1, False)
    found = slopes(x, 3 * x[:, 0] - 4 * x[:, 1])
    assert found is not None
    assert found.slope == pytest.approx(np.array([0.6, -0.8]), abs=0.02)
    assert found.r2 == pytest.approx(1)
    assert found.rms == pytest.approx(0, abs=1e-12)
    off = np.random.default_rng(0).choice([-0.1, 0.1], 256)
    assert slopes(x, 3 * x[:, 0] + off).rms == pytest.approx(0.1, rel=0.02)
    assert slopes(x[:4], x[:4, 0]) is None
    assert slopes(np.c_[x[:, 0], x[:, 0]], x[:, 0]) is None


def test_a_surface_is_exact_for_a_quadratic_and_no_surface_for_noise():
    x = 10 + 5 * unit_points("sobol", 3, 128, 1, False)
    found = surface(x, 1 + x[:, 0] * x[:, 1] - 0.3 * x[:, 2] ** 2)
    assert found is not None
    assert found.held_out == pytest.approx(1, abs=1e-9)
    at = np.array([[12.0, 11.0, 13.0]])
    assert found(at) == pytest.approx(1 + 132 - 0.3 * 169)
    assert found.rms == pytest.approx(0, abs=1e-10)
    noise = np.random.default_rng(0).normal(size=128)
    fitted = surface(x, noise)
    assert fitted is not None
    assert fitted.held_out < 0 < fitted.r2


def test_a_pair_gives_what_its_product_does_and_squares_do_not_count():
    x = 10 * unit_points("sobol", 3, 128, 1, False)
    y = 2 * x[:, 0] - x[:, 1] + 0.05 * x[:, 0] * x[:, 1] - 0.02 * x[:, 1] * x[:, 2] + x[:, 2] ** 2
    found = surface(x, y)
    a, b, c = np.ptp(x, axis=0)
    assert list(found.pairs) == [(0, 1), (1, 2), (0, 2)]
    assert list(found.pairs.values()) == pytest.approx([0.05 * a * b, -0.02 * b * c, 0], abs=1e-9)
    summed = surface(x, 2 * x[:, 0] - x[:, 1])
    assert list(summed.pairs.values()) == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_surface_holds_out_rows_that_tell_each_others_values():
    """Noise that five rows share looks predictable where they are not held out together."""
    x = unit_points("sobol", 2, 64, 1, False)
    twins, noise = np.repeat(x, 5, axis=0), np.repeat(np.random.default_rng(0).normal(size=64), 5)
    apart, together = surface(twins, noise), surface(twins, noise, together=5)
    assert apart is not None
    assert together is not None
    assert together.held_out < apart.held_out
    assert surface(x[:11], x[:11, 0]) is None


def test_a_band_is_of_what_there_is():
    found = band(np.array([1.0, np.nan, 3.0, 2.0]))
    assert found is not None
    assert (found.runs, found.mean, found.sd) == (3, 2.0, 1.0)
    assert found.quantiles[2] == 2.0
    assert band(np.array([1.0, np.nan])) is None


def test_wide_intervals_of_indices_say_how_many_blocks_would_do():
    names = ["one", "two", "three"]
    coarse, fine = (indices(ishigami(n, False), 3, False) for n in (32, 4096))
    assert isinstance(coarse, Indices)
    assert isinstance(fine, Indices)
    said = too_few_for_indices(coarse, names)
    widest = max(coarse.first_conf.max(), coarse.total_conf.max())
    assert f"±{widest:.2g} by 32 blocks" in said
    assert f"some {float(f'{32 * (widest / WIDE) ** 2:.2g}'):.0f} would bring it" in said
    assert not too_few_for_indices(fine, names)


def test_a_slope_is_known_by_many_runs_and_not_by_few():
    x = unit_points("sobol", 2, 1024, 1, False)
    y = x[:, 0] + np.random.default_rng(0).normal(size=1024)
    few, many = slopes(x[:64], y[:64]), slopes(x, y)
    assert few is not None
    assert many is not None
    assert too_few_for_slopes(few, 64, "ab").endswith("would bring it to ±0.1")
    assert not too_few_for_slopes(many, 1024, "ab")


def test_the_ends_of_the_middle_are_known_from_as_many_runs_as_the_binomial_law_asks():
    assert 1 - 0.975**119 >= 0.95 > 1 - 0.975**118
    assert "by 118 runs" in too_few_for_ends(118)
    assert not too_few_for_ends(119)
