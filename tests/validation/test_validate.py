"""The validations: what is compared with what, and the scoreboard that says it."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from string import ascii_lowercase

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.length_experiments import EXPERIMENT_MODELS, Value, experiments
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.outcome import Outcome
from cosim.pipeline import batches_of
from cosim.results.audit import BOUNDS, Bound
from cosim.results.compare import Comparison, Target, verdict
from cosim.validation.force import AN, MYOHAND, PAST_THE_HOOD, THROUGH_THE_HOOD, two_models
from cosim.validation.free_finger import needed_stiffness
from cosim.validation.lengths import OWN_ZERO, measure_lengths
from cosim.validation.plan import STRAIGHT, groups, losses, rows_of, split_answers, trial_name
from cosim.validation.run import (
    MISSES,
    NOT_KNOWN,
    SPLIT,
    Board,
    _case,
    by_kind,
    choose_groups,
    explain_misses,
    folder_name,
    reasons,
    run_validation,
)
from cosim.validation.run import board_of as board_of_outcomes
from cosim.validation.scoreboard import join_uncertainty as with_uncertainty
from cosim.validation.scoreboard import scoreboard
from cosim.validation.skill import FACTORS, hand_data, hands_headline, judging_rows
from cosim.validation.trial import Trial, TrialGroup, angles_of
from tests.helpers.folders import ROOT

GROUPS = groups(Path("mi29.feb"))


BY_NAME = {g.name: g for g in GROUPS}
JUDGED = [g for g in GROUPS if not g.variant]


def test_every_trial_is_a_case_that_loads_and_every_target_belongs_to_a_trial_of_its_group():
    trials = {}
    for group in GROUPS:
        assert {t.case for t in group.targets} <= {t.name for t in group.trials}
        for trial in group.trials:
            assert trials.setdefault(trial.name, trial) == trial
            if not trial.published:
                load_case(trial.case, trial.settings)
    assert len(trials) > 60


@pytest.mark.parametrize("trial", [t for g in GROUPS for t in g.trials if t.muscle])
def test_a_trial_loads_the_muscle_in_the_posture_that_it_states(trial: Trial):
    """Its name is for people; what a row is of stands in its fields."""
    case = load_case(trial.case, trial.settings)
    pulls = {name: case.tension(name) for name in case.tendons}
    loaded = {name for name, pull in pulls.items() if pull == max(pulls.values())}
    assert {name.rstrip(ascii_lowercase) for name in loaded} == {trial.muscle}
    if trial.posture:
        posture = case.finger.posture.angles()
        stated = [np.degrees(posture[joint]) for joint in ("MCP", "PIP", "DIP")]
        assert stated == pytest.approx(angles_of(trial.posture))


def test_groups_are_of_one_kind_and_the_experiments_come_first():
    for group in GROUPS:
        assert {t.kind for t in group.targets if not t.fitted} <= {group.kind}
    order = [g.kind for g in JUDGED if g.name != "fitted numbers"]
    assert list(dict.fromkeys(order)) == [
        *("experiment", "experiment at second hand", "published model", "inferred")
    ]
    assert order == sorted(order, key=list(dict.fromkeys(order)).index)
    assert [g.variant for g in GROUPS] == sorted(g.variant for g in GROUPS)


def test_what_was_fitted_is_shown_in_a_group_of_its_own_that_counts_nothing():
    fitted = {t.name for g in GROUPS for t in g.targets if t.fitted}
    assert fitted == {t.name for t in BY_NAME["fitted numbers"].targets}
    assert f"{STRAIGHT}: terminal over central slip under EDC" in fitted
    assert sum(" EDC at the " in name for name in fitted) >= 2
    rows = list(rows_of(BY_NAME["fitted numbers"], {}))
    assert rows
    assert judging_rows(rows) == []


def test_no_target_of_an_experiment_holds_the_null_answer_unless_the_experiment_does():
    measured = [t for g in GROUPS for t in g.targets if t.kind.startswith("experiment")]
    assert len(measured) > 100
    marked = [t for t in measured if OWN_ZERO in t.note]
    for t in measured:
        holds = verdict(t, 0.0) in ("inside 1 SD", "inside the band")
        assert holds == (t in marked), t.name
    own = [t for t in marked if "Synek" not in t.source and "in Jadelis" not in t.source]
    assert {t.quantity for t in own} == {"measured.glide_mcp_mm"}
    lost = list(
        losses({trial_name(m, *ip) for m in (0, 30, 60) for ip in ((0, 0), (45, 15), (60, 30))}, {})
    )
    assert len(lost) == 14
    assert {verdict(row.target, 0.0) for row in lost} == {"outside"}


def test_no_muscle_that_passes_the_hood_is_judged_twice():
    seen = set()
    for group in JUDGED:
        for t in group.targets:
            if not t.fitted:
                key = (t.quantity, t.reference, t.sd, t.low, t.high, t.source, t.case)
                assert key not in seen, t.name
                seen.add(key)
    flexors = [
        n for g in JUDGED for n in {t.name for t in g.trials} if n.endswith(("_fdp", "_fds"))
    ]
    assert sorted(n for n in flexors if not n.startswith("free")) == [
        *("middle_majorflex_fdp", "middle_majorflex_fds"),
        *("middle_minorflex_fdp", "middle_minorflex_fds"),
    ]
    forces = [t.name for g in GROUPS for t in g.trials if t.name.startswith("force")]
    for muscle in PAST_THE_HOOD:
        assert [n for n in forces if n.endswith(muscle)] == [f"force split {muscle}"]


def test_nine_postures_of_the_shipped_hood():
    trials = BY_NAME["Lee 2008: slip forces"].trials
    assert len(trials) == 9
    (bent,) = [t for t in trials if t.name == trial_name(60, 45, 15)]
    case = load_case(bent.case, bent.settings)
    angles = case.finger.posture.angles()
    assert np.degrees(angles["MCP"]) == pytest.approx(60)
    assert np.degrees(angles["DIP"]) == pytest.approx(15)
    assert "60/45/15 deg, fibres" in case.title


def test_an_s_own_paths_are_not_compared_with_an_s_model():
    for group in GROUPS:
        for t in group.targets:
            assert not (t.case.startswith("force split") and t.source == AN)
    sources = {t.source for t in BY_NAME["two models: hood"].targets}
    assert sources == set(two_models()["EDC"]) == {AN, MYOHAND}


def test_the_twelve_rows_of_the_free_finger_are_as_printed_and_of_cases_of_their_own():
    hood, split = BY_NAME["free finger: hood"], BY_NAME["free finger: fixed split"]
    printed = {(t.case, t.quantity[-3:]): t.reference for t in hood.targets}
    assert len(printed) == len(hood.targets) == len(split.targets) == 12
    assert printed["free_fdp", "PIP"] == 41.8
    assert printed["free_edc", "MCP"] == -18.3
    for trial in (*hood.trials, *split.trials):
        case = load_case(trial.case)
        assert case.finger.tip.kind == "free"
        assert case.hood.kind == ("split" if "split" in trial.name else "shell")
    mcp = load_case("free_edc").finger.passive["MCP"].curve
    angle, torque = np.array(mcp).T
    assert np.interp(np.radians(33.2), angle, torque) == pytest.approx(0, abs=1e-12)
    slope = np.interp(np.radians([33.2, 34.2]), angle, torque) @ [-1, 1] / np.radians(1)
    assert slope == pytest.approx(-0.0391, rel=0.01)


def test_the_stiffness_that_the_free_finger_would_need_is_told_and_judges_nothing():
    group = BY_NAME["free finger: hood"]
    (held,) = [t for t in group.trials if t.case == "free_fds" and t.settings]
    case = load_case(held.case, held.settings)
    assert case.finger.tip.kind == "posture"
    angles = {j: np.degrees(a) for j, a in case.finger.posture.angles().items()}
    assert [angles[j] for j in ("MCP", "PIP", "DIP")] == pytest.approx([58.0, 92.9, 15.0])

    bears = {
        "passive": {"MCP": -16.0, "PIP": -20.0, "DIP": 1.0},
        "holder": {"MCP": -60.0, "PIP": -60.0, "DIP": -60.0},
    }
    rows = list(needed_stiffness([held], group.targets, {held.name: {"joint_torque_Nmm": bears}}))
    assert [r.target.quantity for r in rows] == ["needed_stiffness.MCP", "needed_stiffness.PIP"]
    assert rows[0].target.reference == pytest.approx(0.076 / np.radians(24.8))
    assert rows[0].model == pytest.approx(0.016 / np.radians(24.8))
    assert "4.8 times ours" in rows[0].target.note
    assert judging_rows(rows) == []


def test_lengths_and_cuts_are_judged_once_and_as_printed():
    first, rest = BY_NAME["lengths and cuts"], BY_NAME["lengths and cuts: other loads and places"]
    assert len(first.targets) == len(experiments()) == 14
    assert len(rest.targets) == sum(
        len(m.experiments) * (len(m.assumptions) - 1) for m in EXPERIMENT_MODELS.values()
    )
    printed = {(e.mean, e.sd, e.at_least) for e in experiments().values()}
    assert {(t.reference, t.sd, t.low) for t in first.targets} == printed
    assert all(t.high is None and t.note.startswith("n ") for t in first.targets)


def test_a_study_that_ends_early_keeps_what_it_measured(monkeypatch):
    def values(hood: str, settings: list[str]) -> Iterator[Value]:
        assert (hood, settings) == ("shell", ["a=1"])
        yield Value("glide_mcp", "", 0.02)
        raise ConvergenceError("no equilibrium")

    what = "glide of the terminal slip"
    monkeypatch.setitem(EXPERIMENT_MODELS, what, EXPERIMENT_MODELS[what]._replace(values=values))
    outcome = measure_lengths(what, ["a=1"])
    assert (outcome.status, outcome.reason) == ("failed", "no equilibrium")
    group = BY_NAME["lengths and cuts"]
    rows = {r.target.quantity: r for r in rows_of(group, {f"lengths: {what}": outcome.value})}
    assert rows["measured.glide_mcp_mm"].verdict == "inside 1 SD"
    assert rows["measured.glide_pip_mm"].verdict == "no value"


def test_a_slip_that_gains_force_is_outside_and_one_that_loses_as_much_as_measured_inside():
    def said(central: float, terminal: float) -> dict:
        return {"difference": {"slip_force_N": {"central": central, "terminal": terminal}}}

    straight, bent, flexed = trial_name(0, 0, 0), trial_name(0, 45, 15), trial_name(60, 0, 0)
    summaries = {straight: said(4.0, 7.0), bent: said(3.0, 7.7), flexed: said(2.0, 6.0)}
    found = {c.target.name: c for c in losses(set(summaries), summaries)}
    assert len(found) == 4
    central = found["central slip: force lost as the IP joints flex, 0/0/0 to 0/45/15"]
    assert (central.model, central.verdict) == (pytest.approx(0.25), "inside the band")
    assert found[central.target.name.replace("central", "terminal")].verdict == "outside"
    lost = found["terminal slip: force lost as the MCP flexes, 0/0/0 to 60/0/0"]
    assert (lost.model, lost.verdict) == (pytest.approx(1 / 7), "outside")
    assert found[lost.target.name.replace("terminal", "central")].verdict == "inside the band"
    summaries[straight] = said(0.1, 11.7)
    (slack, *_) = losses({straight, bent}, summaries)
    assert (slack.model, slack.verdict) == (None, "no value")


def test_a_trial_that_failed_stays_on_the_board():
    group = BY_NAME["Lee 2008: strains"]
    rows = tuple(rows_of(group, {}))
    assert rows
    assert {row.verdict for row in rows} == {"no value"}
    failed = Board(group.name, rows, {"strain soft ti": "no equilibrium"})
    text = scoreboard(with_uncertainty([failed], {}))
    board = json.loads(text)
    assert board["failed"] == {"strain soft ti": "no equilibrium"}
    assert board["judged"][group.name]["tally"]["model"] == {"no value": len(rows)}
    assert text == scoreboard(with_uncertainty([failed], {}))


def test_every_miss_of_the_committed_board_says_why():
    board = json.loads((ROOT / "cases" / "scoreboard.json").read_text(encoding="utf-8"))
    rows = [(name, row) for name, group in board["groups"].items() for row in group]
    missed = [(name, row) for name, row in rows if row["verdict"] in MISSES]
    assert missed
    assert all("why: " in row["note"] for _, row in missed)
    for group, row in rows:
        assert ("why: " in row["note"]) == (row["verdict"] in MISSES), (group, row["name"])


def test_every_reason_fits_a_group_and_stands_only_beside_a_miss():
    names = [g.name for g in GROUPS]
    assert all(any(fnmatchcase(n, r.group) for n in names) for r in reasons())
    name, note = "40 deg, RI, distal", "clamped"
    target = Target(name, "q", "N", 1.0, 0.1, None, None, "s", "experiment", note=note)
    rows = [Comparison(target, 1.05), Comparison(target, 2.0)]
    near, far = explain_misses("cadaver forces: hood", rows)
    assert near.target.note == "clamped"
    assert far.target.note.startswith("clamped; why: An's normative path of RI")
    (other,) = explain_misses("lengths and cuts", [Comparison(target, 2.0)])
    assert other.target.note == f"clamped; why: {NOT_KNOWN}"


def in_phalanx(printed: Sequence[float]) -> dict[str, float]:
    """A force of Synek's table (distal, palmar, radial) along our axes."""
    distal, palmar, radial = printed
    return {"distal": distal, "radial": radial, "dorsal": -palmar}


