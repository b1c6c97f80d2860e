"""Friction of tendons at their guides: the capstan's law, virtual work, balance, hysteresis."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cosim.errors import InputError
from cosim.port import Load
from meshes.skeleton import index_finger
from rigid.chain.kinematics import body_jacobian
from rigid.fingers.index import finger_model
from rigid.fingers.robot import robot_finger
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tendon_friction import (
    FrictionStep,
    GuideReadings,
    TendonFriction,
    TendonGuides,
)

MU = 0.12
HUMAN, ROBOT = finger_model(index_finger(), central=0.5), robot_finger()
POSTURE = np.radians([38.0, 4.0, 51.0, 22.0])


def rubbing(model, mu=MU, sliding="loading"):
    finger = MujocoFinger(model)
    return finger.with_friction({t: TendonFriction(mu, sliding) for t in finger.tendons})


def wheel(kind, *, through=0.0, rise=0.0, side=True):
    """A tendon along x, a quarter round a wheel of 20 mm about y and down to a body that turns
    about the same axis."""
    geom = "cylinder" if kind == "cylinder" else "sphere"
    size = "0.02 0.1" if kind == "cylinder" else "0.02"
    return f"""
    <mujoco><worldbody>
      <site name="a" pos="-0.1 {through} 0.02"/>
      <geom name="wheel" type="{geom}" size="{size}" zaxis="0 1 0" contype="0" conaffinity="0"/>
      <site name="side" pos="0.03 0 0.03"/>
      <body name="b"><joint axis="0 -1 0"/><geom size="0.001" mass="1" pos="0.02 0 -0.1"/>
        <site name="b" pos="0.02 {through + rise} -0.1"/></body>
    </worldbody><tendon><spatial name="t"><site site="a"/>
      <geom geom="wheel" sidesite="side"/><site site="b"/></spatial></tendon></mujoco>"""


def quarter(text, mu=0.3, sliding="loading"):
    """The force at the wheel's rim per N of the muscle, the angle, and the wrenches."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    guides = TendonGuides(model, ("t",), {"t": TendonFriction(mu, sliding)})
    readings = guides.read(data)
    arms = readings.arms(guides.grip, np.zeros((1, model.nv)))
    return (
        arms[0, 0] / 0.02,
        readings.turn.sum() / mu,
        guides.wrenches(data, np.ones(1), guides.grip),
    )


@pytest.mark.parametrize("kind", ["cylinder", "sphere"])
@pytest.mark.parametrize(
    ("sliding", "sign"), [("loading", -1), ("unloading", 1), ("frictionless", 0)]
)
def test_a_quarter_turn_round_a_wheel_leaves_exp_of_mu_theta(kind, sliding, sign):
    force, turn, _ = quarter(wheel(kind), sliding=sliding)
    assert turn == pytest.approx(np.pi / 2, rel=1e-12)
    assert force == pytest.approx(np.exp(sign * 0.3 * np.pi / 2), rel=1e-12)


def test_a_helix_turns_by_the_sum_of_its_curvature():
    _, turn, wrenches = quarter(wheel("cylinder", rise=0.05))
    around, straight = 0.02 * np.pi / 2, 0.2
    cosine = (around + straight) / np.hypot(around + straight, 0.05)
    assert turn == pytest.approx(np.pi / 2 * cosine, rel=1e-12)
    assert np.abs(wrenches[0].sum(axis=0)).max() < 1e-16  # both bodies stand at the origin


@pytest.mark.parametrize("model", [HUMAN, ROBOT], ids=["human", "robot"])
def test_without_friction_the_torques_are_those_of_the_path(model):
    bare, grip = MujocoFinger(model), rubbing(model, sliding="frictionless")
    arms = bare.moment_arms(POSTURE)
    assert np.abs(grip.torques_per_tension(POSTURE) - arms).max() < 1e-15
    tension = np.arange(1.0, len(bare.tendons) + 1)
    ours, theirs = (f.own_wrenches(POSTURE, tension) for f in (grip, bare))
    assert max(np.abs(ours[t] - theirs[t]).max() for t in bare.tendons) < 1e-13


