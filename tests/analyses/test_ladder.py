"""The ladder of hoods on its quick rungs."""

from __future__ import annotations

import csv
import json

import pytest
from typer.testing import CliRunner

from cosim.analyses import ladder
from cosim.analyses.ladder import side_by_side, to_csv, to_html, to_markdown
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError

QUICK = {name: ladder.RUNGS[name] for name in ("split", "two_band", "network")}


@pytest.fixture
def quick(monkeypatch) -> None:
    monkeypatch.setattr(ladder, "RUNGS", QUICK)


@pytest.fixture(scope="module")
def rungs() -> list[ladder.Rung]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ladder, "RUNGS", QUICK)
        case = load_case("network_edc", ['finger.posture.PIP="50 deg"'])
        found = {rung.name: rung for rung in ladder.solve_rungs(case, 1)}
        return [found[name] for name in QUICK]


def test_a_case_keeps_all_but_its_hood():
    case = load_case("network_edc", ['hood.connecting.edc_slip.stiffness="99 N/mm"'])
    assert case.hood.rung() == "network"
    assert ladder.case_on_rung(case, "network") is case
    other = ladder.case_on_rung(case, "split")
    assert other.hood.kind == "split"
    assert other.finger == case.finger
    assert other.tendons == case.tendons
    assert set(ladder.case_on_rung(case, "two_band").hood.muscles) == {"EDC", "UI", "LUM"}
    assert load_case("fingertip_isotropic_edc").hood.rung() == "isotropic shell"
    assert load_case("fingertip_fibres_edc").hood.rung() == "fibre shell"
    assert ladder.rungs_of(load_case("pulley_edc"))[:2] == ["pulley", "split"]
    middle = load_case("middle_minorflex_edc")
    isotropic = ladder.case_on_rung(middle, "isotropic shell").hood
    assert {region.kind for region in isotropic.regions.values()} == {"isotropic"}
    assert isotropic.springs == load_case("base/middle_hood.toml").hood.springs
    assert isotropic.springs != load_case("isometric_edc").hood.springs


def test_the_slips_share_what_enters(rungs):
    """All tension passes the slips: of a split by halves, of a network as its springs share it."""
    by_name = {rung.name: rung for rung in rungs}
    assert [rung.is_own for rung in rungs] == [False, False, True]
    assert all(rung.status == "converged" for rung in rungs)
    pull = 3.469
    split, network = by_name["split"].slips, by_name["network"].slips
    assert split["central"] == pytest.approx(split["terminal"])
    assert sum(split.values()) == pytest.approx(pull + 3 * 0.05)
    assert sum(network.values()) == pytest.approx(pull + 2 * 0.05)
    assert sum(by_name["two_band"].slips.values()) == pytest.approx(pull)
    assert set(by_name["network"].excursions) == {"EDC"}
    assert by_name["network"].excursions["EDC"] > 0
    for rung in rungs:
        assert rung.summary["posture_deg"]["PIP"] == pytest.approx(50, abs=6)


def test_tables_hold_every_rung(rungs):
    rows = {row[0]: row[1:] for row in side_by_side(rungs).words()}
    network = rungs[2].summary
    assert float(rows["arm EDC PIP mm"][2]) == pytest.approx(
        network["moment_arm_mm"]["EDC"]["PIP"], rel=1e-3
    )
    assert float(rows["tip force dorsal N"][2]) == pytest.approx(
        network["fingertip_force_N"]["dorsal"], rel=1e-3
    )
    assert float(rows["tip force at rest N"][2]) == pytest.approx(
        network["unloaded"]["fingertip_magnitude_N"], rel=1e-3
    )
    assert rows["audits"] == ["kept", "kept", "kept"]
    told = list(csv.DictReader(to_csv(rungs).splitlines()))
    assert [row["rung"] for row in told] == [*QUICK]
    assert float(told[0]["terminal / central"]) == pytest.approx(1)
    assert "| network * |" in to_markdown(rungs, "it")
    page = to_html(rungs, "it & more")
    assert all(f"<td>{row[0]}</td>" in page for row in side_by_side(rungs).rows)
    assert "it &amp; more" in page
    assert "Fingertip force: " in page


def test_a_rung_that_does_not_apply_is_no_failure(quick, tmp_path):
    """EI is no tendon of the network's nor of the two bands'."""
    ran = CliRunner().invoke(app, ["ladder", "split_ei", "-o", str(tmp_path)])
    assert ran.exit_code == 0, ran.output
    assert "network: does not apply: tendons.EI: this finger and hood have no such" in ran.output
    folder = tmp_path / "split_ei"
    assert (folder / "ladder.png").stat().st_size > 10_000
    found = json.loads((folder / "ladder.json").read_text())
    assert [r["status"] for r in found] == ["converged", "does not apply", "does not apply"]


def test_a_rung_without_equilibrium_is_a_failure(quick, tmp_path):
    args = ["ladder", "network_edc", "-o", str(tmp_path), "--set", "solve.max_iterations=1"]
    ran = CliRunner().invoke(app, args)
    assert ran.exit_code == 1, ran.output
    assert "network: failed: hood and finger did not agree in 1 round" in ran.output
    assert (tmp_path / "network_edc" / "ladder.md").is_file()


def test_a_motion_is_no_rung():
    with pytest.raises(InputError, match="is a motion"):
        list(ladder.solve_rungs(load_case("forward_edc"), 1))
    ran = CliRunner().invoke(app, ["ladder", "motion_edc_fdp"])
    assert ran.exit_code == 2
