"""Bands of uncertainty of any case: percentiles in closed form, curves, the cost that is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import app
from cosim.errors import InputError
from cosim.study import open_study
from cosim.study import page as page_module
from cosim.study.answers import too_few_for_ends
from cosim.study.plan import read_plan
from meshes.skeleton import JOINTS
from tests.helpers.fixed_posture import HELD

STUDY = """
case = "held.toml"
bands = true
[sampling]
kind = "latin_hypercube"
n = 20
seed = 1
[parameters.stiffness]
distribution = "uniform"
low = 0.5
high = 1.5
scale = ["finger.passive.PIP.stiffness", "hood.regions.*.c1"]
[parameters.posture]
distribution = "uniform"
low = "-2 deg"
high = "2 deg"
shift = ["finger.posture.PIP"]
[parameters.matrix]
label = "matrix between the fibres"
distribution = "uniform"
low = 0.5
high = 1.5
scale = ["hood.regions.*.c1"]
[outputs]
torque = "joint_torque_Nmm.passive.PIP"
strain = "fibre_strain_percent.central_slip.p95"
"""
TORQUE = "joint_torque_Nmm.passive.PIP"


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    (tmp_path / "held.toml").write_text(HELD, encoding="utf-8")
    (tmp_path / "spread.toml").write_text(STUDY, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page_module, "picture_address", lambda *_: "")
    return tmp_path


def study(*words: str):
    return CliRunner().invoke(app, ["study", "spread.toml", *words, "--workers", "0"])


def torques(angle: float, samples: np.ndarray) -> np.ndarray:
    """N mm of the joint's spring, 40 N mm/rad from 0 deg, at samples (n, 2) of factor and deg."""
    return -40 * samples[:, -2] * np.radians(angle + samples[:, -1])


def test_percentiles_are_the_closed_form_s_beside_the_case_as_it_is(place):
    done = study("--set", "finger.posture.PIP=30 deg")
    assert done.exit_code == 0, done.output
    assert "21 runs of held: as it is and at 20 samples of 2 inputs" in done.output
    assert "1 left out, of which the case has nothing: matrix between the fibres" in done.output
    assert "hardly known by 20 runs" in done.output
    found = open_study(place / "studies" / "spread")
    row = found.bands.set_index("quantity").loc[TORQUE]
    samples = found.table[["stiffness", "posture"]].to_numpy(float)
    assert row.as_it_is == pytest.approx(-40 * np.radians(30))
    expected = np.percentile(torques(30, samples), (5, 50, 95))
    assert row[["p5", "p50", "p95"]].tolist() == pytest.approx(expected.tolist())
    assert row.runs == 20
    assert found.outputs == ("torque",)  # a hood without a sheet has no strain
    assert "PIP angle" in set(found.bands.meaning)  # among what one asks for first
    assert (place / "studies" / "spread" / "bands.png").is_file()


def test_one_sample_that_ended_is_no_band(place):
    """Of two, the other of which has a spring of less than no stiffness."""
    wide = STUDY.replace("low = 0.5\nhigh = 1.5", "low = -100\nhigh = 102", 1)
    (place / "spread.toml").write_text(wide, encoding="utf-8")
    bands = cosim.run_study("spread.toml", place / "out", samples=2).bands
    row = bands.set_index("quantity").loc[TORQUE]
    assert (row.runs, row[["p5", "p50", "p95"]].isna().tolist()) == (1, [True] * 3)
    assert row.as_it_is == pytest.approx(-40 * np.radians(45))


def test_over_a_key_every_sample_is_solved_at_each_of_its_values(place):
    results = cosim.run_study(
        "spread.toml", place / "out", samples=8, over="finger.posture.PIP=20 deg, 50 deg"
    )
    bands = results.bands[results.bands.quantity == TORQUE].set_index("finger.posture.PIP")
    drawn = results.table[results.table["finger.posture.PIP"] == 50]
    samples = drawn[["stiffness", "posture"]].to_numpy(float)
    assert len(results.table) == 16
    for angle in (20.0, 50.0):
        row, each = bands.loc[angle], torques(angle, samples)
        assert row.as_it_is == pytest.approx(-40 * np.radians(angle))
        assert row.p5 == pytest.approx(np.percentile(each, 5))
        assert row.p95 == pytest.approx(np.percentile(each, 95))


