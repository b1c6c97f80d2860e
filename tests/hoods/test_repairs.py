"""What a surgeon joins: sutures and grafts, and repairs beside each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.analyses.repairs import (
    Compared,
    RepairTable,
    _share_of_strength,
    compare_repairs,
    read_repairs,
    table_of_repairs,
)
from cosim.analyses.repairs_page import repair_sentences, repairs_page
from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.fingers.kinds import anatomy_of, skeleton_of
from cosim.hoods.lesion import apply_lesion_to_mesh
from cosim.hoods.repairs import suture
from cosim.models.build import build
from cosim.port import Motion
from meshes.severed import PLACES, cut_ends
from meshes.skeleton import BODIES
from tests.helpers.folders import ROOT
from tests.helpers.jobs import run

COARSE = "hood.mesh.quads=104"
QUICK = "output.picture=false"
CUT = 'lesion.cut=["central_slip"]'
STIFF = 'lesion.suture.central_slip={stiffness="2000 N/mm"}'
LOOSE = 'lesion.suture.central_slip={stiffness="2000 N/mm",gap="9 mm"}'


def solved(*settings: str) -> cosim.Result:
    return cosim.run(load_case("isometric_edc", [COARSE, *settings]))


@pytest.fixture(scope="module")
def three() -> tuple[cosim.Result, cosim.Result, cosim.Result]:
    """Intact, cut, and sutured stiffly."""
    return solved(), solved(CUT), solved(CUT, STIFF)


def test_a_stiff_suture_is_the_slip_again(three):
    intact, cut, sutured = three
    for axis, newtons in intact.tip_force.items():
        change = abs(cut.tip_force[axis] - newtons)
        assert sutured.tip_force[axis] == pytest.approx(newtons, abs=0.1 * change + 1e-3), axis
    assert sutured.slips == pytest.approx(intact.slips, rel=0.03)
    assert cut.slips["central"] == 0.0
    assert sutured.audit.passed


def test_what_the_suture_bears_is_the_slip_s_force_on_the_bone(three):
    sutured = three[2]
    borne = sutured.summary["repair_force_N"]["suture_central_slip"]
    assert borne == pytest.approx(
        sutured.slips["central"], rel=0.02
    )  # its strands are near parallel
    assert "suture_central_slip" not in sutured.summary["spring_force_N"]
    rows = sutured.ledger.query("body == 'middle' and source == 'hood suture_central_slip'")
    assert len(rows)
    assert "repair_force_N.suture_central_slip" in sutured.quantities.index


def test_a_gap_that_is_not_closed_is_the_cut(three):
    cut, loose = three[1], solved(CUT, LOOSE)
    assert loose.summary["repair_force_N"]["suture_central_slip"] == 0.0
    assert loose.tip_force == pytest.approx(cut.tip_force, abs=1e-6)


@pytest.mark.parametrize("part", PLACES)
@pytest.mark.parametrize("quads", [104, 416])
def test_the_ends_of_a_cut_face_each_other(part, quads):
    case = load_case("isometric_edc", [f"hood.mesh.quads={quads}", f'lesion.cut=["{part}"]'])
    laid = anatomy_of(case.finger, case.hood.left_to_finger)
    from cosim.hoods.shell.build import generate_mesh

    mesh = apply_lesion_to_mesh(generate_mesh(case.hood, laid), case.lesion)
    first, last = cut_ends(mesh, part).T
    assert (mesh.station[first] <= PLACES[part]).all()
    assert (mesh.station[last] > PLACES[part]).all()
    assert len(np.unique(first)) == len(first) == len(np.unique(last))
    rest = Motion(BODIES, *skeleton_of(case.native_finger()).pose(mesh.rest_posture))
    joined = f'lesion.suture.{part}={{stiffness="10 N/mm",gap="1 mm"}}'
    stated = load_case("isometric_edc", [f'lesion.cut=["{part}"]', joined])
    made = suture(part, stated.lesion.suture[part], mesh, mesh.points, rest)
    gap = np.linalg.norm(mesh.points[first] - mesh.points[last], axis=1)
    assert made.length == pytest.approx(gap + 1e-3)
    assert made.law.stiffness * len(first) == pytest.approx(10e3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ((STIFF,), "central_slip is not cut"),
        ((CUT, 'lesion.suture.centrl_slip.stiffness="1 N/mm"'), "not cut"),
        (('lesion.graft.x={start="nowhere",end="central_slip",stiffness="1 N/mm"}',), "no part"),
        (
            (
                'lesion.graft.x={start="central_slip",bone="thumb",at=["0 mm","0 mm","0 mm"],'
                'stiffness="1 N/mm"}',
            ),
            "unknown body",
        ),
        (
            ('lesion.graft."a b"={start="central_slip",end="terminal_slip",stiffness="1 N/mm"}',),
            "graft",
        ),
    ],
)
def test_a_repair_that_makes_no_sense_is_refused(settings, words):
    with pytest.raises(InputError, match=words):
        load_case("isometric_edc", [COARSE, *settings])


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ('bone="proximal",at=["22 mm","0 mm","-5 mm"]', "through the"),
        ('bone="middle",at=["10 mm","0 mm","30 mm"]', "off the middle bone"),
        ('end="central_band"', "one place"),
    ],
)
def test_a_graft_through_a_bone_or_off_it_is_refused(end, words):
    graft = f'lesion.graft.x={{start="central_band",{end},stiffness="1 N/mm"}}'
    with pytest.raises(InputError, match=words):
        build(load_case("isometric_edc", [COARSE, graft]))


def test_other_hoods_say_that_they_take_none():
    with pytest.raises(InputError, match='"shell" does'):
        load_case("network_edc", [CUT, STIFF])


# The table

NETWORK = """
title = "Which repair"
rank = "terminal_slip"
[[repair]]
name = "shorter"
title = "terminal slip 0.7 mm shorter"
change.lesion.lengthen.terminal_slip = "0.3 mm"
[[repair]]
name = "undone"
change.lesion = { cut = ["no_such_part"] }
[[condition]]
key = "tendons.EDC.tension"
values = ["2 N", "4 N"]
"""


@pytest.fixture(scope="module")
def compared(tmp_path_factory) -> RepairTable:
    folder = tmp_path_factory.mktemp("repairs")
    (folder / "r.toml").write_text(NETWORK)
    case = load_case("network_edc", ['lesion.lengthen.terminal_slip="1 mm"', QUICK])
    return compare_repairs(case, read_repairs(folder / "r.toml"), folder / "runs")


def test_each_repair_stands_beside_the_injury_in_every_condition(compared):
    assert [row.name for row in compared.rows] == ["intact", "injured", "shorter", "undone"]
    assert compared.conditions == ("tendons.EDC.tension = 2 N", "tendons.EDC.tension = 4 N")
    intact, injured, shorter, undone = compared.rows
    two, four = intact.values["terminal_slip"]
    assert four > two > 0
    assert injured.off("terminal_slip", intact) > 0
    assert "no_such_part" in undone.failure
    assert np.isnan(undone.values["tip_force"]).all()
    (one,) = [
        cosim.run(load_case("network_edc", ['tendons.EDC.tension="2 N"', "finger.tip.kind=point"]))
    ]
    assert intact.values["tip_force"][0] == pytest.approx(
        one.summary["fingertip_magnitude_N"], rel=1e-6
    )
    assert shorter.off("terminal_slip", intact) != injured.off("terminal_slip", intact)


def test_the_table_and_the_page_tell_what_was_found(compared):
    table = table_of_repairs(compared)
    assert [row[1] for row in table.rows] == ["", "", "1", ""]
    assert " to " in table.rows[0][table.columns.index("terminal slip, held, N")]
    said, page = repair_sentences(compared), repairs_page(compared)
    assert "terminal slip 0.7 mm shorter" in said[1]
    assert "no_such_part" in page
    assert "tendons.EDC.tension = 4 N" in page


def test_a_repair_is_judged_by_what_it_bears_of_its_strength():
    shares = {"strength": {"a": {"share": 0.2}, "b": {"share": 0.3}}}
    assert _share_of_strength({"repair_force_N": {"a": 1.0}, **shares}) == 30
    assert _share_of_strength({"repair_force_N": {"a": 1.0}}) is None
    assert _share_of_strength({}) == 0


def row(name: str, *pip: float) -> Compared:
    values = dict.fromkeys(("dip_droop", "tip_force"), np.ones(len(pip)))
    return Compared(name, name, {**values, "pip_lag": np.array(pip)}, np.full(len(pip), np.nan))


def test_misses_to_either_side_do_not_cancel():
    intact = row("intact", 10, 20)
    assert row("even", 14, 16).off("pip_lag", intact) == pytest.approx(4)
    assert row("lost", 14, np.nan).off("pip_lag", intact) == np.inf


def test_what_cannot_be_told_apart_is_said():
    intact, injured = row("intact", 10, 20), row("injured", 30, 50)
    near, far = row("near", 12, 21), row("far", 15, 26)
    found = RepairTable("t", "pip_lag", intact, injured, (near, far), ("a", "b"))
    assert any("far cannot be told from it" in said for said in repair_sentences(found))
    worse = RepairTable("t", "pip_lag", intact, injured, (row("worse", 60, 90),), ())
    assert any("no repair helps" in said for said in repair_sentences(worse))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("rank", '"beauty"'), "write one of"),
        (("name", '"intact"'), "stands for another"),
        (("values", "[]"), "at least"),
        (("values", "[" + "1, " * 70 + "1]"), "conditions"),
        (("names", "1"), "unknown key|names"),
    ],
)
def test_a_bad_file_of_repairs_is_one_message(change, words, tmp_path):
    key, value = change
    word = "name" if key == "names" else key
    lines = [
        f"{key} = {value}" if line.startswith(f"{word} =") else line
        for line in NETWORK.splitlines()
    ]
    path = tmp_path / "r.toml"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=words):
        read_repairs(path)


def test_a_case_without_a_lesion_and_a_file_that_is_not_there_are_told(tmp_path):
    told = run("lesion", "isometric_edc", "--repairs", "boutonniere")
    assert (told.exit_code, "has no table [lesion]" in told.output) == (2, True)
    with pytest.raises(InputError, match="packaged are: boutonniere, claw"):
        read_repairs(tmp_path / "none.toml")


def test_a_finger_that_was_not_solved_is_no_fault_of_the_input(tmp_path):
    hurried = ['lesion.lengthen.terminal_slip="1 mm"', QUICK, 'solve.patience="1 us"']
    (tmp_path / "r.toml").write_text(NETWORK)
    repairs = read_repairs(tmp_path / "r.toml")
    with pytest.raises(ConvergenceError, match="the intact finger has no answer"):
        compare_repairs(load_case("network_edc", hurried), repairs, tmp_path / "runs")


PACKAGED = {
    "boutonniere": "lesion_boutonniere_fibres",
    "claw": "base/lesion",
    "mallet": "lesion_mallet",
    "sagittal_band": "lesion_sagittal_band_radial",
    "swan_neck": "lesion_swan_neck",
}


@pytest.mark.parametrize(
    "name",
    ["mallet", *(pytest.param(n, marks=pytest.mark.slow) for n in PACKAGED if n != "mallet")],
)
def test_packaged_repairs_can_be_made_of_their_case(name):
    file = read_repairs(Path(name))
    case = load_case(PACKAGED[name])
    if file.injury is not None:
        case = case.with_layers([("injury", file.injury.change)])
    for repair in file.repair:
        build(case.with_layers([(repair.name, repair.change)]))
    assert {path.stem for path in (ROOT / "cases" / "repairs").glob("*.toml")} == set(PACKAGED)


def test_an_injury_of_the_file_stands_in_for_a_lesion(tmp_path):
    """A muscle that is lost, beside the whole finger; the repair has its tension back."""
    path = tmp_path / "r.toml"
    path.write_text(
        'rank = "tip_force"\n[injury]\ntitle = "weak"\nchange.tendons.EDC.tension = "1 N"\n'
        '[[repair]]\nname = "back"\nchange.tendons.EDC.tension = "3.469 N"\n'
    )
    found = compare_repairs(load_case("pulley_edc", [QUICK]), read_repairs(path), tmp_path)
    (back,) = found.repairs
    assert found.injured.title == "weak"
    assert found.injured.off("tip_force", found.intact) > 0.05
    assert back.off("tip_force", found.intact) == 0
