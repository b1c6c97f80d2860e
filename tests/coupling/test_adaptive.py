"""Steps in time whose length follows from their error."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.coupling.adaptive import Control, adaptive_step
from cosim.coupling.schemes import Explicit, Linear, Newton, Scheme, begin, step
from cosim.errors import ConvergenceError, InputError
from tests.helpers.recording_hood import recording_pair
from tests.proofs.coupling.pairs import REST, pulls_on_cables, soft_pair, soft_truth, stiff_pair


def steps_of(control: Control, until: float, scheme: Scheme | None = None) -> list:
    finger, hood = soft_pair()
    scheme = Linear() if scheme is None else scheme
    start = finger.begin(dict(zip(finger.joints, REST, strict=True)))
    state, dt, out = begin(scheme, finger, hood, start, pulls_on_cables), 1e-3, []
    while state.time < until - 1e-12:
        dt = min(dt, until - state.time)
        out.append(adaptive_step(scheme, finger, hood, state, pulls_on_cables, dt, control))
        state, dt = out[-1].state, out[-1].proposed
    return out


@pytest.mark.parametrize("scheme", [Linear(), Newton()])
def test_a_tighter_tolerance_gives_more_steps_and_less_error(scheme):
    truth = soft_truth(np.array([0.0, 0.01]))[-1]
    runs = [steps_of(Control(e, 1e-6, 5e-3), 0.01, scheme) for e in (1e-3, 1e-4)]
    errors = [np.abs(run[-1].state.finger.angles - truth).max() for run in runs]
    assert errors[1] < 0.5 * errors[0]
    assert len(runs[1]) > 1.5 * len(runs[0])
    for run, tolerance in zip(runs, (1e-3, 1e-4), strict=True):
        assert 0.1 * tolerance < max(s.error for s in run) <= tolerance
        assert run[-1].state.time == pytest.approx(0.01)
        for s in run:
            growth = np.clip(0.9 * np.sqrt(tolerance / s.error), 0.2, 2.0)
            assert s.proposed == pytest.approx(min(growth * s.taken, 5e-3))


def test_the_scheme_makes_the_halves():
    finger, hood = soft_pair()
    state = begin(Explicit(), finger, hood, finger.begin({"MCP": 0.5}), pulls_on_cables)
    found = adaptive_step(
        Explicit(), finger, hood, state, pulls_on_cables, 1e-3, Control(1.0, 1e-4, 1e-2)
    ).state
    for _ in range(2):
        state = step(Explicit(), finger, hood, state, pulls_on_cables, 5e-4)
    assert np.array_equal(found.finger.angles, state.finger.angles)
    assert found.solves == state.solves + 1


def test_all_solves_of_adaptive_steps_are_counted():
    run = steps_of(Control(1e-4, 1e-6, 5e-3), 0.01)
    tries = len(run) + sum(s.rejected for s in run)
    assert run[-1].state.solves == 1 + 3 * tries
    assert sum(s.rejected for s in run) > 0


def test_a_jump_that_no_step_resolves_is_an_honest_stop():
    finger, hood = stiff_pair()
    jump = lambda t: (np.array([1e3 * (t > 0.00203)]), np.zeros(0))  # noqa: E731
    control = Control(1e-6, 1e-4, 2e-3)
    state = begin(Linear(), finger, hood, finger.begin({}), jump)
    first = adaptive_step(Linear(), finger, hood, state, jump, 5e-3, control)
    assert (first.taken, first.proposed, first.rejected) == (2e-3, 2e-3, 0)
    match = r"at t = 0.002 s a step of 0.0001 s, .*error of .* rad; the tolerance is 1.0e-06 rad"
    with pytest.raises(ConvergenceError, match=match):
        adaptive_step(Linear(), finger, hood, first.state, jump, 2e-3, control)


def test_a_step_that_fails_is_tried_shorter_until_the_floor():
    finger, hood = recording_pair()
    hood.most_tension = 5.0
    ramp = lambda t: (np.array([1e3 * t]), np.zeros(0))  # noqa: E731
    state = begin(Linear(), finger, hood, finger.begin({}), ramp)
    control = Control(1.0, 1e-3, 1e-2)
    found = adaptive_step(Linear(), finger, hood, state, ramp, 8e-3, control)
    assert (found.taken, found.rejected) == (4e-3, 1)
    match = r"at t = 0.004 s a step of 0.001 s, the smallest allowed, did not converge"
    late = lambda t: ramp(2 * t)  # noqa: E731
    with pytest.raises(ConvergenceError, match=match) as stop:
        adaptive_step(Linear(), finger, hood, found.state, late, 8e-3, control)
    assert "tears" in str(stop.value.__cause__)


@pytest.mark.parametrize("values", [(0.0, 1e-4, 1e-3), (1e-3, 0.0, 1e-3), (1e-3, 2e-3, 1e-3)])
def test_a_control_that_cannot_work_is_refused(values):
    with pytest.raises(InputError, match="floor <= ceiling"):
        Control(*values)
