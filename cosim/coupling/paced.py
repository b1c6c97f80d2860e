"""A coupled motion in steps whose length follows from their error."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

from cosim.coupling import give_way
from cosim.coupling.adaptive import AdaptiveStep, Control, adaptive_step
from cosim.coupling.events import GivingHood
from cosim.coupling.motion import EVERY, CoupledMotion, MotionState, Pace
from cosim.coupling.state import CoupledState
from cosim.errors import Progress, pulse
from cosim.port import Array

DURATION_ROUNDING = 1e-12  # relative to the duration: so much may be missing at the end


def adaptive_states(
    moves: CoupledMotion, control: Control, at: MotionState, until: float, progress: Progress
) -> Iterator[tuple[MotionState, ...]]:
    """The states after each half of every accepted step up to `until` s; a step in which a part of
    the hood gives way ends there.

    Raises ConvergenceError, which says when, where a step of the control's floor misses its
    tolerance or fails."""
    begun, first = time.perf_counter(), at.coupled.time
    while until - at.coupled.time > DURATION_ROUNDING * until:
        at = moves.with_splints(at)
        end = min(until, moves.next_switch(at.coupled.time))
        step: tuple[MotionState, ...]
        if moves.giving is None:
            step = take_step(moves, control, at, end)
        else:
            step = _step_with_events(moves, moves.giving, control, at, end)
        at = step[-1]
        yield step
        c, count = at.coupled, at.pace.accepted
        if until - c.time > DURATION_ROUNDING * until:
            pulse("t = {:.4g} s, {} steps", c.time, count)
        if count % EVERY == 0 or until - c.time <= DURATION_ROUNDING * until:
            left = (time.perf_counter() - begun) / (c.time - first) * (until - c.time)
            progress(
                f"t = {c.time:.4g} s, {count} steps ({at.pace.rejected} rejected), {c.solves} hood "
                f"solves, some {left:.0f} s left"
            )


def take_step(
    moves: CoupledMotion, control: Control, at: MotionState, until: float
) -> tuple[MotionState, MotionState]:
    """One step, as long as the last one proposed or shorter to end at `until` s: the states after
    its halves."""
    c, split = at.coupled, len(moves.hood.tendons)

    def tension(time: float) -> tuple[Array, Array]:
        pulls = moves.tendon_pull(at, time).tension
        return pulls[:split], pulls[split:]

    dt = _first_try(until - c.time, at.pace.proposed)
    step = adaptive_step(moves.scheme, moves.finger, moves.hood, c, tension, dt, control)
    half = _state_after(moves, at, at, step.half, 0.5 * step.taken)
    whole = _state_after(moves, at, half, step.state, 0.5 * step.taken)
    return half, replace(whole, pace=_next_pace(at.pace, step))


def _step_with_events(
    moves: CoupledMotion, hood: GivingHood, control: Control, at: MotionState, until: float
) -> tuple[MotionState, ...]:
    """The states in a step that ends at latest where a part of the hood gives way or begins."""
    at = give_way.settle(moves, hood, at)
    half, whole = take_step(moves, control, at, min(until, give_way.next_time(hood, at)))
    for start, end in ((at, half), (half, whole)):
        if give_way.passes(hood, end):
            found = give_way.locate(moves, hood, start, end)
            done = replace(give_way.settle(moves, hood, found), pace=whole.pace)
            return (done,) if start is at else (half, done)
    return half, give_way.settle(moves, hood, whole)


def _first_try(left: float, proposed: float) -> float:
    """The first step to try (s); two like ones where one more would leave a sliver of the time that
    is `left`."""
    if left <= proposed:
        return left
    return min(proposed, 0.5 * left)


def _state_after(
    moves: CoupledMotion, at: MotionState, last: MotionState, c: CoupledState, dt: float
) -> MotionState:
    """The state `c`, `dt` s after `last`, in the step that began at `at`."""
    lost = last.dissipated + dt * moves.finger.dissipation(c.finger)
    slipped = last.slipped + moves.finger.device_loss(c.finger)
    rubbed = last.friction + moves.finger.friction_work(c.finger)
    pulls = moves.tendon_pull(at, c.time).state
    return MotionState(c, pulls, lost, slipped, rubbed, at.pace, at.draw, last.events)


def _next_pace(last: Pace, step: AdaptiveStep) -> Pace:
    return Pace(
        step.proposed,
        last.accepted + 1,
        last.rejected + step.rejected,
        max(last.error, step.error),
    )
