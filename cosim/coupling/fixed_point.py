"""Coupled static equilibrium by an accelerated fixed point, for hoods without derivatives.

In each round the hood answers the finger's pose, and the finger balances against that answer, held;
the joint angles go on as the accelerator says.  No derivative of the hood is asked for on the way,
one at the end, for the moment arms that are reported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cosim.coupling.accelerators import Accelerator, accelerated, begun
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium
from cosim.coupling.finger_equilibrium import MOST_TURN, balanced
from cosim.port import (
    STATIC,
    Array,
    Balance,
    ConvergenceError,
    Finger,
    Hood,
    Progress,
    Response,
    State,
    quiet,
)


class Round(NamedTuple):
    """What a round of the fixed point found."""

    response: Response
    now: Balance
    """Of the finger against the hood's answer, where it stands."""
    aim: State
    foreseen: Balance
    turn: float
    """rad, the largest from where it stands to its aim."""


def fixed_point(
    finger: Finger,
    hood: Hood,
    finger_state: State,
    hood_state: State,
    hood_tension: Array,
    finger_tension: Array,
    options: CouplingOptions,
    accelerator: Accelerator,
    turn: float,
    progress: Progress = quiet,
) -> Equilibrium:
    """As `cosim.coupling.equilibrium.equilibrium`, to the interface's tolerance and a `turn` (rad)
    of the joints in the last round.  Raises ConvergenceError."""
    history = begun(accelerator, len(finger.joints))
    at, state = finger_state, hood_state
    for iteration in range(1, options.max_iterations + 1):
        found = _round(finger, hood, at, state, hood_tension, finger_tension, options.tolerance)
        progress(f"fixed point, round {iteration}: relative residual {found.now.relative:.1e}")
        if found.now.relative <= options.tolerance and found.turn <= turn:
            return Equilibrium(
                at,
                finger.motion(at),
                found.response,
                found.now,
                hood.jacobian(found.response.state),
                hood_tension,
                finger_tension,
                found.foreseen.relative,
                found.now.relative,
                iteration,
            )
        angles, image = finger.angles(at), finger.angles(found.aim)
        aim, history = accelerated(accelerator, history, angles, image)
        step = (aim - angles) * min(1.0, MOST_TURN / (np.abs(aim - angles).max() or 1.0))
        at, state = _at(finger, found.aim, angles + step), found.response.state
    raise ConvergenceError(
        f"hood and finger did not agree in {options.max_iterations} rounds of the fixed point: the "
        f"relative residual is {found.now.relative:.1e} ({options.tolerance:.1e} is allowed) and a "
        f"joint would still turn by {found.turn:.1e} rad ({turn:.1e}). Try more rounds "
        '(solve.max_iterations), coupling.accelerator = "iqn_ils", or coupling.scheme = "newton"'
    )


def _round(
    finger: Finger,
    hood: Hood,
    at: State,
    state: State,
    hood_tension: Array,
    finger_tension: Array,
    tolerance: float,
) -> Round:
    response = hood.advance(state, finger.motion(at), hood_tension, STATIC)
    now = finger.balance(at, response.load, finger_tension)
    n = 6 * len(finger.bodies)
    held = np.zeros((n, n))
    aim, foreseen = balanced(finger, at, response.load, finger_tension, held, tolerance)
    turn = float(np.abs(finger.angles(aim) - finger.angles(at)).max())
    return Round(response, now, aim, foreseen, turn)


def _at(finger: Finger, state: State, angles: Array) -> State:
    """The state with its joints at angles (nq,) rad, its reaction kept."""
    step = np.zeros(len(finger.unknowns(state)))
    step[: len(angles)] = angles - finger.angles(state)
    return finger.displaced(state, step)
