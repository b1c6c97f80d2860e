"""A finger out of the user's MuJoCo model."""

from __future__ import annotations

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cosim.anatomy.case_folder import new_case
from cosim.anatomy.read import UserAnatomy
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fingers.index import IndexFingerConfig
from cosim.fingers.kinds import finger_model, live_finger, skeleton_of
from cosim.models.build import mjcf_of
from cosim.models.fit import check_fit
from cosim.pipeline import run_case
from cosim.results.conventions import vector_of
from cosim.schema.types import TENDONS
from cosim.text_tables import read_toml
from meshes.skeleton import BODIES, JOINTS
from rigid.mjcf.read import read_mjcf
from rigid.mujoco.finger import MujocoFinger
from rigid.opensim.osim import import_osim, write_import
from tests.helpers.folders import CASE_DATA, TEST_DATA

RIGHT = np.eye(3)
LIKE_MYOHAND = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
"""Our x, y, z in frames whose -y is distal and x radial."""


def write_finger(path: Path, turn: np.ndarray = RIGHT, more: str = "", **replaced: str) -> Path:
    """A straight finger of 40, 25 and 20 mm whose frames are ours turned, joints at the origins;
    a flexor and an extensor over a cylinder."""

    def at(*place: float) -> str:
        return " ".join(repr(float(x)) for x in turn @ place)

    text = f"""<mujoco><compiler angle="radian"/><worldbody><body name="hand" pos="0.1 0.2 0.3">
<joint name="wrist"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="metacarpal" pos="0.01 0.02 0.03">
<site name="f0" pos="{at(-0.02, 0.001, -0.008)}"/><site name="e0" pos="{at(-0.02, 0, 0.009)}"/>
<body name="proximal"><joint name="MCP" axis="{at(0, 1, 0)}" range="-0.5 1.5"/>
<joint name="MCP_abduction" axis="{at(0.1, 0, 1)}"/>
<inertial pos="{at(0.02, 0, 0)}" mass="0.02" diaginertia="2e-6 2e-6 2e-6"/>
<geom name="drum" type="cylinder" size="0.005" contype="0" conaffinity="0"
 fromto="{at(0.04, -0.01, 0)} {at(0.04, 0.01, 0)}"/><site name="side" pos="{at(0.04, 0, 0.02)}"/>
<site name="f1" pos="{at(0.01, 0.001, -0.006)}"/><site name="e1" pos="{at(0.02, 0, 0.006)}"/>
<body name="middle" pos="{at(0.04, 0, 0)}"><joint name="PIP" axis="{at(0, 1, 0)}"/>
<inertial pos="{at(0.012, 0, 0)}" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/>
<site name="f2" pos="{at(0.01, 0, -0.005)}"/><site name="e2" pos="{at(0.005, 0, 0.0045)}"/>
<body name="distal" pos="{at(0.025, 0, 0)}"><joint name="DIP" axis="{at(0, 1, 0)}"/>
<inertial pos="{at(0.01, 0, 0)}" mass="0.005" diaginertia="1e-7 1e-7 1e-7"/>
<site name="f3" pos="{at(0.005, 0, -0.003)}"/><site name="tip" pos="{at(0.02, 0, 0)}"/>
</body></body></body></body></body></worldbody><tendon>
<spatial name="FDP"><site site="f0"/><site site="f1"/><site site="f2"/><site site="f3"/></spatial>
<spatial name="EDC"><site site="e0"/><site site="e1"/><geom geom="drum" sidesite="side"/>
<site site="e2"/></spatial>{more}</tendon>
<actuator><muscle name="m" tendon="FDP" force="79"/></actuator></mujoco>"""
    for old, new in replaced.items():
        assert old in text
        text = re.sub(rf'"{old}"', f'"{new}"', text)
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mjcf") / "finger.xml"
    path.write_text(mjcf_of(load_case("split_edc")))
    return path