@pytest.mark.parametrize("model", [HUMAN, ROBOT], ids=["human", "robot"])
def test_friction_keeps_wrenches_torques_and_work_together(model):
    finger, rng = rubbing(model), np.random.default_rng(1)
    guides, bare = finger.guides, MujocoFinger(model)
    for _ in range(3):
        q, v = rng.uniform(0.0, 1.0, 4), rng.normal(size=4)
        grip, tension = rng.uniform(-1, 1, len(guides.owner)), rng.uniform(1, 9, len(bare.tendons))
        readings = guides.read(finger.at_angles(q))
        arms = bare.moment_arms(q)
        torque = readings.arms(grip, arms)
        wrenches = finger.own_wrenches(q, tension, grip)
        turns = body_jacobian(finger.chain(q))
        for t, name in enumerate(finger.tendons):
            assert turns.T @ wrenches[name].ravel() == pytest.approx(
                tension[t] * torque[t], abs=1e-14
            )
            pulled = wrenches[name]
            moment = pulled[:, 3:] + np.cross(finger.chain(q).motion.position, pulled[:, :3])
            assert np.abs(pulled[:, :3].sum(axis=0)).max() < 1e-13
            assert np.abs(moment.sum(axis=0)).max() < 1e-14
        before, beyond = readings.factors(grip)
        lost = tension[readings.owner] * (before - beyond) @ (readings.slides @ v)
        assert lost == pytest.approx(tension @ (arms - torque) @ v, abs=1e-14)


@pytest.mark.parametrize("model", [HUMAN, ROBOT], ids=["human", "robot"])
def test_the_tangent_with_friction_is_the_derivative_of_the_torques(model):
    finger, tension, step = rubbing(model), np.full(len(model.muscles), 5.0), 1e-4
    torque = lambda q: np.sum(list(finger.own_torques(q, tension).values()), axis=0)  # noqa: E731
    columns = [(torque(POSTURE + e) - torque(POSTURE - e)) / (2 * step) for e in step * np.eye(4)]
    assert finger.own_tangent(POSTURE, tension) == pytest.approx(np.array(columns).T, abs=2e-7)


