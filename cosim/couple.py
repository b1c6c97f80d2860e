"""Coupled static equilibrium of a finger and a hood, over the port and nothing else.

The hood answers a pose with wrenches and with their derivatives.  The finger then balances against
that answer as an affine function of its poses, which costs it next to nothing; the hood is asked
again at the new pose, until its answer is the one that the finger balanced against.  Each round is
a Newton step of the whole (the finger's own nonlinearity, such as a joint limit, is solved out).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import (
    STATIC,
    Array,
    Balance,
    ConvergenceError,
    Finger,
    Hood,
    HoodJacobian,
    Load,
    Motion,
    Response,
    State,
)

MOST_TURN = np.deg2rad(8.0)
"""A finger's joint moves at most so far in one round."""
LOOSE, NEAR = 1e-3, 0.1
"""The hood is solved to LOOSE until the interface's residual is below NEAR (an inexact Newton:
Dembo, Eisenstat and Steihaug 1982, SIAM J Numer Anal 19:400)."""
AT_REST = 1e-4
"""rad: a finger that would still turn so far is not at rest, however small its residual: it stands
where it would run away."""
MOST_STEPS = 30
MOST_RELAXING = 500
RELAXING_TURN = np.deg2rad(0.5)
NEAR_REST = 1e-6
"""Of the largest residual met, where relaxing ends and Newton takes over."""
SMALL_TORQUE = 1e-12
"""N m, below which a residual that no longer falls is rounding error."""


@dataclass(frozen=True)
class CouplingOptions:
    """`tolerance` of the finger's and of the interface's relative residual."""

    tolerance: float = 5e-7
    max_iterations: int = 25


@dataclass(frozen=True)
class Equilibrium:
    """A coupled equilibrium with its audit."""

    finger_state: State
    motion: Motion
    response: Response
    balance: Balance
    jacobian: HoodJacobian
    hood_tension: Array
    finger_tension: Array
    finger_residual: float
    """Relative imbalance of the finger against the load that it was solved with."""
    interface_residual: float
    """Relative difference, as joint torques, of that load and the hood's answer at this pose."""
    iterations: int
    """Hood solves."""

    @property
    def load(self) -> Load:
        return self.response.load

    @property
    def excursion(self) -> Array:
        return self.response.excursion


def affine(load: Load, by_motion: Array, at: Motion, motion: Motion) -> Load:
    """The load at `motion` as the tangent `by_motion` (6 nb, 6 nb) at `at` foresees it; the change
    is booked under the first source, since only its sum plays a part."""
    change = (by_motion @ at.twist_to(motion).ravel()).reshape(-1, 6)
    wrench = load.wrench.copy()
    wrench[:, 0] += change
    return replace(load, wrench=wrench)


def balanced(
    finger: Finger, state: State, load: Load, tension: Array, by_motion: Array, tolerance: float
) -> tuple[State, Balance]:
    """The finger's stable equilibrium under an affine load (its poses at `state` are where it was
    taken), or a state on the way there where a joint turns by more than MOST_TURN: so far off, the
    affine load need not have an equilibrium.

    Raises ConvergenceError."""
    at, nq = finger.motion(state), len(finger.joints)
    start = np.zeros(len(finger.unknowns(state)))

    def there(step: Array) -> tuple[State, Load]:
        moved = finger.displaced(state, step)
        return moved, affine(load, by_motion, at, finger.motion(moved))

    def residual(step: Array) -> Array:
        return finger.balance(*there(step), tension).residual

    def slope(step: Array) -> Array:
        return finger.tangent(*there(step), tension, by_motion)

    step = _newton(residual, slope, start)
    if step is None or not _is_near(step, nq) or _softest(slope(step), nq) > 0:
        step = _relaxed(residual, slope, start, nq)
        if _is_near(step, nq):
            polished = _newton(residual, slope, step)
            step = step if polished is None else polished
    moved, seen = there(step)
    balance = finger.balance(moved, seen, tension)
    if _is_near(step, nq) and not balance.relative <= tolerance:
        raise ConvergenceError(
            f"the finger found no equilibrium: its relative residual is {balance.relative:.1e} "
            f"(joints {finger.joints}). Try a stiffer passive joint, or smaller tensions."
        )
    return moved, balance


def _is_near(step: Array, nq: int) -> bool:
    return bool(np.abs(step[:nq]).max() <= MOST_TURN)


def _newton(
    residual: Callable[[Array], Array], slope: Callable[[Array], Array], step: Array
) -> Array | None:
    """A root near `step` by plain Newton, or None where a step does not lower the residual."""
    r = residual(step)
    for _ in range(MOST_STEPS):
        try:
            trial = step - np.linalg.solve(slope(step), r)
        except np.linalg.LinAlgError:
            return None
        after = residual(trial)
        if not np.abs(after).max() < np.abs(r).max():
            break
        step, r = trial, after
    else:
        return None
    return step if np.abs(r).max() < SMALL_TORQUE else None


