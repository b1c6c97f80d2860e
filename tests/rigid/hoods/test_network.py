"""The tendon network against its own springs, and its hood behind the port."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from cases.papers.models.networks.human_network import (
    MUSCLES,
    OPERATING_FORCE,
    STIFFNESS,
    TENDONS,
    human_finger,
)
from cosim.errors import InputError
from cosim.port import STATIC, Array, Motion
from meshes.skeleton import BODIES, index_finger
from rigid.chain.hinge import HingeFinger
from rigid.fingers.index import finger_model
from rigid.hoods.joint_angles import Joint, JointChain, flexion_joints, hinges_between
from rigid.hoods.network import Arms, Network, junction
from rigid.hoods.network_hood import NetworkHood
from rigid.hoods.two_band import JOINTS
from tests.helpers import conformance, networks

EDC, LUM, UI = range(3)
ES, LB = TENDONS.index("EDC slip"), TENDONS.index("EDC radial")


def random_states(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Postures (count, 3) rad and forces of all six muscles (count, 6) N."""
    rng = np.random.default_rng(seed)
    posture = rng.uniform([-0.5, 0.0, 0.0], [1.6, 1.9, 1.3], (count, 3))
    return posture, rng.uniform(0.01, 60.0, (count, 6))


def best_set(length: Array, stiffness: Array, force: float) -> Array:
    """Tensions of springs on one junction: every set of bearing springs is tried."""
    n = len(length)
    for size in range(1, n + 1):
        for some in map(list, combinations(range(n), size)):
            k = stiffness[some]
            position = (force + k @ length[some]) / k.sum()
            gap = position - length
            if (gap[some] >= 0).all() and (np.delete(gap, some) <= 0).all():
                return np.where(np.isin(np.arange(n), some), stiffness * gap, 0.0)
    raise AssertionError("no set of springs is in equilibrium")


def test_a_junction_is_the_equilibrium_of_its_springs():
    """Against all sets of bearing springs, and against a root search on the sum of the forces."""
    rng = np.random.default_rng(3)
    for n in range(1, 6):
        for _ in range(60):
            length, k = rng.normal(0, 2e-3, n), rng.uniform(1e3, 2e5, n)
            force = float(rng.uniform(0.01, 50))
            found = junction(length, k, np.array(force))
            assert found.tension == pytest.approx(best_set(length, k, force), abs=1e-10 * force)

            def excess(s, x=length, k=k, f=force):
                return float(k @ np.maximum(s - x, 0.0) - f)

            root = brentq(excess, length.min(), length.max() + 1.0, xtol=1e-16)
            assert found.position == pytest.approx(root, abs=1e-13)


def test_an_unpulled_junction_rests_at_its_shortest_tendon():
    found = junction(np.array([2e-3, -1e-3, 0.0]), np.full(3, 1e4), np.array(0.0))
    assert found.position == -1e-3
    assert (found.tension == 0.0).all()


def test_the_network_is_its_junctions():
    """1000 postures and loads at once, each muscle's tendons against all sets of springs."""
    network, (posture, force) = human_finger(), random_states(1000)
    _, tension = network.solve(posture, force)
    length = network.lengths(posture)
    for n in range(0, 1000, 5):
        for i, own in enumerate(network.connection.T.astype(bool)):
            if own.any():
                known = best_set(length[n, own], network.stiffness[own], force[n, i])
                assert tension[n, own] == pytest.approx(known, abs=1e-10 * force[n, i])
    assert tension @ network.connection == pytest.approx(
        force * network.connection.any(axis=0), rel=1e-13
    )
    assert (tension >= 0).all()
    assert (tension == 0).mean() > 0.1, "some of the states have slack tendons"