def board_of(group: TrialGroup, factor: float, **others: float) -> Board:
    """The board of models that say so many times what was measured; others: of trials by name."""

    def said(name: str) -> dict:
        times = others.get(name, factor)
        mine = [times * t.reference for t in group.targets if t.case == name]
        return {"difference": {"fingertip_force_in_phalanx_N": in_phalanx(mine)}}

    trials = [*(t.name for t in group.trials), *group.partners.values()]
    partner = {split: name for name, split in group.partners.items()}
    summaries = {n: said(partner.get(n, n)) for n in trials}
    for split, name in partner.items():
        summaries[split] = {
            "difference": {
                "fingertip_force_in_phalanx_N": in_phalanx(
                    [0.5 * t.reference for t in group.targets if t.case == name]
                )
            }
        }
    outcomes = {n: Outcome("converged", s) for n, s in summaries.items()}
    return board_of_outcomes(group, outcomes)


def test_a_board_says_in_its_first_line_whether_the_hood_beats_its_null_models():
    group = BY_NAME["cadaver forces: hood"]
    perfect = board_of(group, 1.0)
    alone = board_of(replace(group, hands={}), 1.0)
    assert alone.headline.startswith("Beats its null models: no answer 1 [1, 1]")
    assert alone.hand_lines == []
    assert perfect.headline.startswith("DOES NOT BEAT halved (skill 1 [-")  # three hands differ
    assert list(perfect.tallies()) == ["model", *FACTORS, SPLIT]
    assert perfect.tallies()["model"] == {"inside 1 SD": 24}
    assert perfect.tallies()["no answer"].get("outside", 0) > 10
    gains = {g.null: g for g in perfect.by_hand}
    assert list(gains) == [*FACTORS, SPLIT]
    assert gains["no answer"].count == "3 of 3"
    assert perfect.headline.endswith("Nearer hand by hand: " + hands_headline(perfect.by_hand))
    assert {s.hands for s in perfect.skills} == {3}
    assert {len(hands) for hands in perfect.hands.values()} == {3}
    assert any(line.startswith("noise: 0.32 N on a hand, 0.15 on") for line in perfect.hand_lines)
    overdone = board_of(group, 2.0)
    assert overdone.headline.startswith("DOES NOT BEAT no answer")
    assert f"{SPLIT} (skill -3" in overdone.headline
    said = json.loads(scoreboard(with_uncertainty([overdone], {})))
    judged = said["judged"][group.name]
    assert judged["headline"] == overdone.headline
    assert overdone.headline.startswith(said["kinds"]["experiment"]["headline"] + ". Nearer hand")
    assert [g["null"] for g in judged["by_hand"]] == [*FACTORS, SPLIT]
    assert {(len(g["resamples"]), len(g["without"])) for g in judged["by_hand"]} == {(10, 3)}
    assert [s["null"] for s in judged["skill"]] == [*FACTORS, SPLIT]
    assert {s["trials"] for s in judged["skill"]} == {8}


