"""A hood laid on a user's bones: registration, joints, what is carried over, what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from cosim.anatomy.carry import Carrier
from cosim.anatomy.joints import Joints, fit_cylinder, fit_head, fit_sphere, joints_of, parent_axis
from cosim.anatomy.landmarks import read_landmarks, stated_axes
from cosim.anatomy.own_case import OwnBones, case_text, own_finger, write_files
from cosim.anatomy.register import Fit, register
from cosim.anatomy.scan import in_posture, scan_words
from cosim.anatomy.user_bones import Template, flat_end, kinds_with_a_hood, template_of
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.fingers.common import Extensor
from cosim.fingers.kinds import FINGERS, anatomy_of
from cosim.pipeline import run_case
from meshes.bones import bone_surface, load_bone
from meshes.skeleton import BODIES, JOINTS
from rigid.model import Via
from tests.helpers.own_bones import mirrored, scanned, write_scans, write_surface

FORCE, ARMS = 0.01, 0.2
"""Relative, and mm: what may be between the packaged finger and its own bones read back."""
ROUGH_FORCE, ROUGH_ARMS = 0.05, 0.6
"""The same with noise of 0.3 mm; three draws came to 0.9 to 2.7 % and 0.15 to 0.43 mm."""


@pytest.fixture(scope="module")
def index() -> Template:
    return template_of("index")


def unmoved(template: Template) -> dict[str, Fit]:
    """Our bones laid on themselves."""
    out = {}
    for body, (points, _) in template.bones.items():
        some = points[::40]
        out[body] = Fit(np.eye(3), np.zeros(3), {}, np.inf, points, some, some)
    return out


def test_a_bone_is_found_again_wherever_it_lies(index: Template):
    """Turned, moved, triangulated anew, a tenth of its points gone, longer and thinner."""
    surface, turn, place = scanned("middle", length=0.9, width=1.1)
    fit = register(index.bones["middle"], surface)
    points = index.bones["middle"][0][::50]
    there = points * [0.9, 1.1, 1.1] @ turn.T + place
    assert np.linalg.norm(fit.carry(points) - there, axis=1).max() < 0.1e-3
    off = Rotation.from_matrix(fit.rotation.T @ turn).magnitude()
    assert np.degrees(off) < 0.5
    np.testing.assert_allclose(fit.stretch, [0.9, 1.1, 1.1], rtol=0.01)
    assert fit.distance["spline"][0] < fit.distance["affine"][0] < 0.03e-3
    assert fit.distance["similarity"][0] > 5 * fit.distance["affine"][0]
    assert fit.flipped > 2


def test_one_bone_does_not_tell_its_side(index: Template):
    """Which is why the side is asked for: a mirrored phalanx is fitted to 0.1 mm."""
    fit = register(index.bones["distal"], mirrored(scanned("distal")[0]))
    assert fit.distance["affine"][0] < 0.1e-3


def test_a_sphere_and_a_cylinder_are_found():
    rng = np.random.default_rng(3)
    way = rng.standard_normal((400, 3)) + np.array([2.0, 0, 0])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre, radius, rms = fit_sphere(np.array([0.01, 0.02, 0.03]) + 5e-3 * way)
    np.testing.assert_allclose(centre, [0.01, 0.02, 0.03], atol=1e-9)
    assert (radius, rms) == (pytest.approx(5e-3), pytest.approx(0, abs=1e-9))
    turn = Rotation.from_rotvec([0.1, 0.05, -0.2]).as_matrix()
    angle, along = rng.uniform(-1.5, 1.5, 400), rng.uniform(-4e-3, 4e-3, 400)
    round_y = np.column_stack([3e-3 * np.cos(angle), along, 3e-3 * np.sin(angle)])
    axis, on_it, radius, rms = fit_cylinder(round_y @ turn.T, np.array([0, 1.0, 0]), np.zeros(3))
    np.testing.assert_allclose(axis, turn[:, 1], atol=1e-7)
    assert np.linalg.norm(np.cross(on_it, axis)) < 1e-9
    assert (radius, rms) == (pytest.approx(3e-3), pytest.approx(0, abs=1e-9))


@pytest.mark.parametrize("kind", kinds_with_a_hood())
def test_our_bones_on_themselves_are_our_finger(kind: str):
    """Joints, paths, surfaces that tendons wrap over, and eyelets, to rounding."""
    template = template_of(kind)
    fits, ours = unmoved(template), template.skeleton
    heads = {body: fit_head(body, template.bones[body], fits[body], ours) for body in BODIES[:3]}
    for head in heads.values():
        assert head.angle < 0.01
        assert head.shift < 1e-6
    joints = joints_of(ours, fits, heads, {})
    np.testing.assert_allclose(joints.skeleton.length, ours.length, atol=1e-7)
    np.testing.assert_allclose(joints.skeleton.zero, ours.zero, atol=1e-4)
    np.testing.assert_allclose(joints.skeleton.axis, ours.axis, atol=1e-4)
    carrier = Carrier(ours, fits, joints)
    model = FINGERS[kind].model(template.config, Extensor(lies_on_bones=True))
    carried = carrier.model(model)
    assert carried.muscles == model.muscles
    for mine, our in zip(carried.tendons, model.tendons, strict=True):
        for a, b in zip(mine.strands[0].path, our.strands[0].path, strict=True):
            if isinstance(a, Via):
                np.testing.assert_allclose(a.point, b.point, atol=1e-5)
            else:
                np.testing.assert_allclose(a.centre, b.centre, atol=1e-6)
                assert a.radius == pytest.approx(b.radius, rel=2e-3)
    eyelets = FINGERS[kind].eyelets(template.config)
    for tendon, at in carrier.eyelets(eyelets).items():
        np.testing.assert_allclose(at, eyelets[tendon], atol=1e-6)


def test_a_turned_pip_turns_the_dip_with_it(index: Template):
    """Its own condyles are too short; a landmark's axis has the last word."""
    ours, fits = index.skeleton, unmoved(index)
    head = fit_head("proximal", index.bones["proximal"], fits["proximal"], ours)
    turn = Rotation.from_rotvec([0, 0, np.radians(6.0)]).as_matrix()
    joints = joints_of(ours, fits, {"proximal": replace(head, turn=turn)}, {}).skeleton

    def angle(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))

    pip = angle(parent_axis(joints, "PIP"), parent_axis(ours, "PIP"))
    dip = angle(parent_axis(joints, "DIP"), parent_axis(ours, "DIP"))
    assert pip == pytest.approx(6.0, abs=0.3)
    assert dip == pytest.approx(6.0, abs=0.5)
    stated = {("proximal", "flexion"): turn @ parent_axis(ours, "PIP")}
    again = joints_of(ours, fits, {}, stated).skeleton
    np.testing.assert_allclose(parent_axis(again, "DIP"), parent_axis(joints, "DIP"), atol=2e-3)
    stated = {("middle", "flexion"): np.array([0.0, -1.0, 0.0])}
    joints = joints_of(ours, fits, {"proximal": replace(head, turn=turn)}, stated).skeleton
    assert angle(parent_axis(joints, "DIP"), np.array([0.0, 1.0, 0.0])) < 1e-4


