"""A finger in motion: closed forms, order, audit, devices, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array, State
from meshes.skeleton import JOINTS
from rigid.chain.joint_torques import JointLaw, TorqueCurve, joint_law, limit_torque
from rigid.chain.support import CLAMPED, FREE, HELD, Support
from rigid.fingers.index import finger_model
from rigid.model import FingerModel, Hinge, Segment
from rigid.mujoco.dynamics import ConstantTension, DynamicPull, FingerDynamics
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tip_device import Cage, Device, Shell, TipContact
from tests.helpers.fingers import POSTURE, at_rest, straight_skeleton
from tests.proofs.fingers.forward import (
    RestCriterion,
    Simulation,
    limit_energy,
    require_rest,
    simulate,
)

LENGTH, MASS, GRAVITY = 0.05, 0.02, 9.81
STIFF = dict.fromkeys(JOINTS, 0.04)


def pendulum(law: JointLaw | None = None, support: Support = FREE) -> MujocoFinger:
    """A point mass at the end of a rod that flexes about y; gravity along the straight rod."""
    bob = Segment(
        "bob",
        LENGTH,
        hinges=(Hinge("MCP", (0.0, 1.0, 0.0)),),
        mass=MASS,
        inertia=(1e-12, 1e-12, 1e-12),
        centre=(LENGTH, 0.0, 0.0),
    )
    model = FingerModel("pendulum", (Segment("ground", 0.01), bob), (LENGTH, 0.0, 0.0))
    return MujocoFinger(model, law=law, support=support, gravity=(GRAVITY, 0.0, 0.0))


def swing(angle: float, dt: float, duration: float, law: JointLaw | None = None) -> Simulation:
    finger = pendulum(law)
    start = finger.start({"MCP": angle})
    return simulate(FingerDynamics(finger, start, ConstantTension(np.zeros(0))), duration, dt)


def index(law: JointLaw, support: Support = HELD, gravity: float = 0.0) -> MujocoFinger:
    model = finger_model(straight_skeleton(), central=0.5)
    return MujocoFinger(model, law=law, support=support, gravity=(0.0, 0.0, -gravity))


def springy(damping: float = 0.6) -> JointLaw:
    return joint_law(JOINTS, STIFF, POSTURE, limit_damping=damping).hold_about(POSTURE)


def run(
    finger: MujocoFinger,
    muscle: str = "EDC",
    device: Device | None = None,
    duration: float = 0.5,
    dt: float = 1e-3,
    posture: Mapping[str, float] = POSTURE,
) -> Simulation:
    pull = ConstantTension(np.where(np.array(finger.tendons) == muscle, 3.0, 0.0))
    return simulate(FingerDynamics(finger, finger.start(posture), pull, device), duration, dt)


def test_period_of_a_pendulum() -> None:
    s = swing(0.02, 1e-4, 1.0)
    crossings = np.flatnonzero(np.diff(np.sign(s.angles[:, 0])))
    gaps = s.angles[crossings, 0] / (s.angles[crossings, 0] - s.angles[crossings + 1, 0])
    times = s.time[crossings] + 1e-4 * gaps
    period = 2 * float(np.mean(np.diff(times)))
    assert period == pytest.approx(2 * np.pi * np.sqrt(LENGTH / GRAVITY), rel=1e-4)


def test_a_swinging_pendulum_keeps_its_energy() -> None:
    s = swing(1.2, 1e-3, 1.0)
    potential = MASS * GRAVITY * LENGTH * (1 - np.cos(s.angles[:, 0]))
    kinetic = 0.5 * MASS * (LENGTH * s.rates[:, 0]) ** 2
    total = potential + kinetic
    assert np.ptp(total) < 0.02 * total[0]
    assert s.energy.gravity == pytest.approx(potential[0] - potential[-1], rel=1e-9)


def test_spring_and_damper() -> None:
    """Overdamped: the exact solution, and the order of the error."""
    k, c = 0.5, 0.005
    law = joint_law(("MCP",), {"MCP": k}, {"MCP": 0.3}, damping={"MCP": c})
    finger = weightless(law)
    inertia = MASS * LENGTH**2
    roots = np.roots([inertia, c, k])

    def error(dt: float) -> float:
        pull = ConstantTension(np.zeros(0))
        start = finger.start({"MCP": 0.0})
        s = simulate(FingerDynamics(finger, start, pull), 0.1, dt)
        a = np.linalg.solve(np.array([[1, 1], roots]), [-0.3, 0.0])
        exact = 0.3 + np.real(a @ np.exp(np.outer(roots, s.time)))
        return float(np.abs(s.angles[:, 0] - exact).max())

    coarse, fine = error(2e-4), error(1e-4)
    assert fine < 0.003
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def weightless(law: JointLaw) -> MujocoFinger:
    finger = pendulum(law)
    finger.model.opt.gravity[:] = 0.0
    return finger


@pytest.mark.parametrize("device", [Cage(), Shell()], ids=["cage", "shell"])
def test_a_mass_settles_on_a_device_with_its_weight(device: Device) -> None:
    """The rod lies across gravity; its end falls on the device and stays."""
    finger = pendulum(joint_law(("MCP",), damping={"MCP": 1e-4}))
    start = finger.start({"MCP": np.pi / 2})
    s = simulate(FingerDynamics(finger, start, ConstantTension(np.zeros(0)), device), 0.6)
    assert require_rest(s) is s
    lever = np.cos(s.angles[-1, 0] - np.pi / 2)
    assert s.force[-1, 0] == pytest.approx(MASS * GRAVITY, rel=2e-3)
    assert lever == pytest.approx(1.0, abs=1e-3)
    fallen = LENGTH * np.sin(np.pi / 2 - s.angles[-1, 0])
    assert fallen == pytest.approx(5e-4, abs=3e-5)


@pytest.mark.parametrize("support", [HELD, CLAMPED, FREE], ids=["held", "clamped", "free"])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_rest_is_the_static_equilibrium(support: Support, gravity: float) -> None:
    law = replace(springy(), damping=np.full(4, 2e-3))
    finger = index(law, support, gravity)
    s = require_rest(run(finger, "FDP", duration=1.0))
    tension = np.where(np.array(finger.tendons) == "FDP", 3.0, 0.0)
    state, balance = at_rest(finger, finger.start(POSTURE), tension)
    np.testing.assert_allclose(s.angles[-1], state.angles, atol=1e-7)
    np.testing.assert_allclose(s.force[-1], balance.tip_force, atol=2e-6)
    np.testing.assert_allclose(-s.moment[-1], state.reaction[3:], atol=1e-7)


def test_a_held_tip_does_not_drift() -> None:
    finger = index(springy())
    s = run(finger, "LUM", duration=0.3)
    start = finger.start(POSTURE)
    apart = [np.linalg.norm(finger.chain(q).tip - start.target) for q in s.angles]
    assert np.ptp(s.angles[:, 0]) > 0.008
    assert max(apart) < 2e-5
    assert apart[-1] < 1e-8


def test_order_of_convergence() -> None:
    """The angles after 20 ms of free fall onto the limits, against steps 32 times as short."""
    law = replace(springy(), damping=np.full(4, 1e-3))
    finger = index(law, FREE)

    def end(dt: float) -> Array:
        pull = ConstantTension(np.full(len(finger.tendons), 0.5))
        dynamics = FingerDynamics(finger, finger.start(POSTURE), pull)
        return simulate(dynamics, 0.02, dt, RestCriterion(window=0.01)).angles[-1]

    exact = end(1e-3 / 64)
    errors = [np.abs(end(dt) - exact).max() for dt in (1e-3, 5e-4, 2.5e-4)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 1.0, atol=0.25)


def test_audit_closes_with_the_step() -> None:
    """What no force explains is the method's own damping, which vanishes with the step."""
    law = replace(springy(), damping=np.full(4, 1e-3))
    finger = index(law, FREE, gravity=9.81)
    energies = [run(finger, "FDP", duration=0.2, dt=dt).energy for dt in (1e-4, 5e-5, 2.5e-5)]
    shares = np.array([e.artificial / e.tendons for e in energies])
    assert (shares > 0).all()
    assert (shares[1:] < 0.65 * shares[:-1]).all()
    assert shares[-1] < 0.1
    assert energies[-1].joints_dissipated > 0
    assert energies[-1].joints_stored > 0


