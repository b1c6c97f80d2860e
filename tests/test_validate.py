"""The validations: what is compared with what, and the scoreboard that says it."""

from __future__ import annotations

import json
import multiprocessing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.audit import BOUNDS, Bound
from cosim.case import load_case
from cosim.cli import app
from cosim.compare import Comparison, Target
from cosim.port import InputError
from cosim.validate import Board, _batches, chosen, scoreboard, validated
from cosim.validation_force import (
    ANGLE,
    EXCESS,
    IDENTIFIED,
    MUSCLES,
    NEAR,
    THROUGH_THE_HOOD,
    angle_between,
    force_rows,
    force_trials,
    near_models,
    thesis_trials,
    two_models,
)
from cosim.validation_plan import LOST, groups, posed, rows_of, trends
from cosim.validation_reasons import MISSES, explained, reason_of, reasons
from cosim.validation_trial import Group, Trial

GROUPS = groups(Path("mi29.feb"))


def test_every_trial_is_a_case_that_loads_and_every_target_belongs_to_a_trial():
    names = [t.name for g in GROUPS for t in g.trials]
    assert len(set(names)) == len(names) > 60
    for group in GROUPS:
        for trial in group.trials:
            if group.name != "published hood":
                load_case(trial.case, trial.settings)
    assert {t.case for g in GROUPS for t in g.targets} <= set(names)


def test_only_one_number_was_fitted():
    fitted = {t.name for g in GROUPS for t in g.targets if t.fitted}
    calibrated = {name for name in fitted if not name.startswith("identified")}
    assert calibrated == {"average ti: terminal over central slip"}


def test_nine_postures_of_each_law():
    strain = [t for g in GROUPS if g.name == "strain" for t in g.trials]
    for law in ("ti", "iso"):
        assert len([t for t in strain if t.name.startswith(f"strain average {law}")]) == 9
    (bent,) = [t for t in strain if t.name == posed("ti", 60, 45, 15)]
    case = load_case(bent.case, bent.settings)
    angles = case.finger.posture.angles()
    assert np.degrees(angles["MCP"]) == pytest.approx(60)
    assert np.degrees(angles["DIP"]) == pytest.approx(15)
    assert "60/45/15 deg, fibres" in case.title


@pytest.mark.xfail(reason="identified on the hood of one thickness; to be identified anew")
def test_the_identified_material_predicts_forces_that_it_was_not_fitted_to():
    wanted = load_case(IDENTIFIED).hood.regions
    trials = [t for t in force_trials() if t.name.startswith("force identified")]
    assert [t.name.split()[-1] for t in trials] == list(THROUGH_THE_HOOD)
    for trial in trials:
        for name, region in load_case(trial.case, trial.settings).hood.regions.items():
            own, other = region.model_dump(), wanted[name].model_dump()
            for key in ("c1", "c3", "c4", "c5", "lam_max"):
                assert own[key] == pytest.approx(other[key], rel=1e-8), (name, key)


def test_angles_between_forces():
    x, y = np.eye(3)[:2]
    assert angle_between(x, 3 * y) == pytest.approx(90)
    assert angle_between(x, -x) == pytest.approx(180)
    assert angle_between(x, 2 * x) == 0.0
    assert angle_between(x, x + y) == pytest.approx(45)


def test_a_force_like_one_of_the_models_is_inside_and_one_across_it_is_not():
    trial = Trial("force ti EDC", "fingertip_fibres_edc")
    model = two_models()["EDC"]["An 1979"]

    def verdicts(force: np.ndarray) -> list[str]:
        size = float(np.linalg.norm(force))
        said = {"fingertip_force_N": force.tolist(), "fingertip_magnitude_N": size}
        return [c.verdict for c in near_models([trial], {trial.name: {"difference": said}})]

    assert verdicts(model) == ["inside the band", "inside the band"]
    assert verdicts(model + 10 * NEAR * model) == ["outside", "inside the band"]
    across = np.cross(model, [1.0, 0, 0])
    assert verdicts(across / np.linalg.norm(across) * 0.4) == ["inside the band", "outside"]
    (none, angle) = near_models([trial], {})
    assert none.verdict == angle.verdict == "no value"
    assert angle.target.high == ANGLE


def test_trends_compare_slips_with_those_of_straight_joints():
    def said(central: float, terminal: float) -> dict:
        return {"difference": {"slip_force_N": {"central": central, "terminal": terminal}}}

    straight, bent, flexed = posed("ti", 0, 0, 0), posed("ti", 0, 45, 15), posed("ti", 60, 0, 0)
    summaries = {straight: said(4.0, 7.0), bent: said(3.0, 7.7), flexed: said(2.0, 6.0)}
    found = {c.target.name: c for c in trends(set(summaries), summaries)}
    assert len(found) == 4
    central = found["average ti: central slip at 0/45/15 over 0/0/0"]
    assert (central.model, central.verdict) == (pytest.approx(0.75), "inside the band")
    assert found["average ti: terminal slip at 0/45/15 over 0/0/0"].verdict == "outside"
    lost = found["average ti: terminal slip at 60/0/0 over 0/0/0"]
    assert lost.target.high == LOST
    assert lost.verdict == "outside"
    assert found["average ti: central slip at 60/0/0 over 0/0/0"].verdict == "inside the band"


