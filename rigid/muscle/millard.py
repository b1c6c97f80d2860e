"""The equilibrium muscle of Millard, Uchida, Seth and Delp 2013 (J Biomech Eng 135:021005): its
force balance, and the isometric equilibrium.

A fibre of fixed width under a pennation angle pulls on an elastic tendon:

    F0 [a f_AL(l) f_V(v) + f_PE(l) + beta v] cos(alpha) = F0 f_T(l_T / l_slack),
    l = l_M / l_opt,  v = dl_M/dt / (v_max l_opt),  l_T = L - l_M cos(alpha),
    l_M sin(alpha) = l_opt sin(alpha_opt),

with the path length L.  The unknown is s = l_M cos(alpha), in which all of it is smooth.
A fibre is never shorter than `Muscles.shortest_fibre`; where the path is too short even for that,
the tendon is slack and nothing pulls.  With a rigid tendon l_T = l_slack and a fibre that would
push pulls with 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from rigid.muscle.curves import STEEP, NotConverged, increasing_root
from rigid.muscle.parameters import Muscles

FIBRE_TOLERANCE = 1e-13
"""Share of a fibre length to which it is bracketed, by the shorter one of fibre and tendon."""
LAST_STEP = 1e-6
"""A last step of Newton's, likewise, after which what is left is below 1e-8 F0."""
STEADY = 1e-4
"""A last step of Newton's in the fibre's velocity over its largest, for steps in time."""
ROUNDS = 8


class ForceBalance(NamedTuple):
    """The force balance over F0 at given s, and its parts (..., n)."""

    value: Array
    """The fibre's pull along the tendon less the tendon's."""
    fibre_slope: Array
    """d fibre's pull / ds, 1/m."""
    tendon: Array
    """The tendon's pull."""
    tendon_slope: Array
    """d tendon's pull / dL, 1/m."""
    gain: Array
    """d fibre's pull / d activation."""


def balance(
    muscles: Muscles, activation: Array, path: Array, s: Array, before: Array, rate: float
) -> ForceBalance:
    """The balance at fibre extents `s` (..., n) along the tendon (m), where the fibre has its
    velocity from (l_M - `before`) * `rate` (1/s; 0: isometric)."""
    width2, per_fibre, per_velocity, per_tendon, _ = muscles.scales
    per_velocity = per_velocity * rate
    length = np.sqrt(s * s + width2)
    cosine = s / length
    x = np.empty((4, *s.shape))
    x[0] = x[1] = length * per_fibre
    x[2] = velocity = (length - before) * per_velocity
    x[3] = (path - s) * per_tendon
    (active, passive, speed, tendon), slopes = muscles.curves.table(x)
    d_active, d_passive, d_speed, d_tendon = slopes
    force = activation * active * speed + passive + muscles.damping * velocity
    d_length = (activation * d_active * speed + d_passive) * per_fibre
    d_velocity = (activation * active * d_speed + muscles.damping) * per_velocity
    return ForceBalance(
        force * cosine - tendon,
        (d_length + d_velocity) * cosine**2 + force * width2 / length**3,
        tendon,
        d_tendon * per_tendon,
        active * speed * cosine,
    )


@dataclass(frozen=True, eq=False)
class MuscleEquilibrium:
    """Muscles at rest, (..., n) each."""

    force: Array
    """N, in the tendon."""
    fibre_length: Array
    """m."""
    normalised_length: Array
    """Fibre length by its optimum."""
    pennation: Array
    """rad."""
    stiffness: Array
    """N/m, d force / d path length."""
    gain: Array
    """N, d force / d activation, at the activation raised to the smallest one."""


def equilibrium(
    muscles: Muscles, activation: ArrayLike, path: ArrayLike, guess: Array | None = None
) -> MuscleEquilibrium:
    """Return the isometric equilibrium at activations (0 to 1) and path lengths (m), which
    broadcast together and end in the muscles' axis (or 1); `guess` (..., n), m, are fibre lengths
    to begin from, such as those of a state near by.

    Raises InputError (names the muscle) and ConvergenceError, which no finite input causes.

    >>> import numpy as np
    >>> from rigid.muscle.millard import equilibrium
    >>> from rigid.muscle.parameters import Muscles
    >>> one = Muscles(("EDC",), np.array([100.0]), *(np.array([x]) for x in (0.06, 0.2, 0.05)))
    >>> at = equilibrium(one, [[0.0], [0.5], [1.0]], [0.26])
    >>> at.force[:, 0].round(1)  # N
    array([ 1. , 47.8, 91.1])
    """
    activation, path = _conditions(muscles, activation, path)
    if guess is None:
        start = _first_guess(muscles, activation, path)
    else:
        start = along(muscles, np.maximum(guess, muscles.shortest_fibre))
    s, _ = solve_balance(muscles, activation, path, start, muscles.optimal_fibre_length, 0.0)
    length = np.sqrt(s * s + muscles.scales.width2)
    at = balance(muscles, activation, path, s, length, 0.0)
    force, stiffness, gain = pull(muscles, at, s)
    normalised = length * muscles.scales.per_fibre
    angle = np.arctan2(muscles.width, s)
    return MuscleEquilibrium(force, length, normalised, angle, stiffness, gain)


def _conditions(muscles: Muscles, activation: ArrayLike, path: ArrayLike) -> tuple[Array, Array]:
    """Checked activation and path length of one shape (..., n)."""
    raised = muscles.effective(muscles.check("activation", activation, 0.0, 1.0))
    length = muscles.check("path length", path, 0.0, np.finfo(float).max)
    shape = np.broadcast_shapes(raised.shape, length.shape)
    return np.broadcast_to(raised, shape), np.broadcast_to(length, shape)


