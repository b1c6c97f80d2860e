"""A fit over several cases: postures of one, parameters of any sign, rows held out, failures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim.analyses.identify.cases import FitCase, fit_cases, stated_cases
from cosim.analyses.identify.fit import fit_all, identifiability, interval
from cosim.analyses.identify.parameters import FitParameter
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.outcome import Outcome
from cosim.results.compare import Target
from tests.helpers.fixed_posture import HELD

TORQUE = "joint_torque_Nmm.passive.PIP"
ANGLES = (10.0, 30.0, 60.0)
K, REST, SD = 50.0, -7.5, 0.5
"""N mm/rad, deg, N mm: the PIP's torque is -K (angle - REST)."""
PARAMETERS = """
[k]
low = 1
high = 1000
start = 20
unit = "N*mm/rad"
settings = ["finger.passive.PIP.stiffness={value}"]

[rest]
low = -20
high = 10
start = 5
unit = "deg"
scale = "linear"
settings = ["finger.passive.PIP.rest={value}"]
"""
POSTURES = "".join(
    f"[cases.p{angle:.0f}]\nset = ['finger.posture.PIP={angle} deg']\n" for angle in ANGLES
)
REST_ALONE = PARAMETERS[PARAMETERS.index("[rest]") :]


def spring(source, settings) -> Outcome:
    """What a run of the held case says of the PIP's spring."""
    finger = load_case(source, settings).finger
    law, angle = finger.passive["PIP"], finger.posture.angles()["PIP"]
    torque = -1e3 * law.stiffness * (angle - law.rest)
    return Outcome("converged", {"joint_torque_Nmm": {"passive": {"PIP": torque}}})


@pytest.fixture(autouse=True)
def analytic(monkeypatch) -> None:
    """No solves; a test that wants them undoes it."""
    monkeypatch.setattr("cosim.analyses.trials.workers.run_trial", spring)


@pytest.fixture
def held(tmp_path) -> Path:
    file = tmp_path / "held.toml"
    file.write_text(HELD, encoding="utf-8")
    return file


@pytest.fixture
def free(tmp_path) -> Path:
    return write_case(tmp_path, PARAMETERS + POSTURES)


def write_case(folder: Path, text: str) -> Path:
    file = folder / "free.toml"
    file.write_text(text, encoding="utf-8")
    return file


def torque(angle: float, rest: float = REST) -> float:
    return -K * np.radians(angle - rest)


def row(case: str, reference: float, name: str = "torque") -> Target:
    return Target(
        name, TORQUE, "N mm", reference, SD, None, None, "A", "published model", case=case
    )


ROWS = [row(f"p{angle:.0f}", torque(angle)) for angle in ANGLES]


def cases(
    held: Path, free: Path, rows: Sequence[Target], apart: Sequence[Target] = ()
) -> tuple[FitCase, ...]:
    fixed = (f"finger.passive.PIP.stiffness={K} N*mm/rad",)
    return fit_cases(stated_cases([held], fixed, free), free, rows, apart)


def test_postures_of_one_case_give_back_a_parameter_of_either_sign(held, free):
    found = fit_all(cases(held, free, ROWS))
    assert found.values["k"] == pytest.approx(K, rel=1e-4)
    assert found.values["rest"] == pytest.approx(REST, abs=3e-3)
    assert [identifiability(found, name) for name in found.values] == ["identified", "identified"]
    assert [r.target.case for r in found.rows] == ["p10", "p30", "p60"]
    assert found.settings == (
        f"finger.passive.PIP.stiffness={found.values['k']!r} N*mm/rad",
        f"finger.passive.PIP.rest={found.values['rest']!r} deg",
    )
    # the deviations of k and rest by the slopes of -k (angle - rest)
    slopes = [[-K * np.radians(a - REST), np.radians(K)] for a in ANGLES]
    covariance = SD**2 * np.linalg.inv(np.transpose(slopes) @ slopes)
    span = [1.0, 30.0]  # of the logarithm; of the range, deg
    deviation = found.confidence.deviation * span
    assert deviation == pytest.approx(np.sqrt(np.diag(covariance)), rel=2e-3)
    expected = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert found.confidence.correlation[0, 1] == pytest.approx(expected, rel=1e-3)


