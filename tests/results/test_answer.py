"""The sentences that terminal, notebook and page begin with."""

from __future__ import annotations

from typing import Any

import pytest

from cosim.results.answer import answer, doubts, trust

FORCE = {"distal": 0.3, "radial": 0.0, "dorsal": -0.4}


def told(summary: dict[str, Any]) -> str:
    return " ".join(answer(summary))


def test_the_force_is_told_with_the_names_of_its_ways() -> None:
    said = told({"fingertip_force_N": FORCE, "fingertip_magnitude_N": 0.5})
    assert said == (
        "At the end, the fingertip pushes with 0.50 N (0.30 distal, 0.00 radial, 0.40 palmar)."
    )


def test_a_loaded_state_stands_beside_its_rest() -> None:
    unloaded = {"fingertip_magnitude_N": 0.1, "slip_force_N": {"central": 0.02}}
    said = told(
        {
            "fingertip_force_N": FORCE,
            "slip_force_N": {"central": 2.0, "terminal": 1.5},
            "unloaded": unloaded,
        }
    )
    assert said.startswith("Under load, the fingertip pushes with 0.50 N")
    assert "0.10 N at rest. The central slip carries 2.00 N, 0.02 N at rest; the terminal" in said


def test_a_free_finger_pushes_on_nothing() -> None:
    assert told({"fingertip_force_N": dict.fromkeys(FORCE, -0.0)}) == (
        "The fingertip pushes on nothing."
    )


@pytest.mark.parametrize(
    ("joint", "angle", "words"),
    [
        ("PIP", 30.04, "PIP 30.0° flexed"),
        ("DIP", -2.6, "DIP 2.6° extended"),
        ("MCP_abduction", 3.0, "MCP 3.0° radial"),
        ("MCP_abduction", -3.0, "MCP 3.0° ulnar"),
    ],
)
def test_a_joint_is_told_by_the_way_that_it_is_turned(joint: str, angle: float, words: str) -> None:
    assert told({"posture_deg": {joint: angle}}) == f"The finger stands at {words}."


def test_an_abduction_that_rounds_to_zero_is_left_out() -> None:
    assert told({"posture_deg": {"PIP": 30.0, "MCP_abduction": 0.04}}).endswith("flexed.")


def test_a_summary_without_numbers_says_nothing() -> None:
    assert not answer({})
    assert not list(doubts({}))
    assert trust({}) == "This run kept no audit."


def test_all_checks_are_counted_those_beside_the_audit_too() -> None:
    summary = {"audit": {"finger_residual": 0.0}, "max_penetration_mm": 0.0, "audit_missed": []}
    assert trust(summary) == "All 2 checks of the audit were kept."


def test_what_was_missed_is_a_doubt() -> None:
    summary = {"audit": {"finger_residual": 1.0}, "audit_missed": ["finger_residual"]}
    assert list(doubts(summary)) == ["The audit was missed in: finger residual."]


def test_a_finger_that_moves_and_a_joint_at_its_limit_are_doubts() -> None:
    at = {"limit_deg": 65.0, "angle_deg": 65.4, "limit_torque_Nmm": 27.7}
    first, second = doubts({"came_to_rest": False, "joints_at_limit": {"PIP": at}})
    assert first == "The finger was still moving at the end."
    assert second.startswith("PIP stands at 65.4 deg, at its limit of 65 deg")


@pytest.mark.parametrize(
    ("strain", "beyond", "words", "doubted"),
    [
        (28.0, -14.7, "28.00 % in the central slip, whose fibres are not straight yet.", False),
        (3.0, 2.0, "3.00 % in the central slip.", False),
        (60.0, 6.7, "60.00 % in the central slip, 6.70 % beyond straight.", False),
        (12.0, 10.9, "12.00 % in the central slip, at which tendons tear.", True),
    ],
)
def test_fibres_are_overloaded_by_their_strain_beyond_straight(
    strain: float, beyond: float, words: str, doubted: bool
) -> None:
    summary = {"fibre_strain_percent": {"central_slip": {"p95": strain, "beyond_straight": beyond}}}
    assert told(summary).endswith(words)
    assert any("Tendons tear" in doubt for doubt in doubts(summary)) == doubted


def test_straight_fibres_are_told_beside_crimped_ones_that_are_strained_more() -> None:
    regions = {
        "oblique_fibres_radial": {"p95": 28.0, "beyond_straight": -14.7},
        "central_slip": {"p95": 3.0, "beyond_straight": 2.0},
    }
    assert "of straight fibres, 3.00 % in the central slip." in told(
        {"fibre_strain_percent": regions}
    )
