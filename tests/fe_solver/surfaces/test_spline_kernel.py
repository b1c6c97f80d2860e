"""The compiled spline against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from fe_solver.elements import kernels
from fe_solver.surfaces.spline_distance import SplineDistance


@pytest.mark.skipif(not kernels.COMPILED, reason="numba is not installed")
def test_the_compiled_spline_does_what_numpy_does(monkeypatch):
    """Within the grid, on its first and last planes, beside it, and where a point is none; slopes
    alone are the same to the bit."""
    rng = np.random.default_rng(3)
    spline = SplineDistance.from_grid(
        np.array([-1.0, 0.0, 2.0]), 0.5, rng.normal(size=(5, 6, 7)), 9.0
    )
    last = spline.origin + 0.5 * np.array([4, 5, 6])
    beside = np.array([0.0, 1e-9, 0.0])
    points = np.vstack(
        [
            rng.uniform(spline.origin - 0.5, last + 0.5, (200, 3)),
            [spline.origin, last, last + beside, spline.origin - beside],
            [[np.nan, 0.5, 2.5]],
        ]
    )
    compiled = spline.distance(points)
    for one, other in zip(spline.slopes(points), compiled[:2], strict=True):
        np.testing.assert_array_equal(one, other)
    monkeypatch.setattr(kernels, "COMPILED", False)
    plain = spline.distance(points)
    assert 50 < (compiled.value != 9.0).sum() < 200
    for one, other in zip(compiled, plain, strict=True):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-12, nan_ok=True)
