"""OpenSim's models as MJCF: places, paths and masses against closed forms and OpenSim's figures."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from cosim.cli import app
from rigid.opensim.osim import write_import
from tests.helpers.osim_files import (
    PLAIN,
    axis,
    body,
    coordinate,
    custom,
    import_text,
    joint,
    model,
    muscle,
    point,
)
from tests.proofs.fingers.osim_rows import at_postures, shipped_models

F_PLACE, F_TURN = (0.1, -0.2, 0.3), (0.4, -0.3, 0.2)
M_PLACE, M_TURN = (-0.05, 0.02, 0.07), (0.3, 0.5, -0.2)
FRAMES = f"""<frames>
<PhysicalOffsetFrame name="F"><socket_parent>/ground</socket_parent>
<translation>{" ".join(map(str, F_PLACE))}</translation>
<orientation>{" ".join(map(str, F_TURN))}</orientation></PhysicalOffsetFrame>
<PhysicalOffsetFrame name="M"><socket_parent>/bodyset/b</socket_parent>
<translation>{" ".join(map(str, M_PLACE))}</translation>
<orientation>{" ".join(map(str, M_TURN))}</orientation></PhysicalOffsetFrame></frames>"""
X, Y, Z = np.eye(3)


def transform(turn: object, shift: object) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("XYZ", turn).as_matrix(), shift
    return out


def pose(xml: str, **values: float) -> mujoco.MjData:
    built = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(built)
    for name, value in values.items():
        data.joint(name).qpos = value
    mujoco.mj_forward(built, data)
    return data


def place(data: mujoco.MjData, name: str = "b") -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
    return out


def test_the_rows_notice_a_point_that_is_a_hundredth_of_a_micrometre_off() -> None:
    finger, told = shipped_models()
    old = '"FDP-2" pos="0.011000000000000001'
    assert f"name={old}" in finger.xml
    moved_point = finger.xml.replace(old, '"FDP-2" pos="0.01100001')
    ours = at_postures(moved_point, told.coordinates, told.paths, told.postures)
    assert 1e-9 < np.abs(ours.lengths - told.lengths)[:, 0].max() < 1e-8


MOTIONS = {  # frame M in F at coordinates q: turns about x, y, z in this order, then a shift in F
    "PinJoint": lambda q: transform((0, 0, q[0]), 0 * X),
    "SliderJoint": lambda q: transform((0, 0, 0), q[0] * X),
    "UniversalJoint": lambda q: transform((q[0], q[1], 0), 0 * X),
    "BallJoint": lambda q: transform(q, 0 * X),
    "GimbalJoint": lambda q: transform(q, 0 * X),
    "PlanarJoint": lambda q: transform((0, 0, q[0]), q[1] * X + q[2] * Y),
    "FreeJoint": lambda q: transform(q[:3], q[3:]),
    "WeldJoint": lambda q: np.eye(4),
}


@pytest.mark.parametrize("kind", MOTIONS)
def test_every_joint_places_its_child_as_its_definition_says(kind: str, tmp_path: Path) -> None:
    q = [0.3, -0.5, 0.7, 0.11, -0.12, 0.13]
    count = {"WeldJoint": 0, "UniversalJoint": 2, "FreeJoint": 6, "PinJoint": 1, "SliderJoint": 1}
    q = q[: count.get(kind, 3)]
    coordinates = "".join(coordinate(f"q{k}") for k in range(len(q)))
    text = model(joints=joint("j", "F", "M", coordinates, FRAMES, kind))
    data = pose(import_text(tmp_path, text).xml, **{f"q{k}": v for k, v in enumerate(q)})
    outer, inner = transform(F_TURN, F_PLACE), transform(M_TURN, M_PLACE)
    assert_allclose(place(data), outer @ MOTIONS[kind](q) @ np.linalg.inv(inner), atol=1e-14)


LINEAR = "<LinearFunction><coefficients>{}</coefficients></LinearFunction>"
SPLINE = "<SimmSpline><x>-1 1 3</x><y>1.2 -0.8 -2.8</y></SimmSpline>"
DOUBLE = f"""<MultiplierFunction><function>{LINEAR.format("0.5 0.05")}</function>
<scale>2</scale></MultiplierFunction>"""


def test_a_custom_joint_keeps_constants_signs_multipliers_and_straight_splines(
    tmp_path: Path,
) -> None:
    axes = (
        axis("rotation1", "<Constant><value>0.3</value></Constant>", along="0 1 0"),
        axis("rotation2", f"<function>{LINEAR.format('-1 0.1')}</function>", "a", "0 2 1"),
        axis("rotation3", SPLINE, "b", "1 0 0"),
        axis("translation1", DOUBLE, "c", "0 1 1"),
        axis("translation3", "<Constant><value>0.07</value></Constant>", along="1 0 0"),
    )
    coordinates = "".join(map(coordinate, "abc"))
    joints = custom(*axes, coordinates=coordinates).replace(
        "</CustomJoint>", f"{FRAMES}</CustomJoint>"
    )
    joints = joints.replace(">/ground</socket_parent_frame", ">F</socket_parent_frame", 1)
    joints = joints.replace(">/bodyset/b</socket_child_frame", ">M</socket_child_frame", 1)
    a, b, c = 0.4, -0.6, 0.05
    data = pose(import_text(tmp_path, model(joints=joints)).xml, a=a, b=b, c=c)
    middle = np.eye(4)
    turns = (0.3 * Y, (0.1 - a) * np.array([0, 2, 1]) / np.sqrt(5), (0.2 - b) * X)
    first, second, third = (Rotation.from_rotvec(t) for t in turns)
    middle[:3, :3] = (first * second * third).as_matrix()
    middle[:3, 3] = (c + 0.1) * np.array([0, 1, 1]) / np.sqrt(2) + 0.07 * X
    outer, inner = transform(F_TURN, F_PLACE), transform(M_TURN, M_PLACE)
    assert_allclose(place(data), outer @ middle @ np.linalg.inv(inner), atol=1e-14)


def test_a_locked_coordinate_is_rigid_at_its_default_and_is_told(tmp_path: Path) -> None:
    locked = "<default_value>0.4</default_value><locked>true</locked>"
    joints = joint("j", "F", "M", coordinate("q", locked), FRAMES)
    made = import_text(tmp_path, model(joints=joints))
    free = import_text(tmp_path, model(joints=joint("j", "F", "M", coordinate("q"), FRAMES)))
    assert_allclose(place(pose(made.xml)), place(pose(free.xml, q=0.4)), atol=1e-15)
    assert mujoco.MjModel.from_xml_string(made.xml).njnt == 0
    (loss,) = made.losses
    assert "rigid at 0.4" in loss.reason


def test_frames_are_found_absolutely_relatively_and_by_name(tmp_path: Path) -> None:
    nested = f"""<components><PhysicalOffsetFrame name="outer"><socket_parent>..</socket_parent>
    <translation>1 0 0</translation><orientation>0 0 1.5707963267948966</orientation><components>
    <PhysicalOffsetFrame name="inner"><socket_parent>..</socket_parent>
    <translation>2 0 0</translation></PhysicalOffsetFrame></components></PhysicalOffsetFrame>
    </components>{PLAIN}"""
    markers = "".join(
        f'<Marker name="m{k}"><socket_parent_frame>{frame}</socket_parent_frame>'
        "<location>0.5 0 0</location></Marker>"
        for k, frame in enumerate(
            ("/bodyset/b/outer/inner", "inner", "../../bodyset/b/outer/inner")
        )
    )
    rest = f'<MarkerSet name="markerset"><objects>{markers}</objects></MarkerSet>'
    made = import_text(tmp_path, model(body("b", nested), rest=rest))
    data = pose(made.xml)
    for k in range(3):
        assert_allclose(data.site(f"m{k}").xpos, [1.0, 2.5, 0.0], atol=1e-15)
    assert made.losses == ()


def test_masses_and_gravity_arrive(tmp_path: Path) -> None:
    inertia = "<mass>2</mass><mass_center>0.1 0.2 0.3</mass_center>"
    inertia += "<inertia>0.03 0.04 0.05 0.001 -0.002 0.003</inertia>"
    slide = joint("j", "/ground", "/bodyset/b", coordinate("q"), kind="SliderJoint")
    text = model(body("b", inertia), slide, rest="<gravity>-3 0 0</gravity>")
    made = mujoco.MjModel.from_xml_string(import_text(tmp_path, text).xml)
    turn = Rotation.from_quat(made.body("b").iquat, scalar_first=True).as_matrix()
    full = turn @ np.diag(made.body("b").inertia) @ turn.T
    told = [[0.03, 0.001, -0.002], [0.001, 0.04, 0.003], [-0.002, 0.003, 0.05]]
    assert_allclose(full, told, atol=1e-15)
    assert_allclose(made.body("b").ipos, [0.1, 0.2, 0.3])
    data = mujoco.MjData(made)
    mujoco.mj_forward(made, data)
    assert_allclose(data.qacc, [-3.0], rtol=1e-12)
    default = mujoco.MjModel.from_xml_string(import_text(tmp_path, model()).xml)
    assert_allclose(default.opt.gravity, [0, -9.80665, 0])


def test_the_keyframe_holds_the_defaults_joint_by_joint_in_a_branching_tree(tmp_path: Path) -> None:
    bodies = "".join(map(body, ("b", "c", "d")))
    values = {"q": 0.1, "r": 0.2, "s": 0.3}
    pairs = (("q", "/bodyset/b", "d"), ("r", "/ground", "c"), ("s", "/ground", "b"))
    joints = "".join(
        joint(
            n,
            above,
            f"/bodyset/{child}",
            coordinate(n, f"<default_value>{values[n]}</default_value>"),
        )
        for n, above, child in pairs
    )
    built = mujoco.MjModel.from_xml_string(import_text(tmp_path, model(bodies, joints)).xml)
    for name, value in values.items():
        assert built.key("default").qpos[built.joint(name).qposadr[0]] == value


def test_an_actuator_pulls_its_tendon_with_its_control_in_newtons(tmp_path: Path) -> None:
    points = point("a", "/ground", "-1 1 0") + point("b", "/bodyset/b", "0 1 0")
    built = mujoco.MjModel.from_xml_string(
        import_text(
            tmp_path, model(forces=muscle("mus", points), rest="<gravity>0 0 0</gravity>")
        ).xml
    )
    data = mujoco.MjData(built)
    data.ctrl[:] = 2.0
    mujoco.mj_forward(built, data)
    assert_allclose(data.ten_length, [1.0])
    assert_allclose(data.qfrc_actuator, [2.0], rtol=1e-12)  # 2 N pull the point at (0, 1) to -x


def test_what_it_writes_can_be_read_again(tmp_path: Path) -> None:
    finger, _ = shipped_models()
    xml, beside, losses = write_import(finger, tmp_path / "finger.xml")
    assert mujoco.MjModel.from_xml_path(str(xml)).nu == len(finger.muscles) == 8
    data = json.loads(beside.read_text())
    assert data["muscles"]["FDP"]["kind"] == "Millard2012EquilibriumMuscle"
    stated = data["muscles"]["FDP"]["properties"]
    assert stated["max_isometric_force"] == 79.12
    assert stated["tendon_slack_length"] == 0.26812
    assert stated["ForceVelocityCurve/max_eccentric_velocity_force_multiplier"] == 1.4
    assert data["muscles"]["LUM"]["properties"]["ignore_tendon_compliance"] is True
    assert data["coordinates"]["PIP"]["default"] == np.radians(45.0)
    assert data["limits"]["PIP_limit"]["upper"] == pytest.approx(np.radians(50.0), rel=1e-15)
    assert len(data["losses"]) == len(finger.losses)
    lines = losses.read_text().splitlines()
    assert len([line for line in lines if "_limit" in line]) == 4
    assert lines[-1].startswith("dropped:")
    assert "only say how things are drawn" in lines[-1]


def test_the_command_prints_what_was_lost(tmp_path: Path) -> None:
    path = tmp_path / "m.osim"
    path.write_text(model(rest='<Credits2 name="x">y</Credits2>'))
    out = tmp_path / "m.xml"
    result = CliRunner().invoke(app, ["import", str(path), "--out", str(out)])
    assert result.exit_code == 0
    assert 'dropped, line 14: Credits2 "x"' in result.output
    assert "1 coordinates and 0 of 0 muscles" in result.output
    assert out.exists()


def test_the_command_refuses_with_code_2_and_writes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "m.osim"
    path.write_text(model(version="10905"))
    result = CliRunner().invoke(app, ["import", str(path), "--out", str(tmp_path / "m.xml")])
    assert result.exit_code == 2
    assert "open it with OpenSim 4 and save it" in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["m.osim"]
