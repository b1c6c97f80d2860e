"""What rows can tell before a fit, and profile likelihoods: against closed forms of linear
models."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.identify.fit import fit
from cosim.analyses.identify.information import check_identifiable, information
from cosim.analyses.identify.profile import LIMIT, profile
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from tests.analyses.test_identify import PASSIVE, TENSION, held, of, stiffness, twin

__all__ = ["held"]
ROWS = np.array([[2.0, 1.0, 0.5], [0.3, -1.0, 2.0], [1.0, 1.0, 1.0], [0.0, 2.0, -1.0]])
BOUNDS = np.full(3, -50.0), np.full(3, 50.0)


def test_a_linear_model_has_its_rank_and_correlation():
    ranges = np.array([1.0, 10.0, 0.5])
    found = information("abc", ROWS, ranges)
    assert (found.rank, found.lost, list(found.faults())) == (3, (), [])
    covariance = np.linalg.inv((ROWS * ranges).T @ (ROWS * ranges))
    sd = np.sqrt(np.diag(covariance))
    assert found.correlation == pytest.approx(covariance / np.outer(sd, sd), abs=1e-9)
    assert found.changes == pytest.approx(np.linalg.norm(ROWS, axis=0) * ranges)
    check_identifiable(found)


def test_what_cannot_be_told_is_named_alone_or_with_what_it_is_confused_with():
    slopes = np.column_stack([ROWS[:, 0], ROWS[:, 1], -2 * ROWS[:, 1], 0 * ROWS[:, 0]])
    found = information(("a", "b", "c", "d"), slopes, np.ones(4))
    assert found.rank == 2
    assert set(found.lost) == {("b", "c"), ("d",)}
    assert np.isnan(found.correlation[1:]).all()
    assert found.correlation[0, 0] == pytest.approx(1)
    with pytest.raises(InputError, match="2 of 4") as error:
        check_identifiable(found)
    assert "b and c: each changes the rows, but they cannot be told apart" in str(error.value)
    assert "d: from bound to bound" in str(error.value)
    assert "--allow-unidentified" in str(error.value)


def test_a_tenth_of_an_sd_over_the_range_is_needed():
    for size, rank in ((0.09, 0), (0.11, 1)):
        assert information("a", np.array([[size / 2]]), np.array([2.0])).rank == rank


def test_parameters_that_do_nothing_are_not_called_confused():
    lines = information("ab", np.array([[0.01, 0.01]]), np.ones(2)).faults()
    start = "{}: from bound to bound all rows together change by 0.01 SD"
    for line, name in zip(lines, "ab", strict=True):
        assert line.startswith(start.format(name))


@pytest.mark.parametrize("i", range(3))
@pytest.mark.parametrize("inflation", [1.0, 1.7])
def test_the_profile_of_a_quadratic_is_the_closed_form(i, inflation):
    """(x - best)^2 / variance, with the variance of the inverse normal matrix."""
    measured = np.array([1.0, -0.5, 0.3, 2.0])
    best = np.linalg.lstsq(ROWS, measured, rcond=None)[0]
    sd = inflation * np.sqrt(np.linalg.inv(ROWS.T @ ROWS)[i, i])
    found = profile(
        "x", i, lambda x: ROWS @ x - measured, lambda x: ROWS, best, BOUNDS, 1.96 * sd, inflation
    )
    above = inflation**2 * ((found.coordinates - best[i]) / sd) ** 2
    assert found.squares - found.least == pytest.approx(above, rel=1e-5, abs=1e-9)
    z = np.sqrt(LIMIT)
    assert found.interval == pytest.approx((best[i] - z * sd, best[i] + z * sd), rel=1e-5)


def test_a_flat_profile_is_open_and_a_wall_ends_it():
    rows = np.array([[1.0, 1.0]])
    bounds = np.full(2, -5.0), np.full(2, 5.0)
    flat = profile("x", 0, lambda x: rows @ x, lambda x: rows, np.zeros(2), bounds, np.inf)
    assert flat.interval == (None, None)
    assert flat.coordinates[[0, -1]] == pytest.approx([-5, 5])

    def fails(x):
        return np.full(1, np.inf) if x[0] > 1.5 else rows @ x

    wall = profile("x", 0, fails, lambda x: rows, np.zeros(2), bounds, np.inf)
    assert np.isnan(wall.squares[-1])
    assert wall.interval == (None, None)

    def no_gradient(x):
        raise ConvergenceError("none")

    lost = profile("x", 0, lambda x: rows @ x, no_gradient, np.zeros(2), bounds, np.inf)
    assert np.isnan(lost.squares[[0, -1]]).all()


def test_an_asymmetric_profile_has_an_asymmetric_interval():
    """exp(x) measured as 1 with an SD of 0.3: the interval is that of exp(x)."""
    found = profile(
        "x", 0,
        lambda x: (np.exp(x) - 1) / 0.3, lambda x: np.exp(x)[:, None] / 0.3,
        np.zeros(1), (np.full(1, -3.0), np.full(1, 3.0)), 1.96 * 0.3,
    )  # fmt: skip
    low, high = found.interval
    z = 0.3 * np.sqrt(LIMIT)
    assert (low, high) == pytest.approx((np.log(1 - z), np.log(1 + z)), abs=0.02)
    assert -low > 1.5 * high


def test_a_fit_that_rows_cannot_tell_is_refused_unless_asked(held):
    free, rows = of(stiffness(), stiffness("DIP")), twin(held)[:1]
    with pytest.raises(InputError, match=r"1 of 2[\s\S]*k DIP"):
        fit(held, (), free, rows)
    found = fit(held, (), free, rows, allow_unidentified=True)
    assert found.before.lost == (("k DIP",),)


@pytest.mark.slow
def test_the_profile_of_a_fit_meets_its_linearised_interval(held):
    """Torques are proportional to k, so that k's interval is 1.96 SD of the torque."""
    targets = twin(held)
    found = fit(held, (), of(stiffness(), TENSION), targets, profiles=True)
    p, of_k = found.parameters[0], found.profiles[0]
    low, high = (p.value(z) for z in of_k.interval)
    by_torque = 50.0 / abs(targets[0].reference)
    assert (low, high) == pytest.approx((50 - 0.196 * by_torque, 50 + 0.196 * by_torque), rel=1e-4)
    part = found.parts[0]
    assert (part.name, part.count) == ("fitted to", 2)
    assert part.end < 0.01 < part.start < part.zero
    assert part.zero == pytest.approx(np.sqrt(np.mean([(t.reference / 0.1) ** 2 for t in targets])))


