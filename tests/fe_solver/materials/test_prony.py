"""Relaxation in steps beside closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import exp1

from cosim.errors import InputError
from fe_solver.materials.prony import Prony, Swing

TWO = Prony(np.array([0.2, 0.3]), np.array([0.5, 40.0]))
SOLE = Prony.fung(0.118, 0.5, 1500.0)


def borne(law: Prony, times, elastic, rest=0.0):
    """What a law bears at times that begin at 0, of what it bears at once."""
    memory, out = law.start(np.array([rest])), []
    for before, time, now in zip([0.0, *times], times, elastic, strict=False):
        factor, held = law.law(memory, time - before)
        out.append(factor * now + held[0])
        memory = law.after(memory, np.array([out[-1]]), time - before)
    return np.array(out)


def test_fung_s_spectrum_is_his_closed_form():
    time = np.geomspace(1e-3, 1e5, 60)
    closed = 1 + 0.118 * (exp1(time / 1500) - exp1(time / 0.5))
    np.testing.assert_allclose(SOLE.modulus(time), closed / (1 + 0.118 * np.log(3000)), atol=2e-5)


def test_the_sole_of_the_foot_loses_40_percent_in_240_seconds():
    assert 1 - SOLE.modulus(240.0) == pytest.approx(0.40, abs=0.01)


def test_of_a_part_that_is_held_any_steps_leave_what_the_function_says():
    times = np.array([0.0, 0.01, 3.0, 3.1, 500.0])
    np.testing.assert_allclose(borne(SOLE, times, np.ones(5)), SOLE.modulus(times), rtol=1e-13)


@given(st.lists(st.floats(1e-3, 50), min_size=1, max_size=6))
def test_an_even_change_is_exact_in_any_steps(steps):
    """Of a ramp at rate 1: the integral of the relaxation function."""
    time = np.cumsum(steps)
    terms = TWO.weights * TWO.times * -np.expm1(-time[:, None] / TWO.times)
    closed = TWO.left * time + terms.sum(axis=1)
    np.testing.assert_allclose(borne(TWO, time, time), closed, rtol=1e-12)


def test_under_a_steady_load_a_standard_solid_creeps_as_its_compliance_says():
    law, missed = Prony(np.array([0.6]), np.array([10.0])), []
    for count in (20, 40):
        memory, before = law.start(np.zeros(1)), 0.0
        for time in (0.0, *np.geomspace(1e-3, 60, count)):
            factor, held = law.law(memory, time - before)
            strain = (1 - held[0]) / factor
            memory, before = law.after(memory, np.ones(1), time - before), time
        closed = 1 / law.left - (1 / law.left - 1) * np.exp(-law.left * 60 / 10.0)
        missed.append(abs(strain - closed))
    assert missed[1] < 0.01
    assert missed[0] / missed[1] == pytest.approx(4, rel=0.2)


def test_a_cycle_loses_its_loss_modulus():
    speed, steps = 2 * np.pi / 3.0, 400
    time = np.arange(1, 20 * steps + 1) * 3.0 / steps
    strain = np.sin(speed * time)
    stress = borne(TWO, time, strain)[-steps - 1 :]
    last = strain[-steps - 1 :]
    loop = ((stress[1:] + stress[:-1]) / 2 * np.diff(last)).sum()
    x = speed * TWO.times
    assert loop == pytest.approx(np.pi * float(TWO.weights @ (x / (1 + x**2))), rel=2e-4)


def test_many_cycles_in_one_step_are_those_one_after_the_other():
    """Evenly up and down between two strains, the lower of which creeps evenly."""
    low, high, creep, period, count = 1.0, 3.0, 0.02, 0.4, 50
    memory = TWO.after(TWO.start(np.zeros(1)), np.array([low]), 0.0)
    each, total = memory, count * period
    for k in range(1, count + 1):
        for aim in (high + creep * (k - 0.5) / count, low + creep * k / count):
            factor, held = TWO.law(each, period / 2)
            each = TWO.after(each, factor * aim + held, period / 2)
    swing = Swing(np.array([high - low]), period)
    factor, held = TWO.law(memory, total, swing)
    at_once = TWO.after(memory, factor * (low + creep) + held, total, swing)
    np.testing.assert_allclose(at_once.branches, each.branches, atol=2e-4)
    np.testing.assert_allclose(at_once.elastic, each.elastic)


def test_what_is_borne_at_rest_stays():
    np.testing.assert_allclose(borne(TWO, [1.0, 1e4], [3.0, 3.0], rest=3.0), 3.0, rtol=1e-14)


def test_at_once_a_law_is_elastic_and_in_the_end_it_has_what_is_left():
    at_rest = TWO.start(np.array([2.0]))
    factor, held = TWO.law(at_rest, 0.0)
    assert (factor, held[0]) == pytest.approx((1, 0), abs=1e-15)
    loaded = TWO.after(at_rest, np.array([6.0]), 0.0)
    factor, held = TWO.law(loaded, np.inf)
    assert factor == TWO.left
    assert factor * 6 + held[0] == pytest.approx(2 + TWO.left * 4)


@pytest.mark.parametrize(
    ("weights", "times"),
    [([0.6, 0.5], [1, 2]), ([-0.1], [1]), ([0.1], [0]), ([0.1, 0.1], [1]), ([np.nan], [1])],
)
def test_what_is_no_relaxation_is_refused(weights, times):
    with pytest.raises(InputError, match="relaxation: "):
        Prony(np.array(weights), np.array(times, dtype=float))
