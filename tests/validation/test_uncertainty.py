"""How sure compared numbers are: budgets, samples of the inputs, other hoods, and their file."""

from __future__ import annotations

import json
from dataclasses import replace
from math import hypot, sqrt
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.mesh_series import MeshSeries, mesh_factors
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.pipeline import run_case
from cosim.results.compare import Comparison, Target
from cosim.validation.ratios import share_group
from cosim.validation.records import write_record
from cosim.validation.run import Board, choose_groups
from cosim.validation.scoreboard import JudgedBoard, join_uncertainty
from cosim.validation.trial import Trial, TrialGroup
from cosim.validation.uncertainty import (
    NumberUncertainty,
    UncertaintyFile,
    budget,
    read_committed,
    read_uncertainty,
    update,
)
from cosim.validation.versions import (
    AS_IT_IS,
    RUBBING,
    InputSpread,
    audited_summary,
    form_values,
    form_versions,
    input_spreads,
    input_versions,
    key_of,
    read_inputs,
    run_versions,
    values_of_boards,
)
from tests.helpers.folders import ROOT

CASES = ROOT / "cases"
TARGET = Target(
    *("force", "force_N.distal", "N", 1.0, 0.3, None, None, "a paper", "experiment", "run"), n=9
)
NUMBER = {
    "group": "g",
    "case": "run",
    "name": "force",
    "quantity": "force_N.distal",
    "unit": "N",
    "model": 1.2,
}
MESHES = MeshSeries(factors=mesh_factors(3, 2), values=(1.29, 1.2, 1.16), bound=0.024)
INPUTS = InputSpread(nominal=1.0, mean=1.04, sd=0.03, samples=16, failed=0)
KNOWN = NumberUncertainty(**NUMBER, meshes=MESHES, inputs=INPUTS)


def test_u_val_is_made_of_mesh_inputs_and_the_mean_of_the_hands():
    found = budget(Comparison(TARGET, 1.2), KNOWN)
    assert found.error == pytest.approx(0.2)
    assert found.u_num == MESHES.uncertainty
    assert found.u_input == pytest.approx(hypot(0.03, 0.04))
    assert found.u_data == pytest.approx(0.3 / sqrt(9))
    assert found.u_val == pytest.approx(hypot(found.u_num, 0.05, 0.1))
    assert found.freedom == pytest.approx(found.u_val**4 / (0.1**4 / 8 + 0.05**4 / 15))


def test_few_hands_widen_the_interval_by_students_factor():
    exact = NumberUncertainty(
        **NUMBER,
        meshes=MeshSeries(factors=(1, 2.25), values=(1.2, 1.2), bound=1.0),
        inputs=InputSpread(nominal=1.0, mean=1.0, sd=0.0, samples=16, failed=0),
    )
    for n, factor in ((3, 4.3027), (9, 2.3060), (None, 1.9600)):
        found = budget(Comparison(replace(TARGET, n=n), 1.2), exact)
        assert found.factor == pytest.approx(factor, rel=1e-4)
        assert found.expanded == pytest.approx(factor * 0.3 / sqrt(n or 1), rel=1e-4)


@pytest.mark.parametrize("side", [-1, 1])
def test_an_error_beyond_the_uncertainty_is_the_models(side):
    allowed = budget(Comparison(TARGET, 1.2), KNOWN).expanded
    for share, judgement in ((0.99, "within uncertainty"), (1.01, "model differs")):
        row = Comparison(TARGET, 1.0 + side * share * allowed)
        assert budget(row, KNOWN).judgement == judgement


def test_null_models_stand_beside_the_u_val_of_the_model_s_numbers():
    """Two rows of one u_val: the model hits both, zero none, and half the smaller one; a number
    that is not found is within nothing."""
    reach = budget(Comparison(TARGET, 1.0), KNOWN).expanded
    targets = [replace(TARGET, name=f"{x} u", reference=x * reach) for x in (1.5, 10.0)]
    rows = tuple(Comparison(t, t.reference) for t in targets)
    known = {key_of("g", row): KNOWN for row in rows}
    judged = JudgedBoard(Board("g", rows, {}), known).judgements()
    within = {answer: count.get("within uncertainty", 0) for answer, count in judged.items()}
    assert within == {"model": 2, "no answer": 0, "halved": 1, "doubled": 0, "reversed": 0}
    lost = (rows[0], Comparison(targets[1], None))
    lacking = JudgedBoard(Board("g", lost, {}), known).judgements()["model"]
    assert lacking == {"within uncertainty": 1, "not found": 1}


