"""A hood on a finger of somebody's hand: what the hand's file says elsewhere changes nothing of it,
names that cannot be right are refused, and what is told is of the file that was written."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.mjcf_hood import HoodFile, attach, hood_file, judge_attached
from cosim.case.file import load_case
from cosim.cli import app
from cosim.scoring.names import match_names
from meshes.skeleton import index_finger
from rigid.fingers.index import finger_model
from rigid.mjcf.attach import Attached, hand_arms, state_defaults, write_attached
from rigid.mjcf.hood import FOLLOWER, compile_model
from rigid.mjcf.read import part_names
from rigid.mjcf.write import mjcf_xml

KINDS = ("joint", "geom", "site", "tendon", "equality", "general")
"""What an attached hood, or the hand's muscles, are made of."""
HOSTILE = ("0.37", "true", "0.2 0.4", "3", "0.9 0.95 0.1 0.5 2", "0.3 0.4 0.5", "user", "fixed")
"""Values that some attribute may have."""
SHAPES = {"type", "fromto", "quat", "axisangle", "euler", "xyaxes", "zaxis", "mesh", "axis"}
"""Attributes that make another finger."""
IDLE = {"cranklength"}
"""Of no actuator that pulls a tendon."""


@cache
def made() -> HoodFile:
    return hood_file(load_case("network_edc"), "network", states=0)


def a_hand(folder: Path, change: tuple[str, str] = ("", "")) -> Path:
    """The index finger with an extensor in fixed shares."""
    text = mjcf_xml(finger_model(index_finger(), central=0.5))
    assert change[0] in text
    path = folder / "hand.xml"
    path.write_text(text.replace(*change), encoding="utf-8")
    return path


def attached(hand: Path) -> Attached:
    names = match_names(part_names(hand), "index").names
    return attach(load_case("network_edc"), "index", hand, names, made())


def differences(a: mujoco.MjModel, b: mujoco.MjModel) -> list[str]:
    """The arrays of two models that differ by more than 1e-9."""
    out = []
    for name in dir(a):
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, np.ndarray) and name != "paths":
            numbers = x.dtype.kind == "f" and x.shape == y.shape
            same = np.allclose(x, y, rtol=1e-9, atol=1e-9) if numbers else np.array_equal(x, y)
            out += [] if same else [name]
    return out


def default_attributes() -> Iterator[tuple[str, str]]:
    """What a class of defaults may say of KINDS, by MuJoCo's own list."""
    schema = mujoco.mj_printSchema(False, False)
    of_default = schema[schema.index("\n   default (R)") :]
    for kind in KINDS:
        found = re.search(rf"\n      {kind} \(\?\)((?:\s+\w+)+?)\s+\w+ \(", of_default)
        assert found is not None
        yield from ((kind, name) for name in found[1].split() if name not in SHAPES | IDLE)


def with_hostile_defaults(text: str) -> tuple[str, set[tuple[str, str]]]:
    """A hand's text with a class of defaults that says what no hood means of every attribute that
    MuJoCo lets it; which these are."""
    facts: dict[str, dict[str, str]] = {}

    def written() -> str:
        default = "".join(str(ET.tostring(ET.Element(k, f), "unicode")) for k, f in facts.items())
        return text.replace("<worldbody>", f"<default>{default}</default><worldbody>")

    for kind, name in default_attributes():
        for value in HOSTILE:
            facts.setdefault(kind, {})[name] = value
            try:
                mujoco.MjModel.from_xml_string(written())
                break
            except ValueError:
                del facts[kind][name]
    return written(), {(kind, name) for kind, said in facts.items() for name in said}


