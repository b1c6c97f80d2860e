"""Morris' screening and the surrogate of a study: against lines, products and Ishigami's
function."""

from __future__ import annotations

import json
from math import pi
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from cosim.study import open_study
from cosim.study.answers import screening
from cosim.study.distributions import Lognormal
from cosim.study.plots import draw_screening
from cosim.study.results import StudyResults
from cosim.study.sampling import LEVELS, count_points, unit_points
from tests.helpers.fixed_posture import HELD

BETWEEN = (LEVELS - 1) / LEVELS
"""From the lowest level to the highest, of the unit interval."""
PLAIN = """
case = "held.toml"
sampling = {{ kind = "{kind}", n = {n}, seed = 3 }}
[parameters.PIP]
label = "angle of the PIP"
distribution = "uniform"
low = "20 deg"
high = "60 deg"
settings = ["finger.posture.PIP={{value}}"]
[parameters.stiffness]
label = "stiffness of the PIP"
distribution = "lognormal"
mean = "40 N*mm/rad"
sd = "8 N*mm/rad"
settings = ["finger.passive.PIP.stiffness={{value}}"]
[parameters.idle]
label = "angle of the MCP"
distribution = "uniform"
low = "10 deg"
high = "20 deg"
settings = ["finger.posture.MCP={{value}}"]
[outputs]
torque = "joint_torque_Nmm.passive.PIP"
"""


def ishigami(x: np.ndarray) -> np.ndarray:
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def a_study(x: np.ndarray, y: np.ndarray, kind: str = "latin_hypercube") -> StudyResults:
    """A study with this table."""
    names = [f"x{i}" for i in range(x.shape[1])]
    facts = {
        "parameters": {name: name for name in names}, "outputs": {"y": "y"},
        "units": {**dict.fromkeys(names, "mm"), "y": "N"},
        "sampling": {"kind": kind, "second_order": False},
    }  # fmt: skip
    study = StudyResults(Path(), facts)
    vars(study)["table"] = pd.DataFrame(x, columns=names).assign(y=y)
    return study


def test_morris_goes_along_one_parameter_at_a_time_within_the_levels():
    x = unit_points("morris", 3, 6, 1, False)
    assert len(x) == count_points("morris", 3, 6, False) == 24
    assert set(np.unique(x)) <= {0.125, 0.375, 0.625, 0.875}
    steps = np.diff(x.reshape(6, 4, 3), axis=1)
    assert ((steps != 0).sum(axis=2) == 1).all()
    assert ((steps != 0).sum(axis=1) == 1).all()
    assert np.abs(steps[steps != 0]) == pytest.approx(0.5)


def test_the_effects_of_a_linear_function_are_its_slopes_and_do_not_scatter():
    slopes = np.array([2.0, -3.0, 0.0])
    x = unit_points("morris", 3, 5, 1, False)
    found, _ = screening(x, x @ slopes)
    assert found.mu == pytest.approx(BETWEEN * slopes)
    assert found.mu_star == pytest.approx(BETWEEN * np.abs(slopes))
    assert np.abs([found.sigma, found.sigma_conf, found.mu_star_conf]).max() < 1e-12


def test_the_effects_of_a_product_scatter_as_the_other_factor_does():
    """Of x y: the other factor, between the levels, times the way."""
    x = unit_points("morris", 2, 4000, 1, False)
    found, _ = screening(x, x[:, 0] * x[:, 1])
    levels = (np.arange(LEVELS) + 0.5) / LEVELS
    assert found.mu_star == pytest.approx([BETWEEN * levels.mean()] * 2, rel=0.03)
    assert found.sigma == pytest.approx([BETWEEN * levels.std()] * 2, rel=0.03)
    error = np.abs(found.mu_star - BETWEEN * levels.mean())
    assert (error < 3 * found.mu_star_conf).all()
    assert (found.sigma_conf < 0.02).all()


def test_a_skew_distribution_has_the_effects_of_its_levels():
    u = unit_points("morris", 2, 8, 1, False)
    law = Lognormal(1.0, 2.0)
    x = np.column_stack([law.quantile(u[:, 0]), u[:, 1]])
    found, _ = screening(x, u[:, 0])  # linear in the levels
    assert found.mu == pytest.approx([BETWEEN, 0.0])
    assert found.sigma == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_failed_run_takes_its_trajectory_with_it():
    x = unit_points("morris", 3, 20, 1, False)
    y = x @ [1.0, 2.0, 3.0]
    y[5] = np.nan
    found, _ = screening(x, y)
    assert (found.trajectories, found.planned) == (19, 20)
    y[[9, 13]] = np.nan
    assert screening(x, y)[1].startswith("no effects: 3 of 20 trajectories hold")
    assert screening(x[:4], y[:4])[1] == "no effects: 1 trajectories are too few; at least 2"


