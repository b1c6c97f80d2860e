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
class HoodAnswer:
    """A hood's answer at one pose and tension (nt,) N, with its tangent where asked for."""

    motion: Motion
    tension: Array
    response: Response
    tangent: HoodJacobian | None

    def load(self) -> AffineLoad:
        """The load that follows the tangent; held where there is none."""
        if self.tangent is None:
            return self.held_load()
        return AffineLoad(self.motion, self.response.load.total(), self.tangent.load_motion)

    def held_load(self) -> AffineLoad:
        """The load as it is, at any pose."""
        n = 6 * len(self.motion.bodies)
        return AffineLoad(self.motion, self.response.load.total(), np.zeros((n, n)))

    def predict(self, motion: Motion, tension: Array) -> Array:
        """Predict the load (nb, 6) at another pose and tension (nt,) N by the tangent."""
        return self.predict_from_twist(self.motion.twist_to(motion), tension)

    def predict_from_twist(self, twist: Array, tension: Array) -> Array:
        """Predict the load (nb, 6) after the bodies' twists (nb, 6) under another tension (nt,) N
        by the tangent."""
        wrench = self.response.load.total()
        if self.tangent is None:
            return wrench
        change = self.tangent.load_motion @ twist.ravel()
        change = change + self.tangent.load_tension @ (tension - self.tension)
        return wrench + change.reshape(-1, 6)


class HoodPoint(NamedTuple):
    """The hood's load and excursions at a pose, from which its work is counted."""

    motion: Motion
    wrench: Array
    """(nb, 6) N and N m about the bodies' origins."""
    excursion: Array
    """(nt,) m."""


@dataclass(frozen=True)
class Energy:
    """Work done and stored since the start, in J."""

    tendons: float = 0.0
    """Work of the hood's tendons, by their excursions (trapezoidal rule)."""
    own: float = 0.0
    """Work of the finger's own tendons, by their lengths (trapezoidal rule)."""
    effort: float = 0.0
    """The tendons' work without its signs: the hood's tendons' and the finger's own."""
    load: float = 0.0
    """Work of the load that the finger was stepped with, as it was at each step's end."""
    hood: float = 0.0
    """Work of the hood's load on the bodies (trapezoidal rule); with the tendons' work it gives
    what the hood has stored."""
    most: float = 0.0
    """The largest value that `hood` has had."""
    predicted: float = 0.0
    """Work of the load that the last answer predicted less the hood's next answer, between their
    two poses; a scheme without tangent predicts the same load."""

    @property
    def artificial(self) -> float:
        """What scheme and step gave the bodies beyond the hood's own work (negative: took)."""
        return self.load - self.hood


@dataclass(frozen=True)
class CoupledState:
    """A finger and a hood at one time."""

    finger: State
    answer: HoodAnswer
    """The hood's last, with its state; at the pose q + h v with Linear and parallel Explicit."""
    time: float
    point: HoodPoint
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
        """The hood's state."""
        return self.answer.response.state


def interface_residual(a: Array, answer: HoodAnswer, length: float) -> float:
    """Relative interface residual: the largest force, or moment over `length` (m), of a load (nb,
    6) less the answer's, over the largest that the answer holds from any source or tendon; in N
    where the answer holds none."""
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    load = answer.response.load
    most = np.abs(load.wrench / scale).max(initial=0.0)
    most = max(most, np.abs(load.pull[:, :3]).max(initial=0.0))
    return float(np.abs((a - load.total()) / scale).max() / (most or 1.0))


def energy_defect(finger: MovingFinger, state: CoupledState) -> float:
    """The energy (J) that the finger has beyond its energy at the start and the work of hood and
    tendons; negative where energy was dissipated."""
    e = state.energy
    return finger.energy(state.finger) - state.start - e.hood - e.own


def advance_state(
    finger: MovingFinger,
    state: CoupledState,
    moved: State,
    answer: HoodAnswer,
    point: HoodPoint,
    applied: Array,
    pulls: tuple[Array, Array],
    dt: float,
) -> CoupledState:
    """The state with the finger `moved` to `point` under `applied` (nb, 6), and the books kept."""
    e, last_answer, last = state.energy, state.answer, state.point
    q, then = finger.angles(moved), finger.angles(state.finger)
    turned = finger.motion(then).twist_to(finger.motion(q))
    tendons = 0.5 * (state.tension[0] + pulls[0]) * (point.excursion - last.excursion)
    shorter = finger.path_lengths(then) - finger.path_lengths(q)
    native_work = 0.5 * (state.tension[1] + pulls[1]) * shorter
    passed = 0.5 * (last.wrench + point.wrench) * last.motion.twist_to(point.motion)
    asked = last_answer.motion.twist_to(answer.motion)
    beyond = last_answer.predict_from_twist(asked, answer.tension) - answer.response.load.total()
    hood = e.hood + float(passed.sum())
    energy = Energy(
        tendons=e.tendons + float(tendons.sum()),
        own=e.own + float(native_work.sum()),
        effort=e.effort + float(np.abs(tendons).sum() + np.abs(native_work).sum()),
        load=e.load + float((applied * turned).sum()),
        hood=hood,
        most=max(e.most, hood),
        predicted=e.predicted + float((beyond * asked).sum()),
    )
    return replace(
        state,
        finger=moved,
        answer=answer,
        point=point,
        time=state.time + dt,
        applied=applied,
        tension=pulls,
        energy=energy,
    )


def hood_point(answer: HoodAnswer, motion: Motion) -> HoodPoint:
    """The hood's load and excursions with the bodies at `motion`, by the answer's tangent."""
    response = answer.response
    if answer.tangent is None:
        return HoodPoint(answer.motion, response.load.total(), response.excursion)
    twist = answer.motion.twist_to(motion)
    moved = answer.tangent.excursion_motion @ twist.ravel()
    return HoodPoint(
        motion, answer.predict_from_twist(twist, answer.tension), response.excursion + moved
    )
