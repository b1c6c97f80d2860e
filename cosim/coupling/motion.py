"""A coupled motion in time: the loop over the steps, and what is kept of each.

Muscles pull with the lengths that their paths had at the end of the step before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from cosim.coupling.events import BEGINS, FAILS, NO_EVENTS, TIME_ROUNDING, Event, GivingHood
from cosim.coupling.excursion import (
    ExcursionState,
    PrescribedExcursions,
    initial_excursions,
    solve_excursions,
)
from cosim.coupling.schemes import Scheme, ask_hood, begin, step
from cosim.coupling.state import CoupledState, advance_state, hood_point
from cosim.errors import ConvergenceError, Progress, ResidualText, pulse
from cosim.port import STATIC, Array, Hood, MovingFinger, State

EVERY = 50
"""Steps between two words of progress."""


class TendonDrive(Protocol):
    """The drive of the tendons: gives tensions over time. Its state is opaque."""

    def start(self, length: Array) -> State:
        """The state at t = 0 with paths of `length` (nt,) m, the hood's tendons first."""
        ...

    def pull(self, state: State, time: float, length: Array, dt: float) -> Any:
        """An object with `tension` (nt,) N and `state` at `time` s, `dt` s after `state`."""
        ...

    def settle_at(self, state: State, length: Array) -> State:
        """The state at the start, once the hood has found its equilibrium with paths of `length`
        (nt,) m: pistons stand where they start there."""
        ...

    def cylinder_signals(self, state: State, time: float) -> Array:
        """Signals (nc, 2) of each pneumatic cylinder: V commanded, Pa above the atmosphere."""
        ...

    def motor_signals(self, state: State, time: float) -> Array:
        """How far each motor has drawn its tendon's end, m, and its torque, N m, (nm, 2)."""
        ...


class RecordedFinger(MovingFinger, Protocol):
    """A moving finger that also reports what is recorded of a motion."""

    def with_tension(self, state: State, tension: Array) -> State:
        """The state at the start with its tendons under tensions (nt,) N already: they stretch by
        what changes from then on."""
        ...

    def dissipation(self, state: State) -> float:
        """W, dissipated by the damping of joints and limits."""
        ...

    def device_loss(self, state: State) -> float:
        """The energy (J) that a device about the fingertip dissipated in the step that ended in the
        state."""
        ...

    def friction_work(self, state: State) -> Array:
        """The work (3,) J at the guides of tendons in the step that ended in the state: made heat,
        held before a tendon slides, and of both what came from the tendons' stretch."""
        ...

    def grip(self, state: State) -> Array:
        """The grip (n,), -1 to 1, of friction at the guides of tendons."""
        ...

    def joint_torques(self, state: State) -> Array:
        """The torques (3, nq) N m of passive joints, of limits and of the damping of both, as far
        as the finger knows them."""
        ...

    def at_insertions(self, angles: Array, tension: Array, grip: Array) -> Array:
        """The tensions (nt,) N that friction leaves at the insertions of the finger's own."""
        ...

    def stored_energy(self, state: State) -> Mapping[str, float]:
        """The parts of `energy` (J) by kind; empty where only their sum is known."""
        ...

    def tip_wrench(self, state: State) -> Array:
        """The wrench (6,) of the fingertip on the world: N, and N m about the fingertip, world
        frame."""
        ...

    def tip(self, angles: Array) -> Array | None:
        """The fingertip's point (3,) m at joint angles (nq,) rad, where it is known."""
        ...

    def lines(self, angles: Array) -> dict[str, Array]:
        """Polylines (k, 3) m to draw, by name."""
        ...

    def ledger(
        self,
        before: tuple[Array, Array],
        now: tuple[Array, Array],
        dt: float,
        hood: Array,
        tension: Array,
        tip: Array,
        grip: Array,
        joints: Array,
    ) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin by source at the end of a step of `dt` s
        between two (angles, rates), beside the hood's (nb, 6) and under the own tendons' tensions
        (nt,), the tip's wrench (6,) on the world, friction's `grip` (n,) and the torques (3, nq) of
        the `joints`, as far as the finger knows its forces."""
        ...


class SplintedFinger(Protocol):
    """A moving finger with splints that are put on and taken off by the clock."""

    @property
    def switches(self) -> tuple[Array, Array]:
        """When each splint (k,) is put on, and when it is taken off, s."""
        ...

    def splinted(self, state: State) -> State:
        """The state with those splints put on and taken off that are due."""
        ...

    def splint_torques(self, state: State) -> Array:
        """The torques (k,) N m of the splints."""
        ...


@dataclass(frozen=True)
class Pace:
    """How the steps of a motion went whose length follows from their error."""

    proposed: float
    """s, for the next one."""
    accepted: int = 0
    rejected: int = 0
    error: float = 0.0
    """rad, the largest estimated of an accepted step."""


@dataclass(frozen=True)
class MotionState:
    """The state of a motion between two steps: all that is needed to go on."""

    coupled: CoupledState
    drive: State
    dissipated: float
    """J, dissipated by the joints and limits since the start."""
    slipped: float
    """J, dissipated by a device about the fingertip since the start."""
    friction: Array
    """(3,) J since the start, as of `RecordedFinger.friction_work`."""
    pace: Pace
    draw: ExcursionState
    events: Array = field(default_factory=lambda: NO_EVENTS)
    """(n, 8) what gave way or began since the start, a row as of `events.Event` each."""


@dataclass(frozen=True)
class MotionFrame:
    """The recorded quantities of a motion at one time."""

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
    """Relative imbalance of the massless hood: of its forces, of its moments."""
    residual: float
    energy: float
    """J, the finger's energy."""
    drive: Array
    """(nc, 2) of each pneumatic cylinder: V commanded, Pa above the atmosphere."""
    motors: Array
    """(nm, 2) of each motor: m that its tendon's end is drawn, N m."""
    points: Array
    """(k, 3) m, the points of the user's on the hood, world axes."""
    grip: Array
    """(n,) of friction at the guides of tendons."""
    friction: Array
    """(3,) J since the start, as of `RecordedFinger.friction_work`."""
    joint_torques: Array
    """(3, nq) N m, of passive joints, of limits and of the damping of both."""