def test_a_study_screens_its_parameters_and_draws_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("held.toml").write_text(HELD, encoding="utf-8")
    Path("screen.toml").write_text(PLAIN.format(kind="morris", n=6), encoding="utf-8")
    done = CliRunner().invoke(app, ["study", "screen.toml", "--workers", "0"])
    assert done.exit_code == 0, done.output
    study = open_study("studies/screen")
    found = study.screening("torque")
    assert found.mu[2] == pytest.approx(0)
    assert (found.mu[:2] < 0).all()
    assert (found.sigma[:2] > 0).all()
    folder = Path("studies/screen")
    lines = (folder / "screening.csv").read_text().splitlines()
    assert lines[0] == "output,parameter,mu,mu_star,mu_star_conf,sigma,sigma_conf"
    assert len(lines) == 4
    told = json.loads((folder / "answers.json").read_text())["outputs"]["torque"]["morris"]
    assert told["mu_star"]["PIP"] == pytest.approx(found.mu_star[0])
    assert told["trajectories"] == 6
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "Morris' scheme, 6 trajectories" in page or "Morris&#39; scheme" in page
    assert "Morris' measures as numbers" in page
    assert "not how they spread over the distributions" in page
    assert not [text for text in study.too_few("torque") if "middle 95 %" in text]
    axes = draw_screening(study, "torque").axes[0]
    assert "(N mm)" in axes.get_xlabel()
    assert draw_screening(a_study(np.eye(3), np.ones(3)), "y") is None


def test_a_grid_and_morris_do_not_go_together(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("held.toml").write_text(HELD, encoding="utf-8")
    text = PLAIN.format(kind="morris", n=6).replace(
        'distribution = "uniform"\nlow = "10 deg"\nhigh = "20 deg"', 'values = ["10 deg", "20 deg"]'
    )
    Path("screen.toml").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(app, ["check", "screen.toml"])
    assert "morris's scheme samples all of them; idle has values" in done.output


@pytest.mark.slow
def test_a_surrogate_of_ishigamis_function_is_as_good_as_it_says():
    x = 2 * pi * unit_points("latin_hypercube", 3, 220, 1, False) - pi
    found = a_study(x, ishigami(x)).surrogate("y")
    new = pi * (2 * np.random.default_rng(5).random((400, 3)) - 1)
    new = np.clip(new, found.low, found.high)
    answers = found(pd.DataFrame(new, columns=["x0", "x1", "x2"]))
    true = ishigami(new)
    errors = answers["mean"] - true
    q2 = 1 - (errors**2).mean() / true.var()
    assert found.q2 > 0.9
    assert q2 > found.q2 - 0.02  # of all runs, where the folds had four fifths
    assert np.sqrt((errors**2).mean()) < 1.2 * found.rms
    assert found.covered > 0.8
    assert np.mean(np.abs(errors) < 1.96 * answers["sd"]) > 0.8
    assert found.unit == "N"


def test_a_poor_surrogate_is_refused_unless_asked_for():
    rng = np.random.default_rng(1)
    study = a_study(rng.random((60, 2)), rng.normal(size=60))
    with pytest.raises(InputError, match=r"explains .* of runs held out .*allow_poor"):
        study.surrogate("y")
    assert study.surrogate("y", allow_poor=True).q2 < 0.5


def test_a_surrogate_says_what_it_cannot_do():
    x = np.random.default_rng(2).random((40, 2))
    found = a_study(x, x @ [1.0, 2.0]).surrogate("y")
    assert found.q2 > 0.999
    with pytest.raises(InputError, match=r"x1 = 1.5 lies outside"):
        found(pd.DataFrame({"x0": [0.5], "x1": [1.5]}))
    with pytest.raises(InputError, match="lack the column x1"):
        found(pd.DataFrame({"x0": [0.5]}))
    with pytest.raises(InputError, match=r"expected|could not convert"):
        found(pd.DataFrame({"x0": ["wide"], "x1": [0.5]}))
    with pytest.raises(InputError, match="at least 20 runs"):
        a_study(x[:10], x[:10] @ [1.0, 2.0]).surrogate("y")
    with pytest.raises(InputError, match="same in every run"):
        a_study(x, np.ones(40)).surrogate("y")


@pytest.mark.slow
def test_the_command_answers_points(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("held.toml").write_text(HELD, encoding="utf-8")
    Path("plain.toml").write_text(PLAIN.format(kind="latin_hypercube", n=40), encoding="utf-8")
    Path("points.csv").write_text("PIP,stiffness,idle\n30,40,15\n45,38,12\n", encoding="utf-8")
    call = ["study", "plain.toml", "--workers", "0", "--surrogate", "points.csv"]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    assert "2 points answered" in done.output
    table = pd.read_csv("studies/plain/surrogate.csv")
    exact = -np.array([40, 38]) * np.radians([30, 45])
    assert table["torque"].to_numpy() == pytest.approx(exact, rel=0.02)
    assert (table["torque_sd"] > 0).all()
    Path("points.csv").write_text("PIP,stiffness,idle\n90,40,15\n", encoding="utf-8")
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 2
    assert "PIP = 90 lies outside" in done.output
