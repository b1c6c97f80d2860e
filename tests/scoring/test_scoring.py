"""`cosim score`: rows against closed forms, skill and rank by hand, what is told of a model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas
import pytest

import cosim
from cosim.commands.score import _show_losses
from cosim.errors import InputError
from cosim.results.compare import Comparison, Target
from cosim.scoring import names as score_names
from cosim.scoring import plausible, references
from cosim.scoring import run as score_run
from cosim.scoring.groups import (
    ARMS,
    DIFFERENCES,
    LOAD,
    SIZES,
    row_words,
    rows_of_group,
    score_groups,
    trials_of,
)
from cosim.scoring.model import read_hand
from cosim.scoring.names import FINGERS, Matched, match_names, read_names, shipped_names
from cosim.scoring.run import judge
from cosim.scoring.scores import Scores
from cosim.text_tables import read_toml
from rigid.mjcf.read import NamedJoint, PartNames
from tests.helpers.folders import ROOT
from tests.helpers.jobs import run

LENGTHS = (45.0, 23.0, 22.0)
FULL = {"MCP": 90.0, "PIP": 100.0, "DIP": 80.0}
SPANS: Mapping[str, Mapping[str, tuple[float, float, float, float]]] = {
    "FDP2": {"MCP": (20, -10, 20, -9), "PIP": (15, -6, 12, -5), "DIP": (9, -4, 10, -4)},
    "FDS2": {"MCP": (20, -12, 20, -11), "PIP": (2, 8, 2, 7)},
    "EDC2": {"MCP": (3, 10, 3, 9), "PIP": (2, 5, 2, 5), "DIP": (1, 4, 1, 4)},
}
"""mm, by tendon and joint: how far proximal of the joint a point of the bone before it lies and how
high dorsal, and the same of a point distal of the joint.  The FDS runs over the back of the PIP."""
JOINTS = ("MCP", "PIP", "DIP")


def arm(span: tuple[float, float, float, float], angle: float) -> float:
    """The closed form (mm) of a straight line's arm, flexion positive, at an angle (rad)."""
    before, height, after, depth = span
    c, s = np.cos(angle), np.sin(angle)
    line = np.array([after * c + depth * s + before, -after * s + depth * c - height])
    slope = np.array([-after * s + depth * c, -after * c - depth * s])
    return float(-line @ slope / np.linalg.norm(line))


def finger_xml(tip: str = '<site name="IFtip" pos=".022 0 0"/>', pip: str = "0 1 0") -> str:
    """A finger of three phalanges with these tendons."""
    bones = ("mc", "p1", "p2", "p3")
    sites: dict[str, str] = dict.fromkeys(bones, "")
    tendons = ""
    for name, spans in SPANS.items():
        path = ""
        for k, joint in enumerate(JOINTS):
            if joint not in spans:
                continue
            before, height, after, depth = spans[joint]
            end = 0.0 if k == 0 else LENGTHS[k - 1]
            for bone, x, z in ((bones[k], end - before, height), (bones[k + 1], after, depth)):
                site = f"{name}_{joint}_{bone}"
                sites[bone] += f'<site name="{site}" pos="{x / 1e3} 0 {z / 1e3}"/>'
                path += f'<site site="{site}"/>'
        tendons += f'<spatial name="{name}">{path}</spatial>'
    low, high = sorted((0.0, float(pip.split()[1]) * FULL["PIP"]))
    mass = '<geom type="sphere" size=".004" mass=".01"/>'
    return f"""<mujoco><compiler angle="degree" autolimits="true"/><worldbody>
    <body name="mc">{mass}{sites["mc"]}<body name="p1">{mass}{sites["p1"]}
      <joint name="2mcp_abduction" axis="0 0 1" range="-20 20"/>
      <joint name="2mcp_flexion" axis="0 1 0" range="0 {FULL["MCP"]}"/>
      <body name="p2" pos=".045 0 0">{mass}{sites["p2"]}
        <joint name="2pm_flexion" axis="{pip}" range="{low} {high}"/>
        <body name="p3" pos=".023 0 0">{mass}{sites["p3"]}{tip}
          <joint name="2md_flexion" axis="0 1 0" range="0 {FULL["DIP"]}"/>
    </body></body></body></body></worldbody><tendon>{tendons}</tendon></mujoco>"""


