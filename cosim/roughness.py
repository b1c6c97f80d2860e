"""How rough a curve is: what a cubic leaves of it in sliding windows of its place.

A window begins at each point of the curve, and one ends at its last point; both ends belong to it.
A cubic is fitted to the points of a window by least squares; residuals are the points less the
cubic.  The rms is that of all residuals of all windows put together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array

WINDOW = 20.0
"""deg."""
FEWEST = 6
"""Points of a window that is judged: a cubic takes four of them."""
SLIP = 1e-9
"""Share of a window: 40.0 and 20 steps of 0.1 may be a bit beyond 42."""


class Window(NamedTuple):
    """A window of a curve; residuals and step in the curve's unit, or in percent of its size."""

    middle: float
    size: float
    """The mean of what the curve is relative to, at least its floor."""
    residuals: Array
    """(n,) what a cubic leaves; (0,) where there are too few points."""
    step: float
    """Largest difference between neighbours; nan where there are none."""


@dataclass(frozen=True)
class Roughness:
    """What a cubic leaves of a curve, in the unit of its windows; nan where nothing is judged."""

    rms: float
    """Root mean square of all residuals of all windows."""
    largest: float
    """Largest absolute residual in any window."""
    worst: float
    """Root mean square of the residuals in the worst window."""
    step: float
    """Largest difference between neighbours."""


def roughness(
    place: Sequence[float] | Array, value: Sequence[float] | Array, window: float = WINDOW
) -> Roughness:
    """The roughness of a curve of values (n,) over places (n,), in windows as wide as `window`, in
    the places' unit.

    Places need no order and no even spacing.  A value that is nan is a gap: it is left out, and no
    step leads across it.  A window of fewer than 6 points is not judged.

    >>> import numpy as np
    >>> from cosim.roughness import roughness
    >>> x = np.linspace(40.0, 60.0, 21)
    >>> wave = roughness(x, 1e-4 * x**3 + 0.01 * (-1.0) ** np.arange(21))
    >>> 0.0095 < wave.rms < 0.01
    True
    """
    return pool(windows(place, value, window))


def roughness_along(place: Array, value: Array, unit: str) -> Roughness:
    """The roughness over a parameter in `unit`: in windows of 20 deg, of another unit over all."""
    return roughness(place, value, WINDOW if unit == "deg" else float(np.ptp(place)) or 1.0)


def windows(
    place: Sequence[float] | Array,
    value: Sequence[float] | Array,
    window: float = WINDOW,
    sizes: Array | None = None,
    floor: float = 0.0,
) -> Iterator[Window]:
    """The windows of a curve of values (n,) over places (n,), nan a gap.  `sizes` (n,): what the
    curve is relative to, at least `floor` in the mean; None: the curve's own unit.

    >>> angles = np.arange(0.0, 31.0, 2.0)
    >>> [float(w.middle) for w in windows(angles, angles**3)]
    [10.0, 12.0, 14.0, 16.0, 18.0, 20.0]
    """
    order = np.argsort(np.asarray(place, dtype=float), kind="stable")
    x, y = (np.asarray(a, dtype=float)[order] for a in (place, value))
    relative_to = np.abs(y if sizes is None else sizes[order])
    last = np.maximum(x[:1], x[-1:] - window)
    for start in np.append(np.unique(x[x < last - SLIP * window]), last):
        inside = (x >= start - SLIP * window) & (x <= start + (1 + SLIP) * window)
        known = inside & np.isfinite(y)
        size = max(float(np.mean(relative_to[known])) if known.any() else np.nan, floor)
        scale = 1.0 if sizes is None or not size else 100.0 / size
        steps = np.abs(np.diff(y[inside]))
        step = max(steps[np.isfinite(steps)].tolist(), default=np.nan)
        residuals = _beyond_cubic((x[known] - start) / window, y[known])
        yield Window(start + window / 2, size, scale * residuals, scale * step)


def _beyond_cubic(x: Array, y: Array) -> Array:
    """What a cubic leaves of points over (0, 1)."""
    if len(x) < FEWEST:
        return np.empty(0)
    powers = np.vander(2 * x - 1, 4)
    residual: Array = y - powers @ np.linalg.lstsq(powers, y, rcond=None)[0]
    return residual


def pool(measured: Iterable[Window]) -> Roughness:
    """The roughness of windows together."""
    every = list(measured)
    left = [w.residuals for w in every if w.residuals.size] or [np.full(1, np.nan)]
    together = np.concatenate(left)
    return Roughness(
        rms=_rms(together),
        largest=float(np.abs(together).max()),
        worst=max(map(_rms, left)),
        step=max((w.step for w in every if np.isfinite(w.step)), default=np.nan),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
