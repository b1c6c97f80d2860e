"""Parts of a hood that give way in a motion, or begin to act: when within a step, and what becomes
of their energy.

A step in which a part passes what it can bear is cut, by interpolation and halving, until it has
just passed that.  Of several the order is then told, or they are within SAME_SHARE of each other
and give way at once.  The part is let go with bodies, tensions and time held: what the hood loses
there, with what its tendons put in meanwhile, is booked as lost.  What its neighbours bear then may
let go the next one at the same time: the one that is furthest beyond what it can bear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cosim.coupling.events import BEGINS, FAILS, TIME_ROUNDING, Event, GivingHood
from cosim.coupling.motion import CoupledMotion, MotionState
from cosim.errors import ConvergenceError, InputError
from cosim.port import Array, Mask

MOST_CUTS = 24
"""So often is a step cut in which parts pass what they can bear."""
OVERSHOOT = 1e-7
"""How far beyond what it can bear a part gives way at most, unless the cuts end before."""
SAME_SHARE = 1e-6
"""Parts that are beyond what they bear by shares that differ by less give way at once."""
FADED = 1e-3
"""The share of its stiffness by which a part that lets go over a while may be off."""


@dataclass(frozen=True)
class GivingMotion(CoupledMotion):
    """A motion in which parts of the hood `giving` give way or begin to act."""

    def advance(self, at: MotionState) -> MotionState:
        """One step on, with what gives way and begins in it.  Raises ConvergenceError."""
        hood = self.giving
        assert hood is not None
        end, at = at.coupled.time + self.dt, settle(self, hood, self.with_splints(at))
        while (left := end - at.coupled.time) > TIME_ROUNDING + 1e-9 * self.dt:
            after = self.advance_by(at, min(left, next_time(hood, at) - at.coupled.time))
            if passes(hood, after):
                after = locate(self, hood, at, after)
            at = settle(self, hood, after)
        return at


def next_time(hood: GivingHood, at: MotionState) -> float:
    """The next time (s) at which a part is let go or begins by the clock; inf without."""
    s, (begun, failed) = hood.schedule, _history(hood, at)
    times = np.concatenate([s.begins[~begun], s.ends[~failed]])
    return float(times[times > at.coupled.time + TIME_ROUNDING].min(initial=np.inf))


def locate(
    moves: CoupledMotion, hood: GivingHood, at: MotionState, after: MotionState
) -> MotionState:
    """The state between `at` and `after` in which a part has just passed what it can bear: the
    first one, or several of which nothing tells the order."""
    low, high, solves = 0.0, after.coupled.time - at.coupled.time, after.coupled.solves
    under, over = (_shares(hood, end).max() - 1.0 for end in (at, after))
    for k in range(MOST_CUTS):
        if over <= OVERSHOOT:
            break
        part = 0.5 if k % 3 == 2 else (0.5 * OVERSHOOT - under) / (over - under)
        middle = low + float(np.clip(part, 0.0, 1.0)) * (high - low)
        tried = moves.advance_by(at, middle)
        solves += tried.coupled.solves - at.coupled.solves
        if (beyond := _shares(hood, tried).max() - 1.0) >= 0.0:
            high, after, over = middle, tried, beyond
        else:
            low, under = middle, beyond
    return replace(after, coupled=replace(after.coupled, solves=solves))


def passes(hood: GivingHood, at: MotionState) -> bool:
    """Whether a part has passed what it can bear."""
    return bool((_shares(hood, at) >= 1.0).any())


def settle(moves: CoupledMotion, hood: GivingHood, at: MotionState) -> MotionState:
    """The motion with all let go and begun that is due: one after the other, or at once where
    nothing tells the order."""
    while True:
        time, (begun, failed) = at.coupled.time, _history(hood, at)
        begin = (hood.schedule.begins <= time + TIME_ROUNDING) & ~begun
        end = (hood.schedule.ends <= time + TIME_ROUNDING) & ~failed & ~begin
        if not (begin | end).any():
            share = _shares(hood, at)
            end = share >= max(1.0, share.max() * (1 - SAME_SHARE))
        wanted = np.where(begin, 1.0, _fading(hood, at, end))
        left = hood.bearing(at.coupled.hood).left
        if not (begin | end).any() and np.array_equal(wanted, left):
            return at
        at = _change(moves, hood, at, wanted, begin, end)


def _history(hood: GivingHood, at: MotionState) -> tuple[Mask, Mask]:
    """Which parts (k,) have begun, and which have given way."""
    parts = np.arange(len(hood.names))
    begun, failed = (
        np.isin(parts, at.events[at.events[:, 6] == kind, 0]) for kind in (BEGINS, FAILS)
    )
    return begun, failed


def _shares(hood: GivingHood, at: MotionState) -> Array:
    """What the parts (k,) bear over what they can; 0 of those that have given way."""
    return np.where(_history(hood, at)[1], 0.0, hood.bearing(at.coupled.hood).share)


def _fading(hood: GivingHood, at: MotionState, end: Mask) -> Array:
    """The shares (k,) that are to be left of the parts, those that `end` now among them; what is
    left of those that let go over a while changes where it is off by FADED, or gone."""
    s, bearing = hood.schedule, hood.bearing(at.coupled.hood)
    out = bearing.left.copy()
    out[end & (s.over_time == 0) & (s.over_stretch == 0)] = 0.0
    fails = (at.events[:, 6] == FAILS) & (at.events[:, 0] < len(hood.names))
    for event in (Event(*row) for row in at.events[fails]):
        i = int(event.part)
        gone = 0.0
        if s.over_time[i]:
            gone = (at.coupled.time - event.time + TIME_ROUNDING) / s.over_time[i]
        elif s.over_stretch[i]:
            gone = (bearing.stretch[i] - event.stretch) / s.over_stretch[i]
        if gone >= 1 or 1 - gone < bearing.left[i] - FADED:
            out[i] = max(1 - gone, 0.0)
    return out


def _change(
    moves: CoupledMotion, hood: GivingHood, at: MotionState, left: Array, begin: Mask, end: Mask
) -> MotionState:
    """The motion with the shares `left` (k,), in equilibrium again at the same time and pose."""
    c = at.coupled
    whole = moves.at_rest_on(c, c.hood, np.concatenate(c.tension))
    bearing, weaker = hood.bearing(c.hood), hood.with_left(whole.hood, left, begin)
    try:
        after, draw = moves.with_excursions(
            replace(at, coupled=whole),
            np.concatenate(c.tension),
            c.time,
            partial(moves.at_rest_on, whole, weaker),
        )
    except (ConvergenceError, InputError) as error:
        gone = ", ".join(name for name, on in zip(hood.names, end, strict=True) if on)
        raise ConvergenceError(
            f"at t = {c.time:.6g} s {gone or 'a part'} gave way, and what is left of the hood "
            f"finds no equilibrium under these tensions: {error}"
        ) from error
    lost = hood.energy(whole.hood) - hood.energy(after.hood)
    lost += after.energy.tendons - whole.energy.tendons
    now, events = np.flatnonzero(begin | end), at.events.copy()
    fading = np.flatnonzero((left != bearing.left) & ~(begin | end))
    rows = np.flatnonzero((events[:, 6] == FAILS) & np.isin(events[:, 0], fading))
    each = lost / (len(rows) + len(now))
    events[rows, 5] += each
    more = (bearing.force, bearing.stretch, bearing.energy)
    new = np.zeros((len(now), events.shape[1]))
    new[:, 0], new[:, 1], new[:, 2:5] = now, c.time, np.stack(more, axis=1)[now]
    new[:, 5], new[:, 6], new[:, 7] = each, np.where(begin[now], BEGINS, FAILS), len(now) - 1
    return replace(at, coupled=after, draw=draw, events=np.vstack([events, new]))
