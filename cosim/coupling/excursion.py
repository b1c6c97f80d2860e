"""Tendons whose ends are displaced over time: the tensions that a step takes, by Broyden's method.

With x(T) the excursions after a step under tensions T, and e those stated, a step solves

    T >= 0,    x(T) - e >= 0,    T (x(T) - e) = 0,

the last two for each tendon by itself: one whose path grows shorter than its end is drawn is slack.
The slope dx/dT is kept from step to step (Broyden 1965, Math Comp 19:577).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, ConvergenceError

TOLERANCE = 1e-10
"""m."""
FIRST_PULL = 0.1
"""N, the change of tension by which the first slope is found."""
MOST_GROWTH = 1.0
"""N, by which a tension may grow beyond twice itself between two trials."""
MOST_TRIALS = 40
T = TypeVar("T")
Trial = Callable[[Array], tuple[T, Array]]
"""A step under tensions (nd,) N: what comes of it, and the excursions (nd,) m after it."""


@dataclass(frozen=True)
class Driven:
    """Tendons, where they stand among all (the hood's first), and how far their ends have been
    drawn proximally (nd,) m since the start at a time in s."""

    names: tuple[str, ...]
    index: Any
    excursion: Callable[[float], Array]


class Draw(NamedTuple):
    """What a step leaves to the next one, (nd,) each."""

    tension: Array
    """N."""
    found: Array
    """m, the excursions that the tendons have."""
    start: Array
    """m, those that they began with."""
    slope: Array
    """(nd, nd) m/N; (0, 0) before the first step."""


def begun(tension: Array, excursion: Array) -> Draw:
    """At rest under tensions (nd,) N with excursions (nd,) m."""
    return Draw(tension, excursion, excursion, np.zeros((0, 0)))


def drawn(driven: Driven, draw: Draw, time: float, trial: Trial[T]) -> tuple[T, Draw]:
    """What comes of the step to `time` s in which the tendons have the excursions stated, or are
    slack.  Raises ConvergenceError."""
    aim, tension = draw.start + driven.excursion(time), draw.tension
    result, found = trial(tension)
    slope = draw.slope if draw.slope.size else _first_slope(trial, tension, found)
    for _ in range(MOST_TRIALS):
        gap = aim - found
        taut = (tension > 0) | (gap > 0)
        if np.abs(gap[taut]).max(initial=0.0) <= TOLERANCE:
            return result, Draw(tension, found, draw.start, slope)
        after = _next(tension, gap, taut, slope)
        result, now = trial(after)
        slope = _updated(slope, after - tension, now - found)
        tension, found = after, now
    off = np.where(taut, np.abs(gap), 0.0)
    raise ConvergenceError(
        f"tendons.{driven.names[int(np.argmax(off))]}.excursion: in {MOST_TRIALS} trials no "
        f"tension was found that draws it as far as stated at t = {time:.6g} s; "
        f"{1e3 * off.max():.2e} mm are missing. Try a slower course or a smaller step"
    )


def _first_slope(trial: Trial[T], tension: Array, found: Array) -> Array:
    columns = [
        (trial(tension + pull)[1] - found) / FIRST_PULL for pull in FIRST_PULL * np.eye(len(found))
    ]
    return np.stack(columns, axis=1)


def _next(tension: Array, gap: Array, taut: NDArray[np.bool_], slope: Array) -> Array:
    """The tensions (nd,) N of the next trial; those that are slack stay so."""
    try:
        step = np.linalg.solve(slope[np.ix_(taut, taut)], gap[taut])
    except np.linalg.LinAlgError:
        raise ConvergenceError("an excursion does not depend on its tendon's tension") from None
    after = tension.copy()
    after[taut] = np.clip(tension[taut] + step, 0.0, 2 * tension[taut] + MOST_GROWTH)
    return after


def _updated(slope: Array, pulled: Array, moved: Array) -> Array:
    """Broyden's: the nearest slope that explains the last change."""
    size = float(pulled @ pulled)
    return slope + np.outer(moved - slope @ pulled, pulled) / size if size > 0 else slope
