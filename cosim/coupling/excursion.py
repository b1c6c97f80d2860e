"""Tendons with prescribed excursions: their tensions, by Broyden's method.

With x(T) the excursions under tensions T, in an equilibrium or after a step of a motion, and e the
prescribed ones, it solves

    T >= 0,    x(T) - e >= 0,    T (x(T) - e) = 0,

the last two for each tendon by itself: one whose path shortens more than its end is drawn is slack.
Of a tendon that stretches, x(T) is the excursion of its drawn end: the path's, and the stretch,
which of one that relaxes grows while its end is held.
The slope dx/dT is kept from step to step (Broyden 1965, Math Comp 19:577).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array, Relaxation

EXCURSION_TOLERANCE = 1e-10
"""m."""
FIRST_PULL = 0.1
"""N, the change of tension by which the first slope is found."""
MOST_GROWTH = 1.0
"""N, by which a tension may grow beyond twice itself between two trials."""
MOST_TRIALS = 40
T = TypeVar("T")
Trial = Callable[[Array], tuple[T, Array]]
"""Tensions (nd,) N -> what comes of them, and the excursions (nd,) m then."""


@dataclass(frozen=True)
class PrescribedExcursions:
    """Tendons, where they stand among all (the hood's first), and how far their ends have been
    moved proximally (nd,) m since the start at a time in s."""

    names: tuple[str, ...]
    index: Any
    excursion: Callable[[float], Array]
    give: Array | float = 0.0
    """(nd,) m/N, by which the tendons stretch."""
    slack: Array | float = 0.0
    """(nd,) m, by which the ends are moved before the tendons bear."""
    relaxation: Relaxation | None = None
    """By which what they bear relaxes, where it does."""


class ExcursionState(NamedTuple):
    """What one solve leaves to the next one, (nd,) each."""

    tension: Array
    """N."""
    excursion: Array
    """m, the excursions that the tendons have."""
    start: Array
    """m, those that they began with."""
    slope: Array
    """(nd, nd) m/N; (0, 0) before the first solve."""
    pretension: Array
    """N, the tensions that they began with."""
    time: float = 0.0
    """s."""
    memory: Any = None
    """What those that relax have borne; None of those that do not."""


def initial_excursions(
    tension: Array, excursion: Array, relaxation: Relaxation | None = None
) -> ExcursionState:
    """The state at rest under tensions (nd,) N with excursions (nd,) m."""
    memory = None if relaxation is None else relaxation.start(tension)
    none = np.zeros((0, 0))
    return ExcursionState(tension, excursion, excursion, none, tension, memory=memory)


def solve_excursions(
    prescribed: PrescribedExcursions, at: ExcursionState, time: float, trial: Trial[T]
) -> tuple[T, ExcursionState]:
    """What comes of the tensions with which the tendons have the excursions of `time` s, or are
    slack.  Raises ConvergenceError."""
    relaxation, dt, tension = prescribed.relaxation, time - at.time, at.tension
    memory, factor, held = at.memory, 1.0, np.zeros(len(tension))
    if relaxation is not None:
        factor, held = relaxation.law(memory, dt)
    give = prescribed.give / factor
    # the ends are drawn further by what the tendons lost since they began
    lost = give * (at.pretension * (1 - factor) - held)
    aim = at.start + prescribed.excursion(time) - prescribed.slack - lost

    def drawn(tension: Array) -> tuple[T, Array]:
        result, excursion = trial(tension)
        return result, excursion + give * (tension - at.pretension)

    result, excursion = drawn(tension)
    slope = at.slope if at.slope.size else _first_slope(drawn, tension, excursion)
    for _ in range(MOST_TRIALS):
        gap = aim - excursion
        taut = (tension > 0) | (gap > 0)
        if np.abs(gap[taut]).max(initial=0.0) <= EXCURSION_TOLERANCE:
            if relaxation is not None:
                memory = relaxation.after(memory, tension, dt)
            return result, at._replace(
                tension=tension, excursion=excursion, slope=slope, time=time, memory=memory
            )
        after = _next_tensions(tension, gap, taut, slope)
        result, new_excursion = drawn(after)
        slope = _broyden_update(slope, after - tension, new_excursion - excursion)
        tension, excursion = after, new_excursion
    off = np.where(taut, np.abs(gap), 0.0)
    raise ConvergenceError(
        f"tendons.{prescribed.names[int(np.argmax(off))]}.excursion: in {MOST_TRIALS} trials no "
        f"tension was found that moves it as far as prescribed at t = {time:.6g} s; "
        f"{1e3 * off.max():.2e} mm are missing. Try a smaller excursion, "
        "or in a motion a slower signal or a smaller step"
    )


def _first_slope(trial: Trial[T], tension: Array, start: Array) -> Array:
    columns = [
        (trial(tension + pull)[1] - start) / FIRST_PULL for pull in FIRST_PULL * np.eye(len(start))
    ]
    return np.stack(columns, axis=1)


def _next_tensions(tension: Array, gap: Array, taut: NDArray[np.bool_], slope: Array) -> Array:
    """The tensions (nd,) N of the next trial; those that are slack stay so."""
    try:
        step = np.linalg.solve(slope[np.ix_(taut, taut)], gap[taut])
    except np.linalg.LinAlgError:
        raise ConvergenceError("an excursion does not depend on its tendon's tension") from None
    after = tension.copy()
    after[taut] = np.clip(tension[taut] + step, 0.0, 2 * tension[taut] + MOST_GROWTH)
    return after


def _broyden_update(slope: Array, pulled: Array, moved: Array) -> Array:
    """The nearest slope (nd, nd) m/N that explains the last change (Broyden 1965)."""
    size = float(pulled @ pulled)
    return slope + np.outer(moved - slope @ pulled, pulled) / size if size > 0 else slope
