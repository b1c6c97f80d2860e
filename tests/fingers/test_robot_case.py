"""The robotic finger in cases: over its own pulley, and with a network hood in its place."""

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fingers.kinds import finger_model
from cosim.hoods.lumped.build import slip_forces
from cosim.models.build import Models, bone_surfaces, build
from cosim.solve.solvers import solve
from rigid.fingers.robot_tables import LENGTHS, TABLE_III

PULLEYS, NETWORK = "robot_pulleys_extensor", "robot_network_extensor"
FREE = 'finger.tip.kind="free"'
AS_PULLEY = (
    'hood.connecting.to_middle.stiffness="40 N/mm"',
    'hood.connecting.to_proximal.stiffness="40 N/mm"',
)
"""Springs as stiff as the pulley's weights."""
TENSION = 4.0
POSTURE = tuple(f"finger.posture.{joint}=30 deg" for joint in ("MCP", "PIP", "DIP"))


def build_case(name: str, *overrides: str) -> Models:
    return build(load_case(name, (FREE, *overrides)))


def hood_at(models: Models, posture):
    """Its state under the tension, and (nq,) m, the arms of its tendon at the finger's joints."""
    state = models.finger.start(posture)
    motion = models.finger.motion(state)
    pulled = models.hood.advance(models.hood.start(motion), motion, np.array([TENSION]), 1.0).state
    by_motion = models.hood.jacobian(pulled).excursion_motion
    return pulled, (by_motion @ models.finger.jacobian(state))[0]


def pulley_arms(models: Models, posture):
    k = models.finger.tendons.index("extensor")
    return models.finger.moment_arms(np.array([posture[j] for j in models.finger.joints]))[k]


def test_the_extensor_is_the_fingers_own_or_the_hoods():
    pulleys, network = load_case(PULLEYS), load_case(NETWORK)
    own = finger_model(pulleys.finger, pulleys.hood.left_to_finger).muscles
    assert own[0] == "extensor"
    assert finger_model(network.finger, network.hood.left_to_finger).muscles == own[1:]
    assert build(network).hood.tendons == ("extensor",)


@pytest.mark.parametrize("name", [PULLEYS, NETWORK])
def test_a_second_extensor_is_the_fingers_own_under_any_hood(name):
    case = load_case(name, ("finger.second_extensor=true",))
    assert finger_model(case.finger, case.hood.left_to_finger).muscles[-1] == "second_extensor"


def test_both_have_the_arms_of_table_iii_where_springs_share_as_the_pulley_does():
    pulleys, network = build_case(PULLEYS), build_case(NETWORK, *AS_PULLEY)
    wanted = -1e-3 * TABLE_III[:, 0]
    assert pulley_arms(pulleys, pulleys.posture) == pytest.approx(wanted, abs=1e-12)
    assert hood_at(network, network.posture)[1] == pytest.approx(wanted, abs=1e-7)


def test_shares_follow_from_stiffness_in_the_posture_and_from_the_way_beyond_it():
    """The pulley's do not; with PIP and DIP bent on, the way to the distal phalanx is longer."""
    network, case = build_case(NETWORK), load_case(NETWORK)
    at = slip_forces(case.hood, hood_at(network, network.posture)[0])
    shares = np.array([126.0, 80.0]) / (126 + 80 + 126)
    assert list(at.values()) == pytest.approx(TENSION * shares, rel=3e-3)
    bent = {**network.posture, "PIP": np.radians(55), "DIP": np.radians(25)}
    state, arm = hood_at(network, bent)
    assert slip_forces(case.hood, state) == pytest.approx({"central": 0.0, "terminal": TENSION})
    assert arm[3] == pytest.approx(-2.26e-3)
    assert pulley_arms(build_case(PULLEYS), bent)[3] == pytest.approx(-1.13e-3, abs=1e-12)


def test_the_pulleys_branches_are_its_slips():
    models = build_case(PULLEYS)
    assert models.built.own_slips is not None
    slips = models.built.own_slips({"extensor": TENSION})
    assert slips == {"central": 0.25 * TENSION, "terminal": 0.5 * TENSION}


@pytest.mark.parametrize("name", [PULLEYS, NETWORK])
def test_the_extensor_lifts_the_fingertip(name):
    """Straight up: nothing here pulls aside."""
    models, states = solve(load_case(name))
    assert models.finger.tendons[-1] == "adduction"
    before, now = (np.asarray(e.balance.tip_force) for e in (states.unloaded, states.loaded))
    assert (now - before)[2] > 0.5
    assert abs((now - before)[1]) < 1e-4


def test_pictures_show_rods_from_joint_to_joint():
    bones = bone_surfaces(load_case(PULLEYS))
    reach = [points[:, 0].max() - 1e-3 for points, _ in list(bones.values())[1:]]
    assert reach == pytest.approx(LENGTHS, abs=3e-5)  # rods are faceted


def test_the_pulley_has_its_own_shares():
    with pytest.raises(InputError, match=r"hood\.central: the robotic finger's pulley"):
        build(load_case(PULLEYS, ("hood.central=0.6",)))


def test_a_shell_does_not_go_on_it():
    with pytest.raises(InputError, match='takes "split" or "two_band" or "network" or "cable"'):
        build(load_case("isometric_edc", ("finger.kind=robot", *POSTURE)))
