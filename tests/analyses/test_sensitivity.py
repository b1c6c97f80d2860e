"""What a case assumes, varied: values against closed forms, settings against the case they make."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from math import exp, radians
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cosim.analyses.identify.sensitivity import (
    RATIO,
    Run,
    Sensitivity,
    bars,
    study,
    to_csv,
    to_json,
    variations,
)
from cosim.analyses.identify.tornado import draw_tornado
from cosim.analyses.trials.workers import run_trial
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.hoods.shell.variation import SHEETS
from cosim.hoods.variation import Side, Variation
from cosim.results.compare import Target, unit_of, value_of
from tests.helpers.fixed_posture import HELD

PASSIVE, EDC = "joint_torque_Nmm.passive.PIP", "joint_torque_Nmm.EDC.PIP"
STIFFER = Variation(
    "PIP's stiffness",
    Side("x 0.5", ("finger.passive.PIP.stiffness=0.02 N*m/rad",)),
    Side("x 1.5", ("finger.passive.PIP.stiffness=0.06 N*m/rad",)),
)
FAILS = Variation(
    "solver",
    Side("one round", ("finger.tip.kind=point", "solve.max_iterations=1")),
    Side("none", ("solve.max_iterations=0",)),
)


@pytest.fixture
def held(tmp_path) -> Path:
    """Bones held at 30/45/15 deg; the PIP's passive torque is -k times its angle."""
    file = tmp_path / "held.toml"
    file.write_text(HELD, encoding="utf-8")
    return file


def of(case: Case) -> dict[str, Variation]:
    return {v.name: v for v in variations(case)}


def test_answers_are_those_of_the_closed_form(held):
    posture = of(load_case(held))["posture, PIP"]
    found = study(held, (), [STIFFER, posture], [PASSIVE, EDC])
    assert found.base[PASSIVE] == pytest.approx(-40 * radians(45), rel=1e-9)
    stiffness, angle = sorted(bars(found, PASSIVE), key=lambda bar: bar.variation)
    half = 20 * radians(45)
    assert stiffness.changes == pytest.approx((half, -half), rel=1e-9)
    assert angle.changes == pytest.approx((40 * radians(5), -40 * radians(5)), rel=1e-9)
    assert [bar.variation for bar in bars(found, PASSIVE)] == [STIFFER.name, posture.name]
    strongest, weakest = bars(found, EDC)
    assert (strongest.variation, weakest.variation) == (posture.name, STIFFER.name)
    assert strongest.swing > weakest.swing == 0


def test_the_cases_own_settings_come_first(held):
    own = ("finger.passive.DIP.stiffness=0 N*m/rad", "finger.posture.PIP=20 deg")
    found = study(held, own, [STIFFER], [PASSIVE])
    values = [run.values[PASSIVE] for run in found.runs]
    assert found.base[PASSIVE] == pytest.approx(-40 * radians(20))
    assert values == pytest.approx([-20 * radians(20), -60 * radians(20)])


def test_what_did_not_converge_is_listed_with_its_reason(held):
    found = study(held, (), [FAILS, STIFFER], [PASSIVE])
    failed, refused, *others = found.runs
    assert (failed.status, refused.status) == ("failed", "refused")
    assert "converge" in failed.reason or "did not" in failed.reason
    assert "must" in refused.reason
    assert {run.status for run in others} == {"converged"}
    rows = list(csv.DictReader(io.StringIO(to_csv(found))))
    assert [row["status"] for row in rows] == ["converged", "failed", "refused", *["converged"] * 2]
    assert rows[1][PASSIVE] == ""
    assert rows[1]["reason"] == failed.reason
    assert float(rows[3][PASSIVE]) == others[0].values[PASSIVE]


def test_a_case_without_an_answer_has_no_sensitivity(held):
    with pytest.raises(ConvergenceError, match="the case as it is"):
        study(held, FAILS.low.settings, [STIFFER], [PASSIVE])
    with pytest.raises(InputError, match="max_iterations"):
        study(held, FAILS.high.settings, [STIFFER], [PASSIVE])
    with pytest.raises(InputError, match="no number at fibre_strain_percent"):
        study(held, (), [STIFFER], ["fibre_strain_percent.central_slip.p95"])


