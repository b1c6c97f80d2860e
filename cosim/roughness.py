"""How rough a curve is: what a cubic leaves of it in any window of its place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array

FEWEST = 6
"""Points of a window that is judged: a cubic takes four of them."""


@dataclass(frozen=True)
class Roughness:
    """What a cubic leaves of a curve, in the curve's unit; nan where nothing can be judged."""

    rms: float
    """Root mean square of the residuals in the worst window."""
    largest: float
    """Largest absolute residual in any window."""
    step: float
    """Largest difference between neighbours."""


def roughness(
    place: Sequence[float] | Array, value: Sequence[float] | Array, window: float = 20.0
) -> Roughness:
    """The roughness of a curve of values (n,) over places (n,): a least-squares cubic is taken off
    in each window as wide as `window`, in the places' unit.

    Places need no order and no even spacing.  A value that is nan is a gap: it is left out, and no
    step leads across it.  A window of fewer than 6 points is not judged.

    >>> import numpy as np
    >>> from cosim.roughness import roughness
    >>> x = np.linspace(40.0, 60.0, 21)
    >>> wave = roughness(x, 1e-4 * x**3 + 0.01 * (-1.0) ** np.arange(21))
    >>> 0.0095 < wave.rms < 0.01
    True
    """
    order = np.argsort(np.asarray(place, dtype=float), kind="stable")
    x, y = (np.asarray(a, dtype=float)[order] for a in (place, value))
    steps = np.abs(np.diff(y))
    known = np.isfinite(x) & np.isfinite(y)
    left = list(_residuals(x[known], y[known], window))
    return Roughness(
        max((float(np.sqrt(np.mean(r**2))) for r in left), default=np.nan),
        max((float(np.abs(r).max()) for r in left), default=np.nan),
        max(steps[np.isfinite(steps)].tolist(), default=np.nan),
    )


def _residuals(x: Array, y: Array, window: float) -> Iterator[Array]:
    """What a cubic leaves of each window that begins at a point, and of the last one."""
    if len(x) < FEWEST:
        return
    slip = 1e-9 * window  # 40.0 + 20 steps of 0.1 may be a bit beyond 42
    last = max(x[0], x[-1] - window)
    for start in {*x[x <= last + slip].tolist(), float(last)}:
        inside = (x >= start - slip) & (x <= start + window + slip)
        if inside.sum() >= FEWEST:
            yield _beyond_cubic((x[inside] - start) / window, y[inside])


def _beyond_cubic(x: Array, y: Array) -> Array:
    powers = np.vander(2 * x - 1, 4)
    residual: Array = y - powers @ np.linalg.lstsq(powers, y, rcond=None)[0]
    return residual


def roughness_along(place: Array, value: Array, unit: str) -> Roughness:
    """The roughness over a parameter in `unit`: in windows of 20 deg, of another unit over all."""
    return roughness(place, value, 20.0 if unit == "deg" else float(np.ptp(place)) or 1.0)
