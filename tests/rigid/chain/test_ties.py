"""Ties from bone to bone: closed forms, balance, derivatives, at rest and in a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cosim
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.results.conventions import COMPONENTS
from meshes.skeleton import JOINTS
from rigid.chain.support import HELD
from rigid.chain.ties import TOE, Ties
from rigid.fingers.index import finger_model
from rigid.mujoco.finger import MujocoFinger
from tests.helpers.fingers import LENGTHS, loaded_state, mujoco_finger, straight_skeleton
from tests.helpers.motions import PLAIN

FREE = (
    PLAIN,
    'finger.tip.kind="free"',
    'finger.limit.half_range="60 deg"',
    *(
        f'finger.passive.{j}={{stiffness="0.1 N*m/rad",rest="posture",damping="0.002 N*m*s/rad"}}'
        for j in JOINTS
    ),
)
PULL = 'tendons={EDC={tension="8 N"},FDP={tension="0.6 N"}}'
SLIP = (
    'finger.tie.fds={bones=["proximal","middle"],at=[["30 mm","0 mm","-5 mm"],'
    '["6 mm","0 mm","-5 mm"]],stiffness="50 N/mm",taut={PIP="40 deg"}}'
)


def ties() -> Ties:
    """One over the PIP, and a slanted one over two joints."""
    pip = [[0.035, 0.001, -0.005], [0.006, -0.002, -0.004]]
    long = [[-0.01, 0.004, -0.006], [0.01, 0.0, -0.004]]
    point, length = np.array([pip, long]), np.array([0.011, 0.05])
    return Ties(("pip", "long"), np.array([[1, 2], [0, 2]]), point, np.array([3e4, 2e4]), length)


def test_of_a_hinge_it_pulls_with_the_arm_of_a_triangle():
    finger = MujocoFinger(finger_model(straight_skeleton()), support=HELD)
    a, b = np.hypot(0.012, 0.005), np.hypot(0.007, 0.004)
    point = np.array([[[LENGTHS[0] - 0.012, 0.0, -0.005], [0.007, 0.0, -0.004]]])
    tie = Ties(("t",), np.array([[1, 2]]), point, np.array([3e4]), np.array([0.01]))
    between = np.arctan2(0.005, 0.012) + np.arctan2(0.004, 0.007)
    for flexion in (0.0, 0.3, 0.6):
        angle = np.pi - between - flexion
        way = np.sqrt(a * a + b * b - 2 * a * b * np.cos(angle))
        tension = 3e4 * (way - 0.01)
        chain = finger.chain(np.array([0.2, 0.0, flexion, 0.3]))
        assert way > 0.01 + TOE
        assert tie.pull(chain).tension == pytest.approx([tension], rel=1e-12)
        torque = tie.torques(chain)
        arm = a * b * np.sin(angle) / way
        assert torque[2] == pytest.approx(tie.pull(chain).tension[0] * arm, rel=1e-12)
        assert torque[[0, 1, 3]] == pytest.approx(0, abs=1e-12)


def test_torque_tangent_and_energy_are_one_law():
    finger, made = mujoco_finger(HELD), ties()
    q = finger.start({"MCP": 0.4, "MCP_abduction": 0.1, "PIP": 0.3, "DIP": 0.2}).angles
    chain = finger.chain(q)
    assert (made.pull(chain).tension > 1).all()
    step, torque = 1e-6, made.torques(chain)
    for i, e in enumerate(step * np.eye(4)):
        up, down = finger.chain(q + e), finger.chain(q - e)
        slope = (made.torques(up) - made.torques(down)) / (2 * step)
        np.testing.assert_allclose(made.tangent(chain)[:, i], slope, rtol=1e-6, atol=1e-7)
        rise = (made.energy(up) - made.energy(down)) / (2 * step)
        assert -rise == pytest.approx(torque[i], rel=1e-6, abs=1e-8)
    whole = made.wrenches(chain)
    at = chain.motion.position
    assert whole[:, :3].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    moment = whole[:, 3:].sum(axis=0) + np.cross(at, whole[:, :3]).sum(axis=0)
    assert moment == pytest.approx(np.zeros(3), abs=1e-12)
    slack = replace(made, length=np.array([1.0, 1.0]))
    assert not slack.torques(chain).any()
    assert not slack.tangent(chain).any()


def test_the_tangent_of_the_balance_has_them_and_the_ledger_closes():
    finger = mujoco_finger(HELD).with_ties(ties())
    state, load, tension = loaded_state(finger)
    n = len(finger.unknowns(state))
    tangent = finger.tangent(state, load, tension, np.zeros((24, 24)))
    for i, step in enumerate(1e-6 * np.eye(n)):
        up, down = (
            finger.balance(finger.displace(state, s), load, tension).residual for s in (step, -step)
        )
        np.testing.assert_allclose(tangent[:, i], (up - down) / 2e-6, rtol=1e-5, atol=2e-5)
    books = finger.ledger(state, load, tension)
    assert np.abs(books["tie"]).max() > 0.1
    whole = load.total() + np.sum([*books.values()], axis=0)
    assert np.abs(whole).max() < 1e-9


def run(*settings: str) -> cosim.Result:
    return cosim.run(load_case("pulley_edc", [*FREE, *settings]))


def test_a_tie_takes_a_joint_out_of_extension_and_bears_what_the_tendons_leave():
    bare, tied = run(PULL), run(PULL, SLIP)
    assert bare.summary["posture_deg"]["PIP"] < 36
    assert 38 < tied.summary["posture_deg"]["PIP"] < 40
    force = tied.summary["tie_force_N"]["fds"]
    assert force > 2
    torque = tied.summary["joint_torque_Nmm"]["tie"]
    assert torque["PIP"] > 0
    assert torque["MCP"] == pytest.approx(0, abs=1e-6)
    pressed = [np.linalg.norm([*r.summary["joint_force_N"]["PIP"].values()]) for r in (bare, tied)]
    assert pressed[1] > pressed[0] + 0.8 * force
    assert tied.audit.passed
    sums = tied.ledger.groupby(["state", "body"])[[*COMPONENTS]].sum()
    assert np.abs(sums.to_numpy()).max() < 1e-6
    flexed = run('tendons.FDP.tension="1 N"', SLIP)
    assert flexed.summary["tie_force_N"]["fds"] == 0


def test_a_motion_on_a_tie_comes_to_rest_where_the_equilibrium_is():
    ramp = 'tendons.{}.signal={{kind="points",at=[["0 s",0.0],["0.05 s",1.0]]}}'
    move = 'forward={duration="0.5 s",step="1 ms",must_rest=false}'
    signals = [ramp.format(name) for name in ("EDC", "FDP")]
    still = 'solve.resting_tension="0 N"'
    aim, end = run(PULL, SLIP, still), run(PULL, SLIP, still, move, *signals)
    for joint, angle in aim.summary["posture_deg"].items():
        assert end.summary["posture_deg"][joint] == pytest.approx(angle, abs=0.02)
    force = aim.summary["tie_force_N"]["fds"]
    assert end.summary["tie_force_N"]["fds"] == pytest.approx(force, rel=5e-3)
    energy = end.summary["energy_mJ"]
    assert abs(energy["artificial"]) < 0.02 * (energy["tendons"] + energy["own_tendons"])
    assert end.audit.passed
    sums = end.ledger.groupby(["state", "body"])[[*COMPONENTS]].sum()
    assert np.abs(sums.to_numpy()).max() < 1e-9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"middle"]', '"proximal"]'), "names one bone twice"),
        (
            ('["30 mm","0 mm","-5 mm"]', '["20 mm","0 mm","5 mm"]'),
            "mm deep through the .* bone where it comes taut",
        ),
        (('taut={PIP="40 deg"}', 'slack="-10 mm",taut={PIP="90 deg"}'), "shorter than nothing"),
        (('"middle"]', '"thumb"]'), "thumb"),
        (("PIP=", "thumb="), "thumb"),
        (('"50 N/mm"', '"0 N/mm"'), "stiffness"),
    ],
)
def test_what_makes_no_sense_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        run(SLIP.replace(*change))
