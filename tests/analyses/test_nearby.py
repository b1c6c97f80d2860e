"""What follows of other parameters from a solved hood, beside whole solves."""

from __future__ import annotations

import pytest

from cosim.analyses.trials.by_tangent import tangent_serves
from cosim.analyses.trials.workers import SolvedCases, Trial, run_trial, solve_many, solve_one
from cosim.case.file import Settings, find_case, load_case
from cosim.results.compare import value_of

SOURCE = find_case("strain_lee2008_average_ti")
COARSE = (
    "hood.mesh.quads=120",
    "solve.hood_tolerance=1e-11",
    "hood.extra_length.central_slip=0.3 mm",
)
SMALL = 1e-3
ONE_ROUND_MORE = "14 Newton iterations of 33 since the cover is blended: rounding costs a round"
QUANTITIES = (
    "difference.marker_strain_percent.longitudinal.mean",
    "difference.marker_strain_percent.lateral.min",
    "slip_force_N.central",
    "slip_force_N.terminal",
    "joint_torque_Nmm.hood.PIP",
    "moment_arm_mm.EDC.PIP",
)


@pytest.fixture(scope="module")
def kept() -> SolvedCases:
    """The coarse case, solved."""
    found: SolvedCases = {}
    assert solve_one(found, "hood", SOURCE, COARSE, arms=True, afresh=True).status == "converged"
    return found


def near(kept: SolvedCases, *settings: Settings) -> list[Trial]:
    return solve_many(kept, "hood", SOURCE, COARSE, settings, arms=True)


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [
        pytest.param(
            "hood.regions.central_slip.c5", 100.76, "MPa", marks=pytest.mark.slow, id="modulus"
        ),
        pytest.param(
            "hood.springs.retinacular_radial.stiffness",
            *(22.5, "N/mm"),
            marks=pytest.mark.slow,
            id="spring",
        ),
        pytest.param(
            "hood.extra_length.central_slip", 0.3, "mm", marks=pytest.mark.slow, id="length"
        ),
        pytest.param(
            "hood.regions.terminal_slip.section", 4.4, "mm**2", marks=pytest.mark.slow, id="region"
        ),
        pytest.param("tendons.EDC.tension", 11.8, "N", id="tension"),
    ],
)
def test_slopes_by_the_tangent_are_those_of_solves(kept, key, value, unit):
    ends = [(*COARSE, f"{key}={value * (1 + d)!r} {unit}") for d in (-SMALL, SMALL)]
    solved = [run_trial(SOURCE, settings).value for settings in ends]
    found = [outcome.value for outcome in near(kept, *ends)]
    for quantity in QUANTITIES:
        slopes = [
            (value_of(b, quantity) - value_of(a, quantity)) / (2 * SMALL)
            for a, b in (solved, found)
        ]
        assert slopes[0] != 0
        assert slopes[1] == pytest.approx(slopes[0], rel=2e-3), quantity


def test_no_change_is_the_solved_case(kept):
    found, solved = near(kept, COARSE)[0].value, run_trial(SOURCE, COARSE).value
    for quantity in QUANTITIES:
        assert value_of(found, quantity) == pytest.approx(value_of(solved, quantity), rel=1e-7)


def test_moment_arms_that_nobody_asks_for_are_the_solved_ones(kept):
    other = (*COARSE, "tendons.EDC.tension=11.7 N")
    full, quick = (
        solve_many(kept, "hood", SOURCE, COARSE, [other], arms)[0].value for arms in (True, False)
    )
    assert quick["slip_force_N"] == full["slip_force_N"]
    arms, moved = (found["moment_arm_mm"]["EDC"]["PIP"] for found in (quick, full))
    solved = near(kept, COARSE)[0].value["moment_arm_mm"]["EDC"]["PIP"]
    assert arms == pytest.approx(solved, rel=1e-9)
    assert abs(moved - solved) > 1e-6


@pytest.mark.parametrize(
    "setting",
    [
        pytest.param(
            "hood.contact.offset.middle=0.11 mm",
            marks=[pytest.mark.slow, pytest.mark.xfail(strict=True, reason=ONE_ROUND_MORE)],
        ),
        pytest.param("hood.mesh.rest_posture.PIP=0.2 deg", marks=pytest.mark.slow),
        pytest.param("hood.thickness=0.152 mm", marks=pytest.mark.slow),
    ],
)
def test_another_mesh_is_solved_from_the_solved_case(kept, setting):
    other = (*COARSE, setting)
    assert load_case(SOURCE, other).mesh_key() != load_case(SOURCE, COARSE).mesh_key()
    found, solved = near(kept, other)[0].value, run_trial(SOURCE, other).value
    assert found["iterations"]["newton"] < solved["iterations"]["newton"] / 3
    for quantity in QUANTITIES:
        assert value_of(found, quantity) == pytest.approx(value_of(solved, quantity), rel=1e-6)


@pytest.mark.slow
def test_a_case_is_solved_from_what_it_was_solved_to_last(kept):
    other = (*COARSE, "hood.extra_length.terminal_slip=-0.2 mm", "tendons.EDC.tension=11 N")
    found = solve_one(dict(kept), "hood", SOURCE, other, arms=True, afresh=False).value
    solved = run_trial(SOURCE, other).value
    assert found["iterations"]["newton"] < solved["iterations"]["newton"]
    for quantity in QUANTITIES:
        assert value_of(found, quantity) == pytest.approx(value_of(solved, quantity), rel=1e-6)


def test_bones_that_move_are_solved_for(kept):
    moved = (*COARSE, "finger.posture.PIP=1 deg")
    found, solved = near(kept, moved)[0].value, run_trial(SOURCE, moved).value
    assert found["slip_force_N"] == pytest.approx(solved["slip_force_N"], rel=1e-9)
    assert found["posture_deg"]["PIP"] == pytest.approx(1.0)


def test_a_finger_that_is_free_to_turn_is_not_foretold():
    assert tangent_serves(load_case(SOURCE, COARSE))
    for setting in ("finger.tip.kind=point", 'hood.contact.penetration="1 um"'):
        assert not tangent_serves(load_case(SOURCE, (*COARSE, setting)))
    assert not tangent_serves(load_case("split_edc"))


def test_a_refused_setting_says_why(kept):
    (found,) = near(kept, ("hood.thickness=-1 mm",))
    assert found.status == "refused"
    assert "hood.thickness" in found.reason
