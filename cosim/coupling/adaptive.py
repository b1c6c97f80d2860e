"""Steps in time whose length follows from their error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cosim.coupling.schemes import Alone, Linear, Scheme, step
from cosim.coupling.state import CoupledState, Pulls
from cosim.errors import ConvergenceError, InputError
from cosim.port import Hood, MovingFinger

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 2.0
"""The next step is SAFETY times the one that the error suggests, and between SMALLEST and LARGEST
times the last one (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I)."""


@dataclass(frozen=True)
class Control:
    """`tolerance`: rad, the error of a joint angle in one step; `floor`, `ceiling`: s, of a step.

    Raises InputError where they are not positive or cross."""

    tolerance: float
    floor: float
    ceiling: float

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and 0 < self.floor <= self.ceiling):
            raise InputError(
                "step control: expected a positive tolerance (rad) and 0 < floor <= ceiling (s), "
                f"got {self}"
            )


class AdaptiveStep(NamedTuple):
    """An accepted step."""

    half: CoupledState
    """After the first of its halves."""
    state: CoupledState
    error: float
    """rad, estimated."""
    taken: float
    """s, its length."""
    proposed: float
    """s, for the next."""
    rejected: int
    """Tries before it."""


def adaptive_step(
    scheme: Scheme,
    finger: MovingFinger,
    hood: Hood,
    state: CoupledState,
    tension: Pulls,
    dt: float,
    control: Control,
) -> AdaptiveStep:
    """One step of at most `dt` s as two halves by `scheme`, whose angles are within the tolerance
    of a whole step by Linear.  A step that is rejected is never tried shorter than the floor.

    The hood solves of the whole and of rejected steps are counted, those of failed ones are not.
    Raises ConvergenceError where a step of the floor's length misses the tolerance, or fails."""
    h, rejected, more = min(dt, control.ceiling), 0, 0
    while True:
        outcome = _try_step(scheme, finger, hood, state, tension, h)
        if isinstance(outcome, ConvergenceError):
            error, proposed = np.nan, 0.5 * h
        else:
            half, halves, error, solves = outcome
            proposed = h * _step_growth(control.tolerance, error)
            more += solves
            if error <= control.tolerance:
                after = replace(halves, solves=halves.solves + more)
                return AdaptiveStep(half, after, error, h, min(proposed, control.ceiling), rejected)
            more += halves.solves - state.solves
        if h <= control.floor:
            raise _step_error(state.time, h, error, control) from (
                outcome if isinstance(outcome, ConvergenceError) else None
            )
        h, rejected = max(min(proposed, 0.9 * h), control.floor), rejected + 1


def _try_step(
    scheme: Scheme,
    finger: MovingFinger,
    hood: Hood,
    state: CoupledState,
    tension: Pulls,
    h: float,
) -> tuple[CoupledState, CoupledState, float, int] | ConvergenceError:
    """The states after one half and after two, their error in rad, and the hood solves of the whole
    step; or why there is none."""
    try:
        half = step(scheme, finger, hood, state, tension, 0.5 * h)
        halves = step(scheme, finger, hood, half, tension, 0.5 * h)
        rough = scheme if isinstance(scheme, Alone) else Linear()
        whole = step(rough, finger, hood, state, tension, h)
    except ConvergenceError as failure:
        return failure
    error = np.abs(finger.angles(halves.finger) - finger.angles(whole.finger)).max()
    return half, halves, float(error), whole.solves - state.solves


def _step_growth(tolerance: float, error: float) -> float:
    """The factor on the step's length, for an error that goes with the step's square."""
    return float(np.clip(SAFETY * np.sqrt(tolerance / max(error, 1e-300)), SMALLEST, LARGEST))


def _step_error(time: float, h: float, error: float, control: Control) -> ConvergenceError:
    why = "did not converge" if np.isnan(error) else f"has an error of {error:.1e} rad"
    return ConvergenceError(
        f"step control: at t = {time:.6g} s a step of {h:g} s, the smallest allowed, {why}; the "
        f"tolerance is {control.tolerance:.1e} rad. Try a lower floor, a larger tolerance, or "
        "smoother tensions."
    )
