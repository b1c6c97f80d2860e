"""The index finger on MuJoCo: frames, tendons, masses and its XML."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from fingers import POSTURE, cables_over_all_joints, mujoco_finger, pushed, solve, straight_skeleton

from cosim.port import Array, InputError, Motion
from meshes.skeleton import BODIES, JOINTS, index_finger
from rigid.index_finger import finger_model
from rigid.joint_torques import joint_law
from rigid.mjcf import mjcf_xml
from rigid.mujoco_finger import MujocoFinger
from rigid.support import FREE, HELD


def test_mujoco_has_the_skeletons_frames() -> None:
    finger = MujocoFinger(finger_model(index_finger()))
    posture = {**POSTURE, "MCP_abduction": 0.2}
    state, pose = finger.start(posture), index_finger().pose(posture)
    motion: Motion = finger.motion(state)
    assert motion.bodies == BODIES
    assert motion.position == pytest.approx(pose[0], abs=1e-15)
    assert motion.rotation == pytest.approx(pose[1], abs=1e-14)
    assert state.target == pytest.approx(index_finger().tip(posture), abs=1e-15)


def test_mujocos_own_routines_agree() -> None:
    """mj_jacBody, mj_applyFT at the bodies' origins and the bias force of a body at rest."""
    finger = mujoco_finger(HELD)
    state, load, tension = pushed(finger)
    model, data = finger.model, mujoco.MjData(finger.model)
    data.qpos[:] = state.angles
    mujoco.mj_forward(model, data)
    force, jac = np.zeros(4), np.zeros((4, 6, 4))
    for b, wrench in enumerate(load.total()):
        body = model.body(BODIES[b]).id
        mujoco.mj_jacBody(model, data, jac[b, :3], jac[b, 3:], body)
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xpos[body], body, force)
    torque = finger.balance(state, load, tension).torque
    assert finger.jacobian(state) == pytest.approx(jac.reshape(24, 4), abs=1e-15)
    assert torque["hood"] == pytest.approx(force, rel=1e-12)
    assert torque["gravity"] == pytest.approx(-data.qfrc_bias, rel=1e-12)


# mm at 0, 15, 30, 45 deg of the joint: straight-line moment arms of the normative paths at
# O2O3 = 20 mm, computed from the table without this code.
ARMS = {
    ("FDP", "DIP"): (4.2, 4.8, 5.2, 5.6),
    ("FDP", "PIP"): (7.2, 8.4, 9.3, 10.1),
    ("FDS", "PIP"): (5.7, 6.8, 7.8, 8.7),
    ("FDP", "MCP"): (9.6, 10.7, 11.7, 12.5),
    ("FDS", "MCP"): (10.8, 11.9, 12.8, 13.6),
    ("FDI", "MCP"): (3.6, 5.0, 6.3, 7.4),
}


def arms(finger: MujocoFinger, muscle: str, joint: str) -> Array:
    """(4,) mm at 0, 15, 30, 45 deg of that joint, the others straight."""
    j, t = JOINTS.index(joint), finger.tendons.index(muscle)
    postures = np.radians([0, 15, 30, 45])[:, None] * np.eye(4)[j]
    return np.array([1e3 * finger.moment_arms(q)[t, j] for q in postures])


@pytest.mark.parametrize(("muscle", "joint"), ARMS)
def test_moment_arms(muscle: str, joint: str) -> None:
    """On straight axes as listed; the real, oblique ones change them by 0.41 mm at most."""
    straight, real = (
        MujocoFinger(finger_model(straight_skeleton())),
        MujocoFinger(finger_model(index_finger())),
    )
    assert arms(straight, muscle, joint) == pytest.approx(ARMS[muscle, joint], abs=0.06)
    assert arms(real, muscle, joint) == pytest.approx(ARMS[muscle, joint], abs=0.45)


def test_abduction_arms() -> None:
    finger = MujocoFinger(finger_model(straight_skeleton()))
    assert arms(finger, "FDI", "MCP_abduction")[0] == pytest.approx(8.8, abs=0.06)
    assert arms(finger, "FDS", "MCP_abduction")[0] == pytest.approx(-1.9, abs=0.06)


def test_tendon_paths_end_on_the_right_bones() -> None:
    finger = MujocoFinger(finger_model(index_finger()))
    paths = finger.tendon_paths(finger.start(POSTURE))
    assert {name: len(p) for name, p in paths.items()} == {"FDP": 7, "FDS": 5, "FDI": 3}
    assert (paths["FDP"][:, 2] < 0).all()  # palmar
    for path in paths.values():  # the muscles pull parallel to the metacarpal
        assert path[1] - path[0] == pytest.approx([0.040, 0.0, 0.0])
    lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in paths.values()]
    data = mujoco.MjData(finger.model)
    data.qpos[:] = finger.start(POSTURE).angles
    mujoco.mj_forward(finger.model, data)
    assert lengths == pytest.approx(data.ten_length)


def test_segments_weigh_what_was_measured_with_their_centres_at_mid_length() -> None:
    finger = MujocoFinger(finger_model(index_finger()))
    for body, mass, length in zip(
        BODIES[1:], (15.5, 6.79, 3.91), index_finger().length[1:], strict=True
    ):
        segment = finger.model.body(body)
        assert 1e3 * segment.mass == pytest.approx([mass])
        assert segment.ipos == pytest.approx([length / 2, 0.0, 0.0])
    assert 1e7 * finger.model.body("distal").inertia == pytest.approx([1.04, 1.90, 1.70])


def test_the_xml_opens_with_bones_and_without() -> None:
    vertices = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    xml = mjcf_xml(
        finger_model(index_finger(), bones={"middle": (vertices, faces)}), gravity=(0, 0, -9.81)
    )
    model = mujoco.MjModel.from_xml_string(xml)
    assert model.nmesh == 1
    assert model.opt.gravity[2] == -9.81
    assert model.body("middle").mass == pytest.approx([0.00679])
    assert not model.jnt_limited.any()
    assert not model.dof_damping.any()
    with pytest.raises(InputError, match="meshes: unknown name thumb"):
        finger_model(index_finger(), bones={"thumb": (vertices, faces)})


def test_an_angle_outside_its_range_is_refused() -> None:
    with pytest.raises(InputError, match="PIP at 120 deg lies outside its range of 0 to 110 deg"):
        MujocoFinger(finger_model(index_finger())).start({"PIP": np.radians(120)})


def test_limits_hold_the_posture() -> None:
    """Limits at +-5 deg as in the thesis: the flexors at 10 % of their maximal force (its table 2:
    79.1, 58.9 and 145.6 N) press every flexion axis less than 1 deg beyond its upper limit."""
    posture = {**POSTURE, "MCP_abduction": 0.0}
    finger = MujocoFinger(
        finger_model(index_finger()), law=joint_law(JOINTS).held_about(posture), support=FREE
    )
    beyond = {joint: angle + np.radians(6.0) for joint, angle in posture.items()}
    tension = 0.1 * np.array([79.12, 58.9, 145.6])
    state, _, balance = solve(finger, cables_over_all_joints(), np.zeros(1), tension, beyond)
    excess = np.degrees(state.angles) - [35, 5, 50, 20]
    assert (excess > 0).all()
    assert (excess < 1).all()
    u = excess / 5
    expected = -20 * (10 * u**3 - 15 * u**4 + 6 * u**5) * excess  # N m/deg
    assert balance.torque["limit"] == pytest.approx(expected, rel=1e-9)
