"""`cosim new`: bones checked, clearance told, a folder written whole or not at all, and run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from cosim.anatomy.bones import Bones, read_bones
from cosim.anatomy.case_folder import write_case
from cosim.anatomy.read import Built, UserAnatomy
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.models.build import bone_surfaces, hood_mesh, mjcf_of
from cosim.pipeline import run_case
from meshes.hood_mesh import HoodMesh, to_json
from meshes.hull import Centreline
from meshes.imported.checks import Placing
from meshes.imported.write import write_inp
from meshes.skeleton import BODIES, index_finger
from tests.helpers.own_anatomy import (
    add_free_node,
    move_points,
    user_hood,
    write_bones,
)

COARSE = "hood.mesh.quads=120"
Surfaces = Mapping[str, tuple[np.ndarray, np.ndarray]]
BESIDE = np.array([0.01, 0.03, 0])
"""m."""
LAID = ["--posture", "0 0 0"]


@pytest.fixture(scope="module")
def ours() -> HoodMesh:
    return hood_mesh(load_case("isometric_edc", [COARSE]))


@pytest.fixture(scope="module")
def surfaces() -> Surfaces:
    """Coarse ones, for the checks alone."""
    from meshes.bones import load_bone

    return {body: load_bone(body).surface(1.5e-3) for body in BODIES}


@pytest.fixture(scope="module")
def files(ours: HoodMesh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with our hood as hood.inp and our bones as .obj, m, in full precision."""
    folder = tmp_path_factory.mktemp("anatomy")
    write_inp(add_free_node(user_hood(ours)), folder / "hood.inp")
    for body, (points, faces) in bone_surfaces(load_case("isometric_edc")).items():
        rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
        rows += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
        (folder / f"{body}.obj").write_text("\n".join(rows))
    (folder / "finger.xml").write_text(mjcf_of(load_case("split_edc")))
    return folder


def new(folder: Path, *options: str) -> tuple[int, str]:
    """Exit code and what was said."""
    done = CliRunner().invoke(app, ["new", "mine", "-o", str(folder / "out"), *options])
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.output


def bones(files: Path) -> list[str]:
    return ["--bones", *(str(files / f"{body}.obj") for body in BODIES), "--bone-unit", "m"]


