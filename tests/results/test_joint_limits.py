"""Joints that stand at a limit: which, with what torque, and when a motion came there."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.pipeline import run_case
from cosim.results.answer import doubts
from cosim.results.joint_limits import (
    describe_limits,
    joints_at_limit,
    joints_ever_at_limit,
    limits_of,
)

PLAIN = "output.picture=false"
FREE = "finger.tip={kind='free'}"
LIMITS = {"PIP": [(-0.1, 0.5), (0.0, 1.9)], "DIP": [(0.0, 1.2)]}


def deg(angle: float) -> float:
    return float(np.degrees(angle))


def test_a_joint_is_at_its_limit_within_a_tenth_of_a_degree():
    torque = {"PIP": -0.02}
    inside = {"PIP": 0.5 - np.radians(0.2), "DIP": np.radians(0.2)}
    assert joints_at_limit(LIMITS, inside, torque) == {}
    near = {"PIP": 0.5 - np.radians(0.05), "DIP": np.radians(-0.5)}
    assert joints_at_limit(LIMITS, near, torque) == {
        "PIP": {"limit_deg": deg(0.5), "angle_deg": deg(near["PIP"]), "limit_torque_Nmm": -20.0},
        "DIP": {"limit_deg": 0.0, "angle_deg": pytest.approx(-0.5), "limit_torque_Nmm": 0.0},
    }


def test_a_motion_tells_when_a_joint_first_came_to_a_limit_and_how_far_beyond():
    angles = np.array([[0.3, 0.3], [0.51, 0.3], [0.4, 0.3], [0.55, 0.3], [0.52, 0.3]])
    times = [0.0, 0.1, 0.2, 0.3, 0.4]
    found = joints_ever_at_limit(
        LIMITS, ("PIP", "DIP"), times, angles, lambda k: np.array([-1e-3 * k, 0.0])
    )
    assert found == {
        "PIP": {
            "limit_deg": deg(0.5),
            "angle_deg": deg(0.55),
            "limit_torque_Nmm": -3.0,
            "first_s": 0.1,
        }
    }
    (text,) = describe_limits({"joints_at_limit": found})
    assert text == (
        "PIP comes to its limit of 28.65 deg, at 0.1 s, and at most to 31.51 deg; the limit "
        "bears 3 N mm there"
    )


def test_a_free_finger_that_is_pulled_leans_on_its_limits():
    """What a limit bears is what all other torques leave over."""
    result = run_case(load_case("split_edc", [PLAIN, FREE]))
    found = result.summary["joints_at_limit"]
    posture = {"MCP": 30.0, "PIP": 45.0, "DIP": 15.0}
    torques = result.summary["joint_torque_Nmm"]
    assert found
    for joint, at in found.items():
        others = sum(of[joint] for source, of in torques.items() if source != "limit")
        assert at["limit_torque_Nmm"] == pytest.approx(-others, abs=1e-3)
        assert abs(at["limit_torque_Nmm"]) > 1
        side = 1 if at["limit_torque_Nmm"] < 0 else -1
        if joint in posture:
            assert at["limit_deg"] == pytest.approx(posture[joint] + 5 * side)
        assert side * (at["angle_deg"] - at["limit_deg"]) > 0
        assert at["angle_deg"] == result.summary["posture_deg"][joint]
    texts = list(describe_limits(result.summary))
    assert [f"{text}.".replace("-", "\N{MINUS SIGN}") for text in texts] == list(
        doubts(result.summary)
    )


def test_a_finger_whose_tip_is_held_does_not():
    assert "joints_at_limit" not in run_case(load_case("split_edc", [PLAIN])).summary


def test_a_joint_at_the_end_of_its_range_without_a_stop_is_told():
    straight = "finger.posture={MCP='20 deg',PIP='0 deg',DIP='10 deg'}"
    summary = run_case(load_case("split_edc", [PLAIN, straight])).summary
    (text,) = describe_limits(summary)
    assert summary["joints_at_limit"]["PIP"]["limit_torque_Nmm"] == 0
    assert text.endswith("at the end of its range of motion, 0 deg")


def test_joints_that_a_case_holds_have_no_limits():
    held = load_case("split_edc", ["finger.tip={kind='posture'}"])
    assert limits_of(held, {"PIP": (0.0, 1.0)}) == {}


def test_a_motion_into_a_limit_ends_as_the_equilibrium_does():
    damped = [
        f'finger.passive.{joint}={{stiffness="0.001 N*m/rad",damping="0.002 N*m*s/rad"}}'
        for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
    ]
    stop = "finger.limit.damping=0.05 N*m*s/deg"
    forward = 'forward={duration="0.4 s",must_rest=false}'
    moved = run_case(load_case("split_edc", [PLAIN, FREE, stop, forward, *damped]))
    still = run_case(load_case("split_edc", [PLAIN, FREE, *damped])).summary["joints_at_limit"]
    found = moved.summary["joints_at_limit"]
    assert found.keys() >= still.keys()
    data = moved.data
    for joint, at in still.items():
        assert found[joint]["limit_deg"] == pytest.approx(at["limit_deg"])
        angle = np.degrees(data.angle.sel(joint=joint))
        side = np.sign(at["angle_deg"] - at["limit_deg"])
        there = data.time.values[side * (angle.values - at["limit_deg"]) >= -0.1 - 1e-9]
        assert found[joint]["first_s"] == pytest.approx(there[0])
        assert found[joint]["angle_deg"] == pytest.approx(side * np.max(side * angle.values))
        # at its farthest the limit bears at least what it bears at rest
        assert abs(found[joint]["limit_torque_Nmm"]) > 0.9 * abs(at["limit_torque_Nmm"])
