"""Coupling in time: one step of a finger and a hood, over the port and nothing else.

In a step from t to t + h the finger moves under what the scheme knows of the hood's load w(q, T):

    Explicit              w of the step before, held; then the hood follows (Gauss-Seidel), or works
                          at the same time at the pose q + h v (parallel: Jacobi)
    Implicit              w(q+), held, by a fixed point in the joint angles q+, accelerated
    Newton                w at the last iterate with its tangent, until that iterate is q+
    Linear                w at the predicted pose q + h v with its tangent, once
    Alone                 no hood is asked: for one that never pushes

The angles agree to `tolerance` (rad).  Where wrenches are compared, moments count over `length`, so
that N and N m do not mix.  Nothing here has a state: `CoupledState` is a value, and a step may be
repeated from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cosim.coupling.accelerators import (
    Accelerator,
    Aitken,
    ConstantRelaxation,
    accelerate,
    initial_history,
    reset_history,
    start_step,
)
from cosim.coupling.state import (
    CoupledState,
    Energy,
    HoodAnswer,
    Pulls,
    advance_state,
    energy_defect,
    hood_point,
    interface_residual,
)
from cosim.errors import ConvergenceError, pulse
from cosim.port import Array, Hood, Motion, MovingFinger, Response, State
from cosim.static_response import static_response
from cosim.stopwatch import timed

LENGTH = 0.046
"""m, of a proximal phalanx (Buchner et al. 1988, J Biomech 21, table 2)."""
ANGLE_TOLERANCE = 1e-9
"""rad."""
MOST_SOLVES = 30
ENERGY_MARGIN = 10.0
"""A stable staggered step lends the finger energy and takes it back, near its limit several times
what passes; what grows goes beyond any multiple."""
ENERGY_ROUNDING = 1e-12
"""J."""
MOST_TURN = np.deg2rad(8.0)
"""Between two iterations no joint moves further."""


@dataclass(frozen=True)
class Explicit:
    """Staggered; `parallel` for Jacobi instead of Gauss-Seidel."""

    parallel: bool = False
    length: float = LENGTH


@dataclass(frozen=True)
class Implicit:
    """A fixed point; no derivatives are asked for."""

    accelerator: Accelerator = field(default_factory=Aitken)
    tolerance: float = ANGLE_TOLERANCE
    most_solves: int = MOST_SOLVES
    length: float = LENGTH


@dataclass(frozen=True)
class Newton:
    """Newton's method with the hood's Jacobian of every iteration."""

    tolerance: float = ANGLE_TOLERANCE
    most_solves: int = MOST_SOLVES
    length: float = LENGTH


@dataclass(frozen=True)
class Linear:
    """Linearly implicit: one hood solve and one Jacobian a step."""

    length: float = LENGTH


@dataclass(frozen=True)
class Alone:
    """For a hood without tendons that never pushes: it is asked once, at the start."""


Scheme = Explicit | Implicit | Newton | Linear | Alone


def begin(
    scheme: Scheme,
    finger: MovingFinger,
    hood: Hood,
    state: State,
    tension: Pulls,
    time: float = 0.0,
) -> CoupledState:
    """A finger's `state` (from `finger.begin`) and a hood at static equilibrium on it."""
    motion = finger.motion(finger.angles(state))
    pull = tension(time)[0]
    first = static_response(hood, hood.start(motion), motion, pull)
    answer = _answer(scheme, hood, motion, pull, first)
    nq = len(finger.joints)
    return CoupledState(
        state,
        answer,
        float(time),
        hood_point(answer, motion),
        answer.response.load.total(),
        tension(time),
        0.0,
        1,
        finger.energy(state),
        Energy(),
        initial_history(_accelerator(scheme), nq),
    )


@timed("steps")
def step(
    scheme: Scheme, finger: MovingFinger, hood: Hood, state: CoupledState, tension: Pulls, dt: float
) -> CoupledState:
    """The finger and the hood `dt` s later; `state` stays valid.

    Raises ConvergenceError where the iteration, the hood or the finger does not converge, and where
    an explicit step gains energy that nobody put in."""
    match scheme:
        case Explicit():
            after = _explicit(scheme, finger, hood, state, tension, dt)
            _check_energy(scheme, finger, hood, state, after, dt)
            return after
        case Linear():
            return _linear(scheme, finger, hood, state, tension, dt)
        case Alone():
            return _alone(finger, state, tension, dt)
        case _:
            return _implicit(scheme, finger, hood, state, tension, dt)