@pytest.mark.slow
def test_our_own_hood_bones_and_finger_make_the_same_run(
    files: Path, ours: HoodMesh, tmp_path: Path
):
    code, told = new(
        tmp_path, "--hood", str(files / "hood.inp"), *LAID, *bones(files),
        "--finger", str(files / "finger.xml"),
    )  # fmt: skip
    assert code == 0, told
    case = tmp_path / "out" / "mine.toml"
    assert (tmp_path / "out" / "cosim_new.txt").read_text() in told
    assert "dropped: 1 nodes that belong to no quad, the first is node 0" in told
    assert CliRunner().invoke(app, ["check", str(case)]).exit_code == 0
    loaded = load_case(case, ["tendons.EDC.activation=0.1"])
    mesh = hood_mesh(loaded)
    np.testing.assert_array_equal(mesh.quads, ours.quads)
    np.testing.assert_allclose(mesh.points, ours.points, atol=1e-12)
    for name, held in ours.springs.items():
        assert mesh.springs[name].body == held.body
        mine, order = mesh.springs[name], np.argsort(mesh.springs[name].nodes)
        known = np.argsort(held.nodes)
        np.testing.assert_array_equal(mine.nodes[order], held.nodes[known])
        np.testing.assert_allclose(mine.anchors[order], held.anchors[known], atol=2e-7)
    even = {name: replace(held, shares=None) for name, held in ours.springs.items()}
    # as of every mesh of others, whose fibres are taken to run along the finger or round it
    plain = replace(ours, lift=None, springs=even, fibre=mesh.fibre)
    (tmp_path / "level.json").write_text(to_json(plain))
    level = f'hood.mesh={{kind="file", path="{(tmp_path / "level.json").as_posix()}"}}'
    before = run_case(load_case("isometric_edc", [level])).summary
    after = run_case(loaded).summary
    for key in ("fingertip_force_N", "moment_arm_mm"):
        assert flat(after[key]) == pytest.approx(flat(before[key]), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("ending", [".inp", ".feb"])
def test_our_own_hood_goes_out_and_comes_back(ours: HoodMesh, tmp_path: Path, ending: str):
    out = tmp_path / f"hood{ending}"
    words = ["export", "isometric_edc", "--mesh", "--set", COARSE, "-o", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert ("directions of the fibres" in done.output) == (ending == ".inp")
    code, told = new(tmp_path, "--hood", str(out))
    assert code == 0, told
    case = load_case(tmp_path / "out" / "mine.toml")
    assert case.hood.thickness == pytest.approx(ours.thickness, rel=1e-12)
    back = hood_mesh(case)
    assert back.thickness == pytest.approx(ours.thickness, rel=1e-12)
    np.testing.assert_array_equal(back.quads, ours.quads)
    np.testing.assert_array_equal(back.region, ours.region)
    np.testing.assert_allclose(back.points, ours.points, atol=1e-7)  # our own file's last digit
    for mine, known in ((back.ends, ours.ends), (back.tied, ours.tied)):
        assert mine.keys() == known.keys()
        for name, nodes in known.items():
            np.testing.assert_array_equal(np.sort(mine[name]), np.sort(nodes))
    assert back.springs.keys() == ours.springs.keys()
    for name, held in ours.springs.items():
        np.testing.assert_array_equal(back.springs[name].nodes, held.nodes)
        np.testing.assert_allclose(back.springs[name].anchors, held.anchors, atol=2e-7)
    if ending == ".feb":
        np.testing.assert_allclose(back.fibre, ours.fibre, atol=1e-5)  # laid to that


def test_the_given_thickness_is_taken_before_the_files(files: Path, tmp_path: Path):
    code, told = new(tmp_path, "--hood", str(files / "hood.inp"), "--thickness", "0.4 mm")
    assert code == 0, told
    assert hood_mesh(load_case(tmp_path / "out" / "mine.toml")).thickness == pytest.approx(4e-4)


def test_a_mesh_is_not_written_to_an_ending_that_says_something_else(tmp_path: Path):
    done = CliRunner().invoke(app, ["export", "no_case", "--mesh", "-o", str(tmp_path / "a.obj")])
    assert done.exit_code == 2
    assert "ending in .json" in done.stderr
    assert ".feb, .inp, .msh, .stl, .vtu" in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def flat(value: object) -> list[float]:
    if isinstance(value, Mapping):
        return [number for key in sorted(value) for number in flat(value[key])]
    return list(np.ravel(np.asarray(value, dtype=float)))


def test_nothing_is_written_where_something_is_wrong(files: Path, tmp_path: Path):
    hood = ["--hood", str(files / "hood.inp"), *LAID]
    code, told = new(tmp_path, *hood, "--unit", "m")
    assert code == 2
    assert "--unit mm" in told
    assert list(tmp_path.iterdir()) == []
    code, told = new(tmp_path, *hood, "--finger", str(files / "finger.xml"))
    assert code == 2
    assert "give its surfaces too" in told
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("mine")
    code, told = new(tmp_path, *hood)
    assert code == 2
    assert "is in the way" in told
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["precious"]


def test_a_folder_of_its_own_is_replaced(files: Path, tmp_path: Path):
    for posture in ("0 0 0", "1 0 0"):
        code, told = new(tmp_path, "--hood", str(files / "hood.inp"), "--posture", posture)
        assert code == 0, told
    assert hood_mesh(load_case(tmp_path / "out" / "mine.toml")).rest_posture["MCP"] == (
        pytest.approx(np.deg2rad(1))
    )


def test_a_finger_alone_is_a_case_of_its_own_tendons(files: Path, tmp_path: Path):
    code, told = new(tmp_path, "--finger", str(files / "finger.xml"))
    assert code == 0
    assert "tendons EDC, EI, LUM, FPI, FDP" in told
    case = load_case(tmp_path / "out" / "mine.toml", ["tendons.EDC.activation=0.1"])
    own = run_case(case).summary
    known = run_case(load_case("split_edc")).summary
    assert flat(own["fingertip_force_N"]) == pytest.approx(
        flat(known["fingertip_force_N"]), rel=1e-8
    )


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ([], "give a hood's mesh"),
        (["--hood", "none.vtu"], "there is no such file"),
        (
            ["--hood", "none.xyz"],
            "expected a mesh file ending in .feb, .vtu, .vtp, .vtk, .msh, .inp",
        ),
        (["--finger", "none.xml"], "there is no such file"),
        (["--finger", "f.xml", "--length-scale", "1.1"], "--length-scale"),
        (["--finger", "f.xml", "--axes", "x x y"], "--axes"),
        (["--finger", "f.xml", "--origin", "1 2"], "--origin"),
        (["--finger", "f.xml", "--posture", "20 200 0"], "PIP 200 deg"),
        (["--finger", "f.xml", "--thickness", "2 N"], "--thickness"),
        (["--finger", "f.xml", "--set-name", "PIP"], "end_central=NSET_12"),
        (["--finger", "f.xml", "--set-name", "PPI=a"], "did you mean PIP"),
        (["--finger", "f.xml", "--names", "none.toml"], "--names none.toml"),
    ],
)
def test_options_that_say_nothing_are_one_clear_fault(
    tmp_path: Path, options: list[str], complaint: str
):
    code, told = new(tmp_path, *options)
    assert code == 2
    assert complaint in " ".join(told.split())
    assert list(tmp_path.iterdir()) == []


