"""Points and gauges of an experiment on a sheet: ink dots, and the distances between two of them.

A point is named on the undeformed hood, as it was laid; it is taken to the nearest point of the
sheet's mid-surface and moves with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import AXES, Array

FARTHEST = 3e-3
"""m from the mid-surface: a point farther off is on no hood."""


@dataclass(frozen=True)
class Gauges:
    """Points on a sheet by name, and gauges between two of them."""

    points: tuple[str, ...]
    nodes: np.ndarray
    """(k, 3) of the triangle in which each point lies."""
    weights: Array
    """(k, 3) of its nodes."""
    gauges: Mapping[str, tuple[str, str]]

    def positions(self, x: Array) -> Array:
        """(k, 3) m, of a sheet with nodes at x (n, 3)."""
        return np.asarray(np.einsum("ki,kij->kj", self.weights, x[self.nodes]))

    def lengths(self, x: Array) -> dict[str, float]:
        """m by gauge."""
        at = dict(zip(self.points, self.positions(x), strict=True))
        return {n: float(np.linalg.norm(at[b] - at[a])) for n, (a, b) in self.gauges.items()}

    def strain(self, x: Array, before: Array) -> dict[str, float]:
        """Engineering strain of each gauge from its length on the sheet at `before`, per cent."""
        first = self.lengths(before)
        return {name: 100 * (now / first[name] - 1) for name, now in self.lengths(x).items()}

    def displacements(self, x: Array, before: Array) -> dict[str, dict[str, float]]:
        """mm by point, from the sheet at `before`, along the world's axes."""
        moved = 1e3 * (self.positions(x) - self.positions(before))
        return {
            name: dict(zip(AXES, map(float, way), strict=True))
            for name, way in zip(self.points, moved, strict=True)
        }


def place_gauges(
    points: Mapping[str, Sequence[float]],
    gauges: Mapping[str, tuple[str, str]],
    x: Array,
    triangles: np.ndarray,
) -> Gauges:
    """The points (3,) m on a sheet with nodes at x (n, 3) and triangles (m, 3).

    Raises InputError for a point farther than FARTHEST from it."""
    nodes, weights, faults = [], [], []
    for name, point in points.items():
        weight, distance = _nearest_points(np.asarray(point, dtype=float), x[triangles])
        best = int(np.argmin(distance))
        if distance[best] > FARTHEST:
            there = 1e3 * weight[best] @ x[triangles[best]]
            faults.append(
                f"hood.points.{name}: is {1e3 * distance[best]:.1f} mm off the undeformed hood, "
                f"whose nearest point is ({', '.join(f'{v:.2f}' for v in there)}) mm"
            )
        nodes.append(triangles[best])
        weights.append(weight[best])
    if faults:
        raise InputError("\n  ".join(faults))
    places = np.array(nodes, dtype=int).reshape(-1, 3), np.array(weights).reshape(-1, 3)
    return Gauges(tuple(points), *places, dict(gauges))


def _nearest_points(point: Array, corners: Array) -> tuple[Array, Array]:
    """Barycentric coordinates (m, 3) of the point of each triangle (m, 3, 3) that is nearest to a
    point (3,), and the distances (m,)."""
    a, b, c = corners.transpose(1, 0, 2)
    e, f, d = b - a, c - a, point - a
    ee, ef, ff = (np.einsum("ij,ij->i", u, v) for u, v in ((e, e), (e, f), (f, f)))
    de, df = (np.einsum("ij,ij->i", d, u) for u in (e, f))
    area = np.maximum(ee * ff - ef * ef, 1e-300)
    v, w = (ff * de - ef * df) / area, (ee * df - ef * de) / area
    candidates = [np.stack([1 - v - w, v, w], axis=1)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[:, i], corners[:, j] - corners[:, i]
        length = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
        t = np.clip(np.einsum("ij,ij->i", point - start, along) / length, 0.0, 1.0)
        weight = np.zeros((len(corners), 3))
        weight[:, i], weight[:, j] = 1 - t, t
        candidates.append(weight)
    weights = np.stack(candidates)
    distance = np.linalg.norm(np.einsum("qmi,mij->qmj", weights, corners) - point, axis=2)
    distance[0, (weights[0] < 0).any(axis=1)] = np.inf
    best = distance.argmin(axis=0)
    each = np.arange(len(corners))
    return weights[best, each], distance[best, each]
