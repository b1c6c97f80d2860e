"""Least cost under linear equations and bounds: linear, quadratic and cubic programmes.

    minimise sum_i c_i |x_i|^p     subject to     A x = b,    lower <= x <= upper,

with c_i >= 0 (for p = 1, x_i >= 0 too): muscles' forces bear a cost, what only passes them on bears
none.  HiGHS solves p = 1, the dual active set of DAQP (Arnstroem, Bemporad and Axehill 2022, IEEE
Trans Autom Control 67:4362) p = 2, Newton's method with that p = 3.  Whatever a solver says, a
solution counts only where the equations and the conditions of Karush, Kuhn and Tucker hold: with
multipliers y of the equations,

    g = dcost/dx - A' y:     g >= 0 at lower bounds,   g <= 0 at upper ones,   g = 0 between.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import daqp
import numpy as np
from scipy.optimize import linprog

from cosim.errors import ConvergenceError
from cosim.port import Array

Power = Literal[1, 2, 3]
ACCURATE = 1e-6
"""Relative: of the equations and of the conditions of optimality, what a solution may miss."""
AT_BOUND = 1e-9
"""Share of the largest value in play: nearer than this to a bound counts as on it."""
EQUALITY = 5
"""DAQP's word for an equation."""
FEASIBLE = (1e-10, 1e-8, 1e-6)
"""DAQP's tolerances: where hardly any x satisfies the equations, rounding alone misses the
narrowest."""
SOFTEST = 1e-7
"""Share of the largest curvature that DAQP is given where the cost has none; taken away again by
proximal steps, each from the last solution."""
COST_ROUNDING = 1e-14
MOST_STEPS = 60
NOTHING = 1e-6
"""N or N m: equations in which nothing is larger hold to an absolute miss."""


class Optimum(NamedTuple):
    """A solution that was checked."""

    x: Array
    """(n,)."""
    multiplier: Array
    """(m,) of the equations: what a unit more of b costs."""
    miss: float
    """The larger of the two relative misses, of the equations and of optimality."""


class Programme(NamedTuple):
    """The equations and bounds: A (m, n), b (m,), lower and upper (n,), upper perhaps infinite."""

    A: Array
    b: Array
    lower: Array
    upper: Array

    def gap(self, x: Array) -> float:
        """Miss of the equations, relative to the largest thing in any of them, but for round-off
        where all of that is next to nothing."""
        scale = float((np.abs(self.A) @ np.abs(x) + np.abs(self.b)).max(initial=0.0))
        return float(np.abs(self.A @ x - self.b).max(initial=0.0) / max(scale, NOTHING))


def least(programme: Programme, cost: Array, power: Power) -> Optimum | None:
    """The cheapest x of a programme at `cost` (n,), none negative; None where nothing satisfies it.

    Raises ConvergenceError where a solver's answer does not stand the check."""
    scaled, scale = _scale(programme)
    cheap = cost / (cost.max() or 1.0)
    x = _linear(scaled, cheap) if power == 1 else _quadratic(scaled, cheap, np.zeros(len(cost)))
    if x is not None and power == 3:
        x = _cubic(scaled, cheap, x)
    if x is None:
        return None
    x = np.clip(x, programme.lower, programme.upper)
    gradient = cheap if power == 1 else power * cheap * x * np.abs(x) ** (power - 2)
    multiplier, miss = optimality(scaled, gradient, x)
    worst = max(miss, scaled.gap(x))
    if not worst <= ACCURATE:
        raise ConvergenceError(
            f"force sharing: the programme's solution misses its conditions by {worst:.1e} "
            f"(relative; {ACCURATE:g} is allowed). Try another cost, or other weights"
        )
    return Optimum(x, multiplier * (cost.max() or 1.0) / scale, worst)


def optimality(programme: Programme, gradient: Array, x: Array) -> tuple[Array, float]:
    """Multipliers (m,) of the equations at x, and by how much the conditions are missed, relative
    to the largest part of the gradient: the best multipliers there are, found as a programme of
    their own where bounds bear."""
    near = AT_BOUND * max(1.0, float(np.abs(x).max(initial=0.0)))
    low, high = x <= programme.lower + near, x >= programme.upper - near
    n, m = len(x), len(programme.b)
    # least t with -t <= gradient - A'y <= t, but one-sided where x is on a bound
    blocks = [(~low, 1.0), (~high, -1.0)]
    rows = [s * np.hstack([-programme.A.T, np.zeros((n, 1))])[free] for free, s in blocks]
    limits = [-s * gradient[free] for free, s in blocks]
    A_ub = np.vstack(rows)
    A_ub[:, -1] = -1.0
    found = linprog(
        np.append(np.zeros(m), 1.0),
        A_ub=A_ub,
        b_ub=np.concatenate(limits),
        bounds=[(None, None)] * m + [(0, None)],
        method="highs",
    )
    if not found.success:
        return np.zeros(m), np.inf
    return np.array(found.x[:m]), float(found.x[m] / (np.abs(gradient).max(initial=0.0) or 1.0))