def test_a_hands_defaults_change_nothing_that_is_attached(tmp_path):
    """Two hands that are the same to MuJoCo, one of which says by defaults what the other says of
    each part, are the same with a hood."""
    hand = a_hand(tmp_path)
    text, said = with_hostile_defaults(hand.read_text(encoding="utf-8"))
    wanted = {("joint", "armature"), ("joint", "margin"), ("joint", "ref"), ("joint", "stiffness")}
    wanted |= {("tendon", "margin"), ("tendon", "solreflimit"), ("equality", "solref")}
    assert wanted <= said
    assert len(said) > 60
    spec = mujoco.MjSpec.from_string(text)
    spec.compile()
    root = ET.fromstring(spec.to_xml())  # MuJoCo's writer rounds to six digits
    hand.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    assert root.find("default") is not None
    state_defaults(root)
    assert root.find("default") is None
    plain = tmp_path / "plain.xml"
    plain.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    assert differences(mujoco.MjModel.from_xml_path(str(hand)), compile_model(root)) == []
    a, b = (compile_model(attached(path).root) for path in (hand, plain))
    assert differences(a, b) == []


def pulled_alone(hand: Path, muscle: str, joint: str, bend: float) -> float:
    """The torque (N m) of 1 N of a muscle about a joint at an angle of the MCP, by the inertia of a
    hand's joints (rad/s2 at the first moment, at 1e4 kg m2) once its slides are at rest."""
    model = mujoco.MjModel.from_xml_path(str(hand))
    data, dof = mujoco.MjData(model), model.joint(joint).dofadr[0]
    fixed = [model.joint(j).dofadr[0] for j in ("MCP", "MCP_abduction", "PIP", "DIP")]
    model.dof_armature[fixed] = 1e4
    data.joint("MCP").qpos[0] = bend
    data.joint("index_hood_PIP_square").qpos[0] = 0.0
    data.actuator(muscle).ctrl[0] = 1.0
    for _ in range(1500):
        mujoco.mj_step(model, data)
        data.qvel[fixed] = 0.0
    mujoco.mj_forward(model, data)
    return float((data.qfrc_actuator + data.qfrc_constraint)[dof])


def test_muscles_keep_their_arms_in_abduction_in_size_and_sign(tmp_path):
    """A hood without arms in abduction has the mean of those of the paths that it takes away."""
    hand, out = a_hand(tmp_path), tmp_path / "out.xml"
    done = attached(hand)
    out.write_text(write_attached(done.root, out), encoding="utf-8")
    joints = {joint: joint for joint in ("MCP", "MCP_abduction", "PIP", "DIP")}
    old, muscles = mujoco.MjModel.from_xml_path(str(hand)), {m: m for m in ("LUM", "FPI")}
    for muscle, sign in (("LUM", 1.0), ("FPI", -1.0)):
        paths = [
            hand_arms(old, joints, muscles, {"MCP": float(bend)}, "MCP_abduction")[muscle]
            for bend in np.radians(np.linspace(0, 90, 7))
        ]
        for bend in (0.0, 1.2):
            arm = pulled_alone(out, muscle, "MCP_abduction", bend)
            assert sign * arm > 4e-3
            assert arm == pytest.approx(np.mean(paths), rel=1e-5)
    assert any("kept: the actuators EDC, LUM, FPI with their names" in line for line in done.told)
    words = next(line for line in done.told if "abduction" in line)
    assert "LUM +6" in words
    assert "FPI -8" in words