def test_no_trend_counts_from_a_slack_slip():
    def said(central: float, terminal: float) -> dict:
        return {"difference": {"slip_force_N": {"central": central, "terminal": terminal}}}

    summaries = {posed("iso", 0, 0, 0): said(0.1, 11.7), posed("iso", 0, 45, 15): said(0.2, 8.0)}
    found = {c.target.name: c for c in trends(set(summaries), summaries)}
    slack = found["average iso: central slip at 0/45/15 over 0/0/0"]
    assert (slack.model, slack.verdict) == (None, "no value")
    terminal = found["average iso: terminal slip at 0/45/15 over 0/0/0"]
    assert terminal.model == pytest.approx(8.0 / 11.7)


def test_a_trial_that_failed_stays_on_the_board():
    (group,) = [g for g in GROUPS if g.name == "strain"]
    rows = tuple(rows_of(group, {}))
    assert rows
    assert {row.verdict for row in rows} == {"no value"}
    text = scoreboard([Board(group.name, rows, {"strain soft ti": "no equilibrium"})])
    board = json.loads(text)
    assert board["failed"] == {"strain soft ti": "no equilibrium"}
    assert board["tally"] == {"strain": {"no value": len(rows)}}
    assert text == scoreboard([Board(group.name, rows, {"strain soft ti": "no equilibrium"})])


def test_every_miss_of_the_committed_board_says_why():
    board = json.loads(
        (Path(__file__).parents[1] / "cases" / "scoreboard.json").read_text(encoding="utf-8")
    )
    rows = [(name, row) for name, group in board["groups"].items() for row in group]
    missed = [(name, row) for name, row in rows if row["verdict"] in MISSES]
    assert missed
    assert all("why: " in row["note"] for _, row in missed)
    for group, row in rows:
        assert ("why: " in row["note"]) == (row["verdict"] in MISSES), (group, row["name"])


def test_a_sum_over_tendons_has_a_reason_of_its_own():
    (why,) = (r.text for r in reasons() if r.pattern.endswith("RMSE*"))
    assert reason_of("cadaver", "EDC, LUM, RI, UI, mean: RMSE, coupled hood") == why


def test_a_reason_stands_only_beside_a_miss():
    name, note = "40 deg, RI, distal", "clamped"
    target = Target(name, "q", "N", 1.0, 0.1, None, None, "s", "experiment", note=note)
    (near, far) = explained("cadaver", [Comparison(target, 1.05), Comparison(target, 2.0)])
    assert near.target.note == "clamped"
    assert far.target.note.startswith("clamped; why: An's normative path of RI")
    (other,) = explained("strain", [Comparison(target, 2.0)])
    assert other.target.note == "clamped"


def test_the_pass_of_the_thesis_is_compared_with_the_coupled_hood():
    trials = list(thesis_trials())
    names = [t.name for t in trials[:2]]
    said = {
        name: {"fingertip_magnitude_N": force, "bound_N": 1.5}
        for name, force in zip(names, (5.1, 0.4), strict=True)
    }
    over, passed, coupled = force_rows(trials[:2], said)
    assert over.model == pytest.approx(4.7)
    assert over.target.reference == EXCESS["EDC"]
    assert (passed.verdict, coupled.verdict) == ("outside", "inside the band")
    (missing, _) = force_rows(trials[:2], {names[0]: said[names[0]]})
    assert missing.verdict == "no value"


def test_numbers_on_the_board_have_six_digits():
    target = GROUPS[0].targets[0]
    (row,) = json.loads(scoreboard([Board("g", (Comparison(target, 1 / 3),), {})]))["groups"]["g"]
    assert row["model"] == 0.333333


@pytest.mark.parametrize(
    ("reference", "high", "models", "told"),
    [
        (-0.8, None, (-0.7211621500001, -0.7211620500001), 0.078838),
        (None, 0.40874318, (0.43693901, 0.43693899), 0.028196),
    ],
)
def test_a_difference_on_the_board_is_that_of_the_numbers_beside_it(reference, high, models, told):
    target = Target("n", "q", "N", reference, None, None, high, source="s", kind="experiment")
    boards = [scoreboard([Board("g", (Comparison(target, m),), {})]) for m in models]
    (row,) = json.loads(boards[0])["groups"]["g"]
    assert row["difference"] == told
    assert boards[0] == boards[1]


def test_unknown_trials_and_half_a_scoreboard_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no trial is called so"):
        chosen("toe")
    run = CliRunner().invoke(app, ["validate", "--only", "toe", "--out", str(tmp_path / "v")])
    assert run.exit_code == 2
    half = CliRunner().invoke(app, ["validate", "--only", "EDC", "--update"])
    assert half.exit_code == 2
    assert "--update takes all trials" in half.stderr


