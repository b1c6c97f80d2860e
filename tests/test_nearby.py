"""What the hood's tangent foretells of other parameters, beside whole solves."""

from __future__ import annotations

import pytest

from cosim.case import find_case, load_case
from cosim.compare import value_of
from cosim.nearby import near_outcome, tangent_serves
from cosim.trials import outcome

SOURCE = find_case("strain_lee2008_soft_iso")
# With mean moduli the central slip hangs slack on a coarse mesh.
COARSE = ("hood.mesh.quads=120", "solve.hood_tolerance=1e-11")
SMALL = 5e-4
QUANTITIES = (
    "difference.marker_strain_percent.longitudinal.mean",
    "difference.marker_strain_percent.lateral.min",
    "slip_force_N.central",
    "slip_force_N.terminal",
    "joint_torque_Nmm.hood.PIP",
    "moment_arm_mm.EDC.PIP",
)


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [
        pytest.param(
            "hood.regions.central_slip.modulus", 53.99, "MPa", marks=pytest.mark.slow, id="modulus"
        ),
        pytest.param("tendons.EDC.tension", 11.8, "N", id="tension"),
    ],
)
def test_slopes_by_the_tangent_are_those_of_solves(key, value, unit):
    ends = [(*COARSE, f"{key}={value * (1 + d)!r} {unit}") for d in (-SMALL, SMALL)]
    solved = [outcome(SOURCE, settings).summary for settings in ends]
    near = [near_outcome(SOURCE, COARSE, settings).summary for settings in ends]
    for quantity in QUANTITIES:
        slopes = [
            (value_of(b, quantity) - value_of(a, quantity)) / (2 * SMALL) for a, b in (solved, near)
        ]
        assert slopes[0] != 0
        assert slopes[1] == pytest.approx(slopes[0], rel=2e-3), quantity


def test_no_change_is_the_solved_case():
    near, solved = near_outcome(SOURCE, COARSE, COARSE).summary, outcome(SOURCE, COARSE).summary
    for quantity in QUANTITIES:
        assert value_of(near, quantity) == pytest.approx(value_of(solved, quantity), rel=1e-7)


def test_bones_that_move_are_solved_for():
    moved = (*COARSE, "finger.posture.PIP=1 deg")
    near, solved = (
        near_outcome(SOURCE, COARSE, moved).summary,
        outcome(SOURCE, moved).summary,
    )
    assert near["slip_force_N"] == pytest.approx(solved["slip_force_N"], rel=1e-9)
    assert near["posture_deg"]["PIP"] == pytest.approx(1.0)


def test_a_finger_that_is_free_to_turn_is_not_foretold():
    assert tangent_serves(load_case(SOURCE, COARSE))
    for setting in ("finger.tip.kind=point", 'hood.contact.penetration="1 um"'):
        assert not tangent_serves(load_case(SOURCE, (*COARSE, setting)))
    assert not tangent_serves(load_case("split_edc"))


def test_a_refused_setting_says_why():
    found = near_outcome(SOURCE, COARSE, ("hood.thickness=-1 mm",))
    assert found.status == "refused"
    assert "hood.thickness" in found.reason
