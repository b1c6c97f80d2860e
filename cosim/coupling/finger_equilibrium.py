"""The equilibrium of a finger alone, under a load that follows its poses; over the port only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array, Balance, Load, Motion, OpenFinger, State

MOST_TURN = np.deg2rad(8.0)
"""A finger's joint moves at most so far in one round."""
MOST_STEPS = 30
MOST_RELAXING = 500
RELAXING_TURN = np.deg2rad(0.5)
NEAR_REST = 1e-6  # relative to the largest residual: relaxation ends, Newton begins
SMALL_TORQUE = 1e-12
"""N m, below which a residual that no longer falls is rounding error."""
MOST_LEFT = 1e-10
"""Relative residual at which Newton's iteration ends, even if more were allowed."""


def affine(load: Load, by_motion: Array, at: Motion, motion: Motion) -> Load:
    """The load at `motion` as the tangent `by_motion` (6 nb, 6 nb) at `at` foresees it; the change
    is booked under the first source, since only its sum plays a part."""
    change = (by_motion @ at.twist_to(motion).ravel()).reshape(-1, 6)
    wrench = load.wrench.copy()
    wrench[:, 0] += change
    return replace(load, wrench=wrench)


def balance_finger(
    finger: OpenFinger, state: State, load: Load, tension: Array, by_motion: Array, tolerance: float
) -> tuple[State, Balance]:
    """The finger's stable equilibrium under a load that is affine in its poses (those of `state`
    are where it was taken); or a state on the way there, where a joint turns by more than
    MOST_TURN: so far away the affine load need not have an equilibrium.

    Raises ConvergenceError."""
    at = finger.motion(state)

    def load_at(moved: State) -> Load:
        return affine(load, by_motion, at, finger.motion(moved))

    return _solve_balance(finger, state, load_at, tension, by_motion, tolerance)


def _solve_balance(
    finger: OpenFinger,
    state: State,
    load_at: Callable[[State], Load],
    tension: Array,
    by_motion: Array,
    tolerance: float,
) -> tuple[State, Balance]:
    """Solves `balance_finger` under a load that is a function of the finger's state."""
    nq, start = len(finger.joints), np.zeros(len(finger.unknowns(state)))

    def there(step: Array) -> tuple[State, Balance]:
        moved = finger.displace(state, step)
        return moved, finger.balance(moved, load_at(moved), tension)

    def residual(step: Array) -> Array:
        return there(step)[1].residual

    def slope(step: Array) -> Array:
        moved = finger.displace(state, step)
        return finger.tangent(moved, load_at(moved), tension, by_motion)

    enough = min(0.1 * tolerance, MOST_LEFT)
    root = _newton(there, slope, start, enough)
    if root is None or not _is_near(root.step, nq) or _softest(root.slope, nq) > 0:
        step = _relax(residual, slope, start, nq)
        root = _newton(there, slope, step, enough) if _is_near(step, nq) else None
        root = _Root(step, slope(step), *there(step)) if root is None else root
    if _is_near(root.step, nq) and not root.balance.relative <= tolerance:
        raise ConvergenceError(
            f"the finger found no equilibrium: its relative residual is "
            f"{root.balance.relative:.1e} (joints {finger.joints}). Try a stiffer passive joint, "
            "or smaller tensions."
        )
    return root.state, root.balance


def _is_near(step: Array, nq: int) -> bool:
    return bool(np.abs(step[:nq]).max() <= MOST_TURN)


class _Root(NamedTuple):
    step: Array
    slope: Array
    """(n, n), of the round before."""
    state: State
    balance: Balance


def _newton(
    balance_at: Callable[[Array], tuple[State, Balance]],
    slope: Callable[[Array], Array],
    step: Array,
    enough: float,
) -> _Root | None:
    """A root near `step` by plain Newton, down to a relative residual of `enough` or to rounding
    error; None where a step does not lower the residual."""
    state, balance = balance_at(step)
    for _ in range(MOST_STEPS):
        tangent = slope(step)
        try:
            trial = step - np.linalg.solve(tangent, balance.residual)
        except np.linalg.LinAlgError:
            return None
        moved, after = balance_at(trial)
        if not _size(after) < _size(balance):
            break
        step, state, balance = trial, moved, after
        if balance.relative <= enough:
            break
    else:
        return None
    return (
        _Root(step, tangent, state, balance)
        if _size(balance) < SMALL_TORQUE or balance.relative <= enough
        else None
    )


def _size(balance: Balance) -> float:
    return float(np.abs(balance.residual).max())


def _softest(slope: Array, nq: int) -> float:
    """The largest eigenvalue (N m/rad) of the joints' tangent (n, n) over the motions that the
    tip's support allows; positive where the finger runs away from its equilibrium."""
    return -float(free_stiffness(slope, nq).min(initial=np.inf))


def free_stiffness(slope: Array, nq: int) -> Array:
    """The stiffness (k,) N m/rad of a finger, least first, in the motions of its joints that the
    tip's support allows, from the derivative (n, n) of its residual; none of a clamped finger of
    four joints.  A negative one is a motion by which the finger leaves its equilibrium."""
    free = np.linalg.svd(slope[nq:, :nq])[2][len(slope) - nq :].T
    allowed = -free.T @ slope[:nq, :nq] @ free
    return np.asarray(np.linalg.eigvalsh((allowed + allowed.T) / 2))


def _relax(
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