def test_energy_of_a_limit_is_the_integral_of_its_torque() -> None:
    law = springy()
    for beyond in (0.03, 0.2):
        x = np.linspace(0.0, beyond, 20_001)
        torque = limit_torque(law.upper[0] + x, law.lower[0], law.upper[0])[0]
        expected = -np.trapezoid(torque, x)
        q = np.array([law.upper[0], 0.0, law.upper[2], law.upper[3]])
        q[0] += beyond
        assert limit_energy(law, q) == pytest.approx(expected, rel=1e-6)
        q[0] = law.lower[0] - beyond
        assert limit_energy(law, q) == pytest.approx(expected, rel=1e-6)


def test_audit_of_a_device() -> None:
    soft = Cage(TipContact(stiffness=1e5))
    finger = index(replace(springy(), damping=np.full(4, 1e-3)))
    ran = [run(finger, "FDP", soft, duration=0.2, dt=dt).energy for dt in (2e-4, 1e-4)]
    assert 0 < ran[1].artificial < 0.6 * ran[0].artificial
    assert ran[1].device_dissipated > 0
    assert ran[1].device_stored > 0


def test_bits_repeat_and_a_state_is_a_value() -> None:
    finger = index(springy())
    pull = ConstantTension(np.full(len(finger.tendons), 1.0))
    one, other = (FingerDynamics(finger, finger.start(POSTURE), pull, Cage()) for _ in range(2))
    at = one.start()
    for _ in range(20):
        at = one.advance(at, 1e-3)
    kept = at
    for _ in range(5):
        at = one.advance(at, 1e-3)
    for _ in range(5):
        kept = other.advance(kept, 1e-3)
    for field in ("angles", "rates", "tip", "tension"):
        np.testing.assert_array_equal(getattr(kept, field), getattr(at, field))