def test_what_is_not_known_forms_no_u_val_and_is_said():
    without = Comparison(replace(TARGET, sd=None), 1.2)
    assert budget(without, KNOWN).u_val is None
    assert budget(without, KNOWN).judgement == "no u_val"
    assert "no SD" in budget(without, KNOWN).lacks
    assert "inputs" in budget(Comparison(TARGET, 1.2), NumberUncertainty(**NUMBER)).lacks
    assert "not varied" in budget(Comparison(TARGET, 1.2), None).lacks
    assert budget(Comparison(TARGET, None), KNOWN).judgement == "not found"
    assert budget(Comparison(without.target, None), KNOWN).judgement == "no u_val"


def test_a_verdict_that_uncertainty_changes_is_found():
    board = Board("g", (Comparison(TARGET, 1.2),), {})
    assert JudgedBoard(board, {KNOWN.key: KNOWN}).changed_verdicts() == []
    sure = KNOWN.model_copy(update={"inputs": INPUTS.model_copy(update={"mean": 1.0})})
    many = replace(TARGET, n=10_000)
    exact = sure.model_copy(update={"meshes": MESHES.model_copy(update={"values": (1.2,) * 3})})
    board = Board("g", (Comparison(many, 1.2),), {})
    ((row, found),) = JudgedBoard(board, {exact.key: exact}).changed_verdicts()
    assert (row.verdict, found.judgement) == ("inside 1 SD", "model differs")


def test_what_was_found_for_another_number_is_not_taken():
    (board,) = join_uncertainty([Board("g", (Comparison(TARGET, 1.2),), {})], {KNOWN.key: KNOWN})
    assert board.known == {KNOWN.key: KNOWN}
    (board,) = join_uncertainty([Board("g", (Comparison(TARGET, 1.21),), {})], {KNOWN.key: KNOWN})
    assert board.known == {}


def test_a_part_that_is_found_anew_leaves_the_others():
    board = Board("g", (Comparison(TARGET, 1.2),), {})
    before = UncertaintyFile(rows=(KNOWN,), samples=16)
    new = INPUTS.model_copy(update={"sd": 0.5})
    found = update(before, [board], {"inputs": {KNOWN.key: new}}, {"run, sample 3": "no"}, (), 20)
    (row,) = found.rows
    assert (row.meshes, row.inputs) == (MESHES, new)
    assert (found.samples, found.failed) == (20, {"run, sample 3": "no"})
    other = Board("h", (Comparison(TARGET, 1.2),), {})
    assert update(before, [other]).rows == ()


def test_the_file_is_read_as_it_was_written_and_another_is_refused(tmp_path: Path):
    place = tmp_path / "u.json"
    written = UncertaintyFile(meshes=(1.0, 2.25), samples=16, rows=(KNOWN,))
    write_record(place, written)
    read = read_uncertainty(place)
    assert read.rows[0].inputs == INPUTS
    assert read.rows[0].meshes.values == MESHES.values
    for text in ("{}", "[]", '{"format": "cosim uncertainty 1", "rows": [{"group": 1}]}'):
        place.write_text(text.replace("{}", '{"samples": "x"}'))
        with pytest.raises(InputError, match=r"u\.json"):
            read_uncertainty(place)


def boards_with(**values: float | None) -> list[Board]:
    rows = (Comparison(replace(TARGET, name=name), value) for name, value in values.items())
    return [Board("g", tuple(rows), {})]


def test_the_spread_is_about_the_number_of_the_case_as_it_is():
    rng = np.random.default_rng(1)
    drawn = rng.normal(1.5, 0.2, 12)
    versions = {f"sample {i}": boards_with(a=v, b=None) for i, v in enumerate(drawn)}
    versions |= {"sample 12": boards_with(a=None, b=None)}
    found = input_spreads({AS_IT_IS: boards_with(a=1.0, b=1.0), **versions})
    ((key, spread),) = found.items()
    assert key[2] == "a"
    assert (spread.samples, spread.failed) == (12, 1)
    assert spread.uncertainty == pytest.approx(hypot(drawn.std(ddof=1), drawn.mean() - 1.0))


def test_every_trial_has_a_case_at_every_sample():
    versions = input_versions(read_inputs(5))
    assert list(versions) == [AS_IT_IS, *(f"sample {i}" for i in range(1, 6))]
    shipped = [g for g in choose_groups(None) if not g.variant]
    trials = {t.name: t for g in shipped for t in g.trials if not t.study}
    some = [trials[name] for name in sorted(trials)[::7]]
    for version in versions.values():
        for trial in some:
            assert version(trial).hood.kind


