"""Tendons whose ends are displaced: the tensions that it takes, by Broyden's method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array, ConvergenceError

FIRST_PULL = 1.0
"""N, the first trial's."""
LEAST_PULL = 1e-4
"""N, below which a tendon that is to give way more is slack."""
STIFFEST = 1e7
"""N/m: above this an excursion says nothing of a tension."""


@dataclass(frozen=True)
class Drawn:
    """n tendons, where they stand among all, and their stated excursions (n,) m."""

    names: tuple[str, ...]
    index: Array
    excursion: Array


class Draw(NamedTuple):
    """A trial: tensions (n,) N, the slope d excursion / d tension (n, n) m/N that is known, and the
    trial before with what came of it."""

    tension: Array
    slope: Array | None
    before: tuple[Array, Array]


def begun(drawn: Drawn, resting: Array) -> Draw:
    """The first trial, from resting tensions (of all tendons) at which no excursion has begun."""
    rest = resting[drawn.index]
    return Draw(rest + FIRST_PULL, None, (rest, np.zeros(len(rest))))


def redrawn(drawn: Drawn, draw: Draw, found: Array) -> Draw:
    """The next trial after one that came to excursions `found` (n,) m.

    Raises ConvergenceError where a tendon would have to push."""
    if not drawn.names:
        return draw
    tension, came = draw.before
    pulled, moved = draw.tension - tension, found - came
    if draw.slope is None:
        slope = np.diag(np.maximum(moved / pulled, 1.0 / STIFFEST))
    else:
        miss, length = moved - draw.slope @ pulled, float(pulled @ pulled)
        slope = draw.slope + (np.outer(miss, pulled) / length if length > 0 else 0.0)
    step = np.linalg.solve(slope, drawn.excursion - found)
    # in one step a tension halves at most, or grows to twice itself and FIRST_PULL
    after = draw.tension + np.clip(step, -0.5 * draw.tension, draw.tension + FIRST_PULL)
    slack = (draw.tension < LEAST_PULL) & (step < 0)
    if slack.any():
        i = int(np.argmax(slack))
        raise ConvergenceError(
            f"tendons.{drawn.names[i]}.excursion: {1e3 * drawn.excursion[i]:.4g} mm would slacken "
            "the tendon; draw it further, or leave it at the resting tension"
        )
    return Draw(after, slope, (draw.tension, found))
