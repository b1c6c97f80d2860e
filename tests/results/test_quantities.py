"""Misspelt quantities are refused; those that a run validly lacks have no value."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from cosim.results.compare import Target, numbers_of, unit_of
from cosim.results.conventions import is_slack
from cosim.results.quantities import check_quantities, is_known, meaning_of
from cosim.results.read import read_run, read_runs
from tests.helpers.report_runs import DATA, run_into

QUICK = "output.picture=false"
CASES = {
    "isometric_edc": ("hood.mesh.quads=120",),
    "split_edc": (),
    "cable_edc": ('hood.mesh.spacing="3 mm"',),
    "planar_edc": (),
    "forward_edc": ("forward.must_rest=false", 'forward.duration="0.1 s"'),
    "pneumatic_edc_fdp": ('forward.duration="10 ms"',),
}
ROW = Target("a row", "fingertip_magnitude_N", "N", 1.0, None, None, None, "S", "inferred")


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return {case: run_into(folder, case, *settings, QUICK) for case, settings in CASES.items()}


@pytest.fixture(scope="module")
def summaries(folders) -> dict[str, Any]:
    return {case: json.loads((f / "summary.json").read_text()) for case, f in folders.items()}


def target(quantity: str) -> Target:
    return replace(ROW, quantity=quantity, unit=unit_of(quantity))


def refusal(quantity: str, summary: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        check_quantities([target(quantity)], [("edc", summary)])
    return str(caught.value)


def misspellings(key: str) -> set[str]:
    """The key with one letter changed, dropped, or swapped with the next."""
    at = range(len(key))
    return {
        *(key[:i] + "q" + key[i + 1 :] for i in at),
        *(key[:i] + key[i + 1 :] for i in at),
        *(key[:i] + key[i + 1] + key[i] + key[i + 2 :] for i in at[:-1]),
    } - {key, ""}


@pytest.mark.parametrize("case", CASES)
def test_every_number_of_a_run_is_known_there_and_in_other_runs(case, summaries):
    for path in numbers_of(summaries[case]):
        check_quantities([target(path)], [(case, summaries[case])])
        assert is_known(path), f"{path} is missing from the table of what runs may have"
        meaning = meaning_of(path, summaries[case])
        assert meaning, path
        assert not set("<>*") & set(meaning), path


def test_a_run_shows_its_quantities_with_unit_and_meaning(folders):
    table = read_run(folders["cable_edc"]).quantities
    assert tuple(table.loc["unloaded.posture_deg.MCP_abduction"])[1:] == (
        "deg",
        "MCP abduction angle, unloaded",
    )
    listed = CliRunner().invoke(app, ["list", "quantities"]).output
    assert "cable.*.tension_N" in listed
    assert "tension of the cable *" in listed


@pytest.mark.parametrize("stride", [19, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", CASES)
def test_a_misspelt_quantity_is_refused_and_the_right_one_named(case, stride, summaries):
    """Each stride-th of the ways to misspell a key by one letter, from another one in each key."""
    summary, tried = summaries[case], set()
    for path in numbers_of(summary):
        keys = path.split(".")
        for i, key in enumerate(keys):
            if key.isdigit() or tuple(keys[: i + 1]) in tried:
                continue
            tried.add(tuple(keys[: i + 1]))
            for other in sorted(misspellings(key))[len(tried) % stride :: stride]:
                wrong = ".".join([*keys[:i], other, *keys[i + 1 :]])
                if is_known(wrong, [summary]):  # FDIm and FDIl
                    continue
                said = refusal(wrong, summary)
                assert said.startswith(f"a row: quantity {wrong}: ")
                hint = said.partition("did you mean ")[2]
                assert key in hint.replace("?", ",").replace(".", ", ").split(", "), said
                if len(key) > 5:
                    assert hint.startswith(f"{path}?"), said
    assert len(tried) > 20


def test_of_a_slack_central_slip_there_is_no_ratio(summaries):
    slack = {k: v for k, v in summaries["isometric_edc"].items() if k != "slip_ratio"}
    slack["slip_force_N"] = {"central": 0.0, "terminal": 1.0}
    assert is_slack(slack["slip_force_N"], "central")
    check_quantities([target("slip_ratio")], [("edc", slack)])
    assert "did you mean slip_ratio?" in refusal("slip_ration", slack)


@pytest.mark.parametrize(
    "quantity",
    [
        *("slip_ratio", "unloaded.slip_ratio", "difference.strain_percent.lateral.min"),
        *("energy_mJ.artificial", "cable.central_slip.tension_N", "tension_N.RI"),
        *("one_way.interface_residual", "step_control.accepted", "audit.torque_balance_at_rest"),
        *("excursion_mm.FDP", "fingertip_moment_Nmm.palmar", "muscle.EDC.pennation_deg"),
        *("region_strain_percent.central_band.lateral.p5", "air.EDC.pressure_kPa"),
    ],
)
def test_what_runs_of_other_kinds_have_is_no_misspelling(quantity, summaries):
    for summary in summaries.values():
        check_quantities([target(quantity)], [("edc", summary)])


def test_null_is_no_misspelling(summaries):
    summary = {**summaries["split_edc"], "own": {"number": None}}
    check_quantities([target("own.number")], [("edc", summary)])


@pytest.mark.parametrize(
    ("quantity", "match"),
    [
        ("strain_percent.lateral", "is no number; it has the parts p5, mean, p95, min, max"),
        ("converged", "is no number"),
        ("fingertip_magnitude_N.0", "nothing in fingertip_magnitude_N"),
        ("fingertip_force_N.up", "There are distal, radial, dorsal, proximal, ulnar, palmar"),
        ("drawn_mm.EDC", "drawn_mm is now called prescribed_excursion_mm"),
        ("difference.fingertip_force_N.1", r"difference\.fingertip_force_N\.palmar in place of"),
        ("posture_deg.pip", r"did you mean posture_deg\.PIP\?"),
        ("difference.excursion_mm.EDC", 'no "excursion_mm" in difference'),
        ("cable.slip.tensionN", r"did you mean cable\.slip\.tension_N\?"),
    ],
)
def test_what_names_no_number_is_refused(quantity, match, summaries):
    with pytest.raises(InputError, match=match):
        check_quantities([target(quantity)], [("edc", summaries["isometric_edc"])])


def test_a_row_for_another_case_is_not_looked_at(summaries):
    runs = [("edc", summaries["split_edc"])]
    check_quantities([replace(target("no_such_thing"), case="other")], runs)
    with pytest.raises(InputError):
        check_quantities([replace(target("no_such_thing"), case="edc")], runs)


def test_a_name_of_one_run_is_right_for_those_beside_it(summaries):
    own = {"posture_deg": {"knuckle": 1.0}, "cable": {"mine": {"tension_N": 1.0}}}
    runs = [("own", own), ("edc", summaries["cable_edc"])]
    check_quantities([target("posture_deg.knuckle"), target("cable.mine.tension_N")], runs)
    check_quantities([target("moment_arm_mm.EDC.knuckle")], runs[:1])
    with pytest.raises(InputError, match="knuckle"):
        check_quantities([target("posture_deg.knuckle")], runs[1:])


def test_a_run_without_the_number_has_no_value_in_the_comparison(folders, tmp_path):
    targets = (target("strain_percent.lateral.min"), target("energy_mJ.artificial"))
    for run in read_runs([folders["split_edc"], folders["planar_edc"]], targets):
        assert [row.verdict for row in run.comparison] == ["no value", "no value"]
    with pytest.raises(InputError, match="did you mean strain_percent"):
        read_run(folders["split_edc"], (target("strain_percnt.lateral.min"),))


def test_every_quantity_of_the_packaged_data_is_known():
    quantities = [
        row["quantity"]
        for path in (files("cases") / "data").iterdir()
        if path.name.endswith(".csv")
        for row in csv.DictReader(
            line for line in path.read_text(encoding="utf-8").splitlines() if line[:1] != "#"
        )
        if "quantity" in row
    ]
    assert quantities
    assert [q for q in quantities if not is_known(q)] == []


@pytest.mark.parametrize("form", ["html", "json"])
def test_the_command_refuses_a_misspelt_quantity(form, folders, tmp_path):
    path, out = tmp_path / "data.csv", tmp_path / f"report.{form}"
    path.write_text(DATA.replace("slip_force_N.terminal", "slip_force_N.termnal"), "utf-8")
    run = str(folders["isometric_edc"])
    command = ["show", run, "--data", str(path), "-o", str(out)]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code == 2
    assert "Slip: quantity slip_force_N.termnal" in refused.stderr
    assert "did you mean slip_force_N.terminal?" in refused.stderr
    assert refused.stderr.splitlines()[-1].startswith("cosim: ")
    assert not out.exists()
