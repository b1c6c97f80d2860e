"""The rows of a hood against the heads that postures bring them over."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.cli import app
from cosim.errors import ConvergenceError, PatienceError
from cosim.fingers.kinds import anatomy_of
from cosim.hoods.fe_supports import head_arcs
from cosim.models.build import hood_mesh, mesh_advice, mesh_warnings
from cosim.pipeline import run_case
from fe_solver.surfaces.shapes import Capsule
from meshes.coarseness import (
    GLIDE,
    LEAST_SAG,
    SHARE,
    Arc,
    arcs,
    coarse_rows,
    rows_on,
)
from meshes.hood_mesh import HoodMesh, display_quads, write
from meshes.skeleton import BODIES, Skeleton, index_finger

FINGER = index_finger()
RADIUS, COVER = 4e-3, 0.6e-3


def capsules() -> list[Arc]:
    ends = zip(BODIES, (-0.04, 0.0, 0.0, 0.0), (0.0, *FINGER.length[1:]), strict=True)
    bones = {b: Capsule(np.array([a, 0, 0]), np.array([e, 0, 0]), RADIUS) for b, a, e in ends}
    even = dict.fromkeys(BODIES, COVER)
    return arcs(FINGER, bones, even, even)


def strip(stations: np.ndarray) -> HoodMesh:
    """Quads 2 mm wide over a straight chain."""
    n = len(stations)
    points = np.array([[1e-3 * s, y, 6e-3] for y in (-1e-3, 1e-3) for s in stations])
    i = np.arange(n - 1)
    quads = np.stack([i, i + 1, i + n + 1, i + n], axis=1)
    fibre = np.tile([1.0, 0.0, 0.0], (n - 1, 1))
    at = np.tile(stations, 2)
    region = np.full(n - 1, 3)
    return HoodMesh(points, quads, region, fibre, {}, {}, {}, at, {}, FINGER.length[1], 0.5e-3)


def laid(name: str, quads: int) -> tuple[Case, HoodMesh, Skeleton, list[Arc]]:
    case = load_case(name, [f"hood.mesh.quads={quads}"])
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    assert anatomy.skeleton is not None
    over = head_arcs(case.hood.contact, anatomy.bones, anatomy.skeleton, case.hood.thickness / 2)
    return case, hood_mesh(case), anatomy.skeleton, over


def test_the_arc_over_a_round_head_is_radius_times_flexion():
    over = capsules()
    assert [arc.body for arc in over] == ["metacarpal", "proximal", "middle"]
    joints = np.cumsum([0.0, *FINGER.length[1:3]])
    for arc, joint, low, high in zip(over, joints, (-20, 0, 0), (90, 110, 70), strict=True):
        assert arc.radius == pytest.approx(RADIUS + COVER, rel=1e-6)
        glide = 1e-3 * GLIDE
        assert arc.first == pytest.approx(joint - arc.radius * np.deg2rad(high) - glide, abs=1e-5)
        assert arc.last == pytest.approx(joint - arc.radius * np.deg2rad(low), abs=1e-5)


def test_rows_are_judged_by_the_sag_of_their_chord():
    arc = capsules()[1]
    fine, coarse = (strip(np.arange(20.0, 60.0, step)) for step in (1.0, 2.4))
    assert max(h for _, _, h in rows_on(fine, FINGER, arc)) == pytest.approx(1e-3)
    assert coarse_rows(fine, FINGER, [arc]) == []
    (rows,) = coarse_rows(coarse, FINGER, [arc])
    assert rows.share == pytest.approx(2.4e-3**2 / (8 * arc.radius * COVER))
    assert rows.share * (arc.spacing / rows.spacing) ** 2 == pytest.approx(1e-3 * LEAST_SAG / COVER)
    thick = arc._replace(thickness=1e-3)
    assert thick.spacing**2 / (8 * arc.radius * thick.thickness) == pytest.approx(SHARE)


def test_one_coarse_row_over_the_head_is_named_and_one_over_the_shaft_is_not():
    arc, even = capsules()[1], np.arange(10.0, 60.0)
    shaft = strip(even[(even < 16) | (even > 20)])
    head = strip(even[(even < 37) | (even > 40)])
    assert coarse_rows(shaft, FINGER, [arc]) == []
    (rows,) = coarse_rows(head, FINGER, [arc])
    assert (rows.first, rows.last) == (36.0, 41.0)
    said = "rows 5.0 mm apart at stations 36 to 41 mm come onto the head of the proximal phalanx"
    assert said in str(rows)
    assert "Lay rows 2.3 mm apart or less" in str(rows)


@pytest.mark.parametrize("name", ["isometric_edc", "hood_majorflex_edc", "ring_edc", "little_edc"])
@pytest.mark.parametrize("quads", [416, 936])
def test_the_generated_hood_meets_the_rule_from_the_default_on(name: str, quads: int):
    """But over the middle finger's DIP, whose head is small: by 4 % with the default."""
    _, mesh, skeleton, over = laid(name, quads)
    assert len(over) == 3
    missed = coarse_rows(mesh, skeleton, over)
    if (name, quads) == ("hood_majorflex_edc", 416):
        (rows,) = missed
        assert rows.arc.body == "middle"
        assert 1.0 < rows.spacing / rows.arc.spacing < 1.04
    else:
        assert missed == []
    corners = mesh.points[display_quads(mesh.quads)]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    along, across = sides[:, [0, 2]].mean(axis=1), sides[:, [1, 3]].mean(axis=1)
    assert (np.maximum(along, across) / np.minimum(along, across)).max() < 8


def test_the_coarsest_generated_hood_misses_the_rule_as_a_users_file_does(tmp_path: Path):
    _, mesh, skeleton, over = laid("isometric_edc", 120)
    missed = coarse_rows(mesh, skeleton, over)
    assert [rows.arc.body for rows in missed] == ["metacarpal", "proximal", "middle"]
    write(mesh, tmp_path / "hood.json")
    setting = f'hood.mesh={{kind="file", path="{(tmp_path / "hood.json").as_posix()}"}}'
    assert mesh_warnings(load_case("isometric_edc", [setting])) == [str(rows) for rows in missed]
    assert mesh_warnings(load_case("isometric_edc")) == ()
    done = CliRunner().invoke(app, ["check", "isometric_edc", "--set", setting])
    assert done.exit_code == 0
    assert done.stderr.count("come onto the head of the") == 3


def test_a_solve_that_fails_on_a_coarse_mesh_says_so(monkeypatch: pytest.MonkeyPatch):
    """Of the little finger's coarsest mesh, and nothing of a mesh that follows the heads."""
    coarse = load_case("little_edc", ["hood.mesh.quads=104"])
    advice = mesh_advice(coarse)
    assert "proximal phalanx 3.0 mm (2.0)" in advice
    assert "write hood.mesh.quads = 416 or more" in advice
    assert mesh_advice(load_case("little_edc")) == mesh_advice(load_case("split_edc")) == ""

    def fail(said: str, cause: Exception | None, *_: object) -> None:
        raise ConvergenceError(said) from cause

    for case, said, cause, words in (
        (coarse, "no equilibrium.", None, f"no equilibrium. {advice}"),
        (coarse, "no equilibrium", None, f"no equilibrium. {advice}"),
        (coarse, "no time", PatienceError("over"), "no time"),
        (load_case("split_edc"), "no equilibrium.", None, "no equilibrium."),
    ):
        monkeypatch.setattr("cosim.pipeline.solve_case", partial(fail, said, cause))
        with pytest.raises(ConvergenceError) as error:
            run_case(case)
        assert str(error.value) == words