def test_what_mjcf_writes_is_read_back_as_the_same_finger(exported: Path):
    ours, theirs = (
        load_case("split_edc", s) for s in ([], [f'finger.path="{exported.as_posix()}"'])
    )
    a, b = (live_finger(case.finger, case.hood.left_to_finger) for case in (ours, theirs))
    assert (a.tendons, a.joints, a.ranges) == (b.tendons, b.joints, b.ranges)
    # MuJoCo's own iteration about rings stops at 1e-9 m of length.
    for angles in np.random.default_rng(1).uniform(0, 1, (20, 4)) * [1.2, 0.2, 1.5, 1.0]:
        np.testing.assert_allclose(a.moment_arms(angles), b.moment_arms(angles), atol=1e-8)
        np.testing.assert_allclose(a.chain(angles).tip, b.chain(angles).tip, atol=1e-15)
    assert read_mjcf(exported).losses == (
        "dropped: stiffness of the joints; give finger.passive in the case",
        "dropped: damping, friction or armature of the joints; give finger.passive in the case",
        "dropped: limits of the joints as forces; give finger.limit in the case",
        "dropped: 1 keyframes",
    )
    assert isinstance(ours.finger, IndexFingerConfig)
    assert isinstance(theirs.finger, IndexFingerConfig)
    one, two = skeleton_of(ours.finger), skeleton_of(theirs.finger)
    for part in ("length", "zero", "axis"):
        np.testing.assert_allclose(getattr(one, part), getattr(two, part), atol=1e-15)
    results = [run_case(case).summary for case in (ours, theirs)]
    force = [vector_of(r["fingertip_force_N"]) for r in results]
    np.testing.assert_allclose(force[0], force[1], rtol=1e-8)


def test_a_finger_imported_from_opensim_is_one_for_new_and_runs(tmp_path: Path):
    """Its metacarpal is the ground, its abduction turns before its flexion."""
    written = write_import(import_osim(CASE_DATA / "finger.osim"), tmp_path / "finger.xml")
    made, told = new_case("imported", UserAnatomy(finger=written[0]), tmp_path / "out")
    assert "finger: changed: no body is the metacarpal; the world is" in "\n".join(told)
    case = load_case(made, ['tendons.EDC.tension="3 N"', "output.picture=false"])
    finger = live_finger(case.finger, case.hood.left_to_finger)
    assert finger.joints == ("MCP_abduction", "MCP", "PIP", "DIP")
    known = json.loads((TEST_DATA / "opensim" / "finger_opensim.json").read_text())
    assert tuple(known["coordinates"]) == finger.joints
    columns = [known["paths"].index(name) for name in finger.tendons]
    for angles, arms in zip(known["postures"], known["moment_arms"], strict=True):
        plain = [name for name in finger.tendons if name not in known["wrapped"]]
        rows = [finger.tendons.index(name) for name in plain]
        found = finger.moment_arms(np.array(angles))[rows]
        np.testing.assert_allclose(found, np.array(arms)[columns][rows], atol=1e-8)
        tip = skeleton_of(case.finger).tip(dict(zip(finger.joints, angles, strict=True)))
        np.testing.assert_allclose(finger.chain(np.array(angles)).tip, tip, atol=1e-12)
    result = run_case(case)
    assert result.audit.passed
    assert result.summary["tension_N"]["EDC"] == 3.0


def test_under_a_hood_the_tendons_of_the_hood_are_left_out(exported: Path):
    case = load_case("isometric_edc", [f'finger.path="{exported.as_posix()}"'])
    model = finger_model(case.native_finger(), case.hood.left_to_finger)
    assert model.muscles == ("FDP", "FDS", "FDIm", "FDIl")
    with pytest.raises(InputError, match=r"finger\.bones.*our metacarpal does not fit"):
        check_fit(case)


def test_a_finger_of_a_file_has_its_size_and_its_shares(exported: Path):
    with pytest.raises(InputError, match="length_scale"):
        load_case("split_edc", [f'finger.path="{exported.as_posix()}"', "finger.length_scale=1.1"])
    case = load_case("split_edc", [f'finger.path="{exported.as_posix()}"', "hood.central=0.4"])
    with pytest.raises(InputError, match=r"hood\.central"):
        check_fit(case)


