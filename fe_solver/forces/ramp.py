"""The smoothed ramp by which a one-sided force sets in."""

from __future__ import annotations

import numpy as np

from cosim.port import Array


def ramp(depth: Array, smoothing: Array | float) -> tuple[Array, Array, Array]:
    """Integral, value and slope of the smoothed ramp max(depth, 0)."""
    blend = (depth + smoothing) / 2
    inside = np.abs(depth) < smoothing
    value = np.where(inside, blend**2 / smoothing, np.maximum(depth, 0.0))
    slope = np.where(inside, blend / smoothing, (depth > 0).astype(float))
    deep = depth**2 / 2 + smoothing**2 / 6
    integral = np.where(inside, 2 * blend**3 / (3 * smoothing), np.where(depth > 0, deep, 0.0))
    return integral, value, slope


def inverse_ramp(value: Array, smoothing: Array | float) -> Array:
    """The depth at which the ramp has this value; of zero, the largest such depth."""
    return np.where(
        value < smoothing, 2 * np.sqrt(smoothing * np.maximum(value, 0.0)) - smoothing, value
    )
