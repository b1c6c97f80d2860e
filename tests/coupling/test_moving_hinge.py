"""The planar finger in motion, against its equations and their integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from cosim.errors import ConvergenceError, InputError
from cosim.port import AffineLoad, Array, Motion
from rigid.chain.hinge import JOINTS, HingeFinger
from rigid.chain.joint_torques import JointLaw, TorqueCurve, joint_law, limit_torque
from rigid.chain.planar_chain import BUCHNER, PlanarChain
from tests.helpers import moving_hinge
from tests.helpers.fingers import LENGTHS
from tests.helpers.moving_hinge import HingeMoment, MovingHinge, inverse_dynamics

NONE = np.zeros(0)


def law(damped: bool = True) -> JointLaw:
    return joint_law(
        JOINTS,
        {"MCP": 0.2, "PIP": 0.12, "DIP": 0.08},
        {"MCP": 0.7, "PIP": 0.9, "DIP": 0.4},
        lower={"MCP": 0.1},
        limit_stiffness=2.0,
        limit_damping=1e-3 if damped else 0.0,
        damping={"PIP": 1e-3} if damped else None,
    )


def finger(order: int = 1, damped: bool = True) -> MovingHinge:
    return MovingHinge(BUCHNER, law(damped), order)


def one_link(order: int = 1) -> MovingHinge:
    links = PlanarChain(*(np.array([x]) for x in (0.046, 0.02, 0.03, 5e-6)))
    return MovingHinge(links, joint_law(JOINTS[:1], {"MCP": 0.05}, damping={"MCP": 5e-4}), order)


def no_load(f: MovingHinge) -> AffineLoad:
    n = 6 * len(f.bodies)
    return AffineLoad(f.motion(np.zeros(len(f.joints))), np.zeros((n // 6, 6)), np.zeros((n, n)))


def some_load(f: MovingHinge, q: Array) -> AffineLoad:
    """In the plane and out of it, with a tangent that is neither symmetric nor small."""
    rng, nb = np.random.default_rng(5), len(f.bodies)
    scale = np.tile([1.0, 1, 1, 0.01, 0.01, 0.01], nb)
    by_motion = rng.normal(size=(6 * nb, 6 * nb)) * scale[:, None] * 10
    return AffineLoad(f.motion(q), rng.normal(size=(nb, 6)) * scale[:6], by_motion)


def differences(f, x: Array, h: float = 1e-6) -> Array:
    return np.array([(f(x + s) - f(x - s)) / (2 * h) for s in h * np.eye(len(x))]).T


def test_inverse_dynamics_undoes_the_papers_accelerations_and_has_exact_derivatives():
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v, a = rng.normal(size=(3, 3)) * [[1], [10], [100]]
        torque, by_angle, by_rate, by_acceleration = inverse_dynamics(BUCHNER, q, v, a)
        back = BUCHNER.acceleration(q, v, torque, np.zeros(2))
        np.testing.assert_allclose(back, a, rtol=0, atol=1e-10)
        for found, part, x in (
            (by_angle, lambda x, v=v, a=a: inverse_dynamics(BUCHNER, x, v, a)[0], q),
            (by_rate, lambda x, q=q, a=a: inverse_dynamics(BUCHNER, q, x, a)[0], v),
            (by_acceleration, lambda x, q=q, v=v: inverse_dynamics(BUCHNER, q, v, x)[0], a),
        ):
            np.testing.assert_allclose(found, differences(part, x), rtol=0, atol=1e-8)


def test_the_kinematics_are_the_hinge_fingers():
    still = HingeFinger(LENGTHS)
    links = PlanarChain(np.array(LENGTHS), BUCHNER.centre, BUCHNER.mass, BUCHNER.inertia)
    moving = MovingHinge(links, joint_law(JOINTS))
    q = np.array([0.5, -0.3, 1.1])
    state = still.start(dict(zip(JOINTS, q, strict=True)))
    assert moving.bodies == still.bodies
    np.testing.assert_allclose(moving.motion(q).position, still.motion(state).position)
    np.testing.assert_allclose(moving.motion(q).rotation, still.motion(state).rotation)
    np.testing.assert_allclose(moving.jacobian(q), still.jacobian(state), atol=1e-15)


@pytest.mark.parametrize("past", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_a_step_keeps_the_equations_at_its_end(order, past):
    """The load is the one at the new poses, the limit (MCP) and the damping act there too."""
    f, dt = finger(order), 2e-3
    q, v = np.array([0.06, 0.6, 0.2]), np.array([-5.0, 8.0, 3.0])
    before = (q - 1.1e-3 * v, 0.9 * v, 1e-3) if past else (q, v, np.inf)
    load = some_load(f, q + 0.1)
    after = f.step(HingeMoment(q, v, 0.25, before), load, NONE, dt)
    new, rate = after.angles, after.rates
    twist = load.at.twist_to(f.motion(new)).ravel()
    pushed = f.jacobian(new).T @ (load.wrench.ravel() + load.by_motion @ twist)
    torque = pushed + f.law.passive(new)[0] + f.law.limit(new)[0] + f.law.viscous(new, rate)[0]
    acceleration = BUCHNER.acceleration(new, rate, torque, np.zeros(2))
    if order == 2 and past:  # r = 2 in the formula of order 2
        change = lambda y, y0, y1: (y - 9 / 5 * y0 + 4 / 5 * y1) / (dt * 3 / 5)  # noqa: E731
        assert change(new, q, before[0]) == pytest.approx(rate, rel=1e-10)
        assert change(rate, v, before[1]) == pytest.approx(acceleration, rel=1e-8)
    else:
        assert (new - q) / dt == pytest.approx(rate, rel=1e-10)
        assert (rate - v) / dt == pytest.approx(acceleration, rel=1e-8)
    assert after.time == 0.25 + dt
    assert f.law.limit(new)[0][0] > 1e-3


def test_newtons_slope_is_the_derivative():
    f, k = finger(), 1e-2
    q, v = np.array([0.3, 0.6, 0.2]), np.array([-5.0, 8.0, 3.0])
    load = some_load(f, q)

    def residual(v: Array) -> Array:
        return f._residual(q + k * v, v, (v - 1.0) / k, k, load)[0]

    slope = f._residual(q + k * v, v, (v - 1.0) / k, k, load)[1]
    assert np.abs(differences(residual, v) - slope).max() < 1e-7 * np.abs(slope).max()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("uneven", [False, True])
def test_orders_of_a_pendulum(order, uneven):
    f, load = one_link(order), no_load(one_link(order))

    def slope(t: float, y: Array) -> Array:
        torque = f.law.passive(y[:1])[0] + f.law.viscous(y[:1], y[1:])[0]
        return np.append(y[1], f.links.acceleration(y[:1], y[1:], torque, np.zeros(2)))

    truth = solve_ivp(slope, (0, 0.06), [1.0, 0.0], "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]

    def error(dt: float) -> float:
        state = f.begin({"MCP": 1.0})
        for i in range(round(0.06 / dt)):
            share = 1.0 + (0.5 if i % 2 else -0.5) * uneven
            state = f.step(state, load, NONE, share * dt)
        assert state.time == pytest.approx(0.06)
        return abs(float(state.angles[0] - truth))

    assert np.log2(error(5e-4) / error(2.5e-4)) == pytest.approx(order, abs=0.2)


def test_backward_euler_only_loses_energy_and_order_two_loses_less():
    lost = []
    for order in (1, 2):
        f = finger(order, damped=False)
        state = f.begin({"MCP": 0.3, "PIP": 0.4})
        energies = [f.energy(state)]
        for _ in range(100):
            state = f.step(state, no_load(f), NONE, 5e-4)
            energies.append(f.energy(state))
        lost.append(energies[0] - energies[-1])
        if order == 1:
            assert np.diff(energies).max() < 0
    assert abs(lost[1]) < 0.2 * lost[0]


@pytest.mark.parametrize("q", [0.05, -0.05, 1.3])
def test_the_limits_energy_is_their_work(q):
    """In the transition, beyond it, and above the upper limit."""
    limits = joint_law(JOINTS[:1], lower={"MCP": 0.1}, upper={"MCP": 1.2}, limit_stiffness=3.0)
    weightless = PlanarChain(*(np.array([x]) for x in (0.046, 0.0, 1e-3, 1e-6)), gravity=0.0)
    f = MovingHinge(weightless, limits)

    def torque(q: float) -> float:
        return float(limit_torque(np.array([q]), limits.lower, limits.upper, 3.0)[0][0])

    work = quad(torque, 0.5, q, points=[0.1, 0.1 - limits.transition, 1.2], epsabs=1e-14)[0]
    assert f.energy(f.begin({"MCP": q})) == pytest.approx(-work, rel=1e-9)
    assert work < -1e-6


def test_a_step_repeats_with_the_same_bits():
    f = finger(2)
    load = some_load(f, np.zeros(3))
    state = f.step(f.begin({"MCP": 0.5}), load, NONE, 1e-3)
    first = f.step(state, load, NONE, 1e-3)
    f.step(first, load, NONE, 2e-3)
    again = f.step(state, load, NONE, 1e-3)
    assert np.array_equal(first.angles, again.angles)
    assert np.array_equal(first.rates, again.rates)


def test_wrong_inputs_are_refused():
    f = finger()
    state, load = f.begin({}), no_load(f)
    with pytest.raises(InputError, match="one to 3 links"):
        MovingHinge(BUCHNER, joint_law(JOINTS[:2]))
    curved = joint_law(JOINTS, curves={"PIP": TorqueCurve((0.0, 1.0), (0.0, -1.0))})
    with pytest.raises(InputError, match="curves of PIP"):
        MovingHinge(BUCHNER, curved)
    with pytest.raises(InputError, match="unknown joint thumb"):
        f.begin({"thumb": 0.1})
    with pytest.raises(InputError, match="no tendons"):
        f.step(state, load, np.ones(1), 1e-3)
    for dt in (0.0, -1e-3, np.inf, np.nan):
        with pytest.raises(InputError, match="positive steps"):
            f.step(state, load, NONE, dt)
    short = one_link()
    with pytest.raises(InputError, match="load on bodies"):
        f.step(state, no_load(short), NONE, 1e-3)
    assert isinstance(short.motion(np.ones(1)), Motion)


def test_a_step_that_does_not_converge_is_an_error(monkeypatch):
    f = finger()
    state, load = f.begin({"MCP": 0.05}), some_load(f, np.zeros(3))
    f.step(state, load, NONE, 1e-2)
    monkeypatch.setattr(moving_hinge, "MOST_ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match=r"t = 0.01 s did not converge in 2 .*than 0.01 s"):
        f.step(state, load, NONE, 1e-2)