@pytest.mark.parametrize("turn", [RIGHT, LIKE_MYOHAND])
def test_frames_of_any_kind_become_ours(tmp_path: Path, turn: np.ndarray):
    model = read_mjcf(write_finger(tmp_path / "f.xml", turn)).model
    np.testing.assert_allclose(model.tip, [0.02, 0, 0], atol=1e-12)
    place = [segment.position for segment in model.segments]
    np.testing.assert_allclose(
        place, [[0, 0, 0], [0, 0, 0], [0.04, 0, 0], [0.025, 0, 0]], atol=1e-12
    )
    plain = MujocoFinger(read_mjcf(write_finger(tmp_path / "plain.xml")).model)
    angles = np.array([0.5, 0.1, 0.7, 0.4])
    arms = MujocoFinger(model).moment_arms(angles)
    np.testing.assert_allclose(arms, plain.moment_arms(angles), atol=1e-9)
    flexor, extensor = arms[model.muscles.index("FDP")], arms[model.muscles.index("EDC")]
    assert (flexor[[0, 2, 3]] > 1e-3).all()
    assert extensor[0] < -1e-3
    assert extensor[2] == pytest.approx(-5e-3, abs=1e-5)  # over the drum
    assert plain.ranges["MCP"] == (-0.5, 1.5)


def test_losses_and_greatest_forces_are_told(tmp_path: Path):
    more = '<fixed name="sum"><joint joint="PIP" coef="1"/></fixed>'
    more += '<spatial name="other"><site site="f0"/><site site="f3"/></spatial>'
    read = read_mjcf(write_finger(tmp_path / "f.xml", more=more), tendons=("FDP", "EDC"))
    told = "\n".join(read.losses)
    for word in ("1 other joints", "tendon sum", "tendon other", "muscles' curves", "gravity"):
        assert word in told
    assert read.model.muscles == ("FDP", "EDC")
    assert read.max_force == {"FDP": 79.0}
    assert len(read.losses) == len(set(read.losses)) == 6  # the limits of the MCP too


def test_names_are_mapped_and_missing_ones_answered_with_the_nearest(tmp_path: Path):
    path = write_finger(tmp_path / "f.xml", PIP="pm2_flexion", middle="2midph", FDP="FDP2")
    with pytest.raises(InputError, match=r"no body 'middle'.*the nearest names are .*2midph"):
        read_mjcf(path)
    names = {"middle": "2midph", "PIP": "pm2_flexion", "FDP": "FDP2"}
    model = read_mjcf(path, names).model
    assert model.joints == JOINTS
    assert model.muscles == ("FDP", "EDC")


def test_joints_that_turn_the_other_way_are_told_and_can_be_turned(tmp_path: Path):
    text = write_finger(tmp_path / "f.xml").read_text()
    path = tmp_path / "pip.xml"
    path.write_text(text.replace('name="PIP" axis="0.0 1.0 0.0"', 'name="PIP" axis="0 -1 0"'))
    with pytest.raises(InputError, match=r"opposite senses.*--set-name PIP=-PIP"):
        read_mjcf(path)
    angles = np.array([0.5, 0.1, 0.7, 0.4])
    arms = [
        MujocoFinger(read_mjcf(p, n).model).moment_arms(angles)
        for p, n in ((tmp_path / "f.xml", {}), (path, {"PIP": "-PIP"}))
    ]
    np.testing.assert_allclose(*arms, atol=1e-12)
    with pytest.raises(InputError, match=r"ulnar side.*left hand"):
        read_mjcf(tmp_path / "f.xml", {"MCP_abduction": "-MCP_abduction"})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("", "is no MuJoCo model"), ("<mujoco>", "is no MuJoCo model"), ("<mujoco/>", "has no body")],
)
def test_a_bad_file_is_one_clear_fault(tmp_path: Path, text: str, complaint: str):
    path = tmp_path / "f.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        read_mjcf(path)
    assert "\n" not in str(caught.value)


def test_a_joint_on_the_wrong_body_is_refused(tmp_path: Path):
    path = write_finger(tmp_path / "f.xml", PIP="x", DIP="PIP")
    path.write_text(path.read_text().replace('"x"', '"DIP"'))
    with pytest.raises(InputError, match=r"joint 'PIP' \(PIP\) turns the body 'distal'"):
        read_mjcf(path)


