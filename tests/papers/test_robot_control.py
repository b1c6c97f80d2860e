"""The robotic finger: tendon forces, controllers, steps in time, the fan of accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from cases.papers.models.xu2012 import checks
from cases.papers.models.xu2012.actuators import PERIOD, Lag
from cases.papers.models.xu2012.control import (
    ARM,
    JOINT_GAINS,
    WEIGHT,
    Gains,
    Memory,
    forces_for_torques,
    joint_forces,
    pid,
    remember,
    tendon_forces,
)
from cases.papers.models.xu2012.fan import fan, least_share
from cases.papers.models.xu2012.plant import Plant
from cases.papers.models.xu2012.tracking import Bench, StepResponse, poses
from rigid.fingers.robot import robot_finger
from rigid.mujoco.finger import MujocoFinger

POSE = np.radians([30.0, 10.0, 45.0, 20.0])


@pytest.fixture(scope="module")
def five() -> MujocoFinger:
    return MujocoFinger(robot_finger())


def test_tensions_are_the_least_squares_of_pulls() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        arms, torque = rng.normal(0.0, ARM, (5, 4)), rng.normal(0.0, 0.05, 4)
        A = np.vstack([arms.T / ARM, np.sqrt(WEIGHT) * np.eye(5)])
        wanted, _ = nnls(A, np.append(torque / ARM, np.zeros(5)))
        np.testing.assert_allclose(forces_for_torques(torque, arms, most=1e3), wanted, atol=1e-7)


def test_tensions_are_the_best_within_their_bounds() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        arms, torque = rng.normal(0.0, ARM, (5, 4)), rng.normal(0.0, 0.5, 4)
        A = np.vstack([arms.T / ARM, np.sqrt(WEIGHT) * np.eye(5)])
        best = lsq_linear(A, np.append(torque / ARM, np.zeros(5)), (0.3, 40.0), tol=1e-14)
        np.testing.assert_allclose(forces_for_torques(torque, arms, least=0.3), best.x, atol=1e-4)


def test_tensions_keep_their_bounds(five: MujocoFinger) -> None:
    force = forces_for_torques(np.array([9.0, 0.0, 9.0, 9.0]), five.moment_arms(POSE), least=0.5)
    assert force.min() == pytest.approx(0.5)
    assert force.max() == pytest.approx(40.0)


def test_tensions_make_the_torques_that_hold_the_finger(five: MujocoFinger) -> None:
    plant = Plant(robot_finger())
    force = forces_for_torques(plant.holding_torque(POSE), five.moment_arms(POSE))
    plant.reset(POSE)
    for _ in range(20):
        plant.advance(force)
    assert np.abs(plant.instant().angle - POSE).max() < np.radians(0.5)


def test_pid_sums_its_three_parts() -> None:
    memory = Memory(np.array([0.2]), np.array([1.0]), np.array([0.0]))
    action, after = pid(Gains(2.0, 3.0, 0.5), memory, np.array([1.1]), np.array([1.5]))
    integral, rate = 0.2 + 0.01 * 0.4, 0.5 * (0.1 / 0.01)
    assert after.integral[0] == pytest.approx(integral)
    assert action[0] == pytest.approx(2.0 * 0.4 + 3.0 * integral - 0.5 * rate)


def test_long_tendon_is_pulled_and_its_integral_held_at_the_bound() -> None:
    memory = remember(np.zeros(2))
    force, after = tendon_forces(
        Gains(1e5, 1.0, 0.0), memory, np.array([0.1, -0.1]), np.array([0.0, 0.0])
    )
    np.testing.assert_allclose(force, [40.0, 0.3])
    np.testing.assert_allclose(after.integral, 0.0)


def test_integral_of_a_joint_waits_while_its_torque_is_out_of_reach(five: MujocoFinger) -> None:
    memory, arms = remember(np.zeros(4)), five.moment_arms(np.zeros(4))
    far, near = np.radians([0.0, 0.0, -4000.0, 0.0]), np.radians([60.0, 0.0, 60.0, 40.0])
    assert joint_forces(JOINT_GAINS, memory, np.zeros(4), far, arms)[1].integral[2] == 0.0
    after = joint_forces(JOINT_GAINS, memory, np.zeros(4), near, arms)[1]
    np.testing.assert_allclose(after.integral, 0.01 * near)


def test_gains_are_tuned_for_their_pose() -> None:
    found = checks.tune(True, air=False)
    assert not any(s.unstable for s in found.steps)
    assert max(s.error for s in found.steps) < np.radians(0.3)
    assert found.gains.i > found.gains.p


def test_lag_is_exact_and_anticipated() -> None:
    lag, length = Lag(time=0.02), np.zeros(2)
    state = lag.begin(np.array([1.0, 50.0]), length)
    np.testing.assert_allclose(lag.force(state), [1.0, 40.0])
    after = lag.advance(state._replace(aim=np.array([3.0, 0.0])), length, 0.02)
    np.testing.assert_allclose(lag.force(after), [3.0 - 2.0 / np.e, 40.0 / np.e])
    wanted = np.array([2.0, 30.0])
    after = lag.advance(lag.command(state, wanted), length, PERIOD)
    np.testing.assert_allclose(lag.force(after), wanted)


def test_fan_is_what_the_plant_does_to_the_fingertip() -> None:
    plant = Plant(robot_finger())
    plant.model.jnt_stiffness[:] = 0.0
    plant.model.dof_damping[:] = 0.0
    plant.model.opt.gravity[:] = 0.0
    finger = MujocoFinger(robot_finger())
    for k in range(5):
        start = plant.reset(POSE).angle
        plant.advance(np.eye(5)[k] * 1e-3)
        turned = plant.instant().angle - start
        moved = finger.chain(POSE + turned).tip - finger.chain(POSE).tip
        acceleration = moved / 1e-3**2 / 1e-3
        np.testing.assert_allclose(acceleration, fan(finger, POSE).acceleration[k], rtol=2e-3,
                                   atol=0.1)  # fmt: skip


def test_pulls_span_a_plane_when_they_surround_its_origin() -> None:
    star = np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])
    assert least_share(star) > 0.1
    assert least_share(star + np.array([2.0, 0.0])) == 0.0
    assert least_share(np.array([[1.0, 0.0], [-1.0, 0.0], [2.0, 0.0]])) == 0.0
    assert least_share(np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])) == 0.0


def test_second_extensor_lets_weaker_forces_hold_the_finger() -> None:
    five, six = checks.reach_targets(False), checks.reach_targets(True)
    assert np.median(five.flatness) < 0.1
    assert six.hold.max() < 0.5 * five.hold.max()
    assert six.joints.all()


def test_settling_and_overshoot_of_a_step() -> None:
    time = 0.01 * np.arange(100)
    angle = np.ones((100, 2))
    angle[:10, 0], angle[10:20, 0], angle[:, 1] = 0.0, 1.1, 0.5
    step = StepResponse(time, angle, np.zeros((100, 5)), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(step.settling, [0.20, np.inf])
    np.testing.assert_allclose(step.overshoot, [0.1, 0.0])
    assert step.error == pytest.approx(0.5)
    assert not step.unstable


def test_quality_counts_steps_and_joints_after_the_first() -> None:
    """Of a still first step, one that settles at 0.1 s past its goal, and one that swings."""
    time, goal = 0.01 * np.arange(100), np.ones(2)
    still, late, swings = np.ones((100, 2)), np.ones((100, 2)), np.ones((100, 2))
    late[:10] = 0.0
    late[20, 0] = np.radians(1.0) + 1.0
    swings[::2, 1] = 0.5
    steps = [
        StepResponse(time, angle, np.zeros((100, 5)), start, goal)
        for angle, start in ((still, goal), (late, np.zeros(2)), (swings, np.zeros(2)))
    ]
    found = checks.quality(steps)
    assert (found.unstable, found.unsettled) == (1, 0)
    np.testing.assert_allclose(found.median_settling, [0.05, 0.545])
    np.testing.assert_allclose(found.longest_settling, [0.1, 0.98 + 0.01])
    np.testing.assert_allclose(found.largest_overshoot, [1.0, 0.0])


@pytest.mark.slow
def test_one_gain_set_in_joint_space_holds_where_tendon_space_fails() -> None:
    bench = Bench(robot_finger(True), Lag())
    goals = list(poses(10))
    joint = bench.in_joint_space(goals, JOINT_GAINS)
    assert not any(s.unstable for s in joint)
    assert np.isfinite([s.settling for s in joint]).all()
    assert sum(s.unstable for s in checks.tendon_steps(True, air=False)) >= 5