def test_the_table_judges_the_file_that_was_written(tmp_path):
    """A hood's part that is another in the file is off by as much in the table, and the arms say
    which muscle's and to which side."""
    hand, out, case = a_hand(tmp_path), tmp_path / "out.xml", load_case("network_edc")
    done = attached(hand)
    out.write_text(write_attached(done.root, out), encoding="utf-8")
    errors, arms = judge_attached(case, "network", hand, out, done)
    assert {e.quantity for e in errors} >= {"joint torques", "slip forces"}
    assert max(e.most for e in errors) < 1e-3
    by = {(a.muscle, a.joint): a for a in arms}
    assert by["LUM", "MCP"].path == pytest.approx(8.8e-3, abs=1e-4)
    assert by["LUM", "MCP"].hood == pytest.approx(11.5e-3, abs=1e-4)
    assert by["FPI", "MCP_abduction"].hood < -8e-3
    for band in done.root.iter("fixed"):
        joint = next((tag for tag in band if tag.get("joint") == "PIP"), None)
        if joint is not None and "edc" in band.attrib["name"]:
            joint.set("coef", repr(1.5 * float(joint.attrib["coef"])))
    out.write_text(write_attached(done.root, out), encoding="utf-8")
    errors, again = judge_attached(case, "network", hand, out, done)
    assert {e.quantity: e.most for e in errors}["joint torques"] > 0.1
    changed = {(a.muscle, a.joint): a.hood / by[a.muscle, a.joint].hood for a in again}
    assert changed["EDC", "PIP"] > 1.4
    assert changed["LUM", "PIP"] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"MCP": "PIP", "PIP": "MCP"}, "PIP (MCP) does not lie beyond MCP (PIP)"),
        ({"PIP": "DIP", "DIP": "PIP"}, "DIP (PIP) does not lie beyond PIP (DIP)"),
        ({"PIP": "-PIP"}, "PIP (PIP) turns the other way than MCP (MCP)"),
        ({"MCP": "MCP_abduction", "MCP_abduction": "MCP"}, "turns across MCP (MCP_abduction)"),
        ({"metacarpal": "middle"}, "MCP (MCP) does not lie beyond metacarpal (middle)"),
        ({"proximal": "distal"}, "PIP (PIP) does not lie beyond proximal (distal)"),
        ({"EDC": "FDP"}, "EDC flexes the MCP (arm +"),
        ({"LUM": "FDP", "FDP": "LUM"}, "LUM flexes the PIP (arm +"),
        ({"EDC": "EI", "EI": "EI"}, 'EDC and EI are both given as "EI"'),
        ({"DIP": "PIP", "PIP": "PIP"}, 'PIP and DIP are both given as "PIP"'),
    ],
)
def test_names_that_cannot_be_right_are_refused(tmp_path, names, said):
    hand, file, out = a_hand(tmp_path), tmp_path / "names.toml", tmp_path / "out.xml"
    lines = (f'{ours} = "{theirs}"\n' for ours, theirs in names.items())
    file.write_text("".join(lines), encoding="utf-8")
    words = ["export", "--attach", str(hand), "--names", str(file), "-o", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.output.split())
    assert not out.exists()


def test_a_name_that_is_no_xml_is_refused(tmp_path):
    text = '<custom><text name="q" data="&#27;[31m"/></custom></mujoco>'
    hand = a_hand(tmp_path, ("</mujoco>", text))
    done = CliRunner().invoke(app, ["export", "--attach", str(hand), "-o", str(tmp_path / "o.xml")])
    assert done.exit_code == 2
    assert "control character" in " ".join(done.output.split())


def test_the_range_of_a_muscles_length_goes_with_its_tendon(tmp_path):
    """A muscle is as long in its range with the hood as without."""
    muscle = '<general name="EDC" tendon="EDC" lengthrange="0.05 0.3" gainprm="-1"'
    hand = a_hand(tmp_path, ('<general name="EDC" tendon="EDC" gainprm="-1"', muscle))
    before, after = mujoco.MjModel.from_xml_path(str(hand)), compile_model(attached(hand).root)
    away = []
    for model in (before, after):
        data = mujoco.MjData(model)
        if model is after:  # the junction where the hood is about to bear
            model.opt.timestep = 0.002
        mujoco.mj_forward(model, data)
        length = data.tendon("EDC").length[0]
        away.append(model.actuator("EDC").lengthrange - length)
    assert abs(after.actuator("EDC").lengthrange[0] - 0.05) > 0.01
    assert away[1] == pytest.approx(away[0], abs=2e-4)


def test_a_keyframe_in_motion_keeps_its_posture(tmp_path):
    """With as many positions as the model has with the hood, at rest."""
    key = '<keyframe><key name="bent" qpos="0.3 0 0.5 0.2" qvel="1 0 2 0"/></keyframe></mujoco>'
    model = compile_model(attached(a_hand(tmp_path, ("</mujoco>", key))).root)
    found = {j: model.key_qpos[0, model.joint(j).qposadr[0]] for j in ("MCP", "PIP", "DIP")}
    assert found == pytest.approx({"MCP": 0.3, "PIP": 0.5, "DIP": 0.2})
    assert model.nv > 4
    assert not model.key_qvel.any()


