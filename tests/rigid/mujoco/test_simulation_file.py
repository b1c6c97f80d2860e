"""`cosim export`: the finger stands in plain MuJoCo where ours does, and looks like ours."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.coupling.finger_equilibrium import balance_finger
from cosim.models.build import OPENING, bone_surfaces, build, mjcf_of
from cosim.port import Array, Load
from rigid.chain.joint_torques import JointLaw, TorqueCurve, joint_law
from rigid.mjcf.simulation import ANATOMY, CELL, coarse_surface, simulation_xml
from rigid.model import FingerModel, Hinge, Segment

FREE = 'finger.tip={kind="free"}'
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
CASES: dict[str, tuple[str, ...]] = {
    "split_edc": (),
    "free_split_edc": (),
    "planar_edc": (),
    "robot_pulleys_extensor": ('hood={kind="split"}', "tendons={}"),
    "middle_minorflex_edc": (
        'solve.resting_tension="0.05 N"',
        'finger.limit={half_range="5 deg",stiffness="20 N*m/deg",transition="5 deg"}',
        *(f'finger.passive.{j}={{stiffness="0.03 N*m/rad",rest="posture"}}' for j in JOINTS),
    ),
}


def our_angles(case: Case) -> Array:
    """The free finger's equilibrium at the resting tensions, rad, under no hood."""
    finger = build(case).finger
    state, n = finger.start(case.native_finger().posture.angles()), len(finger.bodies)
    load = Load(finger.bodies, ("hood",), np.zeros((n, 1, 6)), np.zeros((0, 6)))
    pulls = np.full(len(finger.tendons), case.solve.resting_tension)
    for _ in range(20):
        state, _ = balance_finger(finger, state, load, pulls, np.zeros((6 * n, 6 * n)), 1e-7)
    return finger.angles(state)


def simulated(xml: str, seconds: float = 4.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("posture").id)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return model, data


@pytest.mark.parametrize("name", CASES)
def test_the_file_s_finger_stands_for_four_seconds_where_ours_does(name):
    case = load_case(name, [FREE, *CASES[name]])
    model, data = simulated(mjcf_of(case))
    joints = [model.joint(i).name for i in range(model.njnt)]
    posture = case.native_finger().posture.angles()
    assert model.key("posture").qpos == pytest.approx([posture[joint] for joint in joints])
    assert data.ctrl == pytest.approx(np.full(model.nu, case.solve.resting_tension))
    assert np.abs(data.qvel).max() < 1e-6
    off = np.degrees(np.abs(data.qpos - our_angles(case)))
    assert off.max() < 0.5, dict(zip(joints, off, strict=True))


def test_the_bones_look_like_ours():
    case = load_case("split_edc")
    xml = mjcf_of(case)
    assert len(xml) < 200_000
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body, (ours, _) in bone_surfaces(case).items():
        geom = model.geom(body)
        at, size = (x[geom.dataid[0]] for x in (model.mesh_vertadr, model.mesh_vertnum))
        turn, bone = data.geom_xmat[geom.id].reshape(3, 3), data.body(body)
        world = model.mesh_vert[at : at + size] @ turn.T + data.geom_xpos[geom.id]
        theirs = (world - bone.xpos) @ bone.xmat.reshape(3, 3)
        assert theirs.min(axis=0) == pytest.approx(ours.min(axis=0), abs=CELL)
        assert theirs.max(axis=0) == pytest.approx(ours.max(axis=0), abs=CELL)
        assert (geom.contype[0], geom.conaffinity[0]) == (0, 0)


def test_a_narrow_limit_is_told_first_with_what_opens_it():
    case = load_case("split_edc")
    first = mjcf_of(case).splitlines()[1]
    assert "5 deg to either side of the posture" in first
    assert f"the setting {OPENING} opens them" in first
    opened = mjcf_of(load_case("split_edc", [OPENING]))
    assert "to either side" not in opened
    model = mujoco.MjModel.from_xml_string(opened)
    for joint in ("MCP", "MCP_abduction", "PIP", "DIP"):
        low, high = model.numeric(ANATOMY + joint).data
        at, stop = model.joint(joint).range
        assert at <= low < high <= stop


def test_a_coarse_surface_stays_closed_in_size():
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.01)
    vertices, faces = coarse_surface((sphere.vertices, sphere.faces))
    assert len(vertices) < len(sphere.vertices) / 10
    assert trimesh.Trimesh(vertices, faces).is_watertight
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.01, abs=CELL / 2)


def hinge_file(law: JointLaw, angle: float) -> str:
    """The file of a bar of 40 mm on one joint J, in a posture of `angle` rad."""
    bar = Segment(
        "bar", 0.04, hinges=(Hinge("J", (0.0, 1.0, 0.0)),), mass=0.01, inertia=(1e-6,) * 3
    )
    finger = FingerModel("one", (Segment("ground", 0.02), bar), (0.04, 0.0, 0.0))
    return simulation_xml(finger, law, {"J": angle}, {})


def passive_torque(law: JointLaw, angle: float) -> float:
    """N m in MuJoCo at `angle` rad."""
    model = mujoco.MjModel.from_xml_string(hinge_file(law, angle))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return float(data.qfrc_passive[0])


@pytest.mark.parametrize("angle", np.radians([-20.0, 0.0, 10.0, 40.0]))
def test_springs_are_exact_and_curves_nearly(angle):
    spring = joint_law(("J",), stiffness={"J": 0.03}, rest={"J": 0.2})
    assert passive_torque(spring, angle) == pytest.approx(spring.passive(np.array([angle]))[0][0])
    points = np.radians([-40.0, -20.0, 0.0, 20.0, 40.0])
    curve = TorqueCurve(tuple(points), tuple(-0.03 * points - 0.01 * points**3))
    curved = joint_law(("J",), curves={"J": curve})
    assert passive_torque(curved, angle) == pytest.approx(curve(angle)[0], abs=2e-4)


def test_a_limit_holds_where_the_spring_s_rest_lies_beyond_it():
    law = joint_law(("J",), stiffness={"J": 0.03}, rest={"J": 0.0}).hold_about({"J": 0.5}, 0.1)
    model, data = simulated(hinge_file(law, 0.5), 2.0)
    assert model.jnt_range[0] == pytest.approx([0.4, 0.6], abs=np.radians(0.6))
    assert data.qpos[0] == pytest.approx(0.4, abs=np.radians(0.5))