def test_the_mcp_s_axes_are_those_that_landmarks_state(index: Template, tmp_path: Path):
    """In the metacarpal's file, wherever that lies, by any two points in the axis's own order or
    the other; the abduction axis turns with the flexion axis unless it is stated too."""
    ours, fits, turn = index.skeleton, unmoved(index), Rotation.from_rotvec([0.3, -1.1, 0.5])
    lying = turn.as_matrix()
    fit = fits["metacarpal"]
    fits["metacarpal"] = Fit(
        lying, np.ones(3), {}, np.inf, fit.surface, fit.template, fit.template @ lying.T + 1.0
    )
    tilt = Rotation.from_rotvec(np.radians([7.0, 0.0, -12.0])).as_matrix()
    flexion, abduction = (tilt @ parent_axis(ours, joint) for joint in JOINTS[:2])
    ends = {"flexion_radial": 8.0, "flexion_ulnar": -5.0}
    path = tmp_path / "points.csv"

    def axes(stated: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        rows = [
            ",".join(["metacarpal", name, *map(repr, (lying @ point + 1.0).tolist())])
            for name, point in stated.items()
        ]
        path.write_text("\n".join(["bone,landmark,x,y,z", *rows]))
        joints = joints_of(ours, fits, {}, stated_axes(read_landmarks(path)))
        return [parent_axis(joints.skeleton, joint) for joint in JOINTS[:2]]

    alone = {name: reach * flexion for name, reach in ends.items()}
    np.testing.assert_allclose(axes(alone)[0], flexion, atol=1e-12)
    swapped = {name: -reach * flexion for name, reach in ends.items()}
    np.testing.assert_allclose(axes(swapped), axes(alone), atol=1e-12)
    kept = [a @ b for a, b in (axes(alone), [parent_axis(ours, j) for j in JOINTS[:2]])]
    assert kept[0] == pytest.approx(kept[1], abs=1e-12)
    both = alone | {"abduction_dorsal": 4.0 * abduction, "abduction_palmar": -3.0 * abduction}
    np.testing.assert_allclose(axes(both), [flexion, abduction], atol=1e-12)
    with pytest.raises(InputError, match=r"flexion axis of the MCP is \d+ deg off"):
        axes({"flexion_radial": 5.0 * abduction, "flexion_ulnar": -5.0 * abduction})
    with pytest.raises(InputError, match="abduction axis needs two points"):
        axes({"abduction_dorsal": abduction})


def test_a_scan_says_how_far_it_is_bent(index: Template):
    ours = index.skeleton
    bent = {"MCP": np.radians(20.0), "PIP": np.radians(40.0), "DIP": np.radians(11.0)}
    position, rotation = ours.pose(bent)
    lying = Joints(
        ours,
        dict(zip(BODIES, position, strict=True)),
        dict(zip(BODIES, rotation, strict=True)),
    )
    (words,) = scan_words(lying, BODIES)
    assert "MCP 20, PIP 40, DIP 11 deg" in words
    np.testing.assert_allclose(in_posture(lying, BODIES, bent).skeleton.zero, ours.zero, atol=1e-12)
    off = [[0.1, 0.0, 0.05], [0.0, 0.1, 0.0], [0.1, 0.0, 0.2], [0.0, 0.0, 0.1]]
    tilted = ours.axis + np.array(off)
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    other = replace(lying, skeleton=replace(ours, axis=tilted))
    stated = in_posture(other, BODIES, bent, JOINTS).skeleton
    for joint in JOINTS:  # where landmarks have it in the bone before
        np.testing.assert_allclose(
            parent_axis(stated, joint), parent_axis(other.skeleton, joint), atol=1e-12
        )
    np.testing.assert_array_equal(in_posture(other, BODIES, bent).skeleton.axis, tilted)
    further = in_posture(lying, BODIES, {"PIP": np.radians(30.0)}).skeleton
    again, _ = further.pose({"PIP": np.radians(30.0)})
    np.testing.assert_allclose(again, position, atol=1e-9)
    apart = Joints(ours, {b: 0.1 * i + np.zeros(3) for i, b in enumerate(BODIES)}, lying.axes)
    assert scan_words(apart, BODIES) == []
    with pytest.raises(InputError, match="centres are apart"):
        in_posture(apart, BODIES, bent)


def faults(bones: Mapping[str, Path], kind: str = "index", **how: object) -> str:
    with pytest.raises(InputError) as error:
        own_finger(OwnBones(kind, bones, **how))
    return str(error.value)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bones")
    return {
        body: write_surface(load_bone(body).surface(0.8e-3), folder / f"{body}.stl")
        for body in BODIES
    }


def test_a_wrong_order_or_unit_is_refused(files: dict[str, Path], tmp_path: Path):
    swapped = {**files, "proximal": files["middle"], "middle": files["proximal"]}
    assert "Are they in order, from the metacarpal to the distal phalanx?" in faults(swapped)
    metres = {
        body: write_surface(load_bone(body).surface(2e-3), tmp_path / f"{body}.stl", 1.0)
        for body in BODIES
    }
    assert "they would fit in m: --bone-unit m" in faults(metres, unit="mm")
    short = write_surface(load_bone("distal").scale(0.5, 0.5).surface(1e-3), tmp_path / "short.stl")
    other = {**files, "distal": short}
    assert "do not belong to one finger" in faults(other)
    assert "expected one of index, middle" in faults(files, "thumb")


def test_open_doubled_and_joined_surfaces_are_refused(files: dict[str, Path], tmp_path: Path):
    points, faces = load_bone("middle").surface(1.2e-3)
    trimesh.Trimesh(1e3 * points, faces[1:], process=False).export(tmp_path / "open.stl")
    assert "its surface is not closed (3 edges" in faults({"middle": tmp_path / "open.stl"})
    pair = (
        np.vstack([points, points + np.array([0.03, 0, 0])]),
        np.vstack([faces, faces + len(points)]),
    )
    two = write_surface(pair, tmp_path / "two.stl")
    assert "are two bones, or one twice, in the file?" in faults({"middle": two})


def test_a_cut_end_and_what_is_no_bone_are_refused(tmp_path: Path):
    points, faces = load_bone("proximal").surface(1e-3)
    cut = points.copy()
    cut[:, 0] = np.maximum(cut[:, 0], points[:, 0].min() + 4e-3)
    said = faults({"proximal": write_surface((cut, faces), tmp_path / "cut.stl")})
    assert "ends in a flat face" in said
    assert "give the whole bone, or leave it out" in said
    rod = trimesh.creation.capsule(0.032, 0.005, count=[24, 24])
    rod = write_surface((np.array(rod.vertices), np.array(rod.faces)), tmp_path / "rod.stl")
    assert "is like no such bone" in faults({"proximal": rod})


@pytest.mark.parametrize("body", BODIES)
def test_a_flat_end_is_told_by_the_shape_alone(body: str):
    """In whatever order a file has triangles and corners, of either hand, wherever it lies."""
    mesh = trimesh.load(f"cases/own/{body}.stl")
    points, f = 1e-3 * np.asarray(mesh.vertices), np.asarray(mesh.faces)
    rng, cut = np.random.default_rng(1), points.copy()
    cut[:, 0] = np.maximum(cut[:, 0], points[:, 0].min() + 0.15 * np.ptp(points[:, 0]))
    cut += 1e-7 * rng.standard_normal(cut.shape)  # no triangle without area
    for p, least, most in ((points, 0.1, 0.5), (cut, 0.8, 4.0)):
        assert least < flat_end((p, f)) < most
        same = [(p, np.roll(f, 1, axis=0)), (p, rng.permutation(f)), (p, np.roll(f, 1, axis=1))]
        same += [(p[::-1], len(p) - 1 - f), mirrored((p, f))]
        same += [(p @ Rotation.random(rng=rng).as_matrix() + 0.1, f)]
        np.testing.assert_allclose([*map(flat_end, same)], flat_end((p, f)), atol=1e-9, rtol=0)
    assert all(flat_end(template_of(kind).bones[body]) < 0.5 for kind in kinds_with_a_hood())


def test_a_left_metacarpal_is_told(index: Template, tmp_path: Path):
    """Of a set that is mirrored, or of which only this bone is."""
    left = mirrored(load_bone("metacarpal").surface(1.2e-3))
    path = write_surface(left, tmp_path / "left.stl")
    said = faults({"metacarpal": path})
    assert "metacarpal: is one of a left hand" in said
    assert "--hand left" in said
    finger = own_finger(OwnBones("index", {"metacarpal": path}, hand="left"))
    assert any(line.startswith("side: left, stated") for line in finger.report)
    assert finger.laid.fits["metacarpal"].distance["affine"][0] < 0.06e-3
    assert finger.size == pytest.approx(1.0, abs=0.01)
    points, faces = finger.laid.surfaces["metacarpal"]
    assert trimesh.Trimesh(points, faces, process=False).volume > 0  # normals outwards


def test_what_is_written_of_a_left_hand_is_read_as_its_mirror_image(tmp_path: Path):
    """The files are those of a left hand, the case says so, and what is solved is the right one."""
    path = write_surface(mirrored(load_bone("metacarpal").surface(1.2e-3)), tmp_path / "left.stl")
    finger = own_finger(OwnBones("index", {"metacarpal": path}, hand="left"))
    hood = load_case("base/index_finger").hood
    write_files(tmp_path, finger)
    text = case_text("mine", finger, hood, hood.extra_length.central_slip)
    (tmp_path / "mine.toml").write_text(text)
    read = load_case(tmp_path / "mine.toml").finger
    assert read.hand == "left"
    laid = anatomy_of(read, Extensor(lies_on_bones=True))
    here = finger.joints.local("proximal", finger.laid.surfaces["proximal"][0])
    assert laid.bones["proximal"][0] == pytest.approx(here, abs=1e-9)
    assert laid.skeleton.axis == pytest.approx(finger.joints.skeleton.axis, abs=1e-6)
    there = np.loadtxt(tmp_path / "proximal.obj", usecols=(1, 2, 3), max_rows=len(here))
    assert there == pytest.approx(here * [1, -1, 1], abs=1e-9)


def test_landmarks_override_and_tell_the_side(files: dict[str, Path], tmp_path: Path):
    path = tmp_path / "points.csv"
    rows = ["middle,dorsal,14,0,4", "middle,radial,14,4,0", "middle,distal_joint,25.6,0.2,-0.1"]
    rows += ["middle,flexion_radial,25,5,0", "middle,flexion_ulnar,25,-5,0"]
    path.write_text("\n".join(["bone,landmark,x,y,z", *rows]))
    given = {"middle": files["middle"]}
    finger = own_finger(OwnBones("index", given, landmarks=path))
    skeleton = finger.joints.skeleton
    assert skeleton.length[2] == pytest.approx(25.6e-3, abs=0.2e-3)
    assert parent_axis(skeleton, "DIP")[1] == pytest.approx(1.0, abs=1e-3)
    path.write_text(path.read_text().replace("14,4,0", "14,-4,0"))
    assert "it is of a left hand, stated is right" in faults(given, landmarks=path)
    path.write_text("bone,landmark,x,y,z\nmiddle,flexion_radial,25,5,0\n")
    with pytest.raises(InputError, match="needs two points"):
        read_landmarks(path)
    path.write_text("bone,landmark,x,y,z\nmiddle,tip,25,5,0\n")
    with pytest.raises(InputError, match="line 2: middle has no 'tip'"):
        read_landmarks(path)
    both = {("middle", "flexion_radial"): np.ones(3), ("middle", "flexion_ulnar"): np.zeros(3)}
    np.testing.assert_allclose(stated_axes(both)["middle", "flexion"], np.ones(3) / np.sqrt(3))


def test_a_fine_surface_is_taken_as_the_spline_bends_ours(
    files: dict[str, Path], monkeypatch: pytest.MonkeyPatch
):
    """The distance of millions of triangles would take minutes to prepare."""
    monkeypatch.setattr("cosim.anatomy.user_bones.MANY", 1000)
    finger = own_finger(OwnBones("index", {"middle": files["middle"]}))
    points, faces = finger.laid.surfaces["middle"]
    np.testing.assert_array_equal(faces, bone_surface("middle")[1])
    assert np.abs(finger.joints.local("middle", points) - bone_surface("middle")[0]).max() < 0.3e-3
    assert any("triangles; the hood lies on ours" in line for line in finger.report)


def test_any_finger_takes_eyelets_and_a_breadth():
    settings = ['finger.eyelets.LUM=["-9 mm", "-6 mm", "7 mm"]', "finger.breadth=1.3"]
    for kind in ("index_finger", "middle_hood"):
        finger = load_case(f"base/{kind}.toml", settings).native_finger()
        anatomy = anatomy_of(finger, Extensor(lies_on_bones=True))
        assert anatomy.eyelets["LUM"] == pytest.approx((-9e-3, -6e-3, 7e-3))
        assert anatomy.width == 1.3
    with pytest.raises(InputError, match=r"eyelets.FDP: .*expected some of LUM, FPI"):
        anatomy_of(
            load_case("isometric_edc", [settings[0].replace("LUM", "FDP")]).finger, Extensor()
        )


def test_bones_alone_need_no_hood_and_their_options_no_other(files: dict[str, Path]):
    done = CliRunner().invoke(app, ["new", "mine", "--bone", "thumb=a.stl"])
    assert done.exit_code == 2
    assert "expected one of metacarpal" in done.output
    done = CliRunner().invoke(app, ["new", "mine", "--hood", "hood.inp", "--hand", "left"])
    assert done.exit_code == 2
    assert "leave out --hood and --finger" in " ".join(done.output.split())


def made(folder: Path, *options: str) -> Path:
    """The case that the command makes."""
    done = CliRunner().invoke(app, ["new", "mine", "-o", str(folder / "mine"), *options])
    assert done.exit_code == 0, done.output
    return folder / "mine" / "mine.toml"


def differences(case: Path, base: str, tendon: str) -> tuple[float, float]:
    """How far the fingertip's force (relative) and the arms (mm, most) are from a packaged
    finger's; its audits are met."""
    pulled = [f"tendons.{tendon}.activation=0.1", "output.picture=false"]
    mine, ours = (run_case(load_case(path, pulled)).summary for path in (case, base))
    assert not mine["audit_missed"]
    force = [np.array([*s["fingertip_force_N"].values()]) for s in (mine, ours)]
    arms = [
        np.array([[arm[joint] for joint in JOINTS] for arm in s["moment_arm_mm"].values()])
        for s in (mine, ours)
    ]
    off = np.linalg.norm(force[0] - force[1]) / np.linalg.norm(force[1])
    return float(off), float(np.abs(arms[0] - arms[1]).max())


@pytest.mark.slow
def test_our_bones_read_back_are_the_packaged_finger(tmp_path: Path):
    case = made(tmp_path, "--bones", *map(str, write_scans(tmp_path)))
    for tendon in ("EDC", "FDP"):
        force, arms = differences(case, "base/index_finger.toml", tendon)
        assert force < FORCE
        assert arms < ARMS
    page = case.with_suffix(".html").read_text(encoding="utf-8")
    for words in ("Moment arms", "An et al. 1979", "carried", "assumed", "affine"):
        assert words in page
    report = (case.parent / "cosim_new.txt").read_text()
    assert "at rest, straight: met" in report


@pytest.mark.slow
def test_our_bones_shorter_and_wider(tmp_path: Path):
    """As long as they are made, and the slips as the packaged hood's."""
    scans = write_scans(tmp_path, length=0.85, width=1.15)
    case = made(tmp_path, "--bones", *map(str, scans))
    text = (case.parent / "cosim_new.txt").read_text()
    finger = load_case(case).native_finger()
    skeleton = anatomy_of(finger, Extensor(lies_on_bones=True)).skeleton
    np.testing.assert_allclose(
        skeleton.length[1:], 0.85 * template_of("index").skeleton.length[1:], rtol=5e-3
    )
    assert "found in" in text
    differences(case, "base/index_finger.toml", "EDC")  # the audits


@pytest.mark.slow
def test_rough_bones_spread_no_further(tmp_path: Path):
    """Noise of 0.3 mm: the hood lies on our bones as the spline bends them."""
    case = made(tmp_path, "--bones", *map(str, write_scans(tmp_path, seed=2, noise=0.3e-3)))
    assert "its surface is rough" in (case.parent / "cosim_new.txt").read_text()
    force, arms = differences(case, "base/index_finger.toml", "EDC")
    assert force < ROUGH_FORCE
    assert arms < ROUGH_ARMS


@pytest.mark.slow
def test_phalanges_of_a_middle_finger_one_by_one(tmp_path: Path):
    """The metacarpal, which is not given, is ours."""
    bones = template_of("middle").bones
    options = ["--finger-kind", "middle"]
    for body in BODIES[1:]:
        path = write_surface(bones[body], tmp_path / f"{body}.stl")
        options += ["--bone", f"{body}={path}"]
    case = made(tmp_path, *options)
    force, arms = differences(case, "base/middle_hood.toml", "EDC")
    assert force < FORCE
    assert arms < ARMS
    assert "metacarpal: not given; ours" in (case.parent / "cosim_new.txt").read_text()


def test_the_template_is_the_packaged_bone(index: Template):
    for body in BODIES:
        np.testing.assert_array_equal(index.bones[body][0], bone_surface(body)[0])
