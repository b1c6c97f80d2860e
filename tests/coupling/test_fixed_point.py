"""The accelerated fixed point at rest, against Newton's method."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.coupling.accelerators import Aitken, ConstantRelaxation, QuasiNewton
from cosim.coupling.equilibrium import CouplingOptions
from cosim.coupling.fixed_point import fixed_point
from cosim.errors import ConvergenceError
from cosim.pipeline import run_case
from cosim.port import Pair, PairState, Tensions
from cosim.results.conventions import vector_of
from rigid.chain.support import FREE, IN_PLANE
from tests.helpers.fingers import POSTURE, cables_over_all_joints, hinge_finger, solve

TENSION, NONE = np.array([3.0]), np.zeros(0)


def by_fixed_point(support, accelerator, rounds=60, tolerance=1e-10, turn=1e-9):
    finger, hood = hinge_finger(support), cables_over_all_joints()
    start = finger.start(POSTURE)
    options = CouplingOptions(tolerance, rounds)
    state = PairState(start, hood.start(finger.motion(start)))
    pair, tensions = Pair(finger, hood), Tensions(TENSION, NONE)
    return finger, fixed_point(pair, state, tensions, options, accelerator, turn)


@pytest.mark.parametrize("support", [IN_PLANE, FREE], ids=["held", "free"])
@pytest.mark.parametrize("accelerator", [ConstantRelaxation(0.7), Aitken(), QuasiNewton()])
def test_every_acceleration_comes_to_newton_s_equilibrium(support, accelerator):
    finger, found = by_fixed_point(support, accelerator)
    state, _, balance = solve(finger, cables_over_all_joints(), TENSION, NONE)
    angles = finger.angles(found.finger_state)
    assert np.abs(angles - finger.angles(finger.start(POSTURE))).max() > 1e-3
    np.testing.assert_allclose(angles, finger.angles(state), atol=1e-8)
    np.testing.assert_allclose(found.balance.tip_force, balance.tip_force, atol=1e-7)
    assert found.interface_residual <= 1e-10
    assert found.iterations > 2


def test_the_quasi_newton_takes_fewer_rounds_than_a_constant_share():
    rounds = [
        by_fixed_point(FREE, a)[1].iterations for a in (ConstantRelaxation(0.7), QuasiNewton())
    ]
    assert rounds[1] < rounds[0]


def test_residual_and_turn_both_decide():
    """A wide tolerance of one leaves it to the other."""
    rounds = [
        by_fixed_point(FREE, ConstantRelaxation(0.7), tolerance=tolerance, turn=turn)[1].iterations
        for tolerance, turn in ((0.5, 1.0), (0.5, 1e-9), (1e-10, 1.0))
    ]
    assert rounds[0] < min(rounds[1:])


def test_too_few_rounds_are_told_and_give_nothing():
    with pytest.raises(ConvergenceError, match=r'in 2 rounds of the fixed point.*"iqn_ils"'):
        by_fixed_point(FREE, Aitken(), rounds=2)


def test_a_case_chooses_it():
    newton = run_case(load_case("pulley_edc"))
    case = load_case("pulley_edc", ['coupling.scheme="implicit"'])
    assert case.setting_key() != load_case("pulley_edc").setting_key()
    implicit = run_case(case)
    forces = [vector_of(r.summary["fingertip_force_N"]) for r in (newton, implicit)]
    np.testing.assert_allclose(*forces, atol=1e-6)
    assert implicit.summary["audit_missed"] == []
    assert implicit.summary["iterations"]["coupling"] > newton.summary["iterations"]["coupling"]
