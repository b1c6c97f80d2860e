"""The index finger on MuJoCo: frames, tendons, masses and its XML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from cosim.analyses.moment_arms import native_arms
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fingers.index import KIND
from cosim.models.build import build
from cosim.port import Array, Motion
from meshes.skeleton import BODIES, JOINTS, Skeleton, index_finger
from rigid.chain.joint_torques import joint_law
from rigid.chain.support import FREE, HELD
from rigid.fingers.anatomy import _distance
from rigid.fingers.index import INDEX, INTRINSIC_ROWS, O2O3, finger_model
from rigid.fingers.little import LITTLE
from rigid.fingers.middle import MIDDLE
from rigid.fingers.middle import O2O3 as MIDDLE_O2O3
from rigid.fingers.ring import RING
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel
from rigid.mujoco.finger import MujocoFinger
from tests.helpers.fingers import (
    POSTURE,
    cables_over_all_joints,
    loaded_state,
    mujoco_finger,
    solve,
    straight_skeleton,
)

FINGERS = [
    finger_model(index_finger(), central=0.5),
    *(finger.scaled_model(finger.strands(0.5), 1.0) for finger in (MIDDLE, RING, LITTLE)),
]


def test_mujoco_has_the_skeletons_frames() -> None:
    finger = MujocoFinger(finger_model(index_finger()))
    posture = {**POSTURE, "MCP_abduction": 0.2}
    state, pose = finger.start(posture), index_finger().pose(posture)
    motion: Motion = finger.motion(state)
    assert motion.bodies == BODIES
    assert motion.position == pytest.approx(pose[0], abs=1e-15)
    assert motion.rotation == pytest.approx(pose[1], abs=1e-14)
    assert state.target == pytest.approx(index_finger().tip(posture), abs=1e-15)


@pytest.mark.parametrize(
    ("degrees", "lumbrical", "interosseous"), [(0, 3.05, 3.61), (30, 3.70, 3.61), (60, 3.51, 2.43)]
)
def test_a_case_chooses_the_intrinsic_tendons_path(
    degrees: float, lumbrical: float, interosseous: float
) -> None:
    """MyoHand's arms, computed with MuJoCo on its model."""
    case = load_case("split_edc", ['finger.intrinsics="myohand"'])
    arms = native_arms(build(case), {"MCP": np.radians(degrees)})
    assert 1e3 * arms["LUM"][0] == pytest.approx(lumbrical, abs=0.03)
    assert 1e3 * arms["FPI"][0] == pytest.approx(interosseous, abs=0.03)


@pytest.mark.parametrize("source", ["an1979", "myohand"])
def test_a_hood_s_eyelets_follow_the_path(source: Literal["an1979", "myohand"]) -> None:
    eyelets = KIND.eyelets(load_case("isometric_edc", [f'finger.intrinsics="{source}"']).finger)
    for tendon, row in INDEX.intrinsic.items():
        assert eyelets[tendon] == pytest.approx(O2O3 * np.array(INTRINSIC_ROWS[source][row][0]))


def test_mujocos_own_routines_agree() -> None:
    """mj_jacBody, mj_applyFT at the bodies' origins and the bias force of a body at rest."""
    finger = mujoco_finger(HELD)
    state, load, tension = loaded_state(finger)
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
# O2O3 = 20 mm, computed from the table without this code; of the extensors at 0 only.
ARMS = {
    ("FDP", "DIP"): (4.2,),
    ("FDIm", "MCP"): (3.6, 5.0, 6.3, 7.4),
    ("LUM", "MCP"): (6.1, 7.6, 8.8, 9.9),
    ("FPI", "MCP"): (3.8, 5.2, 6.5, 7.7),
    ("FDP", "PIP"): (7.2,),
    ("FDS", "PIP"): (5.7,),
    ("FDP", "MCP"): (9.6,),
    ("FDS", "MCP"): (10.8,),
    ("EDC", "MCP"): (-9.6,),
    ("EDC", "PIP"): (-5.3 / 2 - (3.6 + 2.7) / 4,),
    ("LUM", "PIP"): (-5.3 / 2 - 3.6 / 2, -5.2 / 2 - 3.2 / 2, -4.9 / 2 - 2.6 / 2),
    ("EDC", "DIP"): (-1.8 / 2, -2.0 / 2, -2.0 / 2, -1.9 / 2),
}


