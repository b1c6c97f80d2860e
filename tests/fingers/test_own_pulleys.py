"""Fingers of a builder's own: arms, lengths and guides of the robotic one, pulleys of one's own."""

import re
import tomllib
from itertools import product

import numpy as np
import pytest

import cosim
from cosim.case.file import load_case, packaged_cases
from cosim.errors import InputError
from cosim.fingers.kinds import finger_model
from cosim.models.build import build
from cosim.ui.controls import controls_of
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import XU2012
from rigid.mujoco.finger import MujocoFinger
from tests.helpers.folders import ROOT

ROBOT, OWN = "robot_pulleys_extensor", "own_pulleys_fdp"
MASSES = {
    "centres": ["27 mm", "16 mm", "12 mm"],
    "masses": ["5 g", "2 g", "1 g"],
    "inertias": ["1 kg*mm**2", "0.2 kg*mm**2", "0.1 kg*mm**2"],
}


def robot(*settings: str) -> MujocoFinger:
    case = load_case(ROBOT, settings)
    return MujocoFinger(finger_model(case.finger, case.hood.left_to_finger))


def arms(finger: MujocoFinger, tendon: str) -> np.ndarray:
    return 1e3 * finger.moment_arms(np.zeros(4))[finger.tendons.index(tendon)]


def test_without_keys_of_its_own_it_is_the_papers_finger_to_the_bit():
    finger = load_case(ROBOT).finger
    assert finger.design() == XU2012
    assert repr(robot_finger(False, finger.design())) == repr(robot_finger())


def test_arms_of_the_straight_finger_are_those_that_a_case_states():
    changed = robot(
        "finger.arms.extensor.MCP=-11.5 mm",
        "finger.arms.flexors.PIP=9 mm",
        "finger.arms.abduction.MCP_abduction=9 mm",
        "finger.lengths.proximal=48 mm",
    )
    assert arms(changed, "extensor") == pytest.approx([-11.5, 0.0, -1.81, -1.13], abs=1e-9)
    assert arms(changed, "pip_flexor") == pytest.approx([13.47, 0.0, 9.0, 0.0], abs=1e-9)
    assert arms(changed, "abduction") == pytest.approx([6.17, 9.0, 0.0, 0.0], abs=1e-9)
    assert changed.tip(changed.start({}))[0] == pytest.approx(0.048 + 0.032 + 0.0237)


def test_its_pulley_parts_the_tension_as_the_case_says():
    case = load_case(ROBOT, ["finger.extensor_share=0.4"])
    strands = finger_model(case.finger, case.hood.left_to_finger).tendons[0].strands
    assert [s.share for s in strands] == pytest.approx([0.4, 0.3, 0.3])


def test_tendons_of_ones_own_stand_beside_the_papers_or_in_their_place():
    beside = robot("finger.pulleys.FDP.PIP=7 mm")
    assert beside.tendons[-1] == "FDP"
    assert len(beside.tendons) == 6
    instead = robot('finger.pulleys.pip_flexor={MCP="9 mm", PIP="6 mm"}')
    assert len(instead.tendons) == 5
    assert arms(instead, "pip_flexor") == pytest.approx([9.0, 0.0, 6.0, 0.0], abs=1e-9)
    alone = robot("finger.paper_tendons=false", "finger.pulleys.FDP.PIP=7 mm")
    assert alone.tendons == ("FDP",)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["finger.arms.extensor.MCP=-20 mm"], "must reach the line between them"),
        (["finger.arms.extensor.MCP=-5 mm"], "must reach the line between them"),
        (["finger.arms.flexors.MCP=40 mm"], "no straight line passes the MCP axis"),
        (["finger.arms.abduction.MCP_abduction=40 mm"], r"finger\.arms\.abduction"),
        (["finger.lengths.proximal=12 mm"], "a guide stands beyond the end of the proximal"),
        (["finger.guides.flexor_distal=100 mm"], r"distal phalanx .*guides\.flexor_distal"),
        (["finger.guides.distal=24 mm"], r"distal phalanx .*guides\.distal"),
        (["finger.guides.side_end=60 mm"], r"proximal phalanx .*guides\.side_end"),
        (["finger.guides.origin=-10 mm"], r"not proximal of finger\.guides\.flexor_x"),
        (["finger.paper_tendons=false", "finger.second_extensor=true"], "write one of them"),
        (["finger.pulleys.FDP={}"], "has no pulley"),
        (
            ["finger.points.FDP={middle=[['1 mm','0 mm','0 mm'],['9 mm','0 mm','0 mm']]}"],
            "no joint",
        ),
    ],
)
def test_a_finger_that_cannot_be_built_is_refused_in_words(settings, words):
    with pytest.raises(InputError, match=words):
        robot(*settings)


