"""Differences of arms from the force at a clamped fingertip."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.pipeline import run_case
from cosim.results.compare import numbers_of
from cosim.results.quantities import is_known
from cosim.results.tip_reach import (
    arm_differences,
    chain_points,
    force_over_tension,
    to_world,
)

POINTS = chain_points((45e-3, 25e-3, 20e-3), (30, 45, 15))


@pytest.mark.parametrize("case", ["middle_minorflex_ui", "middle_majorflex_ri"])
def test_a_force_on_parallel_axes_says_the_arms_of_its_tendon(case: str):
    summary = run_case(load_case(case)).summary
    (arms,) = (arm for arm in summary["moment_arm_mm"].values() if arm)
    said = summary["difference"]
    expected = {"MCP_PIP": arms["MCP"] - arms["PIP"], "PIP_DIP": arms["PIP"] - arms["DIP"]}
    assert said["arm_difference_mm"] == pytest.approx(expected, rel=1e-9)
    assert said["abduction_arm_mm"] == pytest.approx(arms["MCP_abduction"], rel=1e-9)
    names = [q for q in numbers_of(summary) if "arm_difference" in q or "abduction_arm" in q]
    assert len(names) == 3
    assert all(is_known(name) for name in names)


def test_tilted_axes_of_the_index_finger_cost_a_tenth_of_a_millimetre():
    summary = run_case(load_case("split_fdp", ['finger.tip.kind="clamped"'])).summary
    arms, said = summary["moment_arm_mm"]["FDP"], summary["difference"]["arm_difference_mm"]
    assert said["MCP_PIP"] == pytest.approx(arms["MCP"] - arms["PIP"], abs=0.1)
    assert said["PIP_DIP"] == pytest.approx(arms["PIP"] - arms["DIP"], abs=0.1)


@pytest.mark.parametrize(("case", "tip"), [("split_fdp", "point"), ("free_split_edc", "free")])
def test_no_other_fingertip_says_arms(case: str, tip: str):
    stated = load_case(case)
    assert stated.native_finger().tip.kind == tip
    assert "arm_difference_mm" not in run_case(stated).summary["difference"]


def test_several_tendons_count_by_their_tensions():
    one, other = np.array([0.3, 0.1, -0.2]), np.array([-0.1, 0.0, 0.4])
    first, second, both = (
        arm_differences(POINTS, force, tension)["arm_difference_mm"]["MCP_PIP"]
        for force, tension in ((one, 1.0), (other, 3.0), (one + other, 4.0))
    )
    assert both == pytest.approx((first + 3 * second) / 4)


def test_a_straight_pip_says_none():
    straight = chain_points((45e-3, 25e-3, 20e-3), (30, 0, 15))
    assert arm_differences(straight, np.array([0.1, 0.0, 0.2]), 1.0) == {}


def test_two_differences_make_the_force_again():
    force = np.array([0.3, 0.1, -0.2])
    arms = arm_differences(POINTS, force, 2.0)["arm_difference_mm"]
    back = 2e-3 * force_over_tension(POINTS, arms["MCP_PIP"], arms["PIP_DIP"])
    np.testing.assert_allclose(back, force[[0, 2]], rtol=1e-12)


def test_a_force_that_extends_has_negative_differences():
    dorsal = to_world(np.array([0.0, 0.0, 1.0]), (0, 0, 0))
    arms = arm_differences(POINTS, dorsal, 1.0)["arm_difference_mm"]
    assert max(arms.values()) < 0
    turned = to_world(np.array([1.0, 0.0, 0.0]), (30, 45, 15))
    np.testing.assert_allclose(turned, [0, 0, -1], atol=1e-12)
