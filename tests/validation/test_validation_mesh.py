"""What a finer mesh changes in the numbers of the validations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.results.compare import Comparison, Target
from cosim.validation.mesh import VERDICTS, Change, changes, refine_meshes, tally
from cosim.validation.run import Board, choose_groups
from tests.helpers.folders import ROOT

CASES = ROOT / "cases"


def row(model: float | None, quantity: str, unit: str, name: str = "") -> Comparison:
    target = Target(
        name or quantity, quantity, unit, 1.0, None, None, None, "a paper", "experiment", "run"
    )
    return Comparison(target, model)


def changes_of(before: list[Comparison], after: list[Comparison]) -> list[Change]:
    return changes([Board("force", tuple(before), {})], [Board("force", tuple(after), {})])


@pytest.mark.parametrize(
    ("unit", "model", "bound"),
    [("%", 5.0, 0.1), ("%", -0.01, 0.1), ("N", -3.0, 0.06), ("mm", 0.5, 0.01), ("1", 1.7, 0.034)],
)
def test_a_strain_may_change_by_a_tenth_of_a_point_and_a_number_by_a_fiftieth(unit, model, bound):
    for share, verdict in ((0.99, "within"), (-0.99, "within"), (1.01, "beyond")):
        (found,) = changes_of([row(model, "q", unit)], [row(model + share * bound, "q", unit)])
        assert found.bound == pytest.approx(bound)
        assert found.verdict == verdict
        assert found.change == pytest.approx(share * bound)


def test_a_component_is_held_to_its_force_and_an_angle_to_the_turn_of_such_a_change():
    force = {"distal": 0.0, "palmar": 3.0, "radial": -4.0}
    before = [row(v, f"force_N.{k}", "N") for k, v in force.items()]
    after = [row(v + 0.05, f"force_N.{k}", "N") for k, v in force.items()]
    found = changes_of([*before, row(10.0, "a_deg", "deg")], [*after, row(11.0, "a_deg", "deg")])
    assert [c.bound for c in found] == pytest.approx([0.1, 0.1, 0.1, np.degrees(0.02)])
    assert {c.verdict for c in found} == {"within"}


def test_a_number_beside_two_references_counts_once_and_one_that_no_mesh_touches_not_at_all():
    twice = [row(1.0, "q", "N", "An"), row(1.0, "q", "N", "MyoHand")]
    other = [row(1.5, "q", "N", "An"), row(1.5, "q", "N", "MyoHand")]
    (found,) = changes_of([*twice, row(2.0, "r", "N")], [*other, row(2.0, "r", "N")])
    assert (found.name, found.quantity) == ("An", "q")
    assert changes_of([row(None, "q", "N")], [row(1.0, "q", "N")]) == []


def test_numbers_of_one_quantity_that_differ_are_all_told():
    """The one-way pass compares a tip force and what it has beyond another."""
    before = [row(1.5, "q", "N", "excess"), row(2.5, "q", "N", "force")]
    after = [row(1.6, "q", "N", "excess"), row(2.51, "q", "N", "force")]
    found = {c.name: (c.model, c.finer, c.verdict) for c in changes_of(before, after)}
    assert found == {"excess": (1.5, 1.6, "beyond"), "force": (2.5, 2.51, "within")}


def test_a_trial_that_failed_on_the_finer_mesh_has_no_value_and_the_misses_come_first():
    names = ("a", "b", "c")
    before = [row(1.0, name, "N") for name in names]
    found = changes_of(before, [row(1.001, "a", "N"), row(None, "b", "N"), row(2.0, "c", "N")])
    assert [c.verdict for c in found] == list(VERDICTS)
    assert tally(found) == {"beyond": 1, "no value": 1, "within": 1}


def test_only_hoods_that_are_generated_are_laid_out_anew():
    before = choose_groups(None, Path("mi29.feb"))
    finer = refine_meshes(before, 2400)
    assert [g.name for g in finer] == [g.name for g in before if g.name != "published hood"]
    trials = {t.name: t for g in finer for t in g.trials}
    assert set(trials) == {
        t.name for g in before for t in g.trials if not t.name.startswith("published")
    }
    meant = {name for name, t in trials.items() if "hood.mesh.quads=2400" in t.settings}
    assert {"strain soft ti", "force iso EDC", "hood_minorflex_edc"} <= meant
    assert not any(name.startswith(("force split", "force network", "middle")) for name in meant)
    soft = trials["strain soft ti"]
    assert load_case(soft.case, soft.settings).hood.mesh.quads == 2400


@pytest.mark.slow
def test_the_command_says_what_a_finer_mesh_changes(tmp_path: Path):
    words = ["validate", "--only", "strain soft iso", "--out", str(tmp_path), "--workers", "1"]
    four = ["--set", 'hood.mesh.elements="linear"']  # quadratic ones tell meshes less apart
    coarse = [*four, "--set", "hood.mesh.quads=120", "--finer", "160"]
    done = CliRunner().invoke(app, [*words, *coarse])
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "mesh_convergence.json").read_text(encoding="utf-8"))
    assert told["quads"] == 160
    assert sum(told["tally"].values()) == len(told["rows"]) > 3
    page = (tmp_path / "scoreboard.html").read_text(encoding="utf-8")
    assert all(r["name"] in page for r in told["rows"])
    assert f"{told['tally']['beyond']} beyond" in page
    assert f"{told['tally']['beyond']} beyond" in done.stdout
    board = json.loads(
        (tmp_path / "finer" / "strain_soft_iso" / "summary.json").read_text(encoding="utf-8")
    )
    (ratio,) = [r for r in told["rows"] if r["quantity"] == "slip_ratio"]
    assert ratio["finer"] == pytest.approx(board["slip_ratio"], rel=1e-5)
    assert not np.isclose(ratio["finer"], ratio["model"], rtol=1e-3)


def test_the_committed_changes_are_those_of_the_committed_scoreboard():
    told = json.loads((CASES / "mesh_convergence.json").read_text(encoding="utf-8"))
    board = json.loads((CASES / "scoreboard.json").read_text(encoding="utf-8"))["groups"]
    models = {(g, r["case"], r["name"], r["quantity"]): r["model"] for g in board for r in board[g]}
    assert len(models) == sum(map(len, board.values()))
    assert len(told["rows"]) > 60
    for r in told["rows"]:
        committed = models[r["group"], r["case"], r["name"], r["quantity"]]
        assert r["model"] == pytest.approx(committed, rel=1e-3, abs=1e-4)