def _explicit(
    scheme: Explicit,
    finger: MovingFinger,
    hood: Hood,
    state: CoupledState,
    tension: Pulls,
    dt: float,
) -> CoupledState:
    pulls = tension(state.time + dt)
    moved = finger.step(state.finger, state.answer.held_load(), pulls[1], dt)
    angles = _predict_angles(finger, state, dt) if scheme.parallel else finger.angles(moved)
    answer = ask_hood(scheme, hood, state.hood, finger.motion(angles), pulls[0], dt)
    applied = state.answer.response.load.total()
    residual = interface_residual(applied, answer, scheme.length)
    point = hood_point(answer, finger.motion(finger.angles(moved)))
    after = advance_state(finger, state, moved, answer, point, applied, pulls, dt)
    return replace(after, residual=residual, solves=state.solves + 1)


def _alone(finger: MovingFinger, state: CoupledState, tension: Pulls, dt: float) -> CoupledState:
    pulls = tension(state.time + dt)
    moved = finger.step(state.finger, state.answer.held_load(), pulls[1], dt)
    energy = _with_own_work(finger, state, moved, pulls[1])
    return replace(state, finger=moved, time=state.time + dt, tension=pulls, energy=energy)


def _with_own_work(
    finger: MovingFinger, state: CoupledState, moved: State, tension: Array
) -> Energy:
    old, new = (finger.path_lengths(finger.angles(at)) for at in (state.finger, moved))
    work, e = 0.5 * (state.tension[1] + tension) * (old - new), state.energy
    effort = e.effort + float(np.abs(work).sum())
    return replace(e, own=e.own + float(work.sum()), effort=effort)


def _linear(
    scheme: Linear, finger: MovingFinger, hood: Hood, state: CoupledState, tension: Pulls, dt: float
) -> CoupledState:
    pulls = tension(state.time + dt)
    motion = finger.motion(_predict_angles(finger, state, dt))
    answer = ask_hood(scheme, hood, state.hood, motion, pulls[0], dt)
    moved = finger.step(state.finger, answer.load(), pulls[1], dt)
    point = hood_point(answer, finger.motion(finger.angles(moved)))
    predicted = state.answer.predict(motion, pulls[0])
    residual = interface_residual(predicted, answer, scheme.length)
    after = advance_state(finger, state, moved, answer, point, point.wrench, pulls, dt)
    return replace(after, residual=residual, solves=state.solves + 1)


def _implicit(
    scheme: Implicit | Newton,
    finger: MovingFinger,
    hood: Hood,
    state: CoupledState,
    tension: Pulls,
    dt: float,
) -> CoupledState:
    pulls, accelerator = tension(state.time + dt), _accelerator(scheme)
    last_answer, history = state.answer, start_step(accelerator, state.history)
    last, angles, same_set = finger.angles(state.finger), _predict_angles(finger, state, dt), True
    for solves in range(1, scheme.most_solves + 1):
        pulse("step from t = {:.6g} s, hood solve {}", state.time, solves)
        answer = ask_hood(scheme, hood, state.hood, finger.motion(angles), pulls[0], dt)
        if same_set and (_active(answer) != _active(state.answer)).any():
            # Once a step: an iteration that hops to and fro would never learn.
            same_set, history = False, reset_history(accelerator, history)
        moved = finger.step(state.finger, answer.load(), pulls[1], dt)
        moved_angles = finger.angles(moved)
        turn = float(np.abs(moved_angles - angles).max())
        if turn <= scheme.tolerance:
            predicted = last_answer.predict(answer.motion, pulls[0])
            gap = interface_residual(predicted, answer, scheme.length)
            residual = gap * min(1.0, turn / (np.abs(angles - last).max() or turn or 1.0))
            point = hood_point(answer, finger.motion(moved_angles))
            after = advance_state(finger, state, moved, answer, point, point.wrench, pulls, dt)
            solves += state.solves
            return replace(after, residual=residual, solves=solves, history=history)
        last_answer, last = answer, angles
        aim, history = accelerate(accelerator, history, angles, moved_angles)
        angles = last + (aim - last) * min(1.0, MOST_TURN / (np.abs(aim - last).max() or 1.0))
    raise ConvergenceError(
        f"hood and finger did not agree in the step from t = {state.time:.6g} s to "
        f"{state.time + dt:.6g} s: after {solves} hood solves a joint would still turn by "
        f"{turn:.1e} rad, {scheme.tolerance:.1e} is allowed. Try a smaller step, IQN-ILS in place "
        "of another acceleration, or the scheme newton or linear."
    )