def test_two_processes_say_the_same_bytes(held):
    one, two = (study(held, (), [FAILS, STIFFER], [PASSIVE], workers=n) for n in (1, 2))
    assert to_json(one) == to_json(two)
    assert to_csv(one) == to_csv(two)


def test_ratios_are_measured():
    summary = {"difference": {"slip_force_N": {"terminal": 5.1, "central": 3.0}}, "a_mm": 2.0}
    assert value_of(summary, RATIO) == pytest.approx(1.7)
    assert unit_of(RATIO) == "1"
    assert unit_of("slip_force_N.central/a_mm") == "N / (mm)"
    assert value_of(summary, "a_mm/absent_mm") is None
    summary["difference"]["slip_force_N"]["central"] = 0.0
    assert value_of(summary, RATIO) is None


@pytest.mark.parametrize(
    "name", ["isometric_edc", "published_sections_edc", "strain_lee2008_average_ti"]
)
def test_every_side_makes_a_case_or_says_why_not(name):
    case = load_case(name)
    for v in variations(case):
        for side in (v.low, v.high):
            assert bool(side.settings) != bool(side.why_not), v.name
            if not side.settings:
                continue
            try:
                changed = load_case(name, side.settings)
            except InputError as error:
                assert "must be" in str(error), v.name  # out of the range of a case
                continue
            assert changed.setting_key() != case.setting_key(), v.name


def test_moduli_sections_and_thickness_scale():
    case = load_case("published_sections_edc")
    v = of(case)
    soft = load_case(case.source, v["modulus"].low.settings).hood
    thin = load_case(case.source, v["thickness"].low.settings).hood
    wide = load_case(case.source, v["sections of the tendons"].high.settings).hood
    for name, region in case.hood.regions.items():
        assert soft.regions[name].modulus == pytest.approx(0.5 * region.modulus)
        assert soft.regions[name].section == region.section
        is_cable = name not in SHEETS
        assert (region.section is not None) == is_cable
        if is_cable:
            assert thin.regions[name].section == pytest.approx(0.5 * region.section)
            assert wide.regions[name].section == pytest.approx(1.8e-6)
    assert thin.thickness == pytest.approx(0.5 * case.hood.thickness)


def test_fibres_stay_smooth_when_their_toe_changes():
    case = load_case("strain_lee2008_average_ti")
    for side, factor in (
        (of(case)["toe of the fibres"].low, 0.5),
        (of(case)["toe of the fibres"].high, 1.5),
    ):
        for name, law in load_case(case.source, side.settings).hood.regions.items():
            toe = factor * (0.5 if name.startswith("oblique_fibres") else 0.01)
            for family in (law, *([law.second] if law.second else [])):
                assert family.lam_max == pytest.approx(1 + toe)
                slope = family.c3 * family.c4 * exp(family.c4 * (family.lam_max - 1))
                assert slope == pytest.approx(family.c5, rel=1e-9)


def test_stiffness_across_leaves_that_along():
    even = load_case("published_sections_edc")
    fibrous = load_case("strain_lee2008_average_ti")
    stiff = load_case(fibrous.source, of(fibrous)["stiffness across fibres"].high.settings)
    for name, law in stiff.hood.regions.items():
        assert law.c1 == pytest.approx(2 * fibrous.hood.regions[name].c1)
    tenth = load_case(even.source, of(even)["stiffness across fibres"].low.settings).hood
    for name, law in tenth.regions.items():
        modulus = even.hood.regions[name].modulus
        assert law.modulus_along == pytest.approx(modulus)
        assert law.modulus_across == pytest.approx(modulus / 10)
        assert law.shear_modulus == pytest.approx(modulus / 28)


def test_what_cannot_go_lower_is_cut_off_and_says_so():
    tight = [f"hood.springs.retinacular_{side}.slack=0 mm" for side in ("radial", "ulnar")]
    v = of(load_case("strain_lee2008_average_ti", tight))
    assert v["contact offset, distal"].low.label == "-0.1 mm"
    assert v["contact offset, distal"].low.settings == ("hood.contact.offset.distal=0 mm",)
    assert "the least" in v["retinacular ligaments, slack"].low.why_not
    assert "held" in v["joint stiffness"].low.why_not


