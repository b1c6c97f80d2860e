"""The shipped example of a user's anatomy: its files are ours, `cosim new` makes its case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from typer.testing import CliRunner

from cosim.anatomy.read import read_hood
from cosim.case.file import load_case
from cosim.cli import app
from cosim.models.build import bone_surfaces, hood_mesh
from meshes.bones import load_bone
from meshes.imported.write import raw_of
from meshes.skeleton import BODIES, index_finger
from tests.helpers.folders import ROOT

FOLDER = ROOT / "cases" / "own"
EDGE = 3e-3
"""m, of the bones' triangles."""
STRAIGHT = '{MCP="0 deg", MCP_abduction="0 deg", PIP="0 deg", DIP="0 deg"}'
LAID = f'hood.mesh={{kind="generated", quads=416, rest_posture={STRAIGHT}}}'


def test_the_files_are_made_by_our_generators():
    for body in BODIES:
        points, faces = load_bone(body).surface(EDGE)
        mesh = trimesh.load_mesh(FOLDER / f"{body}.stl")
        assert len(mesh.faces) == len(faces)
        np.testing.assert_allclose(mesh.triangles, 1e3 * points[faces], atol=1e-5)  # 32 bits
    laid = raw_of(hood_mesh(load_case("own_edc", [LAID])), index_finger())
    read = read_hood(FOLDER / "hood.inp")
    np.testing.assert_array_equal(read.quads, laid.quads)
    np.testing.assert_allclose(read.points, laid.points, atol=1e-3)
    assert sum(path.stat().st_size for path in FOLDER.glob("*.*") if path.suffix != ".png") < 3e5


def test_cosim_new_makes_the_shipped_case_of_its_files(tmp_path: Path):
    """All but the tension and the title."""
    bones = [str(FOLDER / f"{body}.stl") for body in BODIES]
    words = ["new", "own_edc", "--hood", str(FOLDER / "hood.inp"), "--bones", *bones]
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "own_edc")])
    assert done.exit_code == 0, done.output
    made = load_case(tmp_path / "own_edc" / "own_edc.toml", ["tendons.EDC.activation=0.1"])
    shipped = load_case("own_edc")
    mine, known = hood_mesh(made), hood_mesh(shipped)
    for name in ("points", "quads", "region", "fibre", "station"):
        np.testing.assert_allclose(getattr(mine, name), getattr(known, name), atol=1e-6)
    for name in ("ends", "tied"):
        assert getattr(mine, name).keys() == getattr(known, name).keys()
        for key, nodes in getattr(known, name).items():
            np.testing.assert_array_equal(np.sort(getattr(mine, name)[key]), np.sort(nodes))
    assert mine.springs.keys() == known.springs.keys()
    for key, held in known.springs.items():
        np.testing.assert_array_equal(mine.springs[key].nodes, held.nodes)
        np.testing.assert_allclose(mine.springs[key].anchors, held.anchors, atol=2e-7)
    surfaces = bone_surfaces(shipped)
    for body, (points, faces) in bone_surfaces(made).items():
        np.testing.assert_allclose(points[faces], surfaces[body][0][surfaces[body][1]], atol=1e-9)
    left_out = {"hood": {"mesh": {"path"}}, "finger": {"bones"}, "source": True, "title": True}
    assert made.model_dump(exclude=left_out) == shipped.model_dump(exclude=left_out)
