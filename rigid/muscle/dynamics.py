"""The muscle in motion: activation, fibre velocity, and a step in time.

`step` is backward Euler in the fibre length: the force balance holds at the end of the step with
the velocity (l_M+ - l_M) / dt.  It is stable at any step and tendon stiffness, needs no special
case for a slack tendon, and comes to rest in `millard.equilibrium` exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from rigid.muscle.curves import NotConverged, increasing_root
from rigid.muscle.millard import along, equilibrium, pull, solve_balance
from rigid.muscle.parameters import Muscles


class MuscleState(NamedTuple):
    """What a step of n muscles begins from, (n,) each."""

    activation: Array
    fibre_length: Array
    """m."""
    fibre_velocity: Array
    """Mean rate over the last step, m/s."""
    fibre_acceleration: Array
    """Acceleration in m/s^2 over the last two steps; only the next step's first guess depends on
    it."""


class MuscleStep(NamedTuple):
    """The end of a step, (n,) each."""

    state: MuscleState
    force: Array
    """N, in the tendon."""
    stiffness: Array
    """N/m, d force / d path length at the end of the step."""


def _quickness(muscles: Muscles, activation: Array, rising: NDArray[np.bool_]) -> Array:
    """1/s, the reciprocal of the time constant."""
    factor = 0.5 + 1.5 * activation
    rise, fall = muscles.activation_time * factor, muscles.deactivation_time / factor
    return 1.0 / np.where(rising, rise, fall)


def advance_activation(muscles: Muscles, activation: Array, excitation: Array, dt: float) -> Array:
    """Activation after `dt` s of constant excitation: exponential approach with the time constant
    halfway; second order, and it never passes the excitation."""
    excitation = muscles.effective(excitation)
    gap = activation - excitation
    rising = gap < 0.0
    half = excitation + gap * np.exp(-0.5 * dt * _quickness(muscles, activation, rising))
    return np.asarray(excitation + gap * np.exp(-dt * _quickness(muscles, half, rising)))


def fibre_velocity(muscles: Muscles, activation: Array, fibre_length: Array, path: Array) -> Array:
    """The fibres' velocity (..., n) m/s that balances the forces in a given state, lengthening
    positive: the muscle as an ordinary differential equation, elastic tendon.

    A fibre at its shortest length does not shorten further.  Raises InputError and
    ConvergenceError, each naming the muscle."""
    if muscles.rigid_tendon:
        raise InputError("fibre velocity: with a rigid tendon it follows from the path's rate")
    curves = muscles.curves
    largest = np.finfo(float).max
    activation = muscles.effective(muscles.check("activation", activation, 0.0, 1.0))
    length = muscles.check("fibre length", fibre_length, 0.0, largest)
    path = muscles.check("path length", path, 0.0, largest)
    length = np.maximum(length, muscles.shortest_fibre)
    s = np.sqrt(length**2 - muscles.width**2)
    tendon = curves.tendon.value((path - s) / muscles.tendon_slack_length)
    normalised = length / muscles.optimal_fibre_length
    wanted = tendon * length / s - curves.passive.value(normalised)
    activation, wanted = np.broadcast_arrays(activation, wanted)
    velocity = _velocity_in_balance(
        muscles, activation * curves.active.value(normalised), np.asarray(wanted)
    )
    velocity = np.where(length > muscles.shortest_fibre, velocity, np.maximum(velocity, 0.0))
    return np.asarray(velocity * muscles.max_velocity * muscles.optimal_fibre_length)


def _velocity_in_balance(muscles: Muscles, active: Array, wanted: Array) -> Array:
    """Normalised v with active * f_V(v) + beta v = wanted."""
    curve = muscles.curves.velocity

    def gap(v: Array) -> tuple[Array, Array]:
        value, slope, _ = curve.evaluate(v)
        return active * value + muscles.damping * v - wanted, active * slope + muscles.damping

    # |f_V(v) - 1| is at least |v| times the smallest slope, which is one of the ends'.
    least = muscles.damping + active * curve.end_slopes.min()
    bound = (np.abs(wanted) + 2.0) / least
    try:
        return increasing_root(gap, -bound, bound, np.zeros_like(bound), 1e-12 * (1.0 + bound))
    except NotConverged as error:
        raise ConvergenceError(
            f"muscle {muscles.first(error.where)}: its fibre velocity did not converge"
        ) from error


def at_rest(muscles: Muscles, activation: ArrayLike, path: ArrayLike) -> MuscleState:
    """The state (n,) in isometric equilibrium.  Raises as `equilibrium` does."""
    n = len(muscles.names)
    length = np.broadcast_to(equilibrium(muscles, activation, path).fibre_length, n)
    raised = np.broadcast_to(muscles.effective(np.asarray(activation)), n)
    return MuscleState(raised, length, np.zeros(n), np.zeros(n))


def step(
    muscles: Muscles, state: MuscleState, excitation: Array, path: Array, dt: float
) -> MuscleStep:
    """The state `dt` s later, where the excitations are (n,) and the path lengths have become
    `path` (n,) m.

    Raises InputError for an excitation beyond 0 to 1 or a value that is not finite, and
    ConvergenceError."""
    low, high = excitation.min(), excitation.max()
    if not (low >= 0.0 and high <= 1.0 and math.isfinite(path.sum())):
        muscles.check("excitation", excitation, 0.0, 1.0)
        muscles.check("path length", path, 0.0, np.finfo(float).max)
    activation = advance_activation(muscles, state.activation, excitation, dt)
    _, before, velocity, acceleration = state
    ahead = before + dt * (velocity + dt * acceleration)
    start = along(muscles, np.maximum(ahead, muscles.shortest_fibre))
    s, at = solve_balance(muscles, activation, path, start, before, 1.0 / dt)
    length = np.sqrt(s * s + muscles.scales.width2)
    now = (length - before) / dt
    force, stiffness, _ = pull(muscles, at, s)
    return MuscleStep(MuscleState(activation, length, now, (now - velocity) / dt), force, stiffness)
