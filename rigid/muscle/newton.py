"""A safeguarded Newton iteration on many independent scalar equations at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array

Function = Callable[[Array], tuple[Array, Array]]

LIMIT = 120
STEEP = 1e-30
"""Least slope that is divided by: a flat function sends Newton out of the bracket, to bisection."""


class NotConverged(ConvergenceError):
    """`where` marks the elements that are still moving."""

    def __init__(self, message: str, where: NDArray[np.bool_] | None = None) -> None:
        super().__init__(message)
        self.where = np.zeros(0, dtype=np.bool_) if where is None else where


def increasing_root(
    function: Function, lower: Array, upper: Array, start: Array, tolerance: Array
) -> Array:
    """x with function(x) = 0 in [lower, upper], element by element, to `tolerance` in x.

    `function` returns value and slope; its value must be negative below the root and positive
    above it.  Where it is positive (negative) all over the bracket, the lower (upper) end is
    returned.  Newton's step is taken where it is at most half of the last one, bisection elsewhere.
    Raises NotConverged, which a function that returns no NaN does not cause."""
    x = np.clip(start, lower, upper)
    last = upper - lower
    for _ in range(LIMIT):
        value, slope = function(x)
        below = value < 0.0
        lower, upper = np.where(below, x, lower), np.where(below, upper, x)
        newton = np.clip(x - value / np.maximum(slope, STEEP), lower, upper)
        crawls = np.abs(newton - x) > 0.5 * last
        new = np.where(crawls, 0.5 * (lower + upper), newton)
        last = np.abs(new - x)
        x = new
        if (last <= tolerance).all():
            return x
    moves = ~(last <= tolerance)
    message = f"{moves.sum()} of {moves.size} scalar equations did not converge"
    raise NotConverged(message, moves)