def test_the_interval_of_a_linear_problem_is_the_closed_form(held, tmp_path):
    free = write_case(tmp_path, REST_ALONE + POSTURES)
    errors = np.array([0.9, -0.4, 0.7])
    rows = [replace(r, reference=r.reference + e) for r, e in zip(ROWS, errors, strict=True)]
    found = fit_all(cases(held, free, rows))
    by_degree = np.radians(K)
    best = REST + errors.mean() / by_degree
    assert found.values["rest"] == pytest.approx(best, abs=3e-3)
    left = errors - errors.mean()
    inflation = max(1.0, np.sqrt(left @ left / 2) / SD)
    width = 1.959964 * inflation * SD / by_degree / np.sqrt(3)
    assert interval(found, "rest") == pytest.approx((best - width, best + width), abs=5e-3)


def test_a_signed_parameter_ends_at_its_bound(held, tmp_path):
    free = write_case(tmp_path, REST_ALONE.replace("low = -20", "low = -5") + POSTURES)
    found = fit_all(cases(held, free, ROWS))
    assert found.values == {"rest": -5.0}
    assert identifiability(found, "rest") == "at its bound"
    near = [
        replace(r, sd=None, reference=torque(a, -19.9)) for r, a in zip(ROWS, ANGLES, strict=True)
    ]
    blurred = [replace(r, reference=r.reference + e) for r, e in zip(near, (9, 0, -9), strict=True)]
    found = fit_all(cases(held, write_case(tmp_path, REST_ALONE + POSTURES), blurred))
    assert found.values == {"rest": -20.0}


def test_rows_held_out_do_not_pull(held, free):
    apart = [row("p30", 999.0, "apart"), row("", -1.0, "everywhere")]
    alone, found = fit_all(cases(held, free, ROWS)), fit_all(cases(held, free, ROWS, apart))
    assert found.values == alone.values
    assert found.evaluations == alone.evaluations
    assert len(found.rows) == 3
    shown = [(r.target.name, r.target.case) for r in found.held_out]
    assert shown == [
        ("everywhere", "p10"),
        *(("apart", "p30"), ("everywhere", "p30")),
        ("everywhere", "p60"),
    ]
    assert found.held_out[1].model == pytest.approx(torque(30), rel=1e-3)
    assert found.held_out_start[1].model != found.held_out[1].model


def failing(monkeypatch, case: str, fails) -> None:
    def sometimes(source, settings):
        value = float(settings[-1].partition("=")[2].split()[0])
        found = spring(source, settings)
        if f"finger.posture.PIP={case} deg" in settings and fails(value):
            return Outcome("failed", None, ConvergenceError("folds"))
        return found

    monkeypatch.setattr("cosim.analyses.trials.workers.run_trial", sometimes)


def test_a_case_that_fails_on_the_way_makes_the_step_shorter(held, tmp_path, monkeypatch):
    free = write_case(tmp_path, REST_ALONE + POSTURES)
    lines: list[str] = []
    failing(monkeypatch, "30.0", lambda rest: rest < -8)
    rows = [replace(r, reference=torque(a, -7.9)) for r, a in zip(ROWS, ANGLES, strict=True)]
    begun = replace(rows[0], reference=torque(10, -14))
    found = fit_all(cases(held, free, [begun, *rows[1:]]), progress=lines.append)
    assert found.failures
    assert "p30" in found.failures[0]
    assert "folds" in found.failures[0]
    assert any("did not converge: p30" in line for line in lines)
    assert -8.0 <= found.values["rest"] < -7.0


def test_a_case_that_fails_at_the_start_is_named(held, free, monkeypatch):
    failing(monkeypatch, "60.0", lambda rest: True)
    with pytest.raises(ConvergenceError, match=r"at the start: p60: .*folds"):
        fit_all(cases(held, free, ROWS))


def test_a_gradient_that_one_case_lacks_is_none(held, tmp_path, monkeypatch):
    free = write_case(tmp_path, REST_ALONE + POSTURES)
    failing(monkeypatch, "60.0", lambda rest: rest not in (5.0, -7.5))
    found = fit_all(cases(held, free, ROWS), most=1)
    assert found.slopes[2] == 0
    assert found.slopes[0] != 0


