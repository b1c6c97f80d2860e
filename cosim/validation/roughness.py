"""How rough a curve over posture is: what a cubic leaves over sliding windows of 20 degrees.

A window begins at each point of the curve and is 20 degrees wide; both ends belong to it.  A cubic
is fitted to its points by least squares; the residuals are point less cubic, at every point of the
window.  rms is the root mean square of all residuals of all windows, and largest the largest of
them.  The step is the largest difference of neighbouring points.  Of a relative number residuals
and steps are in percent of the window's size, before windows are put together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cosim.port import Array

WINDOW = 20.0
"""deg."""
LEAST = 8
"""Points of a window that is measured, twice a cubic's coefficients: gaps may leave fewer."""
ROUNDING = 1e-9
"""deg, of angles that are sums of steps."""


class Window(NamedTuple):
    """What one window of a curve leaves, in the curve's unit, or in percent of its size."""

    middle: float
    """deg."""
    size: float
    """The mean of what the curve is relative to, at least its floor."""
    residuals: Array
    step: float
    """The largest difference of neighbouring points that are both there."""


class Roughness(NamedTuple):
    """What windows of a curve leave, in the curve's unit, or in percent of their sizes."""

    size: float
    """The mean size of the windows."""
    rms: float
    largest: float
    step: float
    windows: int


def windows(
    angles: Array, values: Array, sizes: Array | None = None, floor: float = 0.0
) -> list[Window]:
    """The measured windows of a curve of `values` (n,) over `angles` (n,), deg, in rising order;
    NaN is a gap.  `sizes` (n,): what the curve is relative to, at least `floor` in the mean; None:
    residuals are in the curve's own unit.

    >>> angles = np.arange(0.0, 31.0, 2.0)
    >>> [float(w.middle) for w in windows(angles, angles**3)]
    [10.0, 12.0, 14.0, 16.0, 18.0, 20.0]
    """
    found = []
    for first in angles[angles + WINDOW <= angles[-1] + ROUNDING]:
        inside = (angles >= first - ROUNDING) & (angles <= first + WINDOW + ROUNDING)
        middle, own = first + WINDOW / 2, values[inside]
        there = np.isfinite(own)
        if np.count_nonzero(there) < LEAST:
            continue
        size = np.mean(np.abs(own if sizes is None else sizes[inside])[there])
        scale = 1.0 if sizes is None else 100.0 / max(size, floor)
        steps = np.abs(np.diff(own))
        residuals = _cubic_residuals((angles[inside][there] - middle) / WINDOW, own[there])
        step = np.max(steps[np.isfinite(steps)], initial=0.0)
        found.append(Window(middle, max(size, floor), scale * residuals, scale * float(step)))
    return found


def _cubic_residuals(x: Array, values: Array) -> Array:
    powers = np.vander(x, 4)
    return values - powers @ np.linalg.lstsq(powers, values)[0]


def roughness(measured: list[Window]) -> Roughness | None:
    """What the windows leave together; None of no window."""
    if not measured:
        return None
    residuals = np.concatenate([w.residuals for w in measured])
    return Roughness(
        float(np.mean([w.size for w in measured])),
        float(np.sqrt(np.mean(residuals**2))),
        float(np.max(np.abs(residuals))),
        max(w.step for w in measured),
        len(measured),
    )
