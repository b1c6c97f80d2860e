"""Results over a parameter: where they stand, how rough they are, what is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cosim
from cosim.results.sweep import describe_sweep, sweep_over
from cosim.roughness import roughness
from cosim.study.results import StudyResults

PIP, FORCE = "finger.posture.PIP", "fingertip_force_N.dorsal"


@pytest.fixture(scope="module")
def results() -> list[cosim.Result]:
    case = cosim.load("pulley_edc")
    return cosim.run_many([case.replace({PIP: f"{a} deg"}) for a in range(40, 52)])


def test_a_sweep_has_the_parameter_in_its_unit_and_a_gap_where_a_run_failed(results):
    sweep = sweep_over([*results[:4], cosim.ConvergenceError("none"), *results[5:]], PIP)
    assert sweep.unit == "deg"
    np.testing.assert_allclose(sweep.place, np.arange(40.0, 52.0))
    assert np.flatnonzero(np.isnan(sweep.values(FORCE))).tolist() == [4]
    figure = cosim.plot_over(list(sweep.results), PIP, [FORCE, "slip_ratio", "posture_deg.PIP"])
    assert [a.get_ylabel() for a in figure.axes] == ["N", "1", "deg"]
    (line,) = figure.axes[0].lines
    assert np.isnan(line.get_ydata()).sum() == 1
    assert "roughness" in line.get_label()


def test_many_runs_say_how_rough_they_are_along_the_one_number_that_differs(results):
    words = describe_sweep(results)
    rms = roughness(np.arange(40, 52), [r.tip_force["dorsal"] for r in results]).rms
    assert words.startswith(f"along {PIP} a cubic leaves {rms:.2g} N of {FORCE}")
    other = cosim.run(cosim.load("pulley_edc", ["tendons.EDC.tension=9 N"]))
    assert describe_sweep([*results, other]) == describe_sweep(results[:5]) == ""


@pytest.mark.parametrize(
    ("parameter", "quantity", "words"),
    [
        ("finger.posture.XIP", FORCE, "key of a number"),
        ("finger.tip.kind", FORCE, "is 'point'"),
        (PIP, "fingertip_force_N.dorsl", "did you mean"),
    ],
)
def test_what_is_no_number_is_refused(results, parameter, quantity, words):
    with pytest.raises(cosim.InputError, match=words):
        cosim.plot_over(results, parameter, quantity)
    with pytest.raises(cosim.InputError, match="no run that has ended"):
        cosim.plot_over([cosim.ConvergenceError("none")], PIP)


def test_a_study_over_one_number_knows_how_rough_it_is():
    facts = {"parameters": {"PIP": ""}, "outputs": ["F"], "units": {"PIP": "deg"}, "sampling": None}
    x = np.arange(40.0, 60.0)
    study = StudyResults(Path(), facts)
    study.__dict__["table"] = pd.DataFrame({"PIP": x, "F": x**3 + 0.1 * (-1) ** x})
    assert study.roughness("F").rms == pytest.approx(0.1, rel=0.05)
    assert StudyResults(Path(), {**facts, "sampling": {"kind": "sobol"}}).roughness("F") is None