def test_every_ligament_of_a_hood_is_varied():
    case = load_case("strain_lee2008_average_ti")
    settings = [text for v in variations(case) for s in (v.low, v.high) for text in s.settings]
    for name in set(case.hood.springs) - {"central_slip"}:  # that is a tendon's insertion
        for key in ("stiffness", "slack"):
            assert any(text.startswith(f"hood.springs.{name}.{key}=") for text in settings), name


def test_a_hood_without_friction_gets_some_and_one_with_it_less_and_more():
    smooth = of(load_case("strain_lee2008_average_ti"))["friction over the bones"]
    assert smooth.high.settings == ("hood.contact.friction=0.3",)
    rough = of(load_case("strain_lee2008_average_ti", ["hood.contact.friction=0.2"]))
    assert rough["friction over the bones"].low.settings == ("hood.contact.friction=0.1",)
    assert rough["friction over the bones"].high.label == "x 2"


def chart(high: float | None) -> tuple[Sensitivity, str]:
    def run(name: str, side: str, value: float | None) -> Run:
        status = "failed" if value is None else "converged"
        return Run(name, side, f"{name} {side}", ("a=1",), status, "", {"x_N": value})

    runs = (
        *(run("weak", "low", 1.001), run("weak", "high", 0.999)),
        *(run("strong", "low", 0.5), run("strong", "high", high)),
        *(run("some", "low", 1.1), run("some", "high", 1.2)),
    )
    return Sensitivity("twin", (), {"x_N": 1.0}, runs), "x_N"


def test_the_chart_has_the_strongest_first_and_names_what_failed():
    axes = draw_tornado(*chart(None)).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["strong", "some"]
    assert "strong high: failed" in [text.get_text() for text in axes.texts]
    ends = sorted(round(bar.get_x() + bar.get_width(), 6) for bar in axes.patches)
    assert ends == [0.5, 1.1, 1.2]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]
    both = draw_tornado(*chart(1.6))
    assert [label.get_text() for label in both.axes[0].get_yticklabels()] == ["strong", "some"]
    assert "Under 1% of the strongest: weak" in both.texts[-1].get_text().replace("\n", " ")


def test_a_band_is_shown_where_it_lies():
    target = Target("x", "x_N", "N", None, None, 0.8, None, "A", "experiment")
    figure = draw_tornado(*chart(1.6), target)
    assert "experiment: [at least 0.8]" in [t.get_text() for t in figure.legends[0].get_texts()]
    axes = figure.axes[0]
    assert any(patch.get_x() == pytest.approx(0.8) for patch in axes.patches)
    beyond = draw_tornado(*chart(1.6), replace(target, low=None, high=-9.0))
    (told,) = [t.get_text() for t in beyond.legends[0].get_texts() if "experiment" in t.get_text()]
    assert told == "experiment: [at most -9], beyond the chart"
    low, high = axes.get_xlim()
    assert low < 0.5
    assert high > 1.6


def test_the_command(held, tmp_path):
    call = [
        "study",
        "--sensitivity",
        str(held),
        "--workers",
        "1",
        "--out",
        str(tmp_path),
        "--only",
        "posture, pip",
    ]
    done = CliRunner().invoke(app, [*call, "--quantity", PASSIVE, "--quantity", EDC])
    assert done.exit_code == 0, done.output
    folder = tmp_path / "held"
    names = {"sensitivity.csv", "sensitivity.json", f"{PASSIVE}.png", f"{EDC}.png"}
    assert {path.name for path in folder.iterdir()} == names
    before = {name: (folder / name).read_bytes() for name in names}
    content = json.loads(before["sensitivity.json"])
    assert content["units"][PASSIVE] == "N mm"
    assert [run["set_to"] for run in content["runs"]] == ["-5 deg", "+5 deg"]
    CliRunner().invoke(app, [*call, "--quantity", PASSIVE, "--quantity", EDC])
    assert {name: (folder / name).read_bytes() for name in names} == before
    for wrong in (["--only", "weather"], ["--quantity", "fibre_strain_percent.central_slip.p95"]):
        assert CliRunner().invoke(app, [*call[:-2], *wrong]).exit_code == 2


def test_an_outcome_has_its_reason_in_one_line(held):
    found = run_trial(held, ("finger.posture.PIP=-5 deg", "finger.posture.DIP=-5 deg"))
    assert found.status == "refused"
    assert "\n" not in found.reason
    assert "2 faults" in found.reason