def test_steep_friction_splits_a_step() -> None:
    """Both interossei against the cage: a step of 1 ms has two solutions; half of one has one."""
    finger = index(springy())
    pull = ConstantTension(np.where(np.char.startswith(finger.tendons, "FDI"), 3.64, 0.0))
    dynamics = FingerDynamics(finger, finger.start(POSTURE), pull, Cage())
    assert require_rest(simulate(dynamics)).at_rest


def test_device_in_other_axes() -> None:
    """Turning finger, gravity's absence and cage together turns nothing but the cage's walls."""
    finger = index(springy())
    turn = finger.chain(finger.start(POSTURE).angles).motion.rotation[-1]
    pull = ConstantTension(np.where(np.array(finger.tendons) == "FDP", 3.0, 0.0))
    start = finger.start(POSTURE)
    s = simulate(FingerDynamics(finger, start, pull, Cage(), turn), 1.0)
    place = turn.T @ (finger.chain(s.angles[-1]).tip - start.target)
    pressed = turn.T @ s.force[-1]
    walls = np.abs(place) > Cage().gap
    assert walls.any()
    np.testing.assert_array_equal(np.abs(pressed) > 0.05, walls)
    np.testing.assert_array_equal(np.sign(pressed[walls]), np.sign(place[walls]))
    same = simulate(FingerDynamics(finger, start, pull, Shell(), turn), 1.0)
    plain = simulate(FingerDynamics(finger, start, pull, Shell()), 1.0)
    np.testing.assert_allclose(same.force[-1], plain.force[-1], atol=1e-6)


@dataclass(frozen=True)
class Elastic:
    """Tendons that are springs: tension + stiffness * (length - at the start)."""

    tension: Array
    stiffness: Array

    def start(self, length: Array) -> State:
        return length

    def pull(self, state: State, time: float, length: Array, dt: float) -> DynamicPull:
        tension = self.tension + self.stiffness * (length - state)
        return DynamicPull(tension, self.stiffness, state)


def test_stiff_tendons_are_stable_and_balance() -> None:
    """1 N/um: steps that knew only the tension would diverge within a few."""
    finger = index(replace(springy(), damping=np.full(4, 2e-3)), FREE)
    n = len(finger.tendons)
    muscles = Elastic(np.full(n, 1.0), np.full(n, 1e6))
    s = require_rest(simulate(FingerDynamics(finger, finger.start(POSTURE), muscles), 1.0))
    start = finger.start(POSTURE)
    stretched = finger.tendon_lengths(s.angles[-1]) - finger.tendon_lengths(start.angles)
    np.testing.assert_allclose(s.tension[-1], 1.0 + 1e6 * stretched, atol=1e-3)
    torque = finger.moment_arms(s.angles[-1]).T @ s.tension[-1]
    torque += finger.law.passive(s.angles[-1])[0] + finger.law.limit(s.angles[-1])[0]
    np.testing.assert_allclose(torque, 0.0, atol=1e-5)


def test_a_straight_torque_curve_is_a_spring() -> None:
    spring = joint_law(JOINTS, STIFF, POSTURE, damping=dict.fromkeys(JOINTS, 1e-3))
    lines = {
        j: TorqueCurve(
            (-2.0, 0.0, 2.0), tuple(-0.04 * (q - POSTURE.get(j, 0.0)) for q in (-2, 0, 2))
        )
        for j in JOINTS
    }
    curved = joint_law(JOINTS, damping=dict.fromkeys(JOINTS, 1e-3), curves=lines)
    one, other = (run(index(law, FREE), duration=0.2) for law in (spring, curved))
    np.testing.assert_allclose(other.angles, one.angles, atol=1e-9)
    assert other.energy.joints_stored == pytest.approx(one.energy.joints_stored, rel=1e-9)


def test_a_finger_that_still_moves_is_a_failure() -> None:
    s = swing(0.5, 1e-3, 0.2)
    assert not s.at_rest
    with pytest.raises(ConvergenceError, match=r"did not come to rest in 0\.2 s.*Try"):
        require_rest(s)


@pytest.mark.parametrize(("duration", "dt"), [(0.1, 0.03), (0.05, 1e-3), (1.0, 0.0), (1.0, -1e-3)])
def test_durations_that_are_refused(duration: float, dt: float) -> None:
    with pytest.raises(InputError, match="multiple of the step"):
        swing(0.1, dt, duration)


def test_a_step_that_cannot_be_taken_is_told() -> None:
    """A tension beyond all bounds: not even a step halved eight times converges."""
    finger = index(springy())
    pull = ConstantTension(np.full(len(finger.tendons), 1e12))
    dynamics = FingerDynamics(finger, finger.start(POSTURE), pull, Cage())
    with pytest.raises(ConvergenceError, match=r"t = .*did not converge.*Try a smaller step"):
        simulate(dynamics, 0.1)