@pytest.mark.parametrize("least", [0.0, 1e-4])
def test_a_follower_resists_no_more_where_no_body_may_be_light(tmp_path, least):
    """A hand whose bodies weigh at least so much: the follower y = c x^2 of mass m adds m (2 c x)^2
    to its joint's inertia, and c goes with the root of the mass."""
    hand = a_hand(tmp_path, ("<compiler", f'<compiler boundmass="{least}"'))
    model = compile_model(attached(hand).root)
    mass = float(model.body("index_hood_PIP_square").mass[0])
    assert mass == max(least, FOLLOWER)
    slide = model.joint("index_hood_PIP_square").id
    c = next(model.eq_data[e][2] for e in range(model.neq) if model.eq_obj1id[e] == slide)
    assert mass * c**2 == pytest.approx(FOLLOWER, rel=1e-9)
    out = tmp_path / "out.xml"
    out.write_text(write_attached(attached(hand).root, out), encoding="utf-8")
    assert pulled_alone(out, "EDC", "PIP", 0.3) == pytest.approx(-5e-3, rel=1e-5)


def test_tendons_are_as_long_where_no_body_may_be_light(tmp_path):
    """Bent, with each follower where its equality has it: one that moves less weighs more."""
    lengths = []
    for least in (0.0, 1e-4):
        change = ("<compiler", f'<compiler boundmass="{least}"')
        model = compile_model(attached(a_hand(tmp_path, change)).root)
        data = mujoco.MjData(model)
        for joint, angle in {"MCP": 0.5, "PIP": 0.9, "DIP": 0.4}.items():
            data.joint(joint).qpos[0] = angle
        for e in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
            one, two = model.jnt_qposadr[[model.eq_obj1id[e], model.eq_obj2id[e]]]
            data.qpos[one] = np.polynomial.polynomial.polyval(data.qpos[two], model.eq_data[e, :5])
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
    np.testing.assert_allclose(*lengths, rtol=0, atol=1e-12)


def test_a_joint_that_turns_the_other_way_and_a_muscle_that_lacks_change_no_arm(tmp_path):
    """The table and the arms of a hand whose PIP turns the other way, and without a lumbrical."""
    root = ET.fromstring(a_hand(tmp_path).read_text(encoding="utf-8"))
    joint = next(tag for tag in root.iter("joint") if tag.get("name") == "PIP")
    axis, (low, high) = joint.attrib["axis"].split(), joint.attrib["range"].split()
    joint.set("axis", " ".join(repr(-float(x)) for x in axis))
    joint.set("range", f"{-float(high)!r} {-float(low)!r}")
    for tag in [*root.iter("spatial"), *root.iter("general")]:
        for name in ("name", "tendon"):
            if tag.get(name) == "LUM":
                tag.set(name, "another")
    hand, out = tmp_path / "other.xml", tmp_path / "out.xml"
    hand.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    done = attached(hand)
    assert done.target.joints["PIP"] == "-PIP"
    out.write_text(write_attached(done.root, out), encoding="utf-8")
    errors, arms = judge_attached(load_case("network_edc"), "network", hand, out, done)
    assert max(e.most for e in errors) < 1e-3
    by = {(a.muscle, a.joint): a for a in arms}
    assert {a.muscle for a in arms} == {"EDC", "FPI"}
    assert by["EDC", "PIP"].path == pytest.approx(-2.9e-3, abs=1e-4)
    assert by["EDC", "PIP"].hood == pytest.approx(-3.1e-3, abs=1e-4)
    assert any("left out: the hood's LUM" in line for line in done.told)
    assert any("kept: " in line and "another" in line for line in done.told)
    assert not any("kept: FD" in line for line in done.told)  # flexors, whichever way PIP turns
