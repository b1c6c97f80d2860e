"""Fingers behind the port: closed forms first, then what every finger must keep."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from cosim.errors import InputError
from cosim.port import Array
from meshes.skeleton import JOINTS
from rigid.chain import hinge
from rigid.chain.hinge import HingeFinger
from rigid.chain.joint_torques import joint_law, limit_torque, spring_torque
from rigid.chain.statics import ChainFinger
from rigid.chain.support import CLAMPED, CLAMPED_IN_PLANE, FREE, HELD, IN_PLANE, JOINTS_HELD
from rigid.fingers.index import finger_model
from rigid.mujoco.finger import MujocoFinger
from tests.helpers.fingers import (
    LENGTHS,
    POSTURE,
    REST,
    SOFT,
    STIFFNESS,
    cables_over_all_joints,
    hinge_finger,
    loaded_state,
    mujoco_finger,
    solve,
    straight_skeleton,
)

FINGERS = {
    "hinge-held": lambda: hinge_finger(IN_PLANE),
    "hinge-free": lambda: hinge_finger(FREE),
    "hinge-clamped": lambda: hinge_finger(CLAMPED_IN_PLANE),
    "mujoco-held": lambda: mujoco_finger(HELD),
    "mujoco-free": lambda: mujoco_finger(FREE),
    "mujoco-clamped": lambda: mujoco_finger(CLAMPED),
    "mujoco-posture": lambda: mujoco_finger(JOINTS_HELD),
    "mujoco-split": lambda: mujoco_finger(HELD, central=0.4),
}


@pytest.fixture(params=FINGERS)
def finger(request: pytest.FixtureRequest) -> ChainFinger:
    return FINGERS[request.param]()


# Joint torques ------------------------------------------------------------------------------------


@given(st.floats(-0.5, 0.5))
def test_torques_have_their_derivatives(angle: float) -> None:
    q, h = np.array([angle]), 1e-6
    laws = (
        lambda x: limit_torque(x, np.array([-0.1]), np.array([0.2])),
        lambda x: spring_torque(x, np.array([0.04]), np.array([0.3])),
    )
    for law in laws:
        slope = (law(q + h)[0] - law(q - h)[0]) / (2 * h)
        assert law(q)[1] == pytest.approx(slope, rel=1e-6, abs=1e-4)


def test_limit_law_at_known_points() -> None:
    """20 N m/deg beyond the transition of 5 deg, half the stiffness in its middle, none inside."""
    degrees = np.array([-26.0, -20.0, 0.0, 10.0, 12.5, 15.0, 20.0])
    bound = np.ones_like(degrees)
    torque, _ = limit_torque(np.radians(degrees), np.radians(-20 * bound), np.radians(10 * bound))
    assert torque == pytest.approx([120.0, 0, 0, 0, -25.0, -100.0, -200.0])


def test_joint_law_speaks_to_people() -> None:
    with pytest.raises(InputError, match=r"rest angles: unknown joint CMC.*PIP"):
        joint_law(JOINTS, rest={"CMC": 0.1})
    with pytest.raises(InputError, match="PIP"):
        joint_law(JOINTS, lower={"PIP": 1.0}, upper={"PIP": 0.5})
    with pytest.raises(InputError, match="negative"):
        joint_law(JOINTS, stiffness={"PIP": -1.0})


# Closed forms -------------------------------------------------------------------------------------


def test_free_finger_under_one_cable() -> None:
    """Eyelets symmetric about a joint: arm r = rho sin(beta - q / 2), and q = rest - r T / k."""
    law = joint_law(hinge.JOINTS, STIFFNESS, REST)
    tension, rho, beta = 3.0, np.hypot(0.006, 0.008), np.arctan2(0.006, 0.008)
    state, _, _ = solve(
        HingeFinger(LENGTHS, law=law, support=FREE),
        cables_over_all_joints(),
        np.array([tension]),
        np.zeros(0),
    )
    for q, joint in zip(state.angles, hinge.JOINTS, strict=True):
        k, rest = STIFFNESS[joint], REST[joint]
        expected = brentq(
            lambda x, k=k, rest=rest: k * (x - rest) + tension * rho * np.sin(beta - x / 2),
            -3,
            3,
            xtol=1e-15,
        )
        assert q == pytest.approx(expected, abs=1e-11)


def test_held_finger_pushes_with_the_inverse_of_its_jacobian() -> None:
    """Joints 2 and 3 without springs: their two torques alone fix the planar tip force."""
    law = joint_law(hinge.JOINTS, {"MCP": 0.1}, {"MCP": POSTURE["MCP"]})
    finger = HingeFinger(LENGTHS, law=law)
    state, _, balance = solve(finger, cables_over_all_joints(), np.array([3.0]), np.zeros(0))
    _, f2, f3 = np.cumsum(state.angles)
    l2, l3 = LENGTHS[1:]
    by_dip = np.array([-l3 * np.sin(f3), -l3 * np.cos(f3)])  # d (x, z) of the tip / dq
    by_pip = by_dip - l2 * np.array([np.sin(f2), np.cos(f2)])
    reaction = np.linalg.solve(np.array([by_pip, by_dip]), -balance.torque["hood"][1:])
    assert state.reaction[:3] == pytest.approx([reaction[0], 0.0, reaction[1]], rel=1e-9)
    assert balance.tip_force == pytest.approx(-state.reaction[:3])
    assert finger.chain(state.angles).tip == pytest.approx(state.target, abs=1e-14)


def test_hinge_finger_equals_a_mujoco_finger_with_straight_axes() -> None:
    planar = hinge_finger(IN_PLANE)
    law = joint_law(JOINTS, STIFFNESS, REST, limit_stiffness=SOFT).hold_about(POSTURE, 0.02)
    spatial = MujocoFinger(finger_model(straight_skeleton()), law=law)
    a, load, _ = loaded_state(planar)
    q = np.insert(a.angles, 1, 0.0)
    b = replace(spatial.start(POSTURE), angles=q, reaction=a.reaction)
    keep = [0, 2, 3]
    assert b.target == pytest.approx(a.target, abs=1e-15)
    for name in ("position", "rotation"):
        pair = getattr(spatial.motion(b), name), getattr(planar.motion(a), name)
        assert pair[0] == pytest.approx(pair[1], abs=1e-12)
    assert spatial.jacobian(b)[:, keep] == pytest.approx(planar.jacobian(a), abs=1e-12)
    K = np.random.default_rng(0).normal(size=(24, 24))
    one, two = planar.balance(a, load, np.zeros(0)), spatial.balance(b, load, np.zeros(4))
    for source, torque in one.torque.items():
        assert two.torque[source][keep] == pytest.approx(torque, abs=1e-12)
    rows = [0, 2, 3, 4, 6]
    pair = spatial.tangent(b, load, np.zeros(4), K), planar.tangent(a, load, np.zeros(0), K)
    assert pair[0][np.ix_(rows, rows)] == pytest.approx(pair[1], rel=1e-12, abs=1e-11)


# What every finger must keep ----------------------------------------------------------------------


def test_tangent_is_the_derivative_of_the_residual(finger: ChainFinger) -> None:
    state, load, tension = loaded_state(finger)
    K = np.random.default_rng(1).normal(size=(24, 24)) * 0.1
    home = finger.motion(state)

    def residual(step: Array) -> Array:
        there = finger.displace(state, step)
        change = (K @ home.twist_to(finger.motion(there)).ravel()).reshape(-1, 6)
        wrench = load.wrench.copy()
        wrench[:, 0] += change
        return finger.balance(there, replace(load, wrench=wrench), tension).residual

    tangent, h = finger.tangent(state, load, tension, K), 1e-5
    columns = [(residual(d) - residual(-d)) / (2 * h) for d in h * np.eye(len(tangent))]
    assert tangent == pytest.approx(np.column_stack(columns), rel=1e-6, abs=1e-7)


def test_torques_do_the_work_of_the_wrenches(finger: ChainFinger) -> None:
    state, load, tension = loaded_state(finger)
    torque = finger.balance(state, load, tension).torque["hood"]
    dq = np.zeros(len(finger.joints) + len(state.basis))
    dq[: len(finger.joints)] = 1e-5 * np.arange(1.0, len(finger.joints) + 1)
    motions = [finger.motion(finger.displace(state, s * dq)) for s in (-1, 1)]
    work = load.total().ravel() @ motions[0].twist_to(motions[1]).ravel()
    assert work == pytest.approx(2 * torque @ dq[: len(torque)], rel=1e-8)


def test_ledger_gives_the_torques_and_closes(finger: ChainFinger) -> None:
    state, load, tension = loaded_state(finger)
    balance, ledger = finger.balance(state, load, tension), finger.ledger(state, load, tension)
    jacobian = finger.jacobian(state)
    assert set(ledger) - {"joint", "ground"} == set(balance.torque) - {"hood"}
    for source, torque in balance.torque.items():
        if source != "hood":
            work = jacobian.T @ ledger[source].ravel()
            assert work == pytest.approx(torque, rel=1e-12, abs=1e-14), source
    whole = load.total() + sum(ledger.values())
    assert np.abs(whole).max() < 1e-12 * np.abs(ledger["joint"]).max()


def test_the_ground_bears_what_comes_from_outside(finger: ChainFinger) -> None:
    """Action and reaction: what acts between the finger's own bodies adds up to nothing about any
    one point, so that the ground holds hood, fingertip and gravity alone."""
    state, load, tension = loaded_state(finger)
    ledger = finger.ledger(state, load, tension)
    position = finger.motion(state).position

    def about_origin(wrench: np.ndarray) -> np.ndarray:
        force, moment = wrench[:, :3], wrench[:, 3:]
        return np.r_[force.sum(axis=0), (moment + np.cross(position, force)).sum(axis=0)]

    outside = [ledger[source] for source in ("gravity", "fingertip") if source in ledger]
    scale = np.abs(ledger["joint"]).max()
    for source in ledger.keys() - {"gravity", "fingertip", "ground"}:
        assert np.abs(about_origin(ledger[source])).max() < 1e-12 * scale, source
    ground = about_origin(load.total() + sum(outside))
    assert about_origin(ledger["ground"]) == pytest.approx(-ground, abs=1e-12 * scale)
    assert np.abs(ground).max() > 1e-3
    assert not ledger["ground"][1:].any()


def test_joints_carry_no_moment_about_their_axes() -> None:
    finger = mujoco_finger(HELD)
    tension = np.array([4.0, 3.0, 3.6, 3.7])
    state, load, balance = solve(finger, cables_over_all_joints(), np.array([3.5]), tension)
    assert np.abs(balance.tip_force).max() > 0.5
    chain = finger.chain(state.angles)
    moment = finger.joint_reactions(state, load, tension)[chain.child, 3:]
    assert np.einsum("ij,ij->i", moment, chain.axis) == pytest.approx(np.zeros(4), abs=1e-11)
    assert np.linalg.norm(moment, axis=1).max() > 1e-3


def test_the_same_state_gives_the_same_bits(finger: ChainFinger) -> None:
    state, load, tension = loaded_state(finger)
    K = np.eye(24)
    first = finger.balance(state, load, tension), finger.tangent(state, load, tension, K)
    finger.balance(finger.start({}), load, 2 * tension)
    again = finger.balance(state, load, tension), finger.tangent(state, load, tension, K)
    assert np.array_equal(first[0].residual, again[0].residual)
    assert np.array_equal(first[1], again[1])


def test_fingers_refuse_wrong_input(finger: ChainFinger) -> None:
    state, load, tension = loaded_state(finger)
    with pytest.raises(InputError, match=r"unknown joint CMC.*PIP"):
        finger.start({"CMC": 0.1})
    with pytest.raises(InputError, match=r"expected .* tensions"):
        finger.balance(state, load, np.ones(7))
    with pytest.raises(InputError, match="in this order"):
        finger.balance(state, replace(load, bodies=load.bodies[::-1]), tension)
    with pytest.raises(InputError, match="step of shape"):
        finger.displace(state, np.zeros(1))


def test_rigid_needs_no_mujoco() -> None:
    code = (
        "import sys, rigid, rigid.chain.hinge, rigid.hoods.pulley, rigid.fingers.index;"
        "assert 'mujoco' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