def test_a_budget_is_kept_and_told(held, free):
    lines: list[str] = []
    found = fit_all(cases(held, free, ROWS), most=2, progress=lines.append)
    assert found.evaluations == 2
    assert found.stop_reason == "stopped at 2 evaluations, the most that were allowed"
    assert lines[0] == "3 cases, 2 parameters, 3 rows: the start, from scratch"
    assert lines[1].startswith("1 of at most 2: sum of squared misses ")
    assert "largest, SDs: torque [p60] " in lines[1]
    assert found.misses @ found.misses < 1e4


def test_every_fault_is_told_at_once(held, free, tmp_path):
    rows = [row("p10", 1.0), replace(row("p11", 1.0, "other"), unit="N"), row("p30", 1.0)]
    wrong = replace(row("p10", 1.0, "wrong"), unit="N")
    with pytest.raises(InputError) as caught:
        cases(held, free, [*rows, wrong])
    assert str(caught.value).splitlines() == [
        "3 faults",
        "  other: there is no case p11; there are p10, p30, p60",
        "  no target is for the case p60",
        f"  wrong: {TORQUE} is in N mm, the row in N",
    ]
    bad = PARAMETERS.replace("high = 1000", "high = 'x'").replace('scale = "linear"', "scale = 1")
    with pytest.raises(InputError, match=r"(?s)2 faults.*k: high = 'x'.*rest: scale = 1"):
        cases(held, write_case(tmp_path, bad + POSTURES), ROWS)
    with pytest.raises(InputError, match=r"(?s)2 faults.*cases\.a: .*cases\.b: "):
        cases(
            held,
            write_case(
                tmp_path,
                PARAMETERS
                + "[cases.a]\nset=['finger.posture.MCP=700 deg']\n"
                + "[cases.b]\nset=['finger.posture.Q=7 deg']\n",
            ),
            [row("", 1.0)],
        )


def test_a_bound_that_the_case_does_not_take_is_refused_before_any_solve(held, tmp_path):
    text = PARAMETERS.replace("low = -20", "low = -2000") + POSTURES
    with pytest.raises(InputError, match=r"finger.passive.PIP.rest"):
        cases(held, write_case(tmp_path, text), ROWS)


def test_built_in_parameters_must_be_those_of_every_case():
    stated = stated_cases(["strain_lee2008_average_ti", "fingertip_isotropic_edc"], (), None)
    with pytest.raises(InputError, match="no region has a law"):
        fit_cases(stated, None, [row("", 1.0)])


def test_a_quantity_that_a_run_lacks_names_the_case(held, free):
    gone = replace(row("p30", 1.0, "gone"), quantity="strain_percent.lateral.min", unit="%")
    odd = replace(row("p60", 1.0, "odd"), quantity="joint_torque_Nmm.passive.PIPE")
    with pytest.raises(
        InputError, match=r"(?s)2 faults.*gone: the run of p30.*odd: .*did you mean"
    ):
        fit_all(cases(held, free, [*ROWS, gone, odd]))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("cases = 3", "expected a table for each"),
        ("[cases]\na = 3", "cases.a: expected a table of `set`"),
        ("[cases.a]\nsets = []", "cases.a: expected a table of `set`"),
        ("[cases.a]\nset = 'x=1'", "cases.a: set = 'x=1': expected a list"),
        ("[cases.a]\nfrom = 'nowhere'", "cases.a: from: 'nowhere': no such file"),
    ],
)
def test_faulty_tables_of_cases_are_refused(held, tmp_path, text, match):
    with pytest.raises(InputError, match=match):
        stated_cases([held], (), write_case(tmp_path, text))


def test_cases_are_named_or_made_of_one(held, tmp_path):
    free = write_case(tmp_path, "[cases.a]\nset = ['x=1']\n[cases.b]\nfrom = 'other.toml'\n")
    other = tmp_path / "other.toml"
    other.write_text(HELD, encoding="utf-8")
    a, b = stated_cases([held], ("y=2",), free)
    assert (a.name, a.source.name, a.settings) == ("a", "held.toml", ("y=2", "x=1"))
    assert (b.name, b.source.name, b.settings) == ("b", "other.toml", ("y=2",))
    with pytest.raises(InputError, match="expected one CASE"):
        stated_cases([held, other], (), free)
    assert [c.name for c in stated_cases([held, other], (), None)] == ["held", "other"]
    with pytest.raises(InputError, match="more than one case is called held"):
        stated_cases([held, held], (), None)


