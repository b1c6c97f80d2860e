"""A hood over postures: couplings, tables, how a pose is solved, and what `cosim hood` writes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from cases.hood_gallery.__main__ import show_hood
from cases.hood_gallery.literature import (
    COUPLINGS,
    buchner_dip,
    buchner_height,
    dip_on_coupling,
    fitted_postures,
)
from cases.hood_gallery.poses import CONVERGED, HoodPoses, SolvedPose, pull_name
from cases.hood_gallery.studies import (
    STRAIGHT,
    HoodStudies,
    arm_table,
    band_table,
    glide_table,
    lines_through,
    rest_postures,
    rest_summary,
    sagittal_table,
    sweep_postures,
)
from cosim.case.file import load_case
from cosim.errors import ConvergenceError
from cosim.fingers.normative import MiddleFingerConfig
from cosim.hoods.shell.variation import scale_moduli
from cosim.report.figures import write_figures
from meshes.bands import HoodLine, SagittalBands, band_heights, sagittal_angles

COARSE = "hood.mesh.quads=120"
EDC, ALL = (("EDC", 3.0),), (("EDC", 1.0), ("EI", 1.0))


def pose(posture, pull=(), way="flexion", **numbers):
    status = CONVERGED if numbers else "no equilibrium: it folds"
    return SolvedPose(posture, pull, way, status, numbers)


# --- couplings and postures


def test_couplings_are_those_of_the_literature():
    assert buchner_dip(45.0) == pytest.approx(12.2, abs=0.05)
    assert buchner_dip(90.0) == pytest.approx(48.9, abs=0.05)
    assert [dip_on_coupling("0.7 PIP", pip) for pip in (45.0, 90.0)] == [31.0, 63.0]
    assert dip_on_coupling("Buchner less 15 deg", 45.0) == 0.0
    assert dip_on_coupling("0.7 PIP and 15 deg", 90.0) == 70.0
    assert buchner_height(np.array([0.0, 90.0])) == pytest.approx([5.0, 1.2], abs=0.01)


def test_rest_is_looked_at_on_every_line_without_long_ways():
    postures = rest_postures()
    assert len(postures) == len(set(postures)) == 30
    assert all(lines_through(posture) for posture in postures)
    for mcp in (0.0, 40.0, 80.0):
        for pip in (0.0, 45.0, 90.0):
            for name in COUPLINGS:
                assert (mcp, pip, dip_on_coupling(name, pip)) in postures
    assert np.abs(np.diff(postures, axis=0))[:, 1:].max() <= 45.0


def test_each_joint_is_swept_alone_and_the_pip_comes_back():
    swept = sweep_postures()
    assert all(np.count_nonzero(posture) <= 1 for posture, _ in swept)
    assert [p for p, way in swept if way == "extension"] == [(0, 60, 0), (0, 30, 0), STRAIGHT]


def test_the_fitted_postures_are_those_of_the_packaged_fit():
    assert STRAIGHT in fitted_postures("slip_ratio")
    assert fitted_postures("slip_ratio") < fitted_postures("hood.")


def test_pulls_are_named_by_tendon_and_tension():
    assert [pull_name(p) for p in ((), EDC, ALL)] == ["rest", "EDC 3 N", "all 1 N"]


# --- tables


def test_the_summary_of_rest_names_the_worst_posture_and_counts():
    numbers = {"torque_MCP_Nmm": 1.0, "torque_DIP_Nmm": 0.0}
    numbers |= {"central_slip_N": 0.1, "terminal_slip_N": 0.2}
    solved = [
        pose(STRAIGHT, torque_PIP_Nmm=-1.0, **numbers),
        pose((0.0, 45.0, 12.0), torque_PIP_Nmm=-4.0, **numbers),
        pose((80.0, 90.0, 49.0)),
    ]
    row = rest_summary(solved).set_index("quantity").loc["torque_PIP_Nmm"]
    assert (row.largest, row["at"], row.within, row.solved, row.poses) == (-4.0, "0/45/12", 1, 2, 3)


def test_excursions_count_from_the_straight_finger():
    def numbers(excursion):
        return {f"{t}_excursion_mm": excursion for t in ("EDC", "EI")} | {"EDC_MCP_arm_mm": -9.0}

    solved = [pose(STRAIGHT, ALL, **numbers(1.0)), pose((20.0, 0.0, 0.0), ALL, **numbers(-2.0))]
    table = arm_table([*solved, pose((45.0, 0.0, 0.0), ALL)], ("EDC", "EI"), ALL)
    mcp = table[(table.joint == "MCP") & (table.tendon == "EDC")]
    assert mcp.excursion_mm.tolist()[:2] == [0.0, -3.0]
    assert mcp.arm_mm.tolist()[:2] == [-9.0, -9.0]
    assert np.isnan(mcp.arm_mm.iloc[2])
    assert mcp.status.iloc[2].startswith("no equilibrium")


def test_a_pose_without_equilibrium_keeps_its_row():
    solved = [pose(STRAIGHT, lateral_band_height_radial_mm=4.0, lateral_band_height_ulnar_mm=2.0)]
    solved += [pose((0.0, 90.0, 0.0)), pose((0.0, 90.0, 0.0), EDC)]
    table = band_table(solved)
    assert table.PIP_deg.tolist() == [0.0, 90.0, 90.0]
    assert table.mean_mm.tolist()[0] == 3.0
    assert table.mean_mm.isna().tolist() == [False, True, True]
    assert len(glide_table(solved)) == 5
    assert sagittal_table(solved[:1]).Young_Rayan_deg.tolist() == [0.0]


def test_all_moduli_are_scaled_those_of_second_families_too():
    case = load_case("hood_rest")
    hood = load_case("hood_rest", scale_moduli(case.hood, 10.0)).hood
    for name, region in case.hood.regions.items():
        assert hood.regions[name].c5 == pytest.approx(10 * region.c5)
    slip, before = (h.regions["lateral_slip_radial"] for h in (hood, case.hood))
    assert slip.second.c5 == pytest.approx(10 * before.second.c5)
    assert slip.second.c4 == before.second.c4
    assert slip.lam_max == before.lam_max


# --- where the bands stand

AXIS = np.array([0.0, 1.0, 0.0])


def straight(*points):
    nodes = tuple((np.array([i]), np.ones(1)) for i in range(len(points)))
    return HoodLine(nodes), np.array(points)


@pytest.mark.parametrize("flexion", [0.0, 0.6, 1.5])
def test_the_height_is_the_distance_from_the_axis_in_the_halving_plane(flexion):
    c, s = np.cos(flexion), np.sin(flexion)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    rotation = np.stack([np.eye(3), np.eye(3), turn, turn])
    centre = np.array([0.04, 0.0, 0.0])
    position = np.array([[0, 0, 0], [0, 0, 0], centre, centre])
    half = flexion / 2
    dorsal = np.array([np.sin(half), 0.0, np.cos(half)])
    distal = np.array([np.cos(half), 0.0, -np.sin(half)])
    over = centre + 3e-3 * dorsal + 5e-3 * AXIS
    line, x = straight(over - 4e-3 * distal, over + 2e-3 * distal)
    assert band_heights({"radial": line}, x, position, rotation, AXIS)["radial"] == pytest.approx(
        3e-3
    )
    assert np.isnan(band_heights({"u": line}, x + 0.01 * distal, position, rotation, AXIS)["u"])


def test_a_sagittal_band_leans_distally_from_either_square():
    line, tendon = straight([-1e-3, 0, 8e-3], [0, 0, 8e-3], [1e-3, 0, 8e-3])
    edge = np.array([[4e-3, 7e-3, 1e-3]])
    nodes, anchor = np.array([3]), np.array([[0.0, 7e-3, -3e-3]])
    bands = SagittalBands(1, {"radial": nodes}, {"radial": anchor}, {"radial": np.ones(1)}, line)
    rest = np.zeros((4, 3)), np.stack([np.eye(3)] * 4)
    told = sagittal_angles(bands, np.vstack([tendon, edge]), *rest)["radial"]
    assert told["edge"] == pytest.approx(np.pi / 4)
    assert told["tendon"] == pytest.approx(0.0)
    assert told["edge_local"] == pytest.approx(np.pi / 4)


# --- a hood


@cache
def coarse():
    return HoodPoses(load_case("hood_rest", [COARSE]))


def test_a_pose_is_audited_and_solved_once(monkeypatch):
    poses, said = coarse(), []
    monkeypatch.setattr(poses, "say", said.append)
    (rest,) = poses.walk("rest", [(STRAIGHT, "flexion")], ())
    assert rest.status == CONVERGED
    assert rest.numbers["hood_force_balance"] < 1e-9
    assert rest.numbers["lateral_band_height_radial_mm"] > 0
    assert "sagittal_ulnar_tendon_local_deg" in rest.numbers
    assert said == ["rest: 1 of 1, 0/0/0, rest"]
    assert poses.walk("again", [(STRAIGHT, "flexion")], ()) == [rest]


def test_a_hood_that_finds_no_equilibrium_is_told_of(monkeypatch):
    def fail(*arguments):
        raise ConvergenceError("it folds")

    poses = coarse()
    monkeypatch.setattr(type(poses.models.hood), "advance", fail)
    (lost,) = poses.walk("rest", [((0.0, 20.0, 0.0), "flexion")], ())
    assert not lost.converged
    assert lost.status == "no equilibrium: it folds"
    assert lost.row()["PIP_deg"] == 20.0


def test_a_page_of_poses_with_pictures_and_tables(tmp_path, monkeypatch):
    """Of made-up numbers in all poses but one."""
    poses = coarse()
    (one,) = poses.walk("rest", [(STRAIGHT, "flexion")], ())
    studies = HoodStudies(poses.case)
    studies.poses = poses

    def solve(posture, pull, way, before):
        numbers = {} if posture == (0.0, 90.0, 0.0) else one.numbers
        return SolvedPose(
            posture, pull, way, CONVERGED if numbers else "no equilibrium: x", numbers
        ), None

    monkeypatch.setattr(poses, "known", {})
    monkeypatch.setattr(poses, "_solve", solve)
    paper = studies.paper("python -m cases.hood_gallery")
    wanted = [s for s in paper.studies if s.name == "bands"]
    assert write_figures(paper, wanted, tmp_path / "out", lambda text: None) == 1
    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert "No equilibrium (crosses at the bottom): 0/90/0, rest" in page
    assert "python -m cases.hood_gallery --only bands" in page
    table = pd.read_csv(tmp_path / "out/bands.csv")
    assert {"hood_residual", "max_penetration_mm", "status"} <= set(table)
    assert (tmp_path / "out/bands.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--only", "nope"], "no such study; it has rest"),
        (["split_edc"], "has no mesh of quads"),
        (["--moduli", "0"], "moduli"),
    ],
)
def test_what_cannot_be_shown_is_refused(words, said, tmp_path):
    app = typer.Typer(rich_markup_mode=None)
    app.command()(show_hood)
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "out").exists()


def test_levels_of_load_are_compared_at_a_posture_of_each_finger():
    assert MiddleFingerConfig.flexed == (40.0, 55.0, 35.0)
