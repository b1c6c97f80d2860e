"""Cables over pulleys of constant radius: torques and excursions in closed form."""

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.port import Load
from rigid.chain.hinge import HingeFinger
from rigid.chain.kinematics import body_jacobian
from rigid.chain.support import FREE

LENGTHS = (0.046, 0.026, 0.02)
PULLEYS = {
    "FDP": {"MCP": 0.010, "PIP": 0.008, "DIP": 0.005},
    "FDS": {"MCP": 0.011, "PIP": 0.007},
    "EDC": {"MCP": -0.009, "PIP": -0.004, "DIP": -0.003},
    "LUM": {"MCP": 0.006, "DIP": -0.003},
}
ARMS = np.array(
    [[0.010, 0.008, 0.005], [0.011, 0.007, 0.0], [-0.009, -0.004, -0.003], [0.006, 0.0, -0.003]]
)
TENSION = np.array([10.0, 7.0, 3.0, 2.0])
POSTURES = np.radians([[0.0, 0.0, 0.0], [30.0, 45.0, 15.0], [80.0, 100.0, 60.0], [-20.0, 5.0, 0.0]])


@pytest.fixture(scope="module")
def finger():
    return HingeFinger(LENGTHS, pulleys=PULLEYS, support=FREE)


def state(finger, angles):
    return finger.start(dict(zip(finger.joints, angles, strict=True)))


@pytest.mark.parametrize("angles", POSTURES)
def test_the_torque_is_radius_times_tension_and_the_excursion_radius_times_turn(finger, angles):
    torques = np.array(list(finger.own_torques(angles, TENSION).values()))
    assert np.array_equal(torques, TENSION[:, None] * ARMS)
    straight, bent = (finger.path_lengths(state(finger, q)) for q in (0 * angles, angles))
    np.testing.assert_allclose(straight - bent, ARMS @ angles, atol=1e-16)


@pytest.mark.parametrize("angles", POSTURES)
def test_the_forces_on_the_bones_do_the_work_of_those_torques(finger, angles):
    jacobian = body_jacobian(finger.chain(angles))
    for k, wrench in enumerate(finger.own_wrenches(angles, TENSION).values()):
        np.testing.assert_allclose(jacobian.T @ wrench.ravel(), TENSION[k] * ARMS[k], atol=1e-15)
        place = finger.chain(angles).motion.position
        moment = wrench[:, 3:] + np.cross(place, wrench[:, :3])
        assert np.abs(wrench[:, :3].sum(axis=0)).max() < 1e-14
        assert np.abs(moment.sum(axis=0)).max() < 1e-15


def test_a_cable_draws_the_joint_together_with_its_tension(finger):
    angles = POSTURES[0]
    only_fds = np.array([0.0, 7.0, 0.0, 0.0])
    idle = Load(finger.bodies, ("hood",), np.zeros((4, 1, 6)), np.zeros((0, 6)))
    joint = finger.joint_reactions(state(finger, angles), idle, only_fds)
    assert joint[1, 0] == pytest.approx(7.0)  # MCP, straight: parallel to the bone
    dip = np.arcsin((0.007 - 0.011) / LENGTHS[0])
    assert joint[2, [0, 2]] == pytest.approx(7.0 * np.array([np.cos(dip), -np.sin(dip)]))


@pytest.mark.parametrize("angles", POSTURES)
def test_the_drawn_cable_is_as_long_as_it_is_said_to_be(finger, angles):
    """Up to the arcs about which the straight finger's is longer: their turns are the joints'."""
    paths = finger.tendon_paths(state(finger, angles))
    fds = finger.cables["FDS"]
    spans = np.linalg.norm(np.diff(paths["FDS"], axis=0), axis=1)
    between = np.sqrt(LENGTHS[0] ** 2 - 0.004**2)
    assert np.isclose(spans, between).sum() == 1
    assert fds.length(angles) == pytest.approx(between - 0.011 * angles[0] - 0.007 * angles[1])


def test_pulleys_that_no_line_can_join_are_refused():
    with pytest.raises(InputError, match=r"PIP to DIP.*over a bone of 26 mm"):
        HingeFinger(LENGTHS, pulleys={"FDP": {"PIP": 0.02, "DIP": -0.01}})
    with pytest.raises(InputError, match="expected a radius for some of the joints"):
        HingeFinger(LENGTHS, pulleys={"FDP": {"wrist": 0.02}})
