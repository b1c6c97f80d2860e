"""Profile likelihoods: each parameter held on a grid while the others are fitted again.

With normal errors the sum of squared misses is -2 log likelihood but for a constant, and the 95 %
interval of a parameter reaches to where its profile is `LIMIT` above the least (Raue et al. 2009,
Bioinformatics 25:1923).  Unlike the linearised interval it follows a bend, and a flat profile shows
a parameter that the rows do not determine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cosim.errors import ConvergenceError
from cosim.port import Array

LIMIT = 3.841459
"""The 95 % quantile of chi squared with one degree of freedom."""
SIDE = 6
"""Points of the grid on each side of what was found."""
REACH = 2.0
"""Half width of the grid over that of the linearised 95 % interval."""
MOST_EVALUATIONS = 12
"""Evaluations for each point of the grid."""
PROFILE_TOLERANCE = 1e-4

Vector = Callable[[Array], Array]


@dataclass(frozen=True)
class Profile:
    """The least sum of squared misses at values of one parameter."""

    name: str
    coordinates: Array
    """(k,) of the parameter, ascending."""
    points: Array
    """(k, n) coordinates of all parameters there."""
    squares: Array
    """(k,), NaN where no case has an answer."""
    limit: float
    """What the interval allows above the least."""

    @property
    def least(self) -> float:
        """The least sum of squares."""
        return float(np.nanmin(self.squares))

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """The coordinates at which the profile crosses the limit, below and above its least; None
        where it does not within the grid.  Between points the root of what it is above the least
        is linear, which is exact of a parabola."""
        fine = np.isfinite(self.squares)
        z, root = self.coordinates[fine], np.sqrt(np.maximum(self.squares[fine] - self.least, 0))
        middle = int(root.argmin())
        sides = (z[: middle + 1][::-1], root[: middle + 1][::-1]), (z[middle:], root[middle:])
        low, high = (_crossing(*side, np.sqrt(self.limit)) for side in sides)
        return low, high


def _crossing(z: Array, root: Array, level: float) -> float | None:
    """Where a side of a profile, from its least on, first comes to a level."""
    above = np.flatnonzero(root >= level)
    if not len(above):
        return None
    j = int(above[0])
    share = (level - root[j - 1]) / (root[j] - root[j - 1]) if j else 0.0
    return float(z[j - 1] + share * (z[j] - z[j - 1])) if j else float(z[0])


def profile(
    name: str,
    i: int,
    misses: Vector,
    slopes: Vector,
    best: Array,
    bounds: tuple[Array, Array],
    half_width: float,
    inflation: float = 1.0,
) -> Profile:
    """The profile of parameter i of misses (m,) and their slopes (m, n) at coordinates (n,), around
    the `best`, within the bounds; `half_width` of the linearised interval, infinite where there is
    none; misses beyond the SDs allow for more by `inflation` squared."""
    found = {float(best[i]): (best, _squares(misses(best)))}
    for bound, sense in zip(bounds, (-1, 1), strict=True):
        end = best[i] + sense * min(REACH * half_width, abs(bound[i] - best[i]))
        x = best
        for z in np.linspace(best[i], end, SIDE + 1)[1:] if end != best[i] else ():
            x, squares = _refit(i, float(z), misses, slopes, x, bounds)
            found[float(z)] = (x, squares)
            if not np.isfinite(squares):
                break
    order = sorted(found)
    above = np.array([found[z][1] for z in order])
    points = np.array([found[z][0] for z in order])
    return Profile(name, np.array(order), points, above, LIMIT * inflation**2)


def _refit(
    i: int, z: float, misses: Vector, slopes: Vector, near: Array, bounds: tuple[Array, Array]
) -> tuple[Array, float]:
    """The coordinates (n,) with the least squares where parameter i is z, and these squares."""
    others = np.flatnonzero(np.arange(len(near)) != i)

    def whole(y: Array) -> Array:
        x = np.array(near)
        x[i], x[others] = z, y
        return x

    x = whole(near[others])
    if not np.isfinite(misses(x)).all():
        return x, np.nan
    if len(others):
        inside = 1e-6 * (bounds[1] - bounds[0])[others]
        begin = np.clip(x[others], bounds[0][others] + inside, bounds[1][others] - inside)
        try:
            solution = least_squares(
                lambda y: misses(whole(y)),
                begin,
                lambda y: slopes(whole(y))[:, others],
                bounds=(bounds[0][others], bounds[1][others]),
                ftol=PROFILE_TOLERANCE,
                xtol=PROFILE_TOLERANCE,
                max_nfev=MOST_EVALUATIONS,
            )
        except (ConvergenceError, ValueError):  # no gradient, or nothing beside to begin with
            return x, np.nan
        x = whole(solution.x)
    return x, _squares(misses(x))


def _squares(misses: Array) -> float:
    total = float(misses @ misses)
    return total if np.isfinite(total) else float("nan")