@pytest.mark.parametrize(
    ("group", "single", "mean", "perfect"),
    [
        ("hood", 0.32, 0.151, 0.884),
        ("fixed split", 0.32, 0.151, 0.884),
        ("flexors", 0.49, 0.231, 0.955),
    ],
)
def test_the_noise_of_three_hands_bounds_the_skill_of_a_perfect_model(group, single, mean, perfect):
    hands = BY_NAME[f"cadaver forces: {group}"].hands
    found = hand_data({h: [Comparison(t, 1.0) for t in targets] for h, targets in hands.items()})
    assert found.noise["N"] == pytest.approx((single, mean), abs=1e-3)
    assert found.gains("no answer").perfect == pytest.approx(perfect, abs=1e-3)


def test_the_fixed_split_answers_where_its_trial_was_run():
    group = BY_NAME["cadaver forces: hood"]
    rows = list(rows_of(group, {}))
    said = {"difference": {"fingertip_force_in_phalanx_N": in_phalanx([1.0, 2.0, 3.0])}}
    found = split_answers(group, rows, {"middle_minorflex_ri": said})
    assert {t.case for t in found} == {"hood_minorflex_ri"}
    assert list(found.values()) == [1.0, 2.0, 3.0]


def test_variants_and_fitted_rows_stay_out_of_the_tally_by_kind():
    def board(name: str, target: Target, *, variant: bool = False) -> Board:
        return Board(name, (Comparison(target, 1.0),), {}, kind=target.kind, variant=variant)

    target = Target("a", "q", "N", 1.0, 0.1, None, None, "s", "experiment", "t")
    fitted = replace(target, fitted=True)
    boards = [board("a", target), board("b", fitted), board("c", target, variant=True)]
    (found,) = by_kind(boards)
    assert (found.group, found.tallies()["model"]) == ("experiment", {"inside 1 SD": 1})