def test_the_command_runs_trials_and_leaves_runs_page_and_board(tmp_path: Path):
    words = ["validate", "--only", "force split E", "--out", str(tmp_path), "--workers", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "2 of 2: force split EI" in done.stderr
    board = json.loads((tmp_path / "scoreboard.json").read_text(encoding="utf-8"))
    rows = board["groups"]["force"]
    page = (tmp_path / "scoreboard.html").read_text(encoding="utf-8")
    assert all(row["name"] in page and row["name"].split(":")[0] in done.stdout for row in rows)
    own = json.loads(
        (tmp_path / "force_split_EDC" / "comparison.json").read_text(encoding="utf-8")
    )["rows"]
    assert {row["case"] for row in own} == {"force split EDC"}
    summary = json.loads(
        (tmp_path / "force_split_EDC" / "summary.json").read_text(encoding="utf-8")
    )
    (palmar,) = [r for r in own if r["name"].endswith("palmar, An 1979")]
    assert palmar["model"] == summary["difference"]["fingertip_force_N"][1]


def test_trials_that_share_an_unloaded_equilibrium_are_run_by_one_process():
    tasks = [(t, (), "") for g in GROUPS for t in g.trials]
    batches = _batches(tasks)
    assert sorted(t.name for batch in batches for t, *_ in batch) == sorted(
        t.name for t, *_ in tasks
    )
    names = [[t.name for t, *_ in batch] for batch in batches]
    (forces,) = [batch for batch in names if "force ti EDC" in batch]
    assert set(forces) == {f"force ti {m}" for m in MUSCLES}
    assert ["strain average ti 60/0/0"] in names
    assert [len(batch) for batch in names] == sorted(map(len, names), reverse=True)


def test_two_processes_give_the_board_of_one(tmp_path: Path):
    boards = [validated([some_of_the_split("fdp")], tmp_path / str(n), workers=n) for n in (1, 2)]
    assert boards[0] == boards[1]
    assert not boards[0][0].failures


def test_a_process_that_is_killed_is_told_in_one_message(tmp_path: Path):
    def kill(text: str) -> None:
        for process in multiprocessing.active_children():
            process.kill()

    with pytest.raises(InputError, match="--workers 1 needs the least"):
        validated([some_of_the_split("fdp", "fds", "lum")], tmp_path, told=kill)


def some_of_the_split(*muscles: str) -> Group:
    """The middle finger with the fixed split in both postures, these muscles alone."""
    (group,) = chosen("middle_m")
    kept = [t for t in group.trials if t.name.endswith(muscles)]
    return replace(group, trials=tuple(kept))


def test_trials_whose_audit_is_missed_are_said_last(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(BOUNDS, "finger_residual", Bound(-1.0, "nothing helps"))
    words = ["validate", "--only", "middle_minorflex_fdp", "--out", str(tmp_path), "--workers", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 3
    *_, loud, reason = done.stderr.splitlines()
    assert loud.endswith("THE AUDIT IS MISSED, do not trust this result")
    assert reason.endswith("more than -1: nothing helps")


def test_hood_and_split_are_compared_over_the_trials_that_both_have():
    (group,) = [g for g in GROUPS if g.name == "cadaver"]

    def said(name: str, off: float) -> dict:
        vector = [
            t.reference + off
            for t in group.targets
            if t.case == name and "force_in_phalanx" in t.quantity
        ]
        return {"difference": {"fingertip_force_in_phalanx_N": vector}}

    summaries = {t.name: said(t.name, 0.1) for t in group.trials if t.name.startswith("hood")}
    summaries |= {t.name: said(t.name, 0.2) for t in group.trials if t.name.startswith("middle")}
    del summaries["hood_majorflex_ui"]
    found = {c.target.name: c for c in rows_of(group, summaries)}
    mean = found["EDC, LUM, RI, UI, mean: RMSE, coupled hood"]
    assert (mean.model, mean.target.high) == (pytest.approx(0.1), pytest.approx(0.2))
    assert mean.verdict == "inside the band"
    assert "7 of 8 trials" in mean.target.note
    assert found["all tendons: median angle, coupled hood"].target.note == "11 of 12 trials"
    assert any(c.verdict == "no value" for c in found.values())


@pytest.mark.parametrize("given", [("--set", "hood.mesh={file}"), ("--published", "{file}")])
def test_the_published_hood_is_a_mesh_that_the_user_gives(tmp_path, given):
    file = tmp_path / "other.feb"
    file.write_text("<febio_spec version='4.0'/>", encoding="utf-8")
    arguments = [part.replace("{file}", str(file)) for part in given]
    only = ("--only", "published hood soft", "--workers", "1", "--out", str(tmp_path / "runs"))
    found = CliRunner().invoke(app, ["validate", *arguments, *only])
    assert found.exit_code == 2, found.output
    assert "other.feb" in found.output.replace("\n", "")