@pytest.fixture(scope="module")
def scores(tmp_path_factory: pytest.TempPathFactory) -> Scores:
    """The analytic finger beside the fixed split."""
    path = tmp_path_factory.mktemp("model") / "straight.xml"
    path.write_text(finger_xml())
    return cosim.score(path, "split_edc")


def values(scores: Scores, group: str) -> dict[str, float]:
    """The first model's numbers of a group by row."""
    (mine,) = (g for g in scores.hands[0].groups if g.group.name == group)
    return {r.target.name: r.model for r in mine.rows if r.model is not None}


def test_arms_over_a_range_are_the_closed_form(scores: Scores) -> None:
    found = values(scores, ARMS)
    for joint in JOINTS:
        angles = np.linspace(0, np.radians(FULL[joint]), 19)
        mean = np.mean([arm(SPANS["FDP2"][joint], a) for a in angles])
        ours = [v for name, v in found.items() if name.startswith(f"FDP: arm at the {joint},")]
        assert ours
        assert ours == pytest.approx([mean] * len(ours), rel=1e-6)


def test_differences_by_the_clamped_force_are_the_closed_form(scores: Scores) -> None:
    """What the force at the clamped fingertip says of the arms, in every measured posture."""
    found = values(scores, DIFFERENCES)
    postures = {name.split()[1].rstrip(":") for name in found}
    assert len(postures) >= 3
    for muscle in ("EDC", "FDP"):
        for posture in postures:
            angles = map(np.radians, map(float, posture.split("/")))
            mcp, pip, dip = (
                arm(SPANS[f"{muscle}2"][j], a) for j, a in zip(JOINTS, angles, strict=True)
            )
            words = ("MCP less PIP arm", "PIP less DIP arm")
            ours = [found[f"{muscle} {posture}: {w}"] for w in words]
            assert ours == pytest.approx([mcp - pip, pip - dip], abs=2e-3)


def test_a_muscle_of_the_wrong_sign_is_told(scores: Scores) -> None:
    straight, split = scores.hands
    assert [d.partition(" (")[0] for d in straight.doubts] == ["FDS extends the PIP"]
    assert "flexes the PIP" in straight.doubts[0]
    assert "Ketchum" in straight.doubts[0]
    assert split.doubts == ()


def test_what_a_model_lacks_is_left_out_and_said(scores: Scores) -> None:
    hand = scores.hands[0]
    assert set(hand.model.missing) == {"EI", "LUM", "FPI", "FDI"}
    by_name = {g.group.name: g for g in hand.groups}
    sizes = by_name[SIZES]
    assert {r.target.name.split()[0] for r in sizes.judged} == {"EDC", "FDP", "FDS"}
    assert "the model has no LUM" in sizes.unjudged.values()
    assert "LUM" in by_name["shares of the flexion moment"].why_not
    assert "no slips" in by_name["slips: terminal over central"].why_not
    assert len(scores.table) == len(list(scores.records()))
    assert set(scores.summary.model) == {"straight", "split_edc"}