def test_bands_of_a_motion_are_over_its_time_too(place):
    """They begin in the case's posture and those of the samples, and end where the numbers do."""
    moving = HELD.replace('"posture"', '"free"').replace("0.04", "0.01")
    moving += '[forward]\nduration = "8 ms"\nstep = "2 ms"\nmust_rest = false\n'
    moving += '[forward.adaptive]\ntolerance = "1e-4 rad"\n'  # each run has steps of its own
    (place / "held.toml").write_text(moving, encoding="utf-8")
    results = cosim.run_study("spread.toml", place / "out", samples=5)
    over = results.bands_over_time.set_index(["quantity", "time_s"])
    assert {q for q, _ in over.index} == {f"posture_deg.{j}" for j in JOINTS}
    pip = over.loc["posture_deg.PIP"]
    assert (pip.index[0], pip.index[-1]) == pytest.approx((0.0, 8e-3))
    assert len({len(r.time) for r in map(results.arrays, range(5))}) > 1
    begun = np.percentile(45 + results.table.posture.to_numpy(float), (5, 50, 95))
    assert pip.iloc[0][["p5", "p50", "p95"]].tolist() == pytest.approx(begun.tolist())
    assert pip.iloc[0].as_it_is == pytest.approx(45)
    ends = results.bands.set_index("quantity").loc["posture_deg.PIP"]
    names = ["as_it_is", "p5", "p50", "p95", "runs"]
    assert pip.iloc[-1][names].tolist() == pytest.approx(ends[names].tolist())
    assert (pip.unit == "deg").all()
    assert (pip.meaning == "PIP angle").all()
    assert abs(pip.p50.iloc[-1] - pip.p50.iloc[0]) > 1
    assert (place / "out" / "spread" / "bands_over_time.png").is_file()


def test_the_cost_of_a_shipped_study_is_said_first_in_python_too(place):
    said: list[str] = []
    with pytest.raises(ValueError, match="stop"):
        cosim.run_study("input_uncertainty", place, 1, _stop_after(said), case="isometric_edc")
    assert "17 runs of isometric_edc: as it is and at 16 samples of" in said[0]


def _stop_after(said: list[str]):
    def progress(text: str) -> None:
        said.append(text)
        raise ValueError("stop")

    return progress


def test_a_case_without_a_result_is_said_in_words(place):
    done = study("--set", "finger.tip.kind=point", "--set", "solve.max_iterations=1")
    assert done.exit_code == 2
    assert "no run of held has a result" in done.output


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ("finger.posture.PIP", "write KEY=VALUE, VALUE"),
        ("finger.posture.PIP=30 deg", "write KEY=VALUE, VALUE"),
        ("finger.tip.kind=posture, point", "a curve is over numbers"),
        ("finger.posture.PIP=30 deg, 1 rad", "several units"),
        ("finger.posture.XIP=30 deg, 40 deg", "XIP"),
    ],
)
def test_a_bad_key_to_pass_over_is_refused(place, over, says):
    with pytest.raises(InputError, match=says):
        read_plan("spread.toml", over=over)


def test_samples_of_a_study_without_any_and_too_many_are_refused(place):
    text = 'case = "held.toml"\n[parameters."finger.posture.PIP"]\nvalues = ["20 deg", "30 deg"]'
    (place / "grid.toml").write_text(f'{text}\n[outputs]\ntorque = "{TORQUE}"', encoding="utf-8")
    with pytest.raises(InputError, match="no parameter has a distribution"):
        read_plan("grid.toml", samples=4)
    with pytest.raises(InputError, match=r"limits\.runs allows"):
        read_plan("spread.toml", samples=50_001, over="finger.posture.PIP=20 deg, 30 deg")


def test_a_case_that_has_none_of_the_inputs_is_refused(place):
    text = STUDY.replace('"finger.passive.PIP.stiffness", ', "").replace(
        "finger.posture.PIP", "a.b"
    )
    (place / "spread.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="none of the inputs"):
        read_plan("spread.toml")


def test_ends_of_a_band_take_runs_beyond_both():
    """With n runs one lies beyond an end of probability q by 1 - q^n."""
    assert "it takes 59" in too_few_for_ends(58, 0.9)
    assert too_few_for_ends(59, 0.9) == ""