def test_names_come_from_a_file_too(files: Path, tmp_path: Path):
    text = (files / "finger.xml").read_text().replace('"PIP"', '"hinge 2"')
    (tmp_path / "f.xml").write_text(text)
    (tmp_path / "names.toml").write_text('PIP = "hinge 2"\n')
    code, told = new(tmp_path, "--finger", str(tmp_path / "f.xml"))
    assert code == 2
    assert "--set-name PIP=NAME" in told
    options = ["--finger", str(tmp_path / "f.xml"), "--names", str(tmp_path / "names.toml")]
    assert new(tmp_path, *options)[0] == 0


def test_a_hood_through_the_bones_is_counted_and_measured(
    files: Path, ours: HoodMesh, tmp_path: Path
):
    low = user_hood(ours)
    write_inp(move_points(low, low.points - [0, 0, 5.0]), tmp_path / "hood.inp")
    code, told = new(tmp_path, "--hood", str(tmp_path / "hood.inp"), *LAID)
    assert code == 2
    assert "nodes of the hood lie in the bone" in told
    assert "mm deep" in told
    write_inp(move_points(low, low.points - [0, 0, 0.15]), tmp_path / "hood.inp")
    code, told = new(tmp_path, "--hood", str(tmp_path / "hood.inp"), *LAID)
    assert code == 0
    assert "nodes are nearer than the base case's" in told
    hood = load_case(tmp_path / "out" / "mine.toml").hood
    assert 0.05e-3 < hood.contact.offset.middle < 0.2e-3  # type: ignore[union-attr]


def test_a_larger_hand_keeps_its_bones_size(surfaces: Surfaces, tmp_path: Path):
    larger = {body: (1.1 * points, faces) for body, (points, faces) in surfaces.items()}
    made = Built(None, {}, Bones(larger, ()), None, {}, ())
    write_case(tmp_path, "mine", UserAnatomy(length_scale=1.1), made)
    drawn = bone_surfaces(load_case(tmp_path / "mine.toml"))
    for body, (points, _) in larger.items():
        np.testing.assert_allclose(np.ptp(drawn[body][0], axis=0), np.ptp(points, axis=0))


def write(surfaces: Surfaces, folder: Path) -> list[Path]:
    return write_bones(surfaces, folder)


def chain(**posture: float) -> Centreline:
    skeleton = index_finger()
    return Centreline(skeleton, *skeleton.pose({k: np.deg2rad(v) for k, v in posture.items()}))