NO_EXCURSIONS = PrescribedExcursions((), np.zeros(0, dtype=int), lambda time: np.zeros(0))


def no_points(state: State) -> Array:
    """The points (0, 3) of a hood that follows none of the user's."""
    return np.zeros((0, 3))


@dataclass(frozen=True)
class CoupledMotion:
    """A finger and a hood that move together in steps of `dt` s."""

    scheme: Scheme
    finger: RecordedFinger
    hood: Hood
    drive: TendonDrive
    dt: float
    prescribed: PrescribedExcursions = NO_EXCURSIONS
    points: Callable[[State], Array] = no_points
    """(k, 3) m, the points of the user's on the hood in one of its states."""
    giving: GivingHood | None = None
    """The hood, where parts of it give way or begin to act."""
    splinted: SplintedFinger | None = None
    """The finger, where splints are put on or taken off."""

    def begin(self, state: State) -> MotionState:
        """The motion at rest in the finger's `state`, the hood in equilibrium on it."""
        split, (pulls, tension) = len(self.hood.tendons), self.first_pull(state)
        state = self.finger.with_tension(state, tension[split:])
        coupled = begin(
            self.scheme,
            self.finger,
            self.hood,
            state,
            lambda time: (tension[:split], tension[split:]),
        )
        index = self.prescribed.index
        draw = initial_excursions(
            tension[index], self._excursions(coupled)[index], self.prescribed.relaxation
        )
        lengths = np.concatenate([-coupled.point.excursion, self._path_lengths(coupled.finger)])
        pulls = self.drive.settle_at(pulls, lengths)
        return MotionState(coupled, pulls, 0.0, 0.0, np.zeros(3), Pace(self.dt), draw)

    def first_pull(self, state: State) -> tuple[State, Array]:
        """What pulls at t = 0 on the finger in `state`, and with what tensions (nt,) N."""
        lengths = np.concatenate([np.zeros(len(self.hood.tendons)), self._path_lengths(state)])
        pulls = self.drive.start(lengths)
        return pulls, self.drive.pull(pulls, 0.0, lengths, 0.0).tension

    def advance(self, at: MotionState) -> MotionState:
        """One step on; raises ConvergenceError."""
        return self.advance_by(self.with_splints(at), self.dt)

    def with_splints(self, at: MotionState) -> MotionState:
        """The motion with those splints put on and taken off that are due, which is booked."""
        if self.splinted is None:
            return at
        c, first = at.coupled, 0 if self.giving is None else len(self.giving.names)
        finger, torque = self.splinted.splinted(c.finger), self.splinted.splint_torques(c.finger)
        events = [
            [first + i, c.time, torque[i], 0.0, 0.0, 0.0, kind, 0.0]
            for kind, times in zip((BEGINS, FAILS), self.splinted.switches, strict=True)
            for i in np.flatnonzero(times <= c.time + TIME_ROUNDING)
            if not (at.events[:, [0, 6]] == (first + i, kind)).all(axis=1).any()
        ]
        if not events:
            return at
        rows, lost = np.array(events), self.finger.energy(c.finger) - self.finger.energy(finger)
        rows[:, Event._fields.index("lost")] = lost / len(rows)
        c = replace(c, finger=finger)
        return replace(at, coupled=c, events=np.vstack([at.events, rows]))

    def next_switch(self, time: float) -> float:
        """When after `time` s the next splint is put on or taken off, s; inf without."""
        if self.splinted is None:
            return np.inf
        times = np.concatenate(self.splinted.switches)
        return float(times[times > time + TIME_ROUNDING].min(initial=np.inf))

    def advance_by(self, at: MotionState, dt: float) -> MotionState:
        """The motion `dt` s on in one step, in which nothing gives way.  Raises
        ConvergenceError."""
        time = at.coupled.time + dt
        pull = self.tendon_pull(at, time)
        after, draw = self.with_excursions(
            at, pull.tension, time, partial(self._step_under, at.coupled, dt)
        )
        lost = at.dissipated + dt * self.finger.dissipation(after.finger)
        slipped = at.slipped + self.finger.device_loss(after.finger)
        rubbed = at.friction + self.finger.friction_work(after.finger)
        return MotionState(after, pull.state, lost, slipped, rubbed, at.pace, draw, at.events)

    def with_excursions(
        self,
        at: MotionState,
        tension: Array,
        time: float,
        step: Callable[[Array], CoupledState],
    ) -> tuple[CoupledState, ExcursionState]:
        """What `step` makes of tensions (nt,) N, in which those of the displaced tendons are solved
        for.  The hood solves of all trials are counted."""
        if not self.prescribed.names:
            return step(tension), at.draw
        index, first, solves = self.prescribed.index, at.coupled.solves, 0

        def trial(displaced: Array) -> tuple[CoupledState, Array]:
            nonlocal solves
            pulls = tension.copy()
            pulls[index] = displaced
            after = step(pulls)
            solves += after.solves - first
            return after, self._excursions(after)[index]

        after, draw = solve_excursions(self.prescribed, at.draw, time, trial)
        return replace(after, solves=first + solves), draw

    def at_rest_on(self, c: CoupledState, hood: State, tension: Array) -> CoupledState:
        """The finger as it is at `c`, and the hood in equilibrium on it from the state `hood` of
        its own, under tensions (nt,) N.  Raises ConvergenceError."""
        split, motion = len(self.hood.tendons), self.finger.motion(self.finger.angles(c.finger))
        answer = ask_hood(self.scheme, self.hood, hood, motion, tension[:split], STATIC)
        pulls, point = (tension[:split], tension[split:]), hood_point(answer, motion)
        after = advance_state(self.finger, c, c.finger, answer, point, c.applied, pulls, 0.0)
        return replace(after, solves=c.solves + 1)

    def _step_under(self, c: CoupledState, dt: float, tension: Array) -> CoupledState:
        """A step of `dt` s under tensions (nt,) N."""
        split = len(self.hood.tendons)
        pulls = tension[:split], tension[split:]
        return step(self.scheme, self.finger, self.hood, c, lambda time: pulls, dt)

    def _excursions(self, c: CoupledState) -> Array:
        """The excursions (nt,) m of all tendons, each from a length of its own."""
        return np.concatenate([c.point.excursion, -self._path_lengths(c.finger)])

    def tendon_pull(self, at: MotionState, time: float) -> Any:
        """The pull at `time` s, after `at`, on paths as long as they are at `at`: an object with
        `tension` (nt,) N and `state`."""
        c = at.coupled
        lengths = np.concatenate([-c.point.excursion, self._path_lengths(c.finger)])
        return self.drive.pull(at.drive, time, lengths, time - c.time)

    def frame(self, at: MotionState) -> MotionFrame:
        """The recorded quantities of a state."""
        c = at.coupled
        load, motion = c.answer.response.load, c.answer.motion
        return MotionFrame(
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
            self.drive.cylinder_signals(at.drive, c.time),
            self.drive.motor_signals(at.drive, c.time),
            self.points(c.hood),
            self.finger.grip(c.finger),
            at.friction,
            self.finger.joint_torques(c.finger),
        )

    def _path_lengths(self, state: State) -> Array:
        return self.finger.path_lengths(self.finger.angles(state))


def motion_states(
    moves: CoupledMotion, at: MotionState, steps: int, progress: Progress
) -> Iterator[MotionState]:
    """The states after each of `steps` steps.  Raises ConvergenceError, which says when."""
    begun = time.perf_counter()
    for k in range(1, steps + 1):
        try:
            at = moves.advance(at)
        except ConvergenceError as error:
            raise ConvergenceError(f"at t = {at.coupled.time:.6g} s: {error}") from error
        c = at.coupled
        if k % EVERY == 0 or k == steps:
            left = (time.perf_counter() - begun) / k * (steps - k)
            line = (
                f"t = {c.time:.4g} s, residual {c.residual:.1e}, {c.solves} hood solves, some "
                f"{left:.0f} s left"
            )
            progress(ResidualText(line, c.residual))
        yield at
        if k < steps:
            pulse("t = {:.4g} s, step {} of {}, residual {:.1e}", c.time, k, steps, c.residual)
