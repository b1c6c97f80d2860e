"""A left hand is the mirror image of a right one: in numbers, files, models and pictures."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import meshio
import mujoco
import numpy as np
import pytest

import cosim
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fingers.kinds import bones_of, finger_model, skeleton_of
from cosim.fmu.hood import FmuHood
from cosim.fmu.quantity import hood_quantities, moving_quantities
from cosim.fmu_export.write import write_fmu
from cosim.models.build import build, mjcf_of
from cosim.port import STATIC, mirror, mirror_axial, rotation_matrix
from cosim.report.views import view_of
from cosim.results.scene_plot import VIEWS
from fe_solver.hood.as_job import job_of_hood, mirrored
from fe_solver.job.solve import solve_job
from meshes.bones import load_bone
from rigid.mjcf.read import read_mjcf
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel
from tests.helpers.fmus import NEEDS_FMU
from tests.helpers.jobs import COARSE, roped_hood, run

LEFT = 'finger.hand="left"'
RNG = np.random.default_rng(7)


@pytest.fixture(scope="module")
def pair() -> tuple[cosim.Result, cosim.Result]:
    """The case that all start with, on either hand."""
    return cosim.run("isometric_edc"), cosim.run(cosim.load("isometric_edc", [LEFT]))


def model_of(case: str, *settings: str) -> FingerModel:
    stated = load_case(case, settings)
    return finger_model(stated.native_finger(), stated.hood.left_to_finger)


def posed(model: mujoco.MjModel, angles: Mapping[str, float]) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for joint, angle in angles.items():
        data.joint(joint).qpos[0] = angle
    mujoco.mj_forward(model, data)
    return data


def test_turning_and_mirroring_commute():
    axis, point = RNG.normal(size=(2, 3))
    there = mirror(rotation_matrix(axis) @ point)
    assert there == pytest.approx(rotation_matrix(mirror_axial(axis)) @ mirror(point), abs=1e-15)


def test_the_numbers_are_the_right_hand_s(pair):
    right, left = pair
    for name in right.data:
        one, other = right.data[name].values, left.data[name].values
        if one.dtype.kind == "f":
            assert other == pytest.approx(one, abs=1e-12, nan_ok=True), name
    assert left.tip_force == pytest.approx(right.tip_force, abs=1e-12)


def test_its_files_show_a_left_hand_and_are_read_back(pair, tmp_path):
    right, left = (run.save(tmp_path / side) for run, side in zip(pair, "rl", strict=True))
    for name in ("hood.vtu", "finger.vtu"):
        one, other = (meshio.read(folder / name) for folder in (right, left))
        assert other.points == pytest.approx(mirror(one.points), abs=1e-12), name
        assert "y ulnar" in (left / name).read_text()
        assert "y radial" in (right / name).read_text()
    one, other = (meshio.read(folder / "hood.vtu") for folder in (right, left))
    assert other.point_data["displacement"] == pytest.approx(
        mirror(one.point_data["displacement"]), abs=1e-12
    )
    assert (other.cells_dict["quad"][:, ::-1] == one.cells_dict["quad"]).all()
    fibres = one.cell_data["fibre_1"][0], other.cell_data["fibre_1"][0]
    assert fibres[1] == pytest.approx(mirror(fibres[0]), abs=1e-12)
    assert cosim.open_run(left).hood.points == pytest.approx(pair[1].hood.points, abs=1e-12)


def test_a_cell_s_normal_stays_outside(pair):
    hood = pair[0].hood
    a, b, c, d = (hood.points[hood.quads[:, k]] for k in range(4))
    outward = np.cross(c - a, d - b)
    other = hood.of("left")
    a, b, c, d = (other.points[other.quads[:, k]] for k in range(4))
    assert np.cross(c - a, d - b) == pytest.approx(mirror(outward))
    back = other.of("left")
    assert (back.points == hood.points).all()
    assert (back.quads == hood.quads).all()


def test_a_view_of_a_left_hand_is_that_in_a_mirror():
    points = RNG.normal(size=(5, 3))
    for view in VIEWS:
        seen, other = view.project(points), view.of("left").project(points)
        assert other == pytest.approx(seen * [-1, 1, 1])
        assert view.of("left").place(points) == pytest.approx(view.place(points))
        towards = np.cross(mirror(view.of("left").right), mirror(view.up))
        assert towards == pytest.approx(mirror(view.towards)), "no view of its own frame"


def test_the_page_is_sent_a_left_hand_in_its_own_frame(pair):
    right, left = (view_of(run) for run in pair)
    assert (right.hand, left.hand) == ("right", "left")
    shown = left.in_own_frame()
    assert shown.sheet.points == pytest.approx(mirror(right.sheet.points), abs=1e-12)
    for one, other in zip(right.bones, shown.bones, strict=True):
        world = one.vertices @ one.rotation[-1].T + one.position[-1]
        mine = other.vertices @ other.rotation[-1].T + other.position[-1]
        assert mine == pytest.approx(mirror(world), abs=1e-12)
        assert np.linalg.det(other.rotation[-1]) == pytest.approx(1.0)
    assert right.in_own_frame() is right


def test_what_is_said_by_direction_tells_its_frame(pair):
    """In left-handed axes of a left hand, so that nobody takes r x F of its figures."""
    for result, axes in zip(pair, ("right-handed", "left-handed"), strict=True):
        assert result.summary["frame"] == result.data.attrs["frame"]
        assert axes in result.summary["frame"]
    assert "y radial" in pair[1].summary["frame"]


@pytest.mark.parametrize("case", ["network_edc", "middle_majorflex_edc"])
def test_a_mirrored_finger_moves_as_the_mirror_shows(case):
    right = model_of(case)
    models = [mujoco.MjModel.from_xml_string(mjcf_xml(m)) for m in (right, right.mirrored())]
    assert right.mirrored().mirrored() == right
    for _ in range(5):
        angles = {j: a * RNG.uniform(0, 1) for j, (_, a) in right.ranges.items()}
        one, other = (posed(m, angles) for m in models)
        assert other.xpos == pytest.approx(mirror(one.xpos), abs=1e-12)
        assert other.ten_length == pytest.approx(one.ten_length, abs=1e-12)
        assert other.site("tip").xpos == pytest.approx(mirror(one.site("tip").xpos), abs=1e-12)


@pytest.mark.parametrize("hood", [(), ("--hood", "network")])
def test_a_left_finger_for_mujoco_is_the_mirrored_one(hood, tmp_path):
    paths = tmp_path / "right.xml", tmp_path / "left.xml"
    case = "network_edc"
    for path, more in zip(paths, ((), ("--set", LEFT)), strict=True):
        told = run("export", case, "-o", path, *hood, *more)
        assert told.exit_code == 0, told.output
    one, other = (mujoco.MjModel.from_xml_path(str(path)) for path in paths)
    data = [mujoco.MjData(m) for m in (one, other)]
    for m, d in zip((one, other), data, strict=True):
        mujoco.mj_resetDataKeyframe(m, d, 0)
        mujoco.mj_forward(m, d)
        for _ in range(20):
            mujoco.mj_step(m, d)
    assert data[1].xpos == pytest.approx(mirror(data[0].xpos), abs=1e-9)
    assert data[1].ten_length == pytest.approx(data[0].ten_length, abs=1e-9)
    assert np.abs(mirror(data[0].xpos) - data[0].xpos).max() > 1e-3


def test_a_left_hand_s_file_is_read_as_one_and_told_where_it_is_not(tmp_path):
    path = tmp_path / "left.xml"
    case = load_case("network_edc", [LEFT])
    path.write_text(mjcf_of(case))
    read, model = read_mjcf(path, hand="left"), model_of("network_edc")
    assert any("left hand" in words for words in read.losses)
    for one, other in zip(model.segments, read.model.segments, strict=True):
        assert other.position == pytest.approx(one.position, abs=1e-9)
        for a, b in itertools.zip_longest(one.hinges, other.hinges):
            assert b.axis == pytest.approx(a.axis, abs=1e-9)
    with pytest.raises(InputError, match="left hand"):
        read_mjcf(path)
    right = tmp_path / "right.xml"
    right.write_text(mjcf_of(load_case("network_edc")))
    with pytest.raises(InputError, match="right hand"):
        read_mjcf(right, hand="left")


def test_a_finger_and_bones_of_a_left_hand_are_read_from_its_files(tmp_path):
    path, settings = tmp_path / "left.xml", []
    path.write_text(mjcf_of(load_case("network_edc", [LEFT])))
    for body in ("metacarpal", "proximal", "middle", "distal"):
        vertices, faces = load_bone(body).surface(2e-3)
        bone = tmp_path / f"{body}.stl"
        meshio.Mesh(mirror(vertices), [("triangle", faces[:, ::-1])]).write(bone)
        settings.append(f'finger.bones.{body}={{surface="{bone}",unit="m",frame="ours"}}')
    case = load_case("network_edc", [LEFT, f'finger.path="{path}"', *settings])
    finger, extensor = case.native_finger(), case.hood.left_to_finger
    own = load_case("network_edc").native_finger()
    assert skeleton_of(finger).axis == pytest.approx(skeleton_of(own).axis, abs=1e-9)
    vertices, faces = bones_of(finger, extensor)["proximal"]
    there, _ = load_bone("proximal").surface(2e-3)
    assert np.sort(vertices, axis=0) == pytest.approx(np.sort(there, axis=0), abs=1e-7)
    corners = vertices[faces]
    volume = np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume > 0, "its triangles turn inside out"


@pytest.mark.parametrize("ending", [".vtu", ".inp"])
def test_the_mesh_of_a_left_hood_is_the_mirrored_one(ending, tmp_path):
    paths = [tmp_path / f"{side}{ending}" for side in "rl"]
    for path, more in zip(paths, ((), ("--set", LEFT)), strict=True):
        assert run("export", "isometric_edc", "-o", path, *more).exit_code == 0
    one, other = (meshio.read(path) for path in paths)
    assert other.points == pytest.approx(mirror(one.points), abs=1e-9)
    quads = one.cells_dict["quad"], other.cells_dict["quad"]
    assert (quads[1][:, ::-1] == quads[0]).all()


def test_a_mirrored_hood_solved_as_it_is_moves_as_the_mirror_shows():
    """No answer is mirrored here: mesh, bones, ropes and pulls are, and the solver meets them."""
    hood, bones = roped_hood()
    job = job_of_hood(hood, hood.rest, np.array([4.0]), bones)
    one, other = (solve_job(j, options=COARSE).states[-1] for j in (job, mirrored(job)))
    moved = one.configuration.x - job.sheet.points
    there = other.configuration.x - mirror(job.sheet.points)
    assert np.abs(moved[:, 1]).max() > 1e-6
    assert there == pytest.approx(mirror(moved), abs=1e-6 * np.abs(moved).max())
    force, mine = one.wrench["contact"][0, :3], other.wrench["contact"][0, :3]
    assert mine == pytest.approx(mirror(force), abs=1e-6 * np.abs(force).max())


def test_the_components_that_a_mirror_turns_are_known_of_every_quantity():
    """A wrench at a point and its mirror image, by force, lever and moment."""
    bodies, names = ("proximal", "middle"), ("slip",)
    every = {q.name: q for q in moving_quantities(bodies, ("MCP",), ("EDC",))}
    every |= {q.name: q for q in hood_quantities(bodies, names, ("EDC",))}
    lever, force = RNG.normal(size=(2, 3))
    sign = {name: q.signs("left") for name, q in every.items()}
    moment = np.cross(lever * sign["position"][0], force * sign["force"][0, 0])
    assert moment == pytest.approx(sign["moment"][0, 0] * np.cross(lever, force))
    turn, twist = rotation_matrix(lever), np.concatenate([force, lever])
    turned = rotation_matrix((sign["excursion_motion"][0, 0] * twist)[3:])
    assert sign["rotation"][0] * turn == pytest.approx(turned)
    slope = np.outer(twist, twist)  # of a wrench by a twist: both turn alike
    mine = sign["load_motion"][0, :, 0]
    assert mine * slope == pytest.approx(np.outer(*2 * [sign["excursion_motion"][0, 0] * twist]))
    assert (sign["tip_moment"] == mirror_axial(np.ones(3))).all()
    for name in ("tension", "excursion", "angle", "static", "path"):
        assert (sign[name] == 1).all(), name
    assert all((q.signs("right") == 1).all() for q in every.values())


@pytest.mark.fmu
@pytest.mark.skipif(NEEDS_FMU[1].args[0] or NEEDS_FMU[2].args[0], reason="no FMU is written here")
def test_a_unit_of_a_left_hood_speaks_in_its_frame(tmp_path):
    case, path = load_case("network_edc", [LEFT]), tmp_path / "left.fmu"
    write_fmu(case, "hood", 2, path)
    models = build(case)
    own = models.hood
    motion = models.finger.motion(models.finger.start(models.posture))
    tension = np.full(len(own.tendons), 2.0)
    native = own.advance(own.start(motion), motion, tension, STATIC)
    names = own.bodies, own.tendons, own.sources
    unit = FmuHood(path, *names, hand="left")
    answer = unit.advance(unit.start(motion), motion, tension, STATIC)
    assert answer.load.wrench == pytest.approx(native.load.wrench, abs=1e-9)
    slope = unit.jacobian(answer.state).load_motion
    there = own.jacobian(native.state).load_motion
    assert slope == pytest.approx(there, abs=1e-6 * np.abs(there).max())
    plain = FmuHood(path, *names)  # what a master sees that lives in the left hand's frame
    turn = np.outer(*2 * [mirror(np.ones(3))])
    seen = type(motion)(motion.bodies, mirror(motion.position), turn * motion.rotation)
    other = plain.advance(plain.start(seen), seen, tension, STATIC).load.wrench
    assert other[..., :3] == pytest.approx(mirror(native.load.wrench[..., :3]), abs=1e-9)
    assert other[..., 3:] == pytest.approx(mirror_axial(native.load.wrench[..., 3:]), abs=1e-12)