def along(muscles: Muscles, length: Array) -> Array:
    """The extent, m, along the tendon of fibres of a length."""
    return np.asarray(np.sqrt(length * length - muscles.scales.width2))


def _first_guess(muscles: Muscles, activation: Array, path: Array) -> Array:
    """The fibre's extent, where the tendon stretches roughly as under the force that the fibre
    has over a rigid one: a power law through the end of the tendon curve's toe."""
    left = np.maximum(path - muscles.tendon_slack_length, muscles.shortest_along)
    if muscles.rigid_tendon:
        return left
    force = balance(muscles, activation, path, left, left, 0.0).value
    (slack, *_, toe), (*_, toe_force) = muscles.curves.tendon.knots
    share = (np.maximum(force, 0.0) / toe_force) ** (2.0 / 3.0)
    return np.asarray(left - (toe - slack) * muscles.tendon_slack_length * share)


def pull(muscles: Muscles, at: ForceBalance, s: Array) -> tuple[Array, Array, Array]:
    """Tendon force (N) and its derivatives by path length (N/m) and activation (N) at the root
    `s` of the balance `at`."""
    moves = s > muscles.shortest_along
    if muscles.rigid_tendon:
        pulls = moves & (at.value > 0.0)
        force, stiffness, gain = at.value * pulls, at.fibre_slope * pulls, at.gain * pulls
    else:
        whole = np.maximum(at.fibre_slope + at.tendon_slope, STEEP)
        share = at.tendon_slope / whole * moves
        force, stiffness, gain = at.tendon, at.tendon_slope * (1.0 - share), at.gain * share
    return force * muscles.max_force, stiffness * muscles.max_force, gain * muscles.max_force


def solve_balance(
    muscles: Muscles, activation: Array, path: Array, start: Array, before: Array, rate: float
) -> tuple[Array, ForceBalance]:
    """The root s (..., n) of the balance, m, from `start`, and the balance there; of a rigid
    tendon the extent that is left to the fibre.  Never less than `Muscles.shortest_along`.

    Plain Newton, and where that fails the safeguarded one.  The balance is that of the round
    before the last, but for the tendon's pull: right to 1e-7, its slopes to 1e-3."""
    lower = muscles.shortest_along
    s = np.maximum(path - muscles.tendon_slack_length if muscles.rigid_tendon else start, lower)
    close = LAST_STEP * muscles.scales.shorter
    if rate > 0.0:
        close = np.minimum(close, STEADY / (muscles.scales.per_velocity * rate))
    for _ in range(ROUNDS):
        at = balance(muscles, activation, path, s, before, rate)
        if muscles.rigid_tendon:
            return s, at
        slope = at.fibre_slope + at.tendon_slope
        if slope.min() <= 0.0:
            break
        new = np.maximum(s - at.value / slope, lower)
        change = new - s
        s = new
        if (np.abs(change) < close).all():
            tendon = np.maximum(at.tendon - at.tendon_slope * change, 0.0)
            return s, at._replace(tendon=tendon)
    s = _bracket(muscles, activation, path, before, rate)
    return s, balance(muscles, activation, path, s, before, rate)


def _bracket(muscles: Muscles, activation: Array, path: Array, before: Array, rate: float) -> Array:
    """The root between the shortest fibre and a slack tendon; in motion the upper end is also
    where the fibre was, since a fibre that lengthens pulls."""
    lower = np.broadcast_to(muscles.shortest_along, path.shape)
    upper = np.maximum(path - muscles.tendon_slack_length, lower)
    if rate > 0.0:
        upper = np.maximum(upper, along(muscles, np.maximum(before, muscles.shortest_fibre)))

    def gap(s: Array) -> tuple[Array, Array]:
        at = balance(muscles, activation, path, s, before, rate)
        return at.value, at.fibre_slope + at.tendon_slope

    tolerance = FIBRE_TOLERANCE * muscles.scales.shorter
    try:
        return increasing_root(gap, lower, upper, upper, tolerance)
    except NotConverged as error:
        raise ConvergenceError(
            f"muscle {muscles.first(error.where)}: its fibre length did not converge"
        ) from error


def path_length(muscles: Muscles, normalised_length: ArrayLike, activation: ArrayLike) -> Array:
    """The path lengths (..., n) m at which fibres of `normalised_length` are at rest under
    `activation` (0 to 1).

    Raises InputError where a fibre would be shorter than the shortest one."""
    shortest = muscles.shortest_fibre / muscles.optimal_fibre_length
    raised = muscles.effective(muscles.check("activation", activation, 0.0, 1.0))
    largest = np.finfo(float).max
    length = muscles.check("normalised fibre length", normalised_length, 0.0, largest)
    short = length < shortest
    if short.any():
        raise InputError(
            f"muscle {muscles.first(short)}, normalised fibre length: expected at least "
            f"{np.broadcast_to(shortest, short.shape)[short][0]:.4f}, its shortest"
        )
    s = along(muscles, length * muscles.optimal_fibre_length)
    if muscles.rigid_tendon:
        return s + muscles.tendon_slack_length
    curves = muscles.curves
    cosine = s / (length * muscles.optimal_fibre_length)
    force = (raised * curves.active.value(length) + curves.passive.value(length)) * cosine
    return np.asarray(s + muscles.tendon_slack_length * curves.tendon.inverse(force))