@given(st.floats(-3, 3), st.floats(0.01, 5), st.floats(0, 1))
def test_values_and_coordinates_are_inverse(low, width, part):
    linear = FitParameter("p", "", low, low + width, low, scale="linear")
    assert linear.value(0.0) == low
    assert linear.value(1.0) == low + width
    value = linear.value(part)
    assert linear.coordinate(value) == pytest.approx(part, abs=1e-6)
    assert abs(linear.coordinate(value) - linear.round_coordinate(part)) <= 1.1e-4
    positive = FitParameter("p", "", 0.1, 0.1 + width, 0.1)
    assert positive.coordinate(positive.value(part - 2)) >= np.log(0.1)


def test_a_linear_parameter_may_have_any_sign_and_a_logarithmic_one_not():
    with pytest.raises(InputError, match=r'0 < low < high .*scale = "linear" is for'):
        FitParameter("p", "mm", -1.0, 1.0, 0.0)
    with pytest.raises(InputError, match="expected low < high and a start between"):
        FitParameter("p", "mm", -1.0, 1.0, 2.0, scale="linear")


def test_the_command_shows_and_writes_cases_apart(held, free, tmp_path):
    data, apart, out = (tmp_path / name for name in ("rows.csv", "apart.csv", "found.toml"))
    head = "name,quantity,unit,reference,sd,low,high,source,kind,case\n"
    lines = [f"torque,{TORQUE},N mm,{torque(a)},{SD},,,A 1999,experiment,p{a:.0f}" for a in ANGLES]
    lines += [f"asked,{TORQUE},N mm,0,100,,,the design,requirement,p10"]
    data.write_text(head + "\n".join(lines), encoding="utf-8")
    apart.write_text(head + f"later,{TORQUE},N mm,0,9,,,B,experiment,p60\n", encoding="utf-8")
    call = ["identify", str(held), "--targets", str(data), "--free", str(free), "--workers", "1"]
    done = CliRunner().invoke(app, [*call, "--held-out", str(apart), "--out", str(out)])
    assert done.exit_code == 0, done.output
    for text in ("Requirements, which nobody measured", "Held out, which did not pull", "p60"):
        assert text in done.output
    text = out.read_text(encoding="utf-8")
    assert "#   p30: held.toml finger.posture.PIP=30.0 deg" in text
    assert "#   p60: later: 0 ± 9 N mm (experiment; B);" in text
    assert "(requirement; the design)" in text
    assert "# Correlations: rest with k" in text
    assert load_case(out).finger.passive["PIP"].rest == pytest.approx(np.radians(REST), abs=1e-3)


def test_settings_found_over_several_files_are_written_without_a_base(held, tmp_path):
    other, out = tmp_path / "other.toml", tmp_path / "found.toml"
    other.write_text(HELD + "\n[finger.posture]\nPIP = '60 deg'\n", encoding="utf-8")
    data = tmp_path / "rows.csv"
    data.write_text(
        "name,quantity,unit,reference,sd,low,high,source,kind\n"
        f"torque,{TORQUE},N mm,-30,0.1,,,A 1999,experiment\n",
        encoding="utf-8",
    )
    free = write_case(tmp_path, REST_ALONE)
    call = ["identify", str(held), str(other), "--targets", str(data), "--free", str(free)]
    done = CliRunner().invoke(app, [*call, "--workers", "1", "--out", str(out)])
    assert done.exit_code == 0, done.output
    text = out.read_text(encoding="utf-8")
    assert 'extends = "CASE"' in text
    assert "\nextends" not in text
    assert "\nfinger.passive.PIP.rest = " in text


@pytest.mark.slow
def test_processes_side_by_side_find_the_same(held, free, monkeypatch):
    monkeypatch.undo()
    one, two = (fit_all(cases(held, free, ROWS), workers=n) for n in (1, 2))
    assert two.values == one.values
    assert two.misses == pytest.approx(one.misses, abs=1e-9)