def _scale(programme: Programme) -> tuple[Programme, Array]:
    """Each equation over its largest coefficient, and those."""
    scale = np.abs(programme.A).max(axis=1, initial=0.0)
    scale = np.where(scale > 0, scale, 1.0)
    A, b = programme.A / scale[:, None], programme.b / scale
    return programme._replace(A=A, b=b), scale


def _linear(programme: Programme, cost: Array) -> Array | None:
    bounds = np.column_stack([programme.lower, programme.upper])
    found = linprog(cost, A_eq=programme.A, b_eq=programme.b, bounds=bounds, method="highs")
    return np.array(found.x) if found.success else None


def _quadratic(programme: Programme, curvature: Array, slope: Array) -> Array | None:
    """Least curvature x^2 + slope x, by proximal steps where some curvature is missing."""
    least = np.maximum(SOFTEST * (curvature.max(initial=0.0) or 1.0) - curvature, 0.0)
    x = np.zeros(len(curvature))
    for _ in range(MOST_STEPS):
        new = _active_set(programme, 2 * (curvature + least), slope - 2 * least * x)
        if new is None or not least.any():
            return new
        moved, x = float(np.abs(new - x).max()), new
        if moved <= 1e-12 * max(1.0, float(np.abs(x).max())):
            break
    return x


def _active_set(programme: Programme, diagonal: Array, slope: Array) -> Array | None:
    """DAQP's solution, set right on the bounds that it found."""
    m, n = programme.A.shape
    sense = np.concatenate([np.zeros(n), np.full(m, EQUALITY)]).astype(np.int32)
    high = np.concatenate([np.minimum(programme.upper, 1e30), programme.b])
    low = np.concatenate([np.maximum(programme.lower, -1e30), programme.b])
    for tolerance in FEASIBLE:
        x, _, flag, _ = daqp.solve(
            np.diag(diagonal),
            slope,
            np.ascontiguousarray(programme.A),
            high,
            low,
            sense,
            primal_tol=tolerance,
        )
        if flag >= 1:
            return _polish(programme, diagonal, slope, np.asarray(x))
    return None


def _polish(programme: Programme, diagonal: Array, slope: Array, x: Array) -> Array:
    """The same by the equations of the values between their bounds alone; the solver's own where
    that would leave a bound."""
    near = 1e-8 * max(1.0, float(np.abs(x).max(initial=0.0)))
    free = (x > programme.lower + near) & (x < programme.upper - near)
    x = np.where(free, x, np.where(x > programme.lower + near, programme.upper, programme.lower))
    A = programme.A[:, free] / np.sqrt(diagonal[free])
    shifted = -slope[free] / np.sqrt(diagonal[free])
    gap = programme.b - programme.A[:, ~free] @ x[~free]
    better = x.copy()
    step = np.linalg.lstsq(A, gap - A @ shifted, rcond=None)[0]
    better[free] = (shifted + step) / np.sqrt(diagonal[free])
    inside = (better >= programme.lower - near) & (better <= programme.upper + near)
    if not inside.all() or programme.gap(better) > programme.gap(x) + 1e-12:
        return x
    return np.clip(better, programme.lower, programme.upper)


def _cubic(programme: Programme, cost: Array, x: Array) -> Array | None:
    """Newton's method from a point that satisfies the equations, halved where it overshoots."""

    def value(at: Array) -> float:
        return float(cost @ np.abs(at) ** 3)

    now = value(x)
    for _ in range(MOST_STEPS):
        curvature = 3 * cost * np.abs(x)
        aim = _quadratic(programme, curvature, -curvature * x)
        if aim is None:
            return None
        part = 1.0
        while value(x + part * (aim - x)) > now * (1 + COST_ROUNDING) and part > 1e-6:
            part *= 0.5
        step = part * (aim - x)
        x = x + step
        now = value(x)
        if np.abs(step).max() <= 1e-10 * max(1.0, np.abs(x).max()):
            break
    return x