def test_in_closed_form_and_on_mujoco_one_finger_presses_alike():
    table = tomllib.loads(packaged_cases()[OWN].read_text("utf-8"))
    moving = table | {"finger": table["finger"] | {"kind": "planar"} | MASSES}
    hinge, planar = (cosim.run(cosim.load(of)).summary for of in (table, moving))
    force, posture, way = "fingertip_force_N", "posture_deg", "own_excursion_mm"
    assert planar[force] == pytest.approx(hinge[force], rel=1e-6, abs=1e-9)
    assert planar[posture] == pytest.approx(hinge[posture], abs=1e-5)
    assert planar[way] == pytest.approx(hinge[way], abs=1e-6)
    turned = np.radians(list(hinge[posture].values()))
    assert hinge[way]["FDP"] == pytest.approx(turned @ [11.0, 8.0, 5.0])


def test_where_the_torques_balance_a_force_at_the_tip_the_finger_does_not_fold():
    """The line that the study of the radii states."""
    radius = 0.15188921 * 10.0 + 1.7831043 * 5.0
    case = load_case(OWN, ["finger.pulleys.FDP.MCP=10 mm", f"finger.pulleys.FDP.PIP={radius} mm"])
    models = build(case)
    reached = cosim.run(case).summary["posture_deg"]
    wanted = {joint: np.degrees(angle) for joint, angle in models.posture.items()}
    assert reached == pytest.approx(wanted, abs=0.1)  # the extensor rests at 0.05 N


def test_what_rolls_over_pulleys_does_not_rub():
    with pytest.raises(InputError, match="wound on pulleys that turn"):
        build(load_case(OWN, ["tendons.FDP.friction=0.1"]))


def test_a_page_has_a_slider_for_each_of_these():
    keys = {c.key for c in controls_of(load_case(OWN))}
    assert {"finger.pulleys.FDP.MCP", "finger.passive.DIP.stiffness"} <= keys
    keys = {c.key for c in controls_of(load_case(ROBOT))}
    assert {"finger.arms.extensor.PIP", "finger.guides.side_y", "finger.lengths.distal"} <= keys


GUIDES = ("cases/README.md", "rigid/README.md", "cosim/fingers/pulleys.py")
OFF = re.compile(
    r"up to ([\d.]+) % at 10, ([\d.]+) % at 20, ([\d.]+) % at 30 and ([\d.]+) % at 35 deg"
)


def test_the_guides_say_by_how_much_a_pulley_is_off_in_abduction():
    """Over the MCP's flexion, to both sides, palmar and dorsal; without abduction, and at the PIP,
    the arm is the radius."""
    bends = np.radians(np.arange(-30, 91, 10))
    found, sideways = [], 0.0
    fingers = [robot(f"finger.pulleys={{FDP={{MCP='{r} mm', PIP='{r} mm'}}}}") for r in (10, -10)]
    for aside in np.radians([0, 10, 20, 30, 35]):
        worst = 0.0
        for finger, bend, to in product(fingers, bends, (aside, -aside)):
            mcp, out, pip, _ = arms_at(finger, "FDP", [bend, to, 0.5, 0.3])
            worst, sideways = max(worst, abs(abs(mcp) - 10) / 10), max(sideways, abs(out) / 10)
            assert abs(pip) == pytest.approx(10, abs=1e-9)
        found.append(100 * worst)
    assert found[0] == pytest.approx(0, abs=1e-9)
    for guide in GUIDES:
        text = " ".join((ROOT / guide).read_text(encoding="utf-8").split())
        said = OFF.search(text)
        assert said is not None, guide
        for words, off in zip(said.groups(), found[1:], strict=True):
            assert float(words) == pytest.approx(off, abs=0.5 if off > 10 else 0.05)
        assert guide.endswith(".py") or f"up to {sideways:.2f} of the radius" in text


def arms_at(finger: MujocoFinger, tendon: str, angles: list[float]) -> np.ndarray:
    return 1e3 * finger.moment_arms(np.array(angles))[finger.tendons.index(tendon)]