def bone_faults(surfaces: Surfaces, folder: Path, unit: str = "mm") -> str:
    with pytest.raises(InputError) as caught:
        read_bones(write(surfaces, folder), "body", unit, Placing(), chain())
    return str(caught.value)


def test_bones_in_one_scan_are_brought_into_their_bodies(surfaces: Surfaces, tmp_path: Path):
    """Also of a left hand, turned and moved."""
    there, laid = (
        chain(MCP=20, PIP=40, DIP=11),
        Placing("mm", np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]]), np.array([10.0, 20, 30])),
    )
    scan = {}
    for i, body in enumerate(BODIES):
        world = there.position[i] + surfaces[body][0] @ there.rotation[i].T
        points = world @ laid.axes + 1e-3 * laid.origin
        scan[body] = points, surfaces[body][1][:, ::-1] if laid.mirrors else surfaces[body][1]
    read = read_bones(write(scan, tmp_path), "hood", "mm", laid, there)
    assert read.notes == ()
    for body, (points, faces) in read.surfaces.items():
        own = trimesh.Trimesh(*surfaces[body])
        back = trimesh.Trimesh(points, faces)
        np.testing.assert_allclose(back.bounds, own.bounds, atol=1e-7)
        assert back.volume == pytest.approx(own.volume, rel=1e-5)
    with pytest.raises(InputError, match="another frame"):
        read_bones([tmp_path / f"{b}.stl" for b in BODIES], "body", "mm", laid, there)


@pytest.mark.parametrize("wider", [0.9, 1.12])
def test_bones_of_the_other_side_are_refused(surfaces: Surfaces, tmp_path: Path, wider: float):
    """Those of one side and a little other are taken without a word."""
    right = {
        body: (points * [1, wider, wider], faces) for body, (points, faces) in surfaces.items()
    }
    assert read_bones(write(right, tmp_path), "body", "mm", Placing(), chain()).notes == ()
    left = {body: (points * [1, -1, 1], faces[:, ::-1]) for body, (points, faces) in right.items()}
    said = bone_faults(left, tmp_path)
    assert "metacarpal: is like one of a left hand" in said
    assert "mirror the four bones as the hood was mirrored" in said


def test_a_bone_goes_onto_our_finger_in_a_case_file(files: Path):
    text = 'extends = "split_edc"\n[finger.bones.proximal]\nsurface = "proximal.obj"\n'
    (files / "own.toml").write_text(f'{text}unit = "m"\nframe = "ours"\n', encoding="utf-8")
    assert load_case(files / "own.toml").finger.bones["proximal"].frame == "ours"


def test_holes_pieces_specks_and_inward_triangles(surfaces: Surfaces, tmp_path: Path):
    points, faces = surfaces["middle"]
    told = bone_faults(dict(surfaces) | {"middle": (points, faces[1:])}, tmp_path)
    assert "middle (middle.stl): its surface is not closed (3 edges" in told
    both = np.vstack([points, points + BESIDE]), np.vstack([faces, faces + len(points)])
    told = bone_faults(dict(surfaces) | {"middle": both}, tmp_path)
    assert "falls into 2 pieces, the second 100 %" in told
    speck = trimesh.creation.icosphere(1, 3e-4)
    small = (
        np.vstack([points, speck.vertices + BESIDE]),
        np.vstack([faces, speck.faces + len(points)]),
    )
    inward = surfaces["distal"][0], surfaces["distal"][1][:, ::-1]
    mixed = surfaces["proximal"][1].copy()
    mixed[:40] = mixed[:40, ::-1]
    spoilt = dict(surfaces) | {
        "middle": small, "distal": inward, "proximal": (surfaces["proximal"][0], mixed)
    }  # fmt: skip
    read = read_bones(write(spoilt, tmp_path), "body", "mm", Placing(), chain())
    told = " | ".join(read.notes)
    for word in ("1 specks", "distal (distal.stl): its triangles faced inward", "wound against"):
        assert word in told
    for body, (corners, cells) in read.surfaces.items():
        volume = trimesh.Trimesh(*surfaces[body]).volume
        assert trimesh.Trimesh(corners, cells).volume == pytest.approx(volume, rel=1e-5)