def test_numbers_on_the_board_have_six_digits():
    target = GROUPS[0].targets[0]
    (row,) = json.loads(
        scoreboard(with_uncertainty([Board("g", (Comparison(target, 1 / 3),), {})], {}))
    )["groups"]["g"]
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
    every = [Board("g", (Comparison(target, m),), {}) for m in models]
    boards = [scoreboard(with_uncertainty([board], {})) for board in every]
    (row,) = json.loads(boards[0])["groups"]["g"]
    assert row["difference"] == told
    assert boards[0] == boards[1]


def test_unknown_trials_and_half_a_scoreboard_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no group or trial has this name"):
        choose_groups("toe")
    run = CliRunner().invoke(app, ["validate", "--only", "toe", "--out", str(tmp_path / "v")])
    assert run.exit_code == 2
    half = CliRunner().invoke(app, ["validate", "--only", "EDC", "--update"])
    assert half.exit_code == 2
    assert "--update takes all trials" in half.stderr


def test_the_command_lists_trials_and_runs_none(tmp_path: Path):
    words = ["validate", "--list", "--only", "flex_ri", "--out", str(tmp_path / "v")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[:2] == ["cadaver forces: hood (experiment)", "  hood_minorflex_ri"]
    assert "cadaver forces: fixed split (experiment, variant)" in lines
    assert not (tmp_path / "v").exists()


def test_only_takes_every_line_that_the_list_prints(monkeypatch: pytest.MonkeyPatch):
    every = choose_groups(None)
    monkeypatch.setattr("cosim.validation.run.groups", lambda published: every)
    for group in every:
        for words in (group.name, group.listed):
            (chosen,) = choose_groups(words)
            assert (chosen.name, chosen.trials) == (group.name, group.trials)
        for trial in group.trials:
            assert trial in (t for g in choose_groups(f"  {trial.name}") for t in g.trials)


def test_the_command_runs_trials_and_leaves_runs_page_and_board(tmp_path: Path):
    words = ["validate", "--only", "force split E", "--out", str(tmp_path), "--workers", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "2 of 2, about 0 s left: force split EI" in done.stderr
    assert "0 of 0" not in done.stderr
    board = json.loads((tmp_path / "scoreboard.json").read_text(encoding="utf-8"))
    rows = board["groups"]["two models: fixed split"]
    page = (tmp_path / "scoreboard.html").read_text(encoding="utf-8").partition("<main>")[2]
    assert page.index("By kind of reference") < page.index("two models: fixed split")
    assert board["judged"]["two models: fixed split"]["headline"].split(" [")[0] in page
    assert all(row["name"] in page and row["name"].split(":")[0] in done.stdout for row in rows)
    own = json.loads(
        (tmp_path / "force_split_EDC" / "comparison.json").read_text(encoding="utf-8")
    )["rows"]
    assert {row["case"] for row in own} == {"force split EDC"}
    summary = json.loads(
        (tmp_path / "force_split_EDC" / "summary.json").read_text(encoding="utf-8")
    )
    (palmar,) = [r for r in own if r["name"].endswith("palmar, MyoHand")]
    assert palmar["model"] == -summary["difference"]["fingertip_force_N"]["dorsal"]


def test_trials_that_share_an_unloaded_equilibrium_are_run_side_by_side():
    trials = {t.name: t for g in GROUPS for t in g.trials if not (t.study or t.published)}
    cases = [_case(trial, ()) for trial in trials.values()]
    batches = batches_of(cases)
    assert sorted(i for batch in batches for i, _ in batch) == list(range(len(cases)))
    assert [len(batch) for batch in batches] == sorted(map(len, batches), reverse=True)
    assert [folder_name("strain average ti 60/0/0")] in [
        [case.name for _, case in batch if case.name.startswith("strain_average_ti_60")]
        for batch in batches
    ]
    names = [case.name for batch in batches for _, case in batch]
    forces = {f"force ti {m}" for m in THROUGH_THE_HOOD} | {"qiu hood EDC 30/45/15"}
    places = sorted(names.index(folder_name(name)) for name in forces)
    assert places == list(range(places[0], places[0] + len(forces)))


@pytest.mark.slow
def test_two_processes_give_the_board_of_one(tmp_path: Path):
    group = some_of_the_split("fdp")
    boards = [run_validation([group], tmp_path / str(n), workers=n) for n in (1, 2)]
    assert boards[0] == boards[1]
    assert not boards[0][0].failures
    assert boards[0][0].skills


@pytest.mark.slow
def test_a_process_that_is_killed_is_told_in_one_message(tmp_path: Path):
    def kill(text: str) -> None:
        for process in multiprocessing.active_children():
            process.kill()

    with pytest.raises(InputError, match="one worker needs the least"):
        run_validation([some_of_the_split("fdp", "fds", "lum")], tmp_path, progress=kill)


def some_of_the_split(*muscles: str) -> TrialGroup:
    """The middle finger without a hood in both postures, these muscles alone."""
    chosen = {group.name: group for group in choose_groups("middle_m")}
    past, split = chosen["cadaver forces: flexors"], chosen["cadaver forces: fixed split"]
    group = replace(past, trials=(*past.trials, *split.trials))
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


@pytest.mark.parametrize("given", [("--set", "hood.mesh={file}"), ("--published", "{file}")])
def test_the_published_hood_is_a_mesh_that_the_user_gives(tmp_path, given):
    file = tmp_path / "other.feb"
    file.write_text("<febio_spec version='4.0'/>", encoding="utf-8")
    arguments = [part.replace("{file}", str(file)) for part in given]
    only = ("--only", "published hood soft", "--workers", "1", "--out", str(tmp_path / "runs"))
    found = CliRunner().invoke(app, ["validate", *arguments, *only])
    assert found.exit_code == 2, found.output
    assert "other.feb" in found.output.replace("\n", "")
