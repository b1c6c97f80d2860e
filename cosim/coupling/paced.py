"""A coupled motion in steps whose length follows from their error."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

from cosim.coupling.adaptive import Adapted, Control, adaptive
from cosim.coupling.motion import EVERY, Moment, Moves, Pace
from cosim.coupling.state import Coupled
from cosim.errors import Progress
from cosim.port import Array

ROUNDING = 1e-12
"""Of the duration, that may be missing at the end."""


def paced(
    moves: Moves, control: Control, at: Moment, until: float, progress: Progress
) -> Iterator[tuple[Moment, Moment]]:
    """The states after each half of every accepted step up to `until` s.

    Raises ConvergenceError, which says when, where a step of the control's floor misses its
    tolerance or fails."""
    begun, first = time.perf_counter(), at.coupled.time
    while until - at.coupled.time > ROUNDING * until:
        half, at = stepped(moves, control, at, until)
        yield half, at
        c, count = at.coupled, at.pace.accepted
        if count % EVERY == 0 or until - c.time <= ROUNDING * until:
            left = (time.perf_counter() - begun) / (c.time - first) * (until - c.time)
            progress(
                f"t = {c.time:.4g} s, {count} steps ({at.pace.rejected} rejected), {c.solves} hood "
                f"solves, some {left:.0f} s left"
            )


def stepped(moves: Moves, control: Control, at: Moment, until: float) -> tuple[Moment, Moment]:
    """One step, as long as the last one proposed or shorter to end at `until` s: the states after
    its halves."""
    c, split = at.coupled, len(moves.hood.tendons)

    def tension(time: float) -> tuple[Array, Array]:
        pulls = moves.pulled(at, time).tension
        return pulls[:split], pulls[split:]

    dt = _first_try(until - c.time, at.pace.proposed)
    found = adaptive(moves.scheme, moves.finger, moves.hood, c, tension, dt, control)
    half = _after(moves, at, at, found.half, 0.5 * found.taken)
    whole = _after(moves, at, half, found.state, 0.5 * found.taken)
    return half, replace(whole, pace=_pace(at.pace, found))


def _first_try(left: float, proposed: float) -> float:
    """s; two like ones where one more would leave a sliver of the time that is `left`."""
    if left <= proposed:
        return left
    return min(proposed, 0.5 * left)


def _after(moves: Moves, at: Moment, before: Moment, c: Coupled, dt: float) -> Moment:
    """The state `c`, `dt` s after `before`, in the step that began at `at`."""
    lost = before.dissipated + dt * moves.finger.dissipation(c.finger)
    slipped = before.slipped + moves.finger.device_loss(c.finger)
    return Moment(c, moves.pulled(at, c.time).state, lost, slipped, at.pace, at.draw)


def _pace(before: Pace, found: Adapted) -> Pace:
    return Pace(
        found.proposed,
        before.accepted + 1,
        before.rejected + found.rejected,
        max(before.error, found.error),
    )
