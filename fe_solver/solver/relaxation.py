"""The last resort before giving up: a damped motion towards an equilibrium.

The sheet is let go with a mass and moves by implicit steps; each time its kinetic energy falls it
is stopped (kinetic damping: Cundall 1976; Barnes 1999, Int J Space Struct 14:89), and the steps
grow as it comes to rest, so that the motion ends in a static equilibrium that is stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.errors import ConvergenceError, pulse
from cosim.port import Array
from fe_solver.solver.dynamics import Substance, advance, at_rest, kinetic_energy, masses
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.solver.residual import length_scale, residual_norm

WATER = Substance(1000.0)
"""Any density would do: the time step follows from it."""
SHORTER, LONGER = 0.25, 1.5
SHORTEST_STEP = 1e-6
"""Share of the first time step; where none so short succeeds, the motion is given up."""
FAR = 10
"""Times the sheet's length; no body that could stop it is so far away."""


@dataclass(frozen=True)
class RelaxOptions:
    """When the damped motion ends, and how it starts."""

    tolerance: float = 1e-4
    """Residual, relative to the largest nodal force, at which the motion ends; each step is solved
    to a tenth of it."""
    max_steps: int = 300
    """Steps after which it ends all the same."""
    reach: float = 0.1
    """Share of an element's size by which the strongest nodal force alone would move its node in
    the first step."""
    iterations: int = 40
    """Newton's at most in a step."""


def relax(
    model: ShellModel,
    start: Configuration,
    tension: Array | None = None,
    options: RelaxOptions | None = None,
) -> Configuration:
    """A configuration near a stable equilibrium under `tension` (nt,) N, for Newton to finish.

    Raises ConvergenceError where the motion does not come to rest, or goes off by FAR times the
    sheet's length."""
    o = options or RelaxOptions()
    newton = NewtonOptions(tolerance=0.1 * o.tolerance, max_iterations=o.iterations)
    tension = np.zeros(len(model.share)) if tension is None else tension
    state, energy, length = at_rest(start), 0.0, np.ptp(start.x, axis=0).max()
    first = dt = _first_step(model, start, tension, o.reach)
    for done in range(o.max_steps):
        pulse("the hood's damped motion, step {}", done)
        if _at_rest(model, state.configuration, tension, o.tolerance):
            return state.configuration
        try:
            moved, _ = advance(model, state, tension, dt, WATER, newton)
        except ConvergenceError:
            dt, state, energy = SHORTER * dt, at_rest(state.configuration), 0.0
            if dt < SHORTEST_STEP * first:
                break
            continue
        if np.abs(moved.configuration.x - start.x).max() > FAR * length:
            raise ConvergenceError(f"it went off by {FAR} times its length: nothing holds it")
        now = kinetic_energy(model, moved, WATER)
        dt = LONGER * dt
        if now < energy:
            state, energy = at_rest(moved.configuration), 0.0
        else:
            state, energy = moved, now
    raise ConvergenceError(f"it did not come to rest in {o.max_steps} steps")


def _first_step(model: ShellModel, c: Configuration, tension: Array, reach: float) -> float:
    """The first time step (s)."""
    force = residual_norm(model, model.evaluate(c, tension, tangent=False))[0]
    mass = float(np.median(masses(model, WATER)[0]))
    return float(np.sqrt(2 * reach * length_scale(model) * mass / max(force, 1e-12)))


def _at_rest(model: ShellModel, c: Configuration, tension: Array, tolerance: float) -> bool:
    residual, force = residual_norm(model, model.evaluate(c, tension, tangent=False))
    return residual <= tolerance * force
