"""A hood that relaxes, beside closed forms: its load, its rest, its books of energy, its arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.hoods.kind import BuiltHood
from cosim.hoods.relaxing import RelaxingFeHood, RelaxingState, borne, relaxed
from cosim.port import STATIC
from fe_solver.forces.cables import Cables, law
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.materials.prony import Prony
from fe_solver.solver.fields import energy_fields
from tests.helpers.pulled import Sled, on_springs, to_body
from tests.proofs.fe.sheets import clamp, plate, sheet

X = np.array([1.0, 0, 0])
NONE = np.zeros(0)
TISSUE = Prony(np.array([0.5]), np.array([2.0]))
SIDE, STIFF = 10e-3, 1e4


def strip(only: bool = False) -> ShellHood:
    """A soft block between springs to the ground and to the sled; or clamped to the ground, on one
    that only pulls."""
    points, quads = plate(SIDE, SIDE, 2, 1)
    model = sheet(points, quads, 10e6, 0.3, 1e-3, bodies=("ground", "sled"))
    left, right = (np.flatnonzero(points[:, 0] == x) for x in (0.0, SIDE))
    far = to_body("far", model, right, 1, SIDE * X, STIFF)
    if only:
        model, sets = clamp(model, left), [replace(far, law=replace(far.law, tension_only=True))]
    else:
        sets = [to_body("near", model, left, 0, -SIDE * X, STIFF), far]
    return on_springs(model, sets, Sled(1.0, X))


def relaxing(only: bool = False, law: Prony = TISSUE) -> RelaxingFeHood:
    return RelaxingFeHood(BuiltHood(strip(only)), law)


def at(reach: float):
    return Sled(1.0, X).motion(np.array([reach]))


def pull_of(response) -> float:
    """N by which the hood pulls the sled back."""
    return -float(response.load.total()[1, 0])


def test_of_a_strip_that_is_held_stretched_the_load_falls_as_its_law_says():
    hood = relaxing()
    rest = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    first = hood.advance(rest, at(1e-3), NONE, 0.0)
    elastic = hood.whole.advance(hood.whole.start(at(0)), at(1e-3), NONE, STATIC)
    assert pull_of(first) == pytest.approx(pull_of(elastic), rel=1e-9)
    state, time = first.state, 0.0
    for dt in (0.1, 0.7, 5.0, 100.0):
        after = hood.advance(state, at(1e-3), NONE, dt)
        state, time = after.state, time + dt
        left = float(TISSUE.modulus(time))
        assert pull_of(after) == pytest.approx(left * pull_of(first), rel=1e-9)
    in_the_end = hood.advance(state, at(1e-3), NONE, STATIC)
    assert pull_of(in_the_end) == pytest.approx(TISSUE.left * pull_of(first), rel=1e-9)
    assert in_the_end.state.memory is state.memory


def test_what_is_borne_at_rest_does_not_relax():
    hood = relaxing()
    rest = hood.advance(hood.start(at(1e-3)), at(1e-3), NONE, STATIC)
    later = hood.advance(rest.state, at(1e-3), NONE, 50.0)
    assert pull_of(later) == pytest.approx(pull_of(rest), rel=1e-10)


def test_the_derivatives_of_a_step_are_those_of_its_loads():
    hood = relaxing()
    rest = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    state = hood.advance(rest, at(1e-3), NONE, 1.0).state
    middle = hood.advance(state, at(1.2e-3), NONE, 0.5)
    slope = hood.jacobian(middle.state).load_motion[6, 6]
    ends = [pull_of(hood.advance(state, at(1.2e-3 + d), NONE, 0.5)) for d in (1e-7, -1e-7)]
    assert -slope == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-6)


def test_a_spring_that_went_slack_bears_nothing_and_recovers_its_length():
    hood = relaxing(only=True)
    rest = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    long = hood.advance(hood.advance(rest, at(1e-3), NONE, 0.0).state, at(1e-3), NONE, 3.0).state
    slack = hood.advance(long, at(0), NONE, 0.0)
    assert pull_of(slack) == 0.0
    soon = hood.advance(slack.state, at(0.5e-3), NONE, 0.0)
    waited = slack.state
    for _ in range(20):
        waited = hood.advance(waited, at(0), NONE, 5.0).state
    late = hood.advance(waited, at(0.5e-3), NONE, 0.0)
    fresh = hood.advance(rest, at(0.5e-3), NONE, 0.0)
    assert pull_of(soon) < 0.9 * pull_of(late)
    assert pull_of(late) == pytest.approx(pull_of(fresh), rel=1e-9)


def test_the_work_of_a_cycle_is_stored_and_given_back_but_for_what_relaxed():
    """There and slowly back: all that is left in the books is what was lost."""
    hood = relaxing()
    state = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    last, work, reach, stored = 0.0, 0.0, 0.0, []
    there = np.linspace(0, 1e-3, 21)[1:]
    for aim in (*there, *there[::-1][1:], 0.0):
        after = hood.advance(state, at(aim), NONE, 0.05)
        work += (last + pull_of(after)) / 2 * (aim - reach)
        state, last, reach = after.state, pull_of(after), aim
        stored.append(hood.energy(state))
    assert 0 < stored[19] < work + stored[19]
    assert stored[-1] == pytest.approx(0, abs=1e-5 * stored[19])
    bearing = borne(hood.hood_of(state), state.hood)
    assert work > 0
    assert np.abs(bearing).max() > 0  # it is not free of stress yet
    later = hood.advance(state, at(0), NONE, 100.0)
    assert pull_of(later) == pytest.approx(0, abs=1e-9)


def test_the_books_of_a_spring_in_even_steps_are_its_closed_form():
    """Work put in over a ramp: what is stored for good and what the branch took."""
    hood = relaxing()
    state = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    whole = hood.whole.advance(hood.whole.start(at(0)), at(1e-5), NONE, STATIC)
    stiffness, work, last, rate, dt = pull_of(whole) / 1e-5, 0.0, 0.0, 1e-5, 0.02
    for k in range(1, 51):
        after = hood.advance(state, at(k * dt * rate), NONE, dt)
        work += (last + pull_of(after)) / 2 * dt * rate
        state, last = after.state, pull_of(after)
    tau = 2.0
    branch = stiffness * 0.5 * rate**2 * tau * (1 - tau * -np.expm1(-1 / tau))
    assert hood.energy(state) == pytest.approx(
        0.5 * stiffness * 0.5 * (50 * dt * rate) ** 2, rel=1e-3
    )
    assert work - hood.energy(state) == pytest.approx(branch, rel=2e-3)


def test_a_state_is_read_back_to_the_bit_and_goes_on_alike():
    hood = relaxing()
    rest = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    state = hood.advance(rest, at(1e-3), NONE, 0.3).state
    for known in (rest, state):
        read = hood.from_arrays(hood.to_arrays(known))
        assert isinstance(read, RelaxingState)
        on, again = (hood.advance(s, at(2e-3), NONE, 0.3) for s in (known, read))
        assert np.array_equal(on.load.wrench, again.load.wrench)
        assert hood.energy(on.state) == hood.energy(again.state)


def test_cables_of_a_step_bear_the_elastic_law_times_its_factor_and_what_is_held():
    cells = Cables(
        np.array([[0, 1]]),
        *(np.array([v]) for v in (10e-3, 1e9, 1e-6, 1e-3, 0.01)),
    )
    hood = strip()
    net = replace(hood, model=replace(hood.model, cables=cells))
    state = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    held = np.zeros(len(borne(net, state)))
    held[-1] = -3.0
    length = np.array([10.2e-3])
    residual = 0.01 * length / 10e-3
    before, after = law(cells, length), law(relaxed(net, 0.7, held).model.cables, length)
    assert after.force - residual == pytest.approx(0.7 * (before.force - residual) - 3.0)


def test_the_energy_shown_of_a_relaxed_sheet_is_that_of_its_law_at_its_strains():
    """Not the potential of a step, which falls below zero."""
    hood = relaxing()
    rest = hood.advance(hood.start(at(0)), at(0), NONE, STATIC).state
    state = hood.advance(rest, at(1e-3), NONE, 3.0).state
    shown, elastic = (
        energy_fields(h.model, state.hood.configuration).density
        for h in (hood.hood_of(state), hood.whole)
    )
    assert hood.hood_of(state) is not hood.whole
    np.testing.assert_array_equal(shown, elastic)
