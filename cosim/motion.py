"""A coupled motion in time: the loop over the steps, and what is kept of each.

Muscles pull with the lengths that their paths had at the end of the step before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cosim.coupled import Coupled
from cosim.port import Array, ConvergenceError, Hood, MovingFinger, State
from cosim.schemes import Scheme, begin, step

Progress = Callable[[str], None]
EVERY = 50
"""Steps between two words of progress."""


class Puller(Protocol):
    """What gives tensions over time; its state is opaque."""

    def start(self, length: Array) -> State:
        """At t = 0 with paths of `length` (nt,) m, the hood's tendons first."""
        ...

    def pull(self, state: State, time: float, length: Array, dt: float) -> Any:
        """At `time` s, `dt` s after `state`: an object with `tension` (nt,) N and `state`."""
        ...


@dataclass(frozen=True)
class Moment:
    """A motion between two steps: all that going on needs."""

    coupled: Coupled
    puller: State
    dissipated: float
    """J, by the joints and limits since the start."""


@dataclass(frozen=True)
class Frame:
    """What is kept of a time."""

    time: float
    angles: Array
    rates: Array
    tension: Array
    """(nt,) N, the hood's tendons, then the finger's own."""
    excursion: Array
    wrench: Array
    """(nb, ns, 6) of the hood by source; with the scheme Linear at the predicted pose."""
    total: Array
    """(nb, 6) of the hood at the pose."""
    imbalance: tuple[float, float]
    """Of the massless hood: relative, of forces and moments."""
    residual: float
    energy: float
    """J, of the finger."""


@dataclass(frozen=True)
class Moves:
    """A finger and a hood that move together in steps of `dt` s."""

    scheme: Scheme
    finger: MovingFinger
    hood: Hood
    puller: Puller
    damping: Callable[[Array, Array], Array]
    """(nq,) N m of the joints' damping at angles and rates."""
    dt: float

    def begin(self, state: State) -> Moment:
        """At rest in the finger's `state`, the hood in equilibrium on it."""
        split = len(self.hood.tendons)
        lengths = np.concatenate([np.zeros(split), self._own(state)])
        pulls = self.puller.start(lengths)
        tension = self.puller.pull(pulls, 0.0, lengths, 0.0).tension
        coupled = begin(
            self.scheme,
            self.finger,
            self.hood,
            state,
            lambda time: (tension[:split], tension[split:]),
        )
        return Moment(coupled, pulls, 0.0)

    def advance(self, at: Moment) -> Moment:
        """One step on; raises ConvergenceError."""
        split, c = len(self.hood.tendons), at.coupled
        lengths = np.concatenate([-c.point.excursion, self._own(c.finger)])
        pull = self.puller.pull(at.puller, c.time + self.dt, lengths, self.dt)
        tension = pull.tension
        after = step(
            self.scheme,
            self.finger,
            self.hood,
            c,
            lambda time: (tension[:split], tension[split:]),
            self.dt,
        )
        q, v = self.finger.angles(after.finger), self.finger.rates(after.finger)
        lost = -self.dt * float(self.damping(q, v) @ v)
        return Moment(after, pull.state, at.dissipated + lost)

    def frame(self, at: Moment) -> Frame:
        c = at.coupled
        load, motion = c.answer.response.load, c.answer.motion
        return Frame(
            c.time,
            self.finger.angles(c.finger),
            self.finger.rates(c.finger),
            np.concatenate(c.tension),
            c.point.excursion,
            load.wrench,
            c.point.wrench,
            load.imbalance(motion),
            c.residual,
            self.finger.energy(c.finger),
        )

    def _own(self, state: State) -> Array:
        return self.finger.path_lengths(self.finger.angles(state))


def moments(moves: Moves, at: Moment, steps: int, progress: Progress) -> Iterator[Moment]:
    """The states after each of `steps` steps.  Raises ConvergenceError, which says when."""
    begun = time.perf_counter()
    for k in range(1, steps + 1):
        try:
            at = moves.advance(at)
        except ConvergenceError as error:
            raise ConvergenceError(f"at t = {at.coupled.time:.6g} s: {error}") from error
        if k % EVERY == 0 or k == steps:
            c = at.coupled
            left = (time.perf_counter() - begun) / k * (steps - k)
            progress(
                f"t = {c.time:.4g} s, residual {c.residual:.1e}, {c.solves} hood solves, some "
                f"{left:.0f} s left"
            )
        yield at
