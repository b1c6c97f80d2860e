"""A finger and a hood at one time, and the books of what passes between them.

Where wrenches are compared, moments count over a length, so that N and N m do not mix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cosim.coupling.accelerators import History
from cosim.port import AffineLoad, Array, HoodJacobian, Motion, MovingFinger, Response, State

Pulls = Callable[[float], tuple[Array, Array]]
"""Tensions (N) at a time (s): of the hood's tendons, and of the finger's own."""


@dataclass(frozen=True)
class Answer:
    """What a hood said at one pose and tension (nt,) N, with its tangent where that was asked."""

    motion: Motion
    tension: Array
    response: Response
    tangent: HoodJacobian | None

    def load(self) -> AffineLoad:
        """The load that follows the tangent; held where there is none."""
        if self.tangent is None:
            return self.held()
        return AffineLoad(self.motion, self.response.load.total(), self.tangent.load_motion)

    def held(self) -> AffineLoad:
        """The load as it is, at any pose."""
        n = 6 * len(self.motion.bodies)
        return AffineLoad(self.motion, self.response.load.total(), np.zeros((n, n)))

    def foreseen(self, motion: Motion, tension: Array) -> Array:
        """(nb, 6) load at another pose and tension, as the tangent has it."""
        return self.displaced(self.motion.twist_to(motion), tension)

    def displaced(self, twist: Array, tension: Array) -> Array:
        """(nb, 6) load after the bodies' twists (nb, 6) under another tension, as the tangent has
        it."""
        wrench = self.response.load.total()
        if self.tangent is None:
            return wrench
        change = self.tangent.load_motion @ twist.ravel()
        change = change + self.tangent.load_tension @ (tension - self.tension)
        return wrench + change.reshape(-1, 6)


class Point(NamedTuple):
    """Where the books of a hood stand."""

    motion: Motion
    wrench: Array
    """(nb, 6)."""
    excursion: Array
    """(nt,) m."""


@dataclass(frozen=True)
class Energy:
    """J, sums since the start."""

    tendons: float = 0.0
    """Work of the hood's tendons, by their excursions (trapezoidal rule), and"""
    own: float = 0.0
    """of the finger's own, by their lengths."""
    effort: float = 0.0
    """Both without their signs."""
    load: float = 0.0
    """Work of the load that the finger was stepped with, as it was at each step's end."""
    hood: float = 0.0
    """Work of the hood's load (trapezoidal rule): with the tendons' work it says what the hood has
    stored; and"""
    most: float = 0.0
    """the most that this has been."""
    foreseen: float = 0.0
    """Work of what the answer before foresaw beyond the hood's own answer, between the poses of
    the two; what a scheme without tangent foresees is the same load."""

    @property
    def artificial(self) -> float:
        """What scheme and step gave the bodies beyond the hood's own work (negative: took)."""
        return self.load - self.hood


@dataclass(frozen=True)
class Coupled:
    """A finger and a hood at one time."""

    finger: State
    answer: Answer
    """The hood's last, with its state; at the pose q + h v with Linear and parallel Explicit."""
    time: float
    point: Point
    """The hood's load and excursions at the finger's pose, as its answer and tangent say; without a
    tangent at the pose of its answer."""
    applied: Array
    """(nb, 6) the load under which the finger made its last step, as it was at the end: the hood's
    answer, what its tangent made of that, or an old one."""
    tension: tuple[Array, Array]
    """N, of the hood's tendons and of the finger's own."""
    residual: float
    """Interface residual of the last step, relative: of Explicit the applied load against the
    hood's next answer; of Linear what the answer before foresaw against the next; of Implicit and
    Newton the same between their last two answers, times the share of its turn that the iteration
    had yet to go."""
    solves: int
    """Hood solves since the start."""
    start: float
    """J, the finger's energy at the start."""
    energy: Energy
    history: History

    @property
    def hood(self) -> State:
        return self.answer.response.state


def apart(a: Array, answer: Answer, length: float) -> float:
    """Largest force or moment over `length` (m) of a load (nb, 6) less the answer's, over the
    largest that the answer holds from any source or tendon; that difference itself (N) where it
    holds none."""
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    load = answer.response.load
    most = np.abs(load.wrench / scale).max(initial=0.0)
    most = max(most, np.abs(load.pull[:, :3]).max(initial=0.0))
    return float(np.abs((a - load.total()) / scale).max() / (most or 1.0))


def unexplained(finger: MovingFinger, state: Coupled) -> float:
    """J that the finger has beyond what it had at first and hood and tendons gave it; negative
    where that was dissipated."""
    e = state.energy
    return finger.energy(state.finger) - state.start - e.hood - e.own


def followed(
    finger: MovingFinger,
    state: Coupled,
    moved: State,
    answer: Answer,
    point: Point,
    applied: Array,
    pulls: tuple[Array, Array],
    dt: float,
) -> Coupled:
    """The state with the finger `moved` to `point` under `applied` (nb, 6), and the books kept."""
    return replace(
        state,
        finger=moved,
        answer=answer,
        point=point,
        time=state.time + dt,
        applied=applied,
        tension=pulls,
        energy=_exchanged(finger, state, moved, answer, point, applied, pulls),
    )


def standing(answer: Answer, motion: Motion) -> Point:
    """Where the books stand with the finger's bodies at `motion`."""
    response = answer.response
    if answer.tangent is None:
        return Point(answer.motion, response.load.total(), response.excursion)
    twist = answer.motion.twist_to(motion)
    moved = answer.tangent.excursion_motion @ twist.ravel()
    return Point(motion, answer.displaced(twist, answer.tension), response.excursion + moved)


def _exchanged(
    finger: MovingFinger,
    state: Coupled,
    moved: State,
    answer: Answer,
    point: Point,
    applied: Array,
    pulls: tuple[Array, Array],
) -> Energy:
    e, before, last = state.energy, state.answer, state.point
    q, then = finger.angles(moved), finger.angles(state.finger)
    turned = finger.motion(then).twist_to(finger.motion(q))
    tendons = 0.5 * (state.tension[0] + pulls[0]) * (point.excursion - last.excursion)
    shorter = finger.path_lengths(then) - finger.path_lengths(q)
    own = 0.5 * (state.tension[1] + pulls[1]) * shorter
    passed = 0.5 * (last.wrench + point.wrench) * last.motion.twist_to(point.motion)
    asked = before.motion.twist_to(answer.motion)
    beyond = before.displaced(asked, answer.tension) - answer.response.load.total()
    hood = e.hood + float(passed.sum())
    return Energy(
        tendons=e.tendons + float(tendons.sum()),
        own=e.own + float(own.sum()),
        effort=e.effort + float(np.abs(tendons).sum() + np.abs(own).sum()),
        load=e.load + float((applied * turned).sum()),
        hood=hood,
        most=max(e.most, hood),
        foreseen=e.foreseen + float((beyond * asked).sum()),
    )