def test_the_human_finger_is_the_papers():
    network = human_finger()
    assert network.muscles == ("EDC", "LUM", "UI", "RI", "FDP", "FDS")
    ones = {(int(j) + 1, int(i) + 1) for j, i in np.argwhere(network.connection)}
    assert ones == {(1, 3), (2, 3), (3, 1), (4, 1), (5, 1), (6, 2), (7, 2)}
    assert network.stiffness == pytest.approx([43e3, 75e3, 40e3, 126e3, 40e3, 75e3, 43e3])
    assert OPERATING_FORCE == 10.0
    arm = network.connecting.at(np.array([0.3, 0.0, 0.2]))
    assert arm[:, ES] == pytest.approx([0, -5e-3, 0])
    assert arm[:, LB] == pytest.approx([0, -5e-3, -3.5e-3])
    bent = network.connecting.at(np.array([0.3, 1.0, 0.2]))
    assert bent[1, LB] == pytest.approx(-5e-3 + 2 * 1.21e-3)


@pytest.mark.parametrize("muscle", [EDC, LUM, UI])
def test_off_the_switch_the_arm_is_that_of_one_tendon(muscle):
    """Figure 3: above the coupling curve of the lateral bands, below it of the slip."""
    network, force = human_finger(), np.full(6, OPERATING_FORCE)
    dip_leads = network.effective_arms(np.array([0.0, 0.3, 1.0]), force)[:, muscle]
    pip_leads = network.effective_arms(np.array([0.0, 1.7, 0.0]), force)[:, muscle]
    assert dip_leads[1:] == pytest.approx([-5e-3 + 2.42e-3 * 0.3, -3.5e-3], rel=1e-14)
    assert pip_leads[1:] == pytest.approx([-5e-3, 0.0], rel=1e-14)


def test_the_switch_is_sharper_for_stiffer_tendons_and_smaller_forces():
    """Width in the PIP angle of the band in which slip and lateral bands both bear, at DIP 45 deg:
    F / (k_ES dl) and its like, both proportional to f / K."""
    pip = np.linspace(0.0, 1.9, 20001)
    posture = np.stack([0 * pip, pip, np.full_like(pip, np.pi / 4)], axis=-1)

    def width(network: Network, force: float) -> float:
        share = network.distribution(posture, np.full(6, force))[:, ES, EDC]
        return float(np.count_nonzero((share > 0) & (share < 1)) * (pip[1] - pip[0]))

    network = human_finger()
    stiffer = Network(
        network.joints,
        network.muscles,
        network.direct,
        network.connecting,
        10 * network.stiffness,
        network.connection,
        network.rest,
    )
    assert width(stiffer, 10.0) == pytest.approx(width(network, 1.0), abs=2e-4)
    assert width(network, 1.0) < width(network, 10.0) / 8
    assert width(network, 0.01) <= 2e-4


@pytest.mark.parametrize("constant", [False, True])
def test_excursions_are_the_integral_of_the_arms(constant):
    """Along two paths from straight to bent."""
    network, force = human_finger(), np.array([10.0, 4.0, 7.0, 2.0, 20.0, 15.0])
    same = np.full(6, OPERATING_FORCE)
    end = np.array([0.4, 1.3, 0.9])
    t = np.linspace(0, 1, 40001)[:, None]
    for path in (t * end, np.hstack([t, t**2, t**3]) * end):
        middle, step = 0.5 * (path[1:] + path[:-1]), np.diff(path, axis=0)
        if constant:
            arms = network.effective_arms(middle, np.broadcast_to(same, (40000, 6)))
        else:
            shares = network.sharing(middle, np.broadcast_to(force, (40000, 6)))
            arms = network.direct.at(middle) + network.connecting.at(middle) @ shares
        quadrature = np.einsum("pn,pnm->m", step, arms)
        if constant:
            ends = [network.constant_force_excursion(q, same) for q in (path[0], path[-1])]
        else:
            ends = [network.excursion(q, force) for q in (path[0], path[-1])]
        assert ends[1] - ends[0] == pytest.approx(quadrature, abs=1e-7)


def test_a_tendon_with_slack_bears_once_it_is_taken_up():
    """Straight, the slip 0.1 mm longer than laid out: the lateral bands bear up to 80 N/mm x 0.1 mm
    alone; what is more all three share."""
    n, slack = human_finger(), 1e-4
    rest = slack * (np.arange(len(TENDONS)) == ES)
    longer = Network(n.joints, n.muscles, n.direct, n.connecting, n.stiffness, n.connection, rest)
    force = np.array([[8.0], [8.0 + 20.6]]) * (np.arange(6) == EDC)
    slip = longer.solve(np.zeros((2, 3)), force)[1][:, ES]
    assert slip == pytest.approx([0.0, 20.6 * 126 / 206], abs=1e-12)


