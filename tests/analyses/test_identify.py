"""Identification: twins must give back known parameters; what is not told is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim.analyses.identify.fit import Fit, confidence, fit, identifiability, interval, miss
from cosim.analyses.identify.parameters import FitParameter, Free, free_built_in, read_free
from cosim.analyses.trials.workers import run_trial
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.outcome import Outcome
from cosim.pipeline import run_case
from cosim.results.compare import Target, read_targets, value_of
from tests.helpers.fixed_posture import HELD
from tests.helpers.folders import CASE_DATA

PASSIVE, PULL = "joint_torque_Nmm.passive.PIP", "joint_torque_Nmm.EDC.MCP"
COARSE = ("hood.mesh.quads=120",)
LEE = "strain_lee2008_average_ti"
STRAIN_DATA = "lee2008_strain.csv"
STRAINS = "difference.marker_strain_percent"


@pytest.fixture
def held(tmp_path) -> Path:
    """Bones held at 30/45/15 deg: the PIP's passive torque is -k times its angle, that of the EDC
    its tension times a constant."""
    file = tmp_path / "held.toml"
    file.write_text(HELD, encoding="utf-8")
    return file


def stiffness(joint: str = "PIP", low: float = 1.0, high: float = 1000.0) -> FitParameter:
    key = f"finger.passive.{joint}.stiffness={{value}}"
    return FitParameter(f"k {joint}", "N*mm/rad", low, high, max(60.0, low), (key,))


TENSION = FitParameter("T", "N", 0.1, 50.0, 2.5, ("tendons.EDC.tension={value}",))


def of(*parameters: FitParameter) -> Free:
    """Without the built-in ones."""
    return Free(
        parameters,
        lambda values: tuple(
            t.replace("{value}", p.format_value(values[p.name]))
            for p in parameters
            for t in p.templates
        ),
    )


def targets_of(case: Path, settings: tuple[str, ...], *quantities: str, sd: float) -> list[Target]:
    """Targets that the case with settings meets."""
    summary = run_case(load_case(case, settings)).summary
    return [
        Target(
            q,
            q,
            "%" if "percent" in q else "N mm",
            value_of(summary, q),
            sd,
            None,
            None,
            "twin",
            "published model",
        )
        for q in quantities
    ]


def twin(held: Path) -> list[Target]:
    truth = ("finger.passive.PIP.stiffness=0.05 N*m/rad", "tendons.EDC.tension=3 N")
    return targets_of(held, truth, PASSIVE, PULL, sd=0.1)


def test_a_twin_gives_back_its_parameters_and_how_sure_they_are(held):
    targets = twin(held)
    found = fit(held, (), of(stiffness(), TENSION), targets)
    assert found.values == pytest.approx({"k PIP": 50.0, "T": 3.0}, rel=1e-4)
    assert [identifiability(found, name) for name in found.values] == ["identified", "identified"]
    # torques are proportional to k and T, so that slopes by their logarithms are the torques
    torque = np.array([abs(t.reference) for t in targets])
    assert found.confidence.deviation == pytest.approx(0.1 / torque, rel=1e-3)
    assert np.abs(found.confidence.correlation - np.eye(2)).max() < 1e-6
    low, high = interval(found, "k PIP")
    assert (low, high) == pytest.approx(
        50 * np.exp(np.array([-1, 1]) * 1.96 * 0.1 / torque[0]), rel=1e-3
    )
    assert found.failures == ()
    assert np.abs(found.misses).max() < 0.1


def test_what_no_target_sees_is_said(held):
    free = of(stiffness(), stiffness("DIP"))
    found = fit(held, (), free, twin(held)[:1], allow_unidentified=True)
    assert found.values["k PIP"] == pytest.approx(50.0, rel=1e-4)
    assert [identifiability(found, name) for name in found.values] == [
        "identified",
        "not identified",
    ]
    assert found.confidence.singular_values[1] == pytest.approx(0.0, abs=1e-9)
    assert interval(found, "k DIP") == pytest.approx((1.0, 1000.0))


def test_a_band_pulls_as_far_as_its_end(held):
    (target,) = twin(held)[:1]
    band = replace(target, reference=None, sd=None, low=-40.0, high=-30.0)
    found = fit(held, (), of(stiffness()), [band])
    assert -40.1 < found.rows[0].model < -39.9 or found.misses == 0
    start = replace(stiffness(), start=45.0)  # -35.3 N mm, inside
    inside = fit(held, (), of(start), [band])
    assert inside.values == {"k PIP": 45.0}
    assert identifiability(inside, "k PIP") == "not identified"


def test_a_row_inside_its_band_does_not_hold_the_others_back(held):
    (target,) = twin(held)[:1]
    idle = replace(target, reference=-30.0, sd=1e-5, low=-1000.0, high=0.0)
    found = fit(held, (), of(stiffness()), [target, idle])
    assert found.values["k PIP"] == pytest.approx(50.0, rel=1e-4)
    assert found.misses[1] == 0
    assert found.confidence.deviation == pytest.approx([0.1 / abs(target.reference)], rel=1e-3)


def test_what_the_targets_cannot_tell_from_a_bound_is_put_there(held):
    near = replace(stiffness("DIP"), start=1.2)
    found = fit(held, (), of(stiffness(), near), twin(held)[:1], allow_unidentified=True)
    assert found.values == pytest.approx({"k PIP": 50.0, "k DIP": 1.0}, rel=1e-4)
    assert identifiability(found, "k DIP") == "at its bound"
    assert [p.name for p in found.within] == ["k PIP"]


def test_a_truth_beyond_the_bounds_ends_at_the_bound(held):
    found = fit(held, (), of(stiffness(low=80.0)), twin(held)[:1])
    assert found.values == {"k PIP": 80.0}
    assert identifiability(found, "k PIP") == "at its bound"
    assert found.within == ()
    assert found.confidence.deviation.size == 0


def test_solves_that_fail_on_the_way_are_listed_and_passed_by(held, monkeypatch):
    def fails_when_soft(source, settings):
        value = float(settings[-1].partition("=")[2].split()[0])
        found = run_trial(source, settings)
        return Outcome("failed", None, ConvergenceError("soft")) if value < 40 else found

    monkeypatch.setattr("cosim.analyses.trials.workers.run_trial", fails_when_soft)
    truth = ("finger.passive.PIP.stiffness=0.06 N*m/rad",)
    target = replace(targets_of(held, truth, PASSIVE, sd=0.1)[0], reference=-47.1239)
    near = replace(stiffness(), start=900.0)
    found = fit(held, (), of(near), [target])
    assert found.values["k PIP"] == pytest.approx(60.0, rel=1e-3)
    with pytest.raises(ConvergenceError, match="soft"):
        fit(held, (), of(replace(near, start=2.0)), [target])


@pytest.mark.slow
def test_a_twin_of_the_hood_gives_back_its_matrix(tmp_path):
    base = load_case(LEE)
    truth = (*COARSE, *(f"hood.regions.{n}.c1=1.1 MPa" for n in base.hood.regions))
    targets = targets_of(base.source, truth, f"{STRAINS}.lateral.mean", sd=0.01)
    only = tmp_path / "free.toml"
    only.write_text("[c1]\nlow = 0.3\nhigh = 3\nstart = 1\n", encoding="utf-8")
    found = fit(base.source, COARSE, read_free(only, base), targets)
    assert found.parameters == (FitParameter("c1", "MPa", 0.3, 3.0, 1.0),)
    assert found.values["c1"] == pytest.approx(1.1, rel=1e-3)
    assert identifiability(found, "c1") == "identified"


@given(st.floats(-20, 20), st.floats(-10, 0), st.floats(0, 10), st.floats(0.1, 5))
def test_a_miss_is_the_distance_from_the_band(model, low, high, sd):
    target = Target("t", "x", "1", 0.0, sd, low, high, "A", "experiment")
    expected = max(model - high, 0) - max(low - model, 0)
    assert miss(target, model) == pytest.approx(expected / sd)
    one_sided = replace(target, reference=None, sd=None, low=None)
    assert miss(one_sided, model) == pytest.approx(max(model - high, 0))
    point = replace(target, low=None, high=None, reference=1.0)
    assert miss(point, model) == pytest.approx((model - 1) / sd)


def test_confidence_of_what_is_told_apart_and_of_what_is_not():
    slopes = np.array([[2.0, 2.0, 0.0], [2.0, -2.0, 0.0]])
    found = confidence(slopes, np.zeros(2))
    assert found.deviation[:2] == pytest.approx([1 / np.sqrt(8)] * 2)
    assert found.deviation[2] == np.inf
    assert np.isnan(found.correlation[2]).all()
    assert found.correlation[0, 1] == pytest.approx(0, abs=1e-12)
    ridge = confidence(np.array([[1.0, 1.0], [1.0, 1.1]]), np.zeros(2))
    inverse = np.linalg.inv(np.array([[2.0, 2.1], [2.1, 2.21]]))
    assert ridge.deviation == pytest.approx(np.sqrt(np.diag(inverse)), rel=1e-6)
    assert ridge.correlation[0, 1] == pytest.approx(
        inverse[0, 1] / np.sqrt(inverse[0, 0] * inverse[1, 1])
    )
    assert confidence(np.zeros((0, 2)), np.zeros(0)).deviation.tolist() == [np.inf, np.inf]


def test_rows_that_miss_by_more_than_their_sds_widen_the_intervals():
    slopes = np.array([[1.0], [1.0], [1.0]])
    assert confidence(slopes, np.array([3.0, -3.0, 0.0])).inflation == pytest.approx(3.0)
    assert confidence(slopes, np.array([0.3, -0.3, 0.0])).inflation == 1.0
    wide = confidence(slopes, np.array([3.0, -3.0, 0.0]))
    assert wide.deviation == pytest.approx([3 / np.sqrt(3)])


def test_the_built_in_parameters_keep_fibres_smooth():
    case = load_case(LEE)
    free = free_built_in(case)
    assert [p.name for p in free.parameters] == ["c1", "toe", "c4"]
    assert [p.start for p in free.parameters] == pytest.approx([0.507821, 0.01, 400.0], rel=1e-5)
    made = load_case(LEE, free.settings({"c1": 0.5, "toe": 0.01, "c4": 150.0})).hood
    for name, law in made.regions.items():
        old = case.hood.regions[name]
        assert (law.c1, law.c5) == (pytest.approx(5e5), old.c5)
        if name.startswith("oblique_fibres"):  # slack until half as long again, in any fit
            assert (law.c4, law.lam_max, law.c3) == (old.c4, 1.5, old.c3)
            continue
        assert law.c4 == 150.0
        assert law.lam_max == pytest.approx(1.01)
        assert law.c3 * law.c4 * np.exp(law.c4 * 0.01) == pytest.approx(law.c5, rel=1e-9)


def test_the_linear_laws_parameters_are_built_in():
    law = (
        "{ kind = 'transversely_isotropic', modulus_along = '100 MPa', modulus_across = '10 MPa', "
        "shear_modulus = '4 MPa', poisson = 0.4, poisson_across = 0.4 }"
    )
    case = load_case("base/one_sheet.toml", (f"hood.regions.central_band={law}",))
    free = free_built_in(case)
    assert {p.name: p.start for p in free.parameters} == pytest.approx(
        {"modulus_across": 10.0, "shear_modulus": 4.0}
    )
    settings = free.settings({"modulus_across": 7.0, "shear_modulus": 3.0})
    assert settings == (
        "hood.regions.central_band.modulus_across=7.0 MPa",
        "hood.regions.central_band.shear_modulus=3.0 MPa",
    )
    with pytest.raises(InputError, match="no region has a law"):
        free_built_in(load_case("base/one_sheet.toml"))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "expected a table"),
        ("c1 = 3", "expected a table"),
        ("[c1", "not valid TOML"),
        ("[c1]\nlow = 2\nhigh = 1", "0 < low < high"),
        ("[c1]\nlow = 0", "0 < low < high"),
        ("[c1]\nlow = '1 MPa'", "low = '1 MPa': expected a number"),
        ("[c1]\nlowest = 1", "unknown lowest"),
        ("[c2]\nlow = 1", "c2: give settings"),
        ("[k]\nlow = 1\nhigh = 2\nsettings = ['a.b']", "list of texts KEY="),
        ("[k]\nlow = 1\nhigh = 2\nsettings = ['a.b={value}']", "lacks start"),
    ],
)
def test_faulty_parameters_are_refused(tmp_path, text, match):
    file = tmp_path / "free.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=match):
        read_free(file, load_case(LEE))


def test_a_target_that_the_run_does_not_have_is_refused(held):
    (target,) = twin(held)[:1]
    absent = replace(target, quantity="joint_torque_Nmm.hood.thumb")
    with pytest.raises(InputError, match="did you mean joint_torque_Nmm"):
        fit(held, (), of(stiffness()), [absent])
    with pytest.raises(InputError, match="no target is for the case held"):
        fit(held, (), of(stiffness()), [replace(target, case="other")])


def test_the_command_writes_a_case_that_does_what_was_fitted(held, tmp_path):
    data, free, out = tmp_path / "data.csv", tmp_path / "free.toml", tmp_path / "sub" / "found.toml"
    data.write_text(
        "name,quantity,unit,reference,sd,low,high,source,kind\n"
        f"torque,{PASSIVE},N mm,-30,0.1,,,A 1999,experiment\n",
        encoding="utf-8",
    )
    free.write_text(
        "[k]\nlow = 1\nhigh = 1000\nstart = 50\nunit = 'N*mm/rad'\n"
        "settings = ['finger.passive.PIP.stiffness={value}']\n",
        encoding="utf-8",
    )
    call = ["identify", str(held), "--targets", str(data), "--free", str(free), "--workers", "1"]
    own = ["--set", "finger.posture.PIP=30 deg", "--set", "tendons.EDC.activation=0.2"]
    done = CliRunner().invoke(app, [*call, *own, "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "57.3" in done.output  # 30 N mm over 30 deg
    text = out.read_text(encoding="utf-8")
    assert "# Identified with `cosim identify` from data.csv" in text
    assert "k = 57.3 N*mm/rad" in text
    assert "A 1999" in text
    found = load_case(out)
    assert found.tendons["EDC"].activation == 0.2
    assert value_of(run_case(found).summary, PASSIVE) == pytest.approx(-30.0, rel=1e-3)
    assert 'extends = "../held.toml"' in text


def test_the_packaged_targets_are_strains_alone():
    rows = read_targets(CASE_DATA / STRAIN_DATA)
    assert len(rows) == 5
    assert all("strain_percent" in row.quantity for row in rows)
    summary = run_case(load_case(LEE, COARSE)).summary
    assert all(value_of(summary, row.quantity) is not None for row in rows)


def test_a_fit_says_what_it_stands_on(held):
    found = fit(held, (), of(stiffness()), twin(held)[:1])
    assert isinstance(found, Fit)
    assert found.settings == ("finger.passive.PIP.stiffness=50.0 N*mm/rad",)
    assert found.solves >= 4
    assert found.start[0].model == pytest.approx(-60 * np.radians(45), rel=1e-6)