def _softest(slope: Array, nq: int) -> float:
    """N m/rad, the largest eigenvalue of the joints' tangent (n, n) over the motions that the tip's
    support allows; positive where the finger runs away from its equilibrium."""
    free = np.linalg.svd(slope[nq:, :nq])[2][len(slope) - nq :].T
    allowed = free.T @ slope[:nq, :nq] @ free
    return float(np.linalg.eigvalsh((allowed + allowed.T) / 2).max(initial=-np.inf))


def _relaxed(
    residual: Callable[[Array], Array], slope: Callable[[Array], Array], step: Array, nq: int
) -> Array:
    """The step after which a finger with viscous joints has come near rest, or has turned a joint
    by more than MOST_TURN: implicit steps whose damping falls with the residual (pseudo-transient
    continuation: Kelley and Keyes 1998, SIAM J Numer Anal 35:508), so that it ends in a stable
    equilibrium."""
    r, largest, joints = residual(step), 0.0, np.zeros(len(step))
    joints[:nq] = 1.0
    for _ in range(MOST_RELAXING):
        size = np.abs(r).max()
        largest = max(largest, size)
        if size <= NEAR_REST * largest or not _is_near(step, nq):
            break
        tangent = slope(step)
        damping = max(size / RELAXING_TURN, 2 * _softest(tangent, nq), 0.0)
        move = -np.linalg.solve(tangent - np.diag(damping * joints), r)
        move /= max(1.0, np.abs(move[:nq]).max() / RELAXING_TURN)
        step = step + move
        r = residual(step)
    return step


def equilibrium(
    finger: Finger,
    hood: Hood,
    finger_state: State,
    hood_state: State,
    hood_tension: Array,
    finger_tension: Array,
    options: CouplingOptions,
    progress: Callable[[str], None] = lambda text: None,
) -> Equilibrium:
    """Joint angles, tip reaction and hood shape that balance, from a finger and a hood nearby.

    Raises ConvergenceError when the interface residual stays above its tolerance, or when the hood
    or the finger alone has no equilibrium."""
    interface, exact = np.inf, False
    state = hood_state
    for iteration in range(1, options.max_iterations + 1):
        motion = finger.motion(finger_state)
        solver = hood if exact else hood.loosely(LOOSE)
        response = solver.advance(state, motion, hood_tension, STATIC)
        jacobian = solver.jacobian(response.state)
        now = finger.balance(finger_state, response.load, finger_tension)
        interface = now.relative
        progress(f"coupling round {iteration}: relative residual {interface:.1e}")
        aim, foreseen = balanced(
            finger,
            finger_state,
            response.load,
            finger_tension,
            jacobian.load_motion,
            options.tolerance,
        )
        turn = np.abs(finger.angles(aim) - finger.angles(finger_state)).max()
        if exact and interface <= options.tolerance and turn <= AT_REST:
            return Equilibrium(
                finger_state,
                motion,
                response,
                now,
                jacobian,
                hood_tension,
                finger_tension,
                foreseen.relative,
                interface,
                iteration,
            )
        exact = interface <= NEAR
        finger_state, state = aim, response.state
    raise ConvergenceError(
        f"hood and finger did not agree in {options.max_iterations} rounds: the interface's "
        f"relative residual is {interface:.1e}, its tolerance {options.tolerance:.1e}. Try more "
        "rounds (solve.max_iterations), a smaller tension, or a stiffer passive joint."
    )


def moment_arms(finger: Finger, e: Equilibrium) -> Array:
    """(nq, nt) m, by force: derivative of the joint torques by each hood tendon's tension,
    d tau/d T at fixed pose (for a prestressed hood not the same as tau/T)."""
    return finger.jacobian(e.finger_state).T @ e.jacobian.load_tension


def reciprocity(finger: Finger, hood: Hood, e: Equilibrium, tendon: int, step: float) -> float:
    """Relative difference of the moment arms by force and by excursion.

    By force: `moment_arms`.  By excursion: the slope of all tendons' excursions over two hood
    solves with the joints moved by +-`step` (rad) along the moment arms of `tendon` (Maxwell's
    reciprocity; the slope is what excursion experiments measure)."""
    by_force = moment_arms(finger, e)
    way = by_force[:, tendon] / np.linalg.norm(by_force[:, tendon])
    excursion = []
    for sign in (1.0, -1.0):
        move = np.zeros(len(finger.unknowns(e.finger_state)))
        move[: len(way)] = sign * step * way
        motion = finger.motion(finger.displaced(e.finger_state, move))
        there = hood.advance(e.response.state, motion, e.hood_tension, STATIC)
        excursion.append(there.excursion)
    by_excursion = (excursion[0] - excursion[1]) / (2 * step)
    along = way @ by_force
    return float(np.abs(by_excursion - along).max() / np.abs(along).max())
