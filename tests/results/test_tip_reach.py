"""The audit of the fingertip force against what the tendons can make."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import quiet
from cosim.pipeline import run_case
from cosim.results.tip_reach import MOVING, NO_TIP, motion_over_reach, tip_forces
from cosim.solve.motion import RestCheck
from cosim.solve.session import Session
from cosim.solve.solvers import solve_case
from rigid.chain.support import CLAMPED, FREE, HELD
from tests.helpers.fingers import POSTURE, mujoco_finger

QUADS = "hood.mesh.quads=120"


def sheet(modulus: str) -> dict[str, Any]:
    case = load_case("isometric_edc_neo_hookean", [QUADS, f'hood.regions.all.modulus="{modulus}"'])
    return run_case(case).summary


def test_a_stiff_sheet_that_pushes_by_itself_misses_the_audit():
    """A sheet of 100 GPa once gave some 10 N for 3.6 N of tension and passed."""
    stiff = sheet("100 GPa")
    assert stiff["fingertip_magnitude_N"] > 2 * stiff["tension_N"]["EDC"]
    assert stiff["audit"]["tip_force_over_reach"] > 5
    assert "tip_force_over_reach" in stiff["audit_missed"]
    soft = sheet("90 MPa")
    assert 0.3 < soft["audit"]["tip_force_over_reach"] < 1.3
    assert soft["audit_missed"] == []


@pytest.mark.parametrize(
    ("name", "settings", "figure"),
    [
        ("pulley_edc", (), (0.5, 1.1)),
        ("split_fdp", (), (0.8, 1.1)),
        ("pulley_edc", ('finger.tip.kind="clamped"',), (0.5, 1.1)),
        ("pulley_edc", ('finger.tip.kind="free"',), "nothing holds the fingertip"),
        ("pulley_edc", ('finger.tip.kind="posture"',), "every joint is held"),
        ("pulley_edc", ("tendons.EDC.activation=0.01",), "less than 1 N"),
    ],
)
def test_every_tip_is_judged_or_the_reason_is_told(name, settings, figure):
    summary = run_case(load_case(name, list(settings))).summary
    found = summary["audit"].get("tip_force_over_reach")
    if isinstance(figure, str):
        assert found is None
        assert figure in summary["audit_not_judged"]["tip_force_over_reach"]
    else:
        assert found is not None
        assert figure[0] < found < figure[1]
    assert "tip_force_over_reach" not in summary["audit_missed"]


def test_a_torque_that_the_tip_bears_gives_its_force():
    """J^T F = tau: the torques of a force at the tip give that force back, held or clamped."""
    force, rng = np.array([0.3, -0.2, 1.1]), np.random.default_rng(0)
    for support in (HELD, CLAMPED):
        finger = mujoco_finger(support)
        at = finger.start(POSTURE)
        jacobian = finger.chain(finger.angles(at)).jacobian[-1, :3]
        found = tip_forces(finger, at, (jacobian.T @ force)[None])
        assert found == pytest.approx([np.linalg.norm(force)], rel=1e-6)
    free = mujoco_finger(FREE)
    assert not tip_forces(free, free.start(POSTURE), rng.normal(size=(2, 4))).any()


def test_a_motion_is_judged_where_it_came_to_rest():
    """The finger in its cage, a short way from its start, told to be at rest there; then with ten
    times the force at its tip."""
    case = load_case("forward_fdp", ['forward.duration="0.02 s"', "forward.must_rest=false"])
    moved = solve_case(case, Session(), quiet)
    moving, rested = (replace(moved, rest=RestCheck(rate, rate)) for rate in (1.0, 0.0))
    assert motion_over_reach(case, moving) == MOVING
    figure = motion_over_reach(case, rested)
    tips = [10 * np.asarray(tip) for tip in moved.history.tips]
    pushed = replace(rested, history=replace(moved.history, tips=tips))
    assert figure > 0
    assert motion_over_reach(case, pushed) == pytest.approx(10 * figure)
    free = case.replace({"finger.tip.kind": "free"})
    assert motion_over_reach(free, rested) == NO_TIP