def test_a_network_refuses_what_does_not_fit():
    n = human_finger()
    with pytest.raises(InputError, match="each connecting tendon on one muscle"):
        Network(n.joints, n.muscles, n.direct, n.connecting, n.stiffness, 0 * n.connection, n.rest)
    with pytest.raises(InputError, match="positive stiffnesses"):
        Network(n.joints, n.muscles, n.direct, n.connecting, -STIFFNESS, n.connection, n.rest)
    with pytest.raises(InputError, match="rest"):
        Network(n.joints, n.muscles, n.direct, n.connecting, n.stiffness, n.connection, n.rest[:3])
    short = Arms(n.direct.constant[:2], n.direct.slope)
    with pytest.raises(InputError, match="direct arms"):
        Network(n.joints, n.muscles, short, n.connecting, n.stiffness, n.connection, n.rest)


def random_motion(seed: int, size: float) -> Motion:
    """Bodies anywhere, turned by up to `size` rad or so each from the last."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.normal(0, size, (4, 3))).as_matrix()
    return Motion(BODIES, rng.normal(0, 0.05, (4, 3)), turn)


HINGES = hinges_between(JOINTS, BODIES)


def test_angles_of_a_finger_are_its_joint_angles():
    skeleton = index_finger()
    posture = {"MCP": 0.5, "PIP": 1.1, "DIP": 0.6}
    motion = Motion(BODIES, *skeleton.pose(posture))
    found = JointChain(flexion_joints(finger_model(skeleton)), BODIES).angles(motion)
    assert found.value == pytest.approx([0.5, 1.1, 0.6], abs=1e-14)
    planar = HingeFinger((0.04, 0.03, 0.02))
    at = JointChain(HINGES, BODIES).angles(planar.motion(planar.start(posture)))
    assert at.value == pytest.approx([0.5, 1.1, 0.6], abs=1e-14)
    rates = planar.jacobian(planar.start(posture))
    assert at.rate @ rates == pytest.approx(np.eye(3), abs=1e-14)


@pytest.mark.parametrize("turn", [-3.1, -2.5, -1.9, 1.9, 2.5, 3.1])
def test_angles_go_on_beyond_a_right_angle(turn):
    child = Rotation.from_rotvec([0, turn, 0]).as_matrix()
    motion = Motion(BODIES[:2], np.zeros((2, 3)), np.stack([np.eye(3), child]))
    assert JointChain(HINGES[:1], BODIES).angles(motion).value == pytest.approx([turn], abs=1e-12)


def test_flexion_is_blind_to_a_turn_about_a_normal_axis():
    flex, aside = (Rotation.from_rotvec(v) for v in ([0, 0.7, 0], [0, 0, 0.3]))
    for turn in (flex * aside, aside * flex):
        motion = Motion(BODIES[:2], np.zeros((2, 3)), np.stack([np.eye(3), turn.as_matrix()]))
        at = JointChain(HINGES[:1], BODIES).angles(motion)
        assert at.value == pytest.approx([0.7], abs=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_rates_of_angles_against_differences(seed):
    """Poses that are no hinge motions, and turns beyond a right angle."""
    motion, step = random_motion(seed, 0.8), 1e-6
    chain = JointChain(HINGES, BODIES)
    found = chain.angles(motion)
    for k in range(24):
        twist = step * np.eye(24)[k]
        ahead, behind = (chain.angles(motion.displace(s * twist)) for s in (1, -1))
        assert found.rate[:, k] == pytest.approx((ahead.value - behind.value) / 2 / step, abs=1e-8)
        slope = (ahead.rate - behind.rate) / 2 / step
        assert found.moment_rate[:, :, k] == pytest.approx(slope, abs=1e-8)


def test_the_hood_makes_the_networks_torques_at_the_joints():
    """torque = r tension at each joint of an analytic finger, and the pull on the metacarpal."""
    finger, network = HingeFinger((0.04, 0.03, 0.02)), human_finger()
    state = finger.start({"MCP": 0.2, "PIP": 0.9, "DIP": 0.3})
    hood = NetworkHood(network, HINGES, finger.motion(finger.start({})))
    tension = np.array([10.0, 4.0, 7.0, 2.0, 20.0, 15.0])
    motion = finger.motion(state)
    _, load, excursion = hood.advance(hood.start(motion), motion, tension, STATIC)
    found = finger.jacobian(state).T @ load.total().ravel()
    at = np.array([0.2, 0.9, 0.3])
    assert found == pytest.approx(network.torque(at, tension), rel=1e-12)
    assert found == pytest.approx(network.effective_arms(at, tension) @ tension, rel=1e-12)
    assert load.total()[0, :3] == pytest.approx([-tension.sum(), 0, 0])
    assert excursion == pytest.approx(network.excursion(at, tension), rel=1e-12)
    bent = NetworkHood(network, HINGES, motion)
    none = bent.advance(bent.start(motion), motion, np.zeros(6), STATIC).excursion
    assert none == pytest.approx(np.zeros(6), abs=1e-17)
    pulled = bent.advance(bent.start(motion), motion, tension, STATIC).excursion
    assert pulled == pytest.approx(excursion - network.excursion(at, np.zeros(6)), rel=1e-9)


@pytest.mark.parametrize(
    "make", [networks.network_hood, networks.constant_force_hood, networks.two_band_hood]
)
def test_forces_and_excursions_are_conjugate_to_eight_digits(make):
    hood, motions, tension, _ = make()
    conformance.check_reciprocity(hood, motions, tension, 1e-8, step=1e-5)


def test_the_last_posture_has_slack_tendons_and_some_that_share():
    _, _, tension, _ = networks.network_hood()
    at = np.array([networks.POSTURES[-1][joint] for joint in JOINTS])
    bears = human_finger().solve(at, tension)[1] > 0
    assert bears.tolist() == [True] * 5 + [False, True]


def test_a_network_hood_refuses_what_it_cannot_be():
    finger, network = HingeFinger((0.04, 0.03, 0.02)), human_finger()
    rest = finger.motion(finger.start({}))
    with pytest.raises(InputError, match="its joints are"):
        NetworkHood(network, HINGES[:2], rest)
    astray = (*HINGES[:2], Joint(("DIP",), "middle", "nail"))
    with pytest.raises(InputError, match=r"unknown are \['nail'\]"):
        NetworkHood(network, astray, rest)
    with pytest.raises(InputError, match="operating force"):
        NetworkHood(network, HINGES, rest, operating_force=0.0)
    hood = NetworkHood(network, HINGES, rest)
    with pytest.raises(InputError, match="none negative"):
        hood.advance(hood.start(rest), rest, np.full(6, -1.0), STATIC)
    with pytest.raises(InputError, match="time step"):
        hood.advance(hood.start(rest), rest, np.ones(6), 0.0)
    with pytest.raises(InputError, match="axis other than zero"):
        Joint(("PIP",), "a", "b", ((0.0, 0.0, 0.0),))


def test_at_the_operating_force_both_laws_agree():
    """With all forces at f_m0 the constant shares are the true ones; elsewhere they are not."""
    finger, network = HingeFinger((0.04, 0.03, 0.02)), human_finger()
    rest, motion = (finger.motion(finger.start(q)) for q in ({}, {"PIP": 0.9, "DIP": 0.3}))
    exact = NetworkHood(network, HINGES, rest)
    constant = NetworkHood(network, HINGES, rest, operating_force=OPERATING_FORCE)

    def loads(force: float) -> list[Array]:
        tension = np.full(len(MUSCLES), force)
        hoods = (exact, constant)
        return [h.advance(h.start(motion), motion, tension, STATIC).load.wrench for h in hoods]

    same, apart = loads(OPERATING_FORCE), loads(4 * OPERATING_FORCE)
    assert same[0] == pytest.approx(same[1], abs=1e-14)
    assert np.abs(apart[0] - apart[1]).max() > 1e-3
