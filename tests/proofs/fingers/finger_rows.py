"""The fingers against closed forms and against cadaver data."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from cosim.port import Array
from meshes.skeleton import index_finger
from rigid.chain.joint_torques import JointLaw, joint_law
from rigid.chain.planar_chain import BUCHNER
from rigid.chain.support import CLAMPED, FREE
from rigid.fingers.index import finger_model as index_model
from rigid.fingers.middle import MIDDLE
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel
from rigid.mujoco.finger import MujocoFinger
from tests.helpers.fingers import at_rest
from tests.helpers.rows import Row

APPENDIX = "Buchner, Hines and Hemami 1988, J Biomech 21, equation 7, appendix and table 2"
SYNEK = "Synek et al. 2019, PeerJ 7:e7470, raw data: mean and SD of three specimens"
SUCCESSOR = "Jadelis et al. 2023, J Biomech 157:111725, abstract: within 0.60 N and 30 deg"
NIMBARTE = "Nimbarte, Kaz and Li 2008, J Orthop Surg Res 3, abstract; no spread given: 10 deg"

# Posture (deg), muscle, tension N, then mean and SD of the fingertip's force on the world in the
# distal phalanx's frame, N: proximal, dorsal, radial.
SINGLE_TENDON = (
    ((40, 55, 35), "FDP", 7.782, (-0.456, -1.926, -0.431), (0.164, 0.136, 0.608)),
    ((40, 55, 35), "FDS", 7.782, (-1.225, -1.394, -0.382), (0.052, 0.279, 0.491)),
    ((40, 55, 35), "EDC", 3.277, (0.421, -0.247, -0.017), (0.052, 0.281, 0.030)),
    ((40, 55, 35), "LUM", 0.369, (-0.031, 0.032, 0.036), (0.022, 0.112, 0.012)),
    ((40, 55, 35), "RI", 5.324, (-0.636, 0.286, 0.276), (0.287, 0.158, 0.388)),
    ((40, 55, 35), "UI", 4.096, (-0.893, 0.408, -0.456), (0.411, 0.461, 0.108)),
    ((55, 57, 25), "FDP", 7.782, (-0.324, -1.742, -0.475), (0.092, 0.261, 0.767)),
    ((55, 57, 25), "FDS", 7.782, (-1.153, -1.273, -0.363), (0.219, 0.174, 0.661)),
    ((55, 57, 25), "EDC", 3.277, (0.339, 0.038, 0.043), (0.029, 0.216, 0.077)),
    ((55, 57, 25), "LUM", 0.369, (-0.183, 0.130, 0.080), (0.030, 0.037, 0.084)),
    ((55, 57, 25), "RI", 5.324, (-0.910, 0.542, 0.094), (0.433, 0.349, 0.303)),
    ((55, 57, 25), "UI", 4.096, (-1.076, 0.406, -0.308), (0.560, 0.331, 0.067)),
)
# Muscle, tension N (10 % of the thesis's greatest forces), rotations of MCP, PIP, DIP in deg,
# flexion positive.
FREE_MOTION = (
    ("FDP", 7.912, (19.7, 41.8, 29.4)),
    ("FDS", 5.89, (24.8, 47.9, 0.0)),
    ("EDC", 3.469, (-18.3, -15.2, -4.0)),
    ("EI", 3.547, (-15.4, -13.2, -3.7)),
)
REST = {"MCP": np.radians(30.0), "PIP": np.radians(45.0), "DIP": np.radians(15.0)}
STIFFNESS = 0.0391
"""N m/rad, mean of four index MCPs (PMC7775510, table 2); the other joints are assumed alike."""
PROXIMAL_DORSAL_RADIAL = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])


def planar_rows() -> Iterator[Row]:
    """Accelerations of the planar finger: MuJoCo against the paper's matrices."""
    model = mujoco.MjModel.from_xml_string(mjcf_xml(BUCHNER.model(), (0, 0, -BUCHNER.gravity)))
    data, rng = mujoco.MjData(model), np.random.default_rng(1988)
    worst = 0.0
    for _ in range(200):
        data.qpos[:], data.qvel[:] = rng.uniform(-0.5, 1.9, 3), rng.normal(0, 10, 3)
        torque, force = rng.normal(0, 0.1, 3), rng.normal(0, 5, 2)
        expected = BUCHNER.acceleration(data.qpos.copy(), data.qvel.copy(), torque, force)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        data.qfrc_applied[:] = torque
        tip, last = data.site("tip").xpos.copy(), model.body("distal").id
        push = np.array([force[0], 0.0, force[1]])
        mujoco.mj_applyFT(model, data, push, np.zeros(3), tip, last, data.qfrc_applied)
        mujoco.mj_forward(model, data)
        worst = max(worst, float(np.abs(data.qacc - expected).max() / np.abs(expected).max()))
    name = "planar finger, 200 random states"
    yield Row(name, "accelerations apart", 1e-10, worst, 0.0, APPENDIX, "bound")