def whole_finger(skeleton: Skeleton) -> MujocoFinger:
    return MujocoFinger(finger_model(skeleton, central=0.5))


def arms(finger: MujocoFinger, muscle: str, joint: str, degrees: Sequence[float]) -> Array:
    """mm at `degrees` of that joint, the others straight."""
    j, t = JOINTS.index(joint), finger.tendons.index(muscle)
    postures = np.radians(degrees)[:, None] * np.eye(4)[j]
    return np.array([1e3 * finger.moment_arms(q)[t, j] for q in postures])


@pytest.mark.parametrize(("muscle", "joint"), ARMS)
def test_moment_arms(muscle: str, joint: str) -> None:
    """On straight axes as listed (a cylinder lies 0.1 mm lower); the real, oblique ones change
    them by 0.45 mm at most."""
    expected = ARMS[muscle, joint]
    degrees = [0, 15, 30, 45][: len(expected)]
    straight = arms(whole_finger(straight_skeleton()), muscle, joint, degrees)
    real = arms(whole_finger(index_finger()), muscle, joint, degrees)
    assert straight == pytest.approx(expected, abs=0.25 if muscle == "LUM" else 0.06)
    assert real == pytest.approx(expected, abs=0.45)


@pytest.mark.parametrize("degrees", [20, 45, 70, 90])
def test_a_sheathed_flexor_takes_the_shortest_way_inside_its_ring(degrees: float) -> None:
    """FDP over the MCP, in the plane: minimal |PX| + |XD| over the ring's points X."""
    start, end = 20.0 * np.array([[-0.4, -0.559], [0.118 + 0.432, -0.386]])
    radius = abs(_distance(start[[0, 0, 1]], end[[0, 0, 1]], np.radians(45.0)))
    apart = 0.15 * 20.0 * (end - start) / np.linalg.norm(end - start)
    start, end = start - apart, end + apart

    def length(q: float) -> float:
        c, s = np.cos(q), np.sin(q)
        there = np.array([[c, s], [-s, c]]) @ end

        def way(angle: float) -> float:
            x = -radius * np.array([np.sin(angle), np.cos(angle)])
            return float(np.linalg.norm(x - start) + np.linalg.norm(there - x))

        least = minimize_scalar(way, bounds=(-1.5, 1.5), method="bounded", options={"xatol": 1e-9})
        straight = abs(_distance(start[[0, 0, 1]], end[[0, 0, 1]], q)) <= radius
        return float(np.linalg.norm(there - start)) if straight else float(least.fun)

    q = np.radians(degrees)
    arm = -(length(q + 1e-3) - length(q - 1e-3)) / 2e-3
    flat = finger_model(straight_skeleton())
    assert arms(MujocoFinger(flat), "FDP", "MCP", [degrees])[0] == pytest.approx(arm, abs=0.05)


@pytest.mark.parametrize(
    ("model", "o2o3"),
    [
        (finger_model(straight_skeleton()), O2O3),
        (FINGERS[1], MIDDLE_O2O3),
    ],
)
def test_a_flexor_s_arm_is_bounded_by_its_sheath(model: FingerModel, o2o3: float) -> None:
    """At the PIP FDS lies dorsal of FDP wherever that bends, at the MCP palmar of it up to 60 deg;
    at the DIP A5 lets FDP rise by a fifth at most."""
    finger = MujocoFinger(model)
    pip = {t: arms(finger, t, "PIP", np.linspace(0, 110, 45)) for t in ("FDP", "FDS")}
    assert (pip["FDP"] - pip["FDS"]).min() > 0.05
    assert pip["FDP"].max() - pip["FDS"].max() == pytest.approx(1e3 * 0.08 * o2o3, abs=0.15)
    assert all(arm.max() < 10.3 and arm.min() > 0.4 * arm.max() for arm in pip.values())
    mcp = {t: arms(finger, t, "MCP", np.linspace(0, 60, 25)) for t in ("FDP", "FDS")}
    assert (mcp["FDS"] - mcp["FDP"]).min() > 0.5
    dip = arms(finger, "FDP", "DIP", np.linspace(0, 70, 29))
    assert 1e3 * 0.22 * o2o3 - 0.1 < dip.max() < 1e3 * 0.22 * o2o3 + 1e-6
    assert dip.max() < 1.2 * dip[0]


