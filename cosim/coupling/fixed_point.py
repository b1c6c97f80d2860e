"""Coupled static equilibrium by an accelerated fixed point, for hoods without derivatives.

In each round the hood is solved in the finger's pose, the finger finds its equilibrium under that
load, held, and the accelerator gives the next joint angles.  The hood's derivatives are needed
once, at the end, for the moment arms that are reported.
"""

from __future__ import annotations

import numpy as np

from cosim.coupling.accelerators import Accelerator, accelerate, initial_history
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium
from cosim.coupling.finger_equilibrium import MOST_TURN
from cosim.errors import ConvergenceError, Progress, pulse, quiet
from cosim.port import Pair, PairState, Tensions
from cosim.static_response import static_response


def fixed_point(
    pair: Pair,
    start: PairState,
    tensions: Tensions,
    options: CouplingOptions,
    accelerator: Accelerator,
    turn: float,
    progress: Progress = quiet,
) -> Equilibrium:
    """The same as `cosim.coupling.equilibrium.equilibrium`, to the interface's tolerance (of a
    finger that reports its forces) and a `turn` (rad) of the joints in the last round.

    Raises ConvergenceError, and InputError for a finger that cannot be asked at any angles."""
    finger, hood = pair
    at, state = start
    history, n = initial_history(accelerator, len(finger.joints)), 6 * len(finger.bodies)
    held = np.zeros((n, n))
    for iteration in range(1, options.max_iterations + 1):
        pulse("round {} begins", iteration)
        motion = finger.motion(at)
        response = static_response(hood, state, motion, tensions.hood)
        balance = finger.balance(at, response.load, tensions.finger)
        aim, finger_residual = finger.settle(
            at, response.load, held, tensions.finger, options.tolerance
        )
        angles, image = finger.angles(at), finger.angles(aim)
        turned = float(np.abs(image - angles).max())
        interface = np.nan if balance is None else balance.relative
        progress(f"fixed point, round {iteration}: a joint turns by {turned:.1e} rad")
        if turned <= turn and (balance is None or interface <= options.tolerance):
            return Equilibrium(
                aim if balance is None else at,
                motion,
                response,
                balance,
                hood.jacobian(response.state),
                *tensions,
                finger_residual,
                interface,
                iteration,
                turned,
            )
        goal, history = accelerate(accelerator, history, angles, image)
        step = (goal - angles) * min(1.0, MOST_TURN / (np.abs(goal - angles).max() or 1.0))
        at, state = finger.with_angles(aim, angles + step), response.state
    known = f"the relative residual is {interface:.1e} ({options.tolerance:.1e} is allowed) and "
    residual = "" if np.isnan(interface) else known
    raise ConvergenceError(
        f"hood and finger did not agree in {options.rounds} of the fixed point: "
        f"{residual}a joint would still turn by {turned:.1e} rad ({turn:.1e}). Try more rounds "
        '(solve.max_iterations), coupling.accelerator = "iqn_ils", or coupling.scheme = "newton"'
    )