def test_a_sample_moves_each_input_by_its_spread_and_a_straight_joint_not_below_straight():
    trials = {t.name: t for g in choose_groups(None) for t in g.trials}
    versions = input_versions(read_inputs(32))
    own, *sampled = (v(trials["strain average ti"]).hood for v in versions.values())
    slack = np.array([h.springs["interosseous_hood_radial"].slack for h in sampled])
    reach = own.springs["interosseous_hood_radial"].slack - slack
    assert 0 <= reach.min() < 0.1e-3
    assert 0.6e-3 < reach.max() <= 0.7e-3
    moduli = [h.regions["central_slip"].c5 / own.regions["central_slip"].c5 for h in sampled]
    assert np.mean(moduli) == pytest.approx(1.0, rel=0.15)
    assert np.std(moduli, ddof=1) == pytest.approx(0.464, rel=0.3)
    dips = [
        v(trials["strain average ti"]).finger.posture.angles()["DIP"] for v in versions.values()
    ]
    assert min(dips) == 0
    assert 0 < max(dips) <= np.radians(2) + 1e-12


def test_forms_are_the_ladders_hoods_and_friction():
    trials = {t.name: t for g in choose_groups(None) for t in g.trials}
    versions = form_versions()
    kinds = {n: v(trials["hood_minorflex_edc"]).hood for n, v in versions.items()}
    assert kinds["split"].kind == "split"
    assert kinds["cable"].kind == "cable"
    assert kinds[RUBBING].contact.friction == 0.1
    past = {v(trials["middle_minorflex_fdp"]).hood.kind for v in versions.values()}
    assert past == {"split"}
    found = form_values({"split": boards_with(a=1.0), "cable": boards_with(a=None)})
    assert list(found.values()) == [{"split": 1.0, "cable": None}]


def test_versions_are_compared_with_the_same_references_and_a_failure_has_no_number():
    target = replace(TARGET, quantity="difference.fingertip_magnitude_N", case="edc")
    group = TrialGroup("g", "experiment", (Trial("edc", "split_edc"),), (target,))

    def at(settings: list[str]):
        return lambda trial: load_case(trial.case, [*trial.settings, *settings])

    pulls = {"own": at([]), "more": at(["tendons.EDC={ tension = '5 N' }"]), "faulty": at(["x=1"])}
    found = run_versions([group], pulls, 1)
    values = {name: next(iter(values_of_boards(b).values())) for name, b in found.items()}
    assert values["more"] > values["own"] > 0
    assert values["faulty"] is None
    assert "x" in found["faulty"][0].failures["edc"]


@pytest.mark.slow
def test_the_command_finds_mesh_inputs_and_forms(tmp_path: Path):
    words = ["validate", "--only", "inferred: central slip", "--out", str(tmp_path)]
    coarse = ["--set", "hood.mesh.quads=300", "--meshes", "3", "--samples", "8", "--forms"]
    done = CliRunner().invoke(app, [*words, *coarse, "--workers", "1"])
    assert done.exit_code == 0, done.output
    told = read_uncertainty(tmp_path / "uncertainty.json")
    (row,) = told.rows
    assert row.meshes is not None
    assert row.inputs is not None
    assert {"split", "cable", RUBBING} <= set(row.forms)
    board = json.loads((tmp_path / "scoreboard.json").read_text(encoding="utf-8"))
    (shown,) = board["groups"]["inferred: central slip"]
    assert shown["u_num"] == pytest.approx(row.u_num, rel=1e-2)
    assert shown["judgement"] in {"within uncertainty", "model differs"}
    page = (tmp_path / "scoreboard.html").read_text(encoding="utf-8")
    assert "95 % of u" in page


def test_the_committed_uncertainties_are_those_of_the_committed_scoreboard():
    told = read_committed()
    board = json.loads((CASES / "scoreboard.json").read_text(encoding="utf-8"))
    models = {
        (g, r["case"], r["name"], r["quantity"]): r["model"]
        for g, rows in board["groups"].items()
        for r in rows
    }
    known = [row for row in told.rows if row.meshes is not None and row.inputs is not None]
    assert len(known) > 100
    assert told.samples >= 8
    for row in told.rows:
        assert row.model == pytest.approx(models[row.key], rel=1e-3, abs=1e-4)


def test_a_run_that_misses_its_audit_has_no_number_and_the_reason_is_kept():
    result = run_case(load_case("split_edc"))
    assert audited_summary(result)["difference"]
    missed = replace(result, summary={**result.summary, "audit_missed": ["force_balance"]})
    with pytest.raises(ConvergenceError, match=r"misses its audit: .*balance"):
        audited_summary(missed)


def test_a_hood_that_lacks_a_muscle_has_no_share_of_the_moment():
    group = share_group()
    (trial,) = group.trials
    full = run_case(load_case("split_edc", trial.settings)).summary
    arms = dict(full["unloaded"]["moment_arm_mm"])
    assert all(row.model for row in group.derived({trial.name: full}))
    del arms["FPI"]
    lacking = {**full, "unloaded": {**full["unloaded"], "moment_arm_mm": arms}}
    assert [row.model for row in group.derived({trial.name: lacking})] == [None, None]