def single_tendon_rows() -> Iterator[Row]:
    """The middle finger under one tendon at a time, its tip clamped; nothing was fitted."""
    finger = MujocoFinger(MIDDLE.scaled_model(MIDDLE.strands(0.5), 1.0), support=CLAMPED)
    misses = []
    for posture, muscle, tension, mean, spread in SINGLE_TENDON:
        name = f"middle finger {'/'.join(map(str, posture))} deg, {muscle} {tension} N"
        force = phalanx_force(finger, posture, muscle, tension)
        for axis, target, found, sd in zip(
            ("proximal", "dorsal", "radial"), mean, force, spread, strict=True
        ):
            yield Row(name, f"force {axis} N", target, float(found), sd, SYNEK, "comparison")
        apart = float(np.degrees(_angle(force, np.array(mean))))
        yield Row(name, "direction apart deg", 0.0, apart, 30.0, SUCCESSOR, "comparison")
        misses.append(force - mean)
    rms = float(np.sqrt(np.mean(np.sum(np.square(misses), axis=1))))
    name = "middle finger, all twelve"
    yield Row(name, "RMS of the vectors apart N", 0.0, rms, 0.6, SUCCESSOR, "comparison")


def phalanx_force(
    finger: MujocoFinger, posture: tuple[int, int, int], muscle: str, tension: float
) -> Array:
    """The force (3,) N of the tip on the world, proximal, dorsal and radial in the distal phalanx's
    frame, at MCP, PIP and DIP in deg."""
    angles = dict(zip(("MCP", "PIP", "DIP"), np.radians(posture), strict=True))
    state, balance = at_rest(finger, finger.start(angles), _alone(finger, muscle, tension))
    turn = finger.motion(state).rotation[-1]
    return PROXIMAL_DORSAL_RADIAL @ turn.T @ balance.tip_force


def _alone(finger: MujocoFinger, muscle: str, tension: float) -> Array:
    return np.where(np.array(finger.tendons) == muscle, tension, 0.0)


def _angle(a: Array, b: Array) -> float:
    return float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def free_motion_rows() -> Iterator[Row]:
    """The index finger free to move, one muscle at a time, from where its joints rest; joint
    ranges as coordinate limits."""
    finger = free_finger(index_model(index_finger(), central=0.5))
    start = finger.start(REST)
    for muscle, tension, rotations in FREE_MOTION:
        state, _ = at_rest(finger, start, _alone(finger, muscle, tension))
        turned = np.degrees(state.angles - start.angles)
        name = f"free index finger, {muscle} {tension} N"
        for joint, target in zip(("MCP", "PIP", "DIP"), rotations, strict=True):
            found = float(turned[finger.joints.index(joint)])
            yield Row(name, f"{joint} turns deg", target, found, 10.0, NIMBARTE, "comparison")


def free_finger(model: FingerModel) -> MujocoFinger:
    """The finger with linear passive joints and limits at the ends of their ranges."""
    return MujocoFinger(model, law=_range(model), support=FREE)


def _range(model: FingerModel) -> JointLaw:
    return joint_law(
        model.joints,
        stiffness=dict.fromkeys(model.joints, STIFFNESS),
        rest=REST,
        lower={joint: low for joint, (low, _) in model.ranges.items()},
        upper={joint: high for joint, (_, high) in model.ranges.items()},
    )