def test_a5_leaves_fdp_its_measured_mean_arm() -> None:
    """4.1 mm: An et al. 1983, index finger."""
    dip = arms(whole_finger(straight_skeleton()), "FDP", "DIP", np.linspace(0, 70, 29))
    assert dip.mean() == pytest.approx(4.1, abs=0.05)


@pytest.mark.parametrize("model", FINGERS)
@pytest.mark.parametrize("joint", ["MCP", "PIP", "DIP"])
def test_over_the_whole_range_no_arm_changes_its_sign_or_jumps(
    model: FingerModel, joint: str
) -> None:
    """But for the radial interossei, dorsal of the MCP's axis beyond 20 deg of hyperextension."""
    finger = MujocoFinger(model)
    low, high = np.degrees(model.ranges[joint])
    for muscle in finger.tendons:
        least = max(low, -19.0) if muscle == "RI" else low
        arm = arms(finger, muscle, joint, np.linspace(least, high, 141))
        assert np.ptp(np.sign(arm[np.abs(arm) > 1e-9])) == 0 if np.abs(arm).max() > 1e-9 else True
        assert np.abs(np.diff(arm)).max() < 0.6  # mm in a degree of MCP
        assert np.abs(arm).max() < 17.0


@pytest.mark.parametrize("model", FINGERS)
def test_a_length_changes_by_its_moment_arm(model: FingerModel) -> None:
    """Everywhere but within a step of where a tendon touches its guide."""
    finger = MujocoFinger(model)
    rng, step = np.random.default_rng(5), 1e-6
    low, high = np.array(list(model.ranges.values())).T
    misses = []
    for q in rng.uniform(low, high, (40, 4)):
        lengths = [
            (finger.tendon_lengths(q + d) - finger.tendon_lengths(q - d)) / (2 * step)
            for d in step * np.eye(4)
        ]
        misses.append(np.abs(finger.moment_arms(q) + np.transpose(lengths)).max())
    assert np.median(misses) < 1e-9
    assert np.max(misses) < 2e-7


def test_strands_share_the_tension() -> None:
    """EDC's length is the mean of its central way and its lateral ones."""
    finger = whole_finger(index_finger())
    state = finger.start(POSTURE)
    ways = finger.tendon_paths(state)
    long = {
        name: np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for name, points in ways.items()
    }
    edc = 0.5 * long["EDC"] + 0.25 * (long["EDC 2"] + long["EDC 3"])
    length = finger.tendon_lengths(state.angles)[finger.tendons.index("EDC")]
    # a tendon's polyline cuts the short arcs of its cylinders
    assert edc == pytest.approx(length, abs=1e-4)


def test_abduction_arms() -> None:
    finger = MujocoFinger(finger_model(straight_skeleton()))
    assert arms(finger, "FDIm", "MCP_abduction", [0])[0] == pytest.approx(8.8, abs=0.06)
    assert arms(finger, "FDS", "MCP_abduction", [0])[0] == pytest.approx(-1.9, abs=0.06)


def test_tendon_paths_end_on_the_right_bones() -> None:
    finger = MujocoFinger(finger_model(index_finger()))
    paths = finger.tendon_paths(finger.start(POSTURE))
    distinct = {name: len(np.unique(p, axis=0)) for name, p in paths.items()}
    assert distinct == {"FDP": 9, "FDS": 7, "FDIm": 3, "FDIl": 3}  # rings touched: FDP 2, FDS 2
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
    79.1, 58.9 and two of 72.8 N) press every flexion axis less than 1 deg beyond its limit."""
    posture = {**POSTURE, "MCP_abduction": 0.0}
    finger = MujocoFinger(
        finger_model(index_finger()), law=joint_law(JOINTS).hold_about(posture), support=FREE
    )
    beyond = {joint: angle + np.radians(6.0) for joint, angle in posture.items()}
    tension = 0.1 * np.array([79.12, 58.9, 72.8, 72.8])
    state, _, balance = solve(finger, cables_over_all_joints(), np.zeros(1), tension, beyond)
    excess = np.degrees(state.angles) - [35, 5, 50, 20]
    assert (excess > 0).all()
    assert (excess < 1).all()
    u = excess / 5
    expected = -20 * (10 * u**3 - 15 * u**4 + 6 * u**5) * excess  # N m/deg
    assert balance.torque["limit"] == pytest.approx(expected, rel=1e-9)