def test_names_are_asked_for_muscles_that_were_not_found_and_no_others(
    scores: Scores, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sum of joint angles has no path and is dropped; what the importer of an OpenSim model drops
    has lost its name, and not how it was found."""
    path = tmp_path / "fixed.xml"
    angles = '<fixed name="EDC2"><joint joint="2pm_flexion" coef=".01"/></fixed>'
    path.write_text(re.sub('<spatial name="EDC2">.*?</spatial>', angles, finger_xml()))
    fixed = read_hand(path, tmp_path / "work")
    imported = replace(fixed, matched=Matched({}, {"LUM": "given", "FDIl": "given"}))
    for model, dropped, unfound in (
        (scores.hands[0].model, "", "EI, LUM, FPI, FDI"),
        (fixed, "EDC", "EI, LUM, FPI, FDI"),
        (imported, "LUM, FDI", "EDC, EI, FPI"),
        (replace(imported, tendons=("EDC", "EI", "FPI", "FDP", "FDS")), "LUM, FDI", ""),
        (replace(fixed, tendons=("EDC", "EI", "LUM", "FPI", "FDP", "FDS", "FDIm")), "", ""),
    ):
        _show_losses(replace(scores.hands[0], model=model))
        told = capsys.readouterr().out
        assert re.findall("DROPPED.*: (.*)", told) == [dropped][: bool(dropped)]
        assert re.findall("NO MUSCLE FOUND for (.*); name them", told) == [unfound][: bool(unfound)]


def test_a_page_says_first_what_reading_lost(scores: Scores, tmp_path: Path) -> None:
    page, table = scores.write(tmp_path / "out")
    text = page.read_text(encoding="utf-8")
    assert len(text) < 3e6
    assert text.index("What reading straight lost") < text.index('id="scores"')
    assert "No muscle was found or read for EI, LUM, FPI, FDI" in text
    assert "FDP2" in text[text.index('id="names"') :]
    assert "FDS extends the PIP" in text
    assert table.read_text().startswith("model,source,finger,group")


def test_the_shipped_references_are_what_is_computed(scores: Scores) -> None:
    """The fixed split's numbers are those of the file, so that it is told to be that reference."""
    shipped = references.reference_values()["split_edc"]
    ours = [v for v in scores.judged_values() if v["model"] == "split_edc"]
    assert len(ours) == len(shipped)
    for v in ours:
        assert shipped[v["finger"], v["group"], v["row"]] == pytest.approx(v["value"], rel=1e-3)
    split = scores.hands[1].groups[0].rank
    assert split is not None
    assert "split_edc" in split.same
    assert split.of == len(split.skills) - len(split.same) + 1


# Skill and rank -----------------------------------------------------------------------------------


def rows(*models: float) -> list[Comparison]:
    """Rows whose measured numbers are 3 and 4."""
    place = (None, None, None, "hands", "experiment")
    targets = [Target(f"row {i}", "q", "1", at, *place, str(i)) for i, at in enumerate((3.0, 4.0))]
    return [Comparison(t, m) for t, m in zip(targets, models, strict=True)]


@pytest.mark.parametrize(("factor", "skill"), [(1.0, 1.0), (0.0, 0.0), (0.5, 0.75), (-1.0, -3.0)])
def test_a_model_of_the_measured_numbers_is_perfect_and_of_zeros_worth_nothing(
    monkeypatch: pytest.MonkeyPatch, scores: Scores, factor: float, skill: float
) -> None:
    """Every group of a model that says the measured numbers times a factor."""
    of = score_run.rows_of_group

    def fed(*args: object) -> object:
        found, _ = of(*args)  # type: ignore[arg-type]
        told = [r for r in found if r.target.reference]
        return [replace(r, model=factor * (r.target.reference or 0.0)) for r in told], {}

    monkeypatch.setattr(score_run, "rows_of_group", fed)
    judged = 0
    for group in score_groups("index"):
        score = score_run._score_group(scores.hands[1].model, group, {}, references=False)
        if score.skill is not None:
            judged += 1
            assert score.skill.value == pytest.approx(skill)
    assert judged >= 4


def test_rank_counts_the_nearer_models_on_shared_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors 1 and 1 make a skill of 1 - 2 / 25; the reference without a row is compared on the
    other."""
    known = {
        "nearer": {("index", "g", "row 0"): 3.0, ("index", "g", "row 1"): 4.5},
        "farther": {("index", "g", "row 0"): 0.0, ("index", "g", "row 1"): 0.0},
        "half": {("index", "g", "row 1"): 3.1},
        "same": {("index", "g", "row 0"): 4.0, ("index", "g", "row 1"): 5.0},
        "of another group": {("index", "h", "row 0"): 3.0},
    }
    monkeypatch.setattr(references, "reference_values", lambda: known)
    rank = references.rank_of("g", "index", rows(4.0, 5.0))
    assert rank is not None
    assert rank.better == ("nearer", "half")
    assert rank.same == ("same",)
    assert str(rank) == "3 of 4"
    assert rank.skills["nearer"] == pytest.approx(1 - 0.25 / 25)
    assert rank.skills["half"] == pytest.approx(1 - 0.81 / 16)
    assert references.rank_of("g", "middle", rows(4.0, 5.0)) is None


def test_references_are_replaced_by_model_and_finger(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    head = "model,finger,group,row,value"
    path.write_text(f"# note\n{head}\nb,index,g,r,1\nb,middle,g,r,2\na,index,g,r,3\n")
    new = {"model": "b", "finger": "index", "group": "g", "row": "s", "value": 5.0}
    references.update_references(path, [new])
    lines = path.read_text().splitlines()
    assert lines[:2] == ["# note", head]
    assert set(lines[2:]) == {"b,middle,g,r,2", "a,index,g,r,3", "b,index,g,s,5.0"}


# Names --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", score_names.SHIPPED)
def test_every_shipped_name_is_found(which: str) -> None:
    """Each alternative of a mapping, alone in a model, is taken for our part, by the mapping; and
    by its usual name too."""
    patterns = read_toml(Path(str(files("cases"))) / "data" / "names_fingers.toml")
    for ours, alternatives in shipped_names(which).items():
        if ours in ("metacarpal", "proximal", "middle", "distal"):
            continue
        for name in alternatives.split("|"):
            is_joint = ours in ("MCP", "MCP_abduction", "PIP", "DIP")
            hinges = {name: NamedJoint("b", "a", (0.0, 1.0))} if is_joint else {}
            sites = (name,) if ours == "tip" else ()
            tendons = (name,) if not hinges and not sites else ()
            found = match_names(PartNames((), hinges, sites, tendons), "index")
            assert found.names == {ours: name}
            assert re.fullmatch(patterns["index"][ours], score_names._short(name)), name


def test_usual_names_are_known_of_both_fingers() -> None:
    patterns = score_names._patterns()
    assert set(patterns) == set(FINGERS)
    for finger in FINGERS:
        assert {"MCP", "MCP_abduction", "PIP", "DIP"} <= set(patterns[finger])
    assert score_names._short("FDP2_tendon_r") == "fdp2"


def test_a_joint_of_the_other_sense_is_turned(tmp_path: Path) -> None:
    """The same finger with its PIP flexing the negative way has the same arms."""
    path = tmp_path / "turned.xml"
    path.write_text(finger_xml(pip="0 -1 0"))
    model = read_hand(path, tmp_path / "work")
    assert model.matched is not None
    assert model.matched.names["PIP"] == "-2pm_flexion"
    found, _ = rows_of_group(model, score_groups("index")[0], {})
    value = next(r.model for r in found if r.target.name.startswith("FDP: arm at the PIP"))
    angles = np.linspace(0, np.radians(FULL["PIP"]), 19)
    assert value == pytest.approx(np.mean([arm(SPANS["FDP2"]["PIP"], a) for a in angles]), rel=1e-6)


def test_without_a_fingertip_no_force_is_judged(tmp_path: Path) -> None:
    path = tmp_path / "blunt.xml"
    path.write_text(finger_xml(tip=""))
    (hand,) = judge([read_hand(path, tmp_path / "work")], 1)
    assert any(line.startswith("assumed: the fingertip") for line in hand.model.losses_of_finger)
    by_name = {g.group.name: g for g in hand.groups}
    assert "fingertip is" in by_name[SIZES].why_not
    difference = by_name[DIFFERENCES].rows[0]
    mcp, pip, _ = map(float, difference.target.name.split()[1].rstrip(":").split("/"))
    spans = SPANS["EDC2"]
    expected = arm(spans["MCP"], np.radians(mcp)) - arm(spans["PIP"], np.radians(pip))
    assert difference.model == pytest.approx(expected, abs=2e-3)


def test_a_sign_is_published_where_all_agree_by_a_millimetre(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One source says little of the FDS, two differ over the EDC, and a model is no witness."""
    rows = [
        *(("FDP", "PIP", 5.0, "A"), ("FDP", "PIP", 7.0, "B"), ("FDS", "DIP", 0.8, "A")),
        *(("FDS", "DIP", 3.0, "B"), ("EDC", "PIP", -4.0, "A"), ("EDC", "PIP", 2.0, "B")),
        *(("LUM", "PIP", -2.0, "A"), ("LUM", "PIP", 4.0, "MyoHand")),
    ]
    known = pandas.DataFrame(rows, columns=["tendon", "joint", "arm_mm", "source"])
    monkeypatch.setattr(plausible, "published_arms", lambda finger: known)
    assert plausible.published_signs("index") == {
        ("FDP", "PIP"): (1, ("A", "B")),
        ("LUM", "PIP"): (-1, ("A",)),
    }


def test_numbers_that_are_another_groups_once_more_count_once(scores: Scores) -> None:
    for hand in scores.hands:
        counted = tuple(g for g in hand.groups if g.group.counts)
        assert sum(len(g.judged) for g in hand.groups) > sum(len(g.judged) for g in counted) > 0
        assert hand.overall == replace(hand, groups=counted).overall


@pytest.mark.parametrize(("scale", "way"), [(0.8, "below"), (1.0, ""), (1.25, "above")])
def test_a_phalanx_far_off_the_measured_ones_is_told(
    tmp_path: Path, scale: float, way: str
) -> None:
    case = cosim.load("split_edc", [f"finger.length_scale={scale}"])
    told = [d for d in score_run.doubts(read_hand(case, tmp_path), {}) if "phalanx" in d]
    assert (told != []) == (way != "")
    assert all(f"SD {way} that of 5 measured hands" in d for d in told)


def test_an_opensim_hand_goes_through_the_importer(tmp_path: Path) -> None:
    """Its strengths and fibres come from the file, and what the importer lost is told first."""
    path = ROOT / "cases" / "data" / "finger.osim"
    model = read_hand(path, tmp_path)
    assert model.source == "OpenSim"
    assert model.matched is not None
    assert model.matched.names["FDIm"] == "FDI"
    assert model.strengths["FDP"] > 0
    assert model.fibres["FDP"] == pytest.approx(0.075)
    assert any("CoordinateLimitForce" in line for line in model.losses_of_finger)
    assert model.missing == ()
    longer = replace(model, fibres={"FDP": 30 * 0.075, "FDS": 0.084})
    (told,) = (d for d in score_run.doubts(longer, {}) if "fibre" in d)
    assert told.startswith("FDP: optimal fibre length")
    assert "a factor of 30" in told


# Faults -------------------------------------------------------------------------------------------

NO_FINGER = '<mujoco><worldbody><body><joint name="elbow"/><geom size="1"/></body></worldbody>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco>", "is no MuJoCo model"),
        (f"{NO_FINGER}</mujoco>", "no index or middle or ring or little finger was found"),
        (finger_xml().partition("<tendon>")[0] + "</mujoco>", "no muscle of the index"),
        (finger_xml().replace('spatial name="', 'spatial name="x'), "xFDP2"),
    ],
)
def test_what_cannot_be_judged_ends_with_code_2(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(text)
    done = run("score", path, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert words in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "out").exists()


def test_names_of_ones_own_are_taken_or_refused(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('FDP = "FDS2"\n')
    assert read_names(own) == {"FDP": "FDS2"}
    parts = PartNames((), {}, (), ("FDP2", "FDS2"))
    assert match_names(parts, "index", read_names(own)).names == {"FDP": "FDS2"}
    own.write_text('FDQ = "FDS2"\n')
    with pytest.raises(InputError, match="FDQ: write lines like"):
        read_names(own)


def test_a_finger_that_nobody_measured_is_refused() -> None:
    with pytest.raises(InputError, match="kind 'robot'"):
        cosim.score("robot_cable_extensor")
    with pytest.raises(InputError, match="name one or more"):
        cosim.score()
    with pytest.raises(InputError, match="finger"):
        cosim.score("split_edc", finger="thumb")  # type: ignore[arg-type]


def test_a_middle_finger_is_judged_by_its_hands() -> None:
    """Names of rows say muscle and posture, and the noise is that of three hands."""
    (hand,) = judge([read_hand("middle_minorflex_edc", Path("unused"))], 1)
    by_name = {g.group.name: g for g in hand.groups}
    forces = by_name["fingertip forces of cadavers"]
    words = [row_words(forces.group, r) for r in forces.rows]
    assert words[0].startswith("EDC 40/55/35: ")
    assert len(set(words)) == len(words)
    every = [row_words(g.group, r) for g in hand.groups for r in g.rows]
    assert len(every) > len(words)
    assert not any("_" in text or "hood" in text for text in every)
    assert "a perfect model expects a skill of" in forces.floor
    assert forces.rank is not None
    assert forces.rank.skills["middle_minorflex_edc"] == pytest.approx(forces.skill.value, rel=1e-3)


def test_the_heads_of_a_muscle_share_what_a_trial_loads_it_with(tmp_path):
    """Both heads of the first dorsal interosseous bear half each of what one muscle would."""
    hand = read_hand(cosim.load("split_edc"), tmp_path)
    groups = score_groups("index")
    trials = [trial for group in groups for g in group.groups for trial in g.trials]
    of_fdi = {trial.name for trial in trials if trial.muscle == "FDI"}
    pulled = [
        {n: t.tension for n, t in case.tendons.items() if t.tension}
        for name, case in trials_of(hand, groups).items()
        if name in of_fdi
    ]
    assert pulled
    most = {n: t.max_force for n, t in hand.case.tendons.items()}
    for loads in pulled:
        assert set(loads) == {"FDIm", "FDIl"}
        for head, tension in loads.items():
            assert tension == pytest.approx(LOAD * most[head] / 2, rel=1e-12)