def _accelerator(scheme: Scheme) -> Accelerator:
    return scheme.accelerator if isinstance(scheme, Implicit) else ConstantRelaxation()


def _predict_angles(finger: MovingFinger, state: CoupledState, dt: float) -> Array:
    """Predict the joint angles (nq,) rad, q + h v."""
    return finger.angles(state.finger) + dt * finger.rates(state.finger)


def ask_hood(
    scheme: Scheme, hood: Hood, state: State, motion: Motion, tension: Array, dt: float
) -> HoodAnswer:
    """The hood's answer at `motion` under `tension` (nt,) N, from a state of its own, with its
    tangent where the scheme wants it.  Raises ConvergenceError."""
    return _answer(scheme, hood, motion, tension, hood.advance(state, motion, tension, dt))


def _answer(
    scheme: Scheme, hood: Hood, motion: Motion, tension: Array, response: Response
) -> HoodAnswer:
    wants_tangent = isinstance(scheme, (Newton, Linear))
    tangent = hood.jacobian(response.state) if wants_tangent else None
    return HoodAnswer(motion, tension, response, tangent)


def _active(answer: HoodAnswer) -> Array:
    """Which tendons pull, and which bodies feel which source: what slack and contacts change."""
    loaded = (answer.response.load.wrench != 0).any(axis=2)
    return np.concatenate([answer.tension > 0, loaded.ravel()])


def _check_energy(
    scheme: Explicit,
    finger: MovingFinger,
    hood: Hood,
    state: CoupledState,
    after: CoupledState,
    dt: float,
) -> None:
    """Check that the finger has no more energy than hood and tendons gave it, by ENERGY_MARGIN
    times what they ever gave and what was stored in the finger at first.  Raises
    ConvergenceError."""
    # In parallel the hood's books are one step late.
    gained = energy_defect(
        finger, replace(after, finger=state.finger) if scheme.parallel else after
    )
    e = after.energy
    allowed = e.effort + e.most + abs(after.start) + ENERGY_ROUNDING
    if gained <= ENERGY_MARGIN * allowed:
        return
    limit = explicit_limit(finger, hood, state, dt)
    known = (
        "Working in parallel needs damping and a step far below"
        if scheme.parallel
        else "It is stable below about"
    )
    raise ConvergenceError(
        f"explicit coupling: up to t = {after.time:.6g} s the finger gained {gained:.1e} J from "
        f"no source (hood and tendons gave it {allowed:.1e} J at most): unstable at a step of "
        f"{dt:g} s. {known} 2 sqrt(I/K) = {limit:.2g} s, I the joints' inertia and K the hood's "
        "stiffness. Try a smaller step, or the scheme linear."
    )


def explicit_limit(finger: MovingFinger, hood: Hood, state: CoupledState, dt: float) -> float:
    """The longest stable step of the explicit scheme (s), 2 sqrt(I/K) of the stiffest motion, from
    the hood's Jacobian K and the finger's answers h^2 I^-1 K dq to the load of small turns dq;
    infinite where the hood does not push back."""
    q = finger.angles(state.finger)
    load, native = state.answer.held_load(), state.tension[1]
    slope = hood.jacobian(state.hood).load_motion @ finger.jacobian(q)
    still = finger.angles(finger.step(state.finger, load, native, dt))
    turn, answers = 1e-5, []
    for change in slope.T:
        pushed = replace(load, wrench=load.wrench + turn * change.reshape(-1, 6))
        answers.append(finger.angles(finger.step(state.finger, pushed, native, dt)) - still)
    most = float(np.linalg.eigvals(-np.array(answers).T / turn).real.max())
    return 2 * dt / np.sqrt(most) if most > 0 else np.inf