@pytest.mark.slow
def test_the_command_writes_profiles_and_both_parts(held, tmp_path):
    head = "name,quantity,unit,reference,sd,low,high,source,kind,held_out\n"
    data, free, out = tmp_path / "data.csv", tmp_path / "free.toml", tmp_path / "profiles"
    data.write_text(
        f"{head}torque,{PASSIVE},N mm,-40,1,,,A 1999,experiment,\n"
        f"again,{PASSIVE},N mm,-38,1,,,B 2001,experiment,yes\n",
        encoding="utf-8",
    )
    table = (
        "[{0}]\nlow = 1\nhigh = 1000\nstart = 50\nunit = 'N*mm/rad'\n"
        "settings = ['finger.passive.{0}.stiffness={{value}}']\n"
    )
    free.write_text(table.format("PIP"), encoding="utf-8")
    call = ["identify", str(held), "--targets", str(data), "--free", str(free), "--workers", "1"]
    done = CliRunner().invoke(app, [*call, "--profiles", str(out)])
    assert done.exit_code == 0, done.output
    assert "can tell 1 of 1" in done.output
    assert "held out" in done.output
    lines = list(csv.reader((out / "profiles.csv").read_text().splitlines()))
    assert lines[0] == [
        *("held", "squared_misses", "above_least", "limit_95", "PIP (N*mm/rad)"),
    ]
    assert len(lines) == 14
    assert (out / "profiles.png").stat().st_size > 10_000
    free.write_text(table.format("PIP") + table.format("DIP"), encoding="utf-8")
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 2
    assert "DIP: from bound to bound" in done.output
    assert CliRunner().invoke(app, [*call, "--allow-unidentified"]).exit_code == 0