def test_the_ledger_closes_with_friction():
    finger = rubbing(HUMAN)
    state = finger.start(dict(zip(finger.joints, POSTURE, strict=True)))
    bodies = finger.bodies
    none = Load(bodies, ("none",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    tension = np.full(len(finger.tendons), 4.0)
    ledger = finger.ledger(state, none, tension)
    assert np.abs(np.sum(list(ledger.values()), axis=0)[:, :3]).max() < 1e-12
    torque = finger.balance(state, none, tension).torque
    turns = body_jacobian(finger.chain(POSTURE))
    for name in finger.tendons:
        assert turns.T @ ledger[name].ravel() == pytest.approx(torque[name], abs=1e-14)


def test_the_order_in_which_tendons_are_named_plays_no_part():
    tension = np.full(len(HUMAN.muscles), 4.0)
    several = ("FDS", "EDC", "FDP")
    rubs = [
        MujocoFinger(HUMAN).with_friction({t: TendonFriction(MU) for t in names})
        for names in (several, several[::-1])
    ]
    torques = [finger.own_torques(POSTURE, tension) for finger in rubs]
    alone = rubbing(HUMAN).own_torques(POSTURE, tension)
    for name in several:
        assert np.array_equal(torques[0][name], torques[1][name])
        assert torques[0][name] == pytest.approx(alone[name], rel=1e-12)
    assert torques[0]["LUM"] == pytest.approx(
        MujocoFinger(HUMAN).own_torques(POSTURE, tension)["LUM"]
    )


def test_friction_of_a_tendon_that_a_finger_lacks_is_refused():
    with pytest.raises(InputError, match="friction of XYZ"):
        MujocoFinger(HUMAN).with_friction({"XYZ": TendonFriction(0.1)})


def one_guide(turn=0.09, arm=0.01):
    """Readings of one tendon that turns by mu theta round one guide, with a moment arm of `arm`."""
    places = np.zeros(3, dtype=np.intp)
    part = np.array([[0.0], [-arm], [0.0]])
    return GuideReadings(
        np.array([0.0, turn, 0.0]),
        part,
        np.ones(3),
        places,
        places,
        np.zeros(3),
        np.array([[arm], [arm], [0.0]]),
    )


def slide(readings, turns, tension, presliding):
    """The grips and works over steps that turn the joint by `turns` (n,) rad each."""
    grip, works, grips = np.zeros(3), [], []
    for turned in np.asarray(turns)[:, None]:
        step = FrictionStep(
            readings, np.full(3, presliding), np.array([[0.01]]), grip,
            np.array([tension]), np.zeros(1), np.zeros(1),
        )  # fmt: skip
        after = step.grip_after(turned)
        works.append(step.work(after, turned, np.array([tension])))
        grip = after
        grips.append(grip[1])
    return np.array(grips), np.array(works)


def test_a_cycle_of_slides_loses_the_closed_form_of_its_loop():
    turn, tension, presliding, half = 0.09, 7.0, 1e-4, 2e-3
    quarter = np.full(400, half / 0.01 / 400)
    cycle = np.concatenate([quarter, -quarter, -quarter, quarter])
    grips, works = slide(one_guide(turn), np.tile(cycle, 2), tension, presliding)
    lost, held, _ = works[len(cycle) :].sum(axis=0)
    wanted = 4 * (half - presliding) * tension * np.sinh(turn)
    assert lost == pytest.approx(wanted, rel=1e-10)
    assert held == pytest.approx(0.0, abs=1e-6 * lost)
    assert (works[:, 0] >= 0).all()
    assert grips[399] == 1.0
    assert grips[3 * 400 - 1] == -1.0


def test_a_small_slide_to_and_fro_loses_nothing():
    grips, works = slide(one_guide(), np.array([2e-3, -2e-3] * 5), 7.0, 1e-4)
    assert works[:, 0] == pytest.approx(0.0, abs=1e-20)
    assert grips == pytest.approx([0.2, 0.0] * 5)


def test_friction_in_a_motion_does_not_depend_on_the_speed():
    turns = np.concatenate([np.full(50, 0.01), np.full(30, -0.01)])
    fine = np.repeat(turns / 10, 10)
    coarse = slide(one_guide(), turns, 7.0, 1e-3)
    assert slide(one_guide(), fine, 7.0, 1e-3)[0][-1] == pytest.approx(coarse[0][-1])


def test_a_stretching_tendon_slides_as_its_tension_rises():
    """In a still finger, by the part of its stretch that lies beyond a guide."""
    model = {t: TendonFriction(MU, "frictionless", 1e-3, 20e3) for t in ("FDP",)}
    finger = MujocoFinger(HUMAN).with_friction(model)
    readings = finger.guides.read(finger.at_angles(POSTURE))
    give = readings.give
    assert give[0] == pytest.approx(1 / 20e3)
    assert give[-1] == 0.0
    assert (np.diff(give) <= 0).all()
    arms, n = finger.moment_arms(POSTURE), len(give)
    rise = np.where(np.array(finger.tendons) == "FDP", 3.0, 0.0)
    step = FrictionStep(readings, np.full(n, 1e-3), arms, np.zeros(n), rise, 0 * rise, rise)
    grip = step.grip_after(np.zeros(4))
    assert grip == pytest.approx(np.minimum(3.0 * give / 1e-3, 1.0))
    work = step.work(grip, np.zeros(4), rise)
    assert work.from_stretch >= work.lost + work.held > 0


@pytest.mark.parametrize(
    ("around", "turn"), [(20, 20), (90, 90), (179, 179), (200, 200), (260, 260), (-10, 0)]
)
def test_an_arc_turns_by_its_angle_and_one_on_the_inner_side_by_none(around, turn):
    """Round the wheel from its top on; contacts in the other order are rounding's, and no turn."""
    model = mujoco.MjModel.from_xml_string(wheel("cylinder"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    guides = TendonGuides(model, ("t",), {"t": TendonFriction(0.3)})
    place = np.array([model.geom("wheel").id])
    at = np.flatnonzero(guides._what == place)
    begin, came = np.array([[0.0, 0.0, 0.02]]), np.array([[1.0, 0.0, 0.0]])
    phi = np.radians(around)
    end = 0.02 * np.array([[np.sin(phi), 0.0, np.cos(phi)]])
    assert guides._arcs(data, at, begin, end, came)[0] == pytest.approx(np.radians(turn))


def test_a_tendon_turns_inside_a_ring_by_the_angle_between_its_straight_parts():
    """A ring of 20 mm draws a tendon that runs 50 mm above its axis down to one point."""
    text = """
    <mujoco><worldbody><site name="a" pos="-0.1 0 0.05"/>
      <geom name="ring" type="cylinder" size="0.02 0.1" zaxis="0 1 0"/><site name="in"/>
      <body><joint axis="0 1 0"/><geom size="0.001" mass="1"/><site name="b" pos="0.1 0 0.05"/>
    </body></worldbody><tendon><spatial name="t"><site site="a"/><geom geom="ring" sidesite="in"/>
      <site site="b"/></spatial></tendon></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn = TendonGuides(model, ("t",), {"t": TendonFriction(0.3)}).read(data).turn.sum() / 0.3
    assert turn == pytest.approx(2 * np.arctan(0.03 / 0.1), rel=1e-6)