def test_triangles_there_twice_and_corners_split_by_normals_are_mended(
    surfaces: Surfaces, tmp_path: Path
):
    """An .obj with a normal and a place in a picture for each corner, as Blender writes it."""
    points, faces = surfaces["middle"]
    doubled = dict(surfaces) | {"middle": (points, np.vstack([faces, faces[:2, [1, 2, 0]]]))}
    files = write(doubled, tmp_path)
    lines = [
        *(f"v {x} {y} {z}" for x, y, z in 1e3 * surfaces["distal"][0]),
        *(f"vt {i} 0" for i in range(3 * len(surfaces["distal"][1]))),
        *(f"vn 0 0 {i}" for i in range(3 * len(surfaces["distal"][1]))),
    ]
    corners = 1 + np.arange(3 * len(surfaces["distal"][1])).reshape(-1, 3)
    for face, places in zip(surfaces["distal"][1] + 1, corners, strict=True):
        lines.append("f " + " ".join(f"{v}/{c}/{c}" for v, c in zip(face, places, strict=True)))
    files[3].with_suffix(".obj").write_text("\n".join(lines))
    read = read_bones([*files[:3], files[3].with_suffix(".obj")], "body", "mm", Placing(), chain())
    assert read.notes == ("middle (middle.stl): 2 triangles that are there twice are left out",)
    for body, (corners, cells) in read.surfaces.items():
        volume = trimesh.Trimesh(*surfaces[body]).volume
        assert trimesh.Trimesh(corners, cells).volume == pytest.approx(volume, rel=1e-5)


def test_the_same_bone_twice_another_unit_and_another_order(surfaces: Surfaces, tmp_path: Path):
    shifted = surfaces["proximal"][0] + [0.01, 0, 0], surfaces["proximal"][1]
    told = bone_faults(dict(surfaces) | {"middle": shifted}, tmp_path)
    assert "proximal and middle are the same surface" in told
    assert "--bone-unit mm" in bone_faults(surfaces, tmp_path, "m")
    other = dict(surfaces) | {"middle": surfaces["distal"], "distal": surfaces["middle"]}
    other |= {"proximal": surfaces["metacarpal"], "metacarpal": surfaces["proximal"]}
    assert "in order, from the metacarpal" in bone_faults(
        dict(surfaces) | {"proximal": surfaces["distal"], "distal": surfaces["proximal"]}, tmp_path
    )
    ahead = surfaces["metacarpal"][0] + [0.06, 0, 0], surfaces["metacarpal"][1]
    assert "metacarpal: its middle lies" in bone_faults(
        dict(surfaces) | {"metacarpal": ahead}, tmp_path
    )
    assert "another frame" in bone_faults(
        {b: (p[:, [1, 0, 2]] * [1, -1, 1], f) for b, (p, f) in surfaces.items()}, tmp_path
    )


@pytest.mark.parametrize("content", [b"", b"solid", b"v 0 0 0\nf 1 2 3\n", bytes(range(256))])
def test_a_file_that_is_no_surface_is_one_clear_fault(
    surfaces: Surfaces, tmp_path: Path, content: bytes
):
    paths = write(surfaces, tmp_path)
    for ending in ("stl", "obj"):
        bad = tmp_path / f"bad.{ending}"
        bad.write_bytes(content)
        with pytest.raises(InputError, match=r"bad\.(stl|obj)"):
            read_bones([*paths[:3], bad], "body", "mm", Placing(), chain())


def test_placing_maps_points_as_it_says():
    placing = Placing("cm", np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([1.0, 2, 3]))
    np.testing.assert_allclose(placing.of(np.array([[2.0, 4, 6]])), [[0.03, -0.01, -0.02]])
    assert not placing.mirrors
    assert replace(placing, axes=-placing.axes).mirrors