def test_the_first_of_several_names_that_is_there_is_taken(tmp_path: Path):
    path = write_finger(tmp_path / "finger.xml")
    path.write_text(path.read_text().replace('name="tip"', 'name="end"'))
    names = {"tip": "IFtip|end", "MCP": "none|MCP", "FDP": "FDP2_tendon|FDP"}
    assert read_mjcf(path, names).model == read_mjcf(path, {"tip": "end"}).model
    with pytest.raises(InputError, match="has no site 'IFtip'"):
        read_mjcf(path, {"tip": "IFtip|other"})


def test_the_packaged_names_are_parts_that_a_finger_has():
    named = read_toml(CASE_DATA / "names_myohand.toml")
    assert set(named) >= {*BODIES, *JOINTS, "tip", "EDC", "FDP"}
    assert set(named) <= {*BODIES, *JOINTS, "tip", *TENDONS}
    assert all(re.fullmatch(r"[\w|-]+", theirs) for theirs in named.values())


def test_tendons_left_out_for_one_reason_are_one_line(tmp_path: Path):
    more = "".join(
        f'<spatial name="{name}"><site site="f0"/><site site="e0"/></spatial>'
        for name in ("A", "B")
    )
    losses = read_mjcf(write_finger(tmp_path / "finger.xml", more=more)).losses
    assert "dropped: tendons A, B: it pulls on no phalanx" in losses


def test_a_body_between_the_hinges_of_the_mcp_is_left_out_and_told(tmp_path: Path):
    """The same finger with both hinges, the abduction's first, on the proximal phalanx."""
    text = write_finger(tmp_path / "plain.xml").read_text()
    flexion = '<joint name="MCP" axis="0.0 1.0 0.0" range="-0.5 1.5"/>\n'
    abduction = '<joint name="MCP_abduction" axis="0.1 0.0 1.0"/>\n'
    assert '<body name="proximal">' + flexion + abduction in text
    rest = text.replace(flexion + abduction, "")
    plain = tmp_path / "ordered.xml"
    plain.write_text(rest.replace('"proximal">', f'"proximal">{abduction}{flexion}'))
    inertial = '<inertial pos="0 0 0" mass="0.001" diaginertia="1e-8 1e-8 1e-8"/>'
    knuckle = f'<body name="knuckle">{abduction}{inertial}<body name="proximal">{flexion}'
    with_knuckle = tmp_path / "knuckle.xml"
    with_knuckle.write_text(
        rest.replace('<body name="proximal">', knuckle).replace(
            "</worldbody>", "</body></worldbody>"
        )
    )
    one, other = read_mjcf(plain), read_mjcf(with_knuckle)
    assert other.model.segments == one.model.segments
    assert other.model.muscles == one.model.muscles
    (told,) = set(other.losses) - set(one.losses)
    assert told.endswith("the body 'knuckle' between the MCP's hinges is left out, with its 1 g")


def test_a_muscle_that_states_no_force_has_mujocos_own(tmp_path: Path):
    text = write_finger(tmp_path / "f.xml").read_text().replace('force="79"', 'scale="50"')
    (tmp_path / "auto.xml").write_text(text)
    m = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(m)
    data.qpos[:], data.act[0] = m.qpos0, 1.0
    mujoco.mj_forward(m, data)
    at_rest = mujoco.mju_muscleGain(
        m.actuator_length0[0], 0.0, m.actuator_lengthrange[0], m.actuator_acc0[0],
        m.actuator_gainprm[0, :9],
    )  # fmt: skip
    curve = mujoco.mju_muscleGain(
        m.actuator_length0[0], 0.0, m.actuator_lengthrange[0], m.actuator_acc0[0],
        np.array([*m.actuator_gainprm[0, :2], 1.0, *m.actuator_gainprm[0, 3:9]]),
    )  # fmt: skip
    found = read_mjcf(tmp_path / "auto.xml").max_force["FDP"]
    assert found * curve == pytest.approx(at_rest, rel=1e-9)
