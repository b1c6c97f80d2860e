"""Points and gauges of an experiment on a sheet: ink dots, and the distances between two of them.

A point is named on the undeformed hood, as it was laid; it is taken to the nearest point of the
sheet's mid-surface and moves with it.  The surface strain at a point is that of its quad.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.errors import InputError
from cosim.hoods.shell.point_table import GridConfig, read_points
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.port import AXES, Array
from meshes.hood_mesh import display_quads

FARTHEST = 3e-3
"""m from the mid-surface: a point farther off is on no hood."""
STRAIN_COMPONENTS = ("longitudinal", "lateral", "shear")
"""The components of the surface strain tensor at a point."""
EDGE = 1e-9
"""A barycentric coordinate down to minus that is of a point on the triangle's edge."""


@dataclass(frozen=True)
class Gauges:
    """Points on a sheet by name, and gauges between two of them."""

    points: tuple[str, ...]
    nodes: np.ndarray
    """(k, 3) of the triangle in which each point lies."""
    weights: Array
    """(k, 3) of its nodes."""
    quads: np.ndarray
    """(k,) the element in which each point lies."""
    gauges: Mapping[str, tuple[str, str]]
    grids: Mapping[str, np.ndarray] = field(default_factory=dict)
    """(rows, columns) places of each grid's points among `points`, rows one after the other
    distally, columns radially."""

    def positions(self, x: Array) -> Array:
        """The points (k, 3) m, of a sheet with nodes at x (n, 3)."""
        return np.asarray(np.einsum("ki,kij->kj", self.weights, x[self.nodes]))

    def lengths(self, x: Array) -> dict[str, float]:
        """The length (m) of each gauge."""
        at = dict(zip(self.points, self.positions(x), strict=True))
        return {n: float(np.linalg.norm(at[b] - at[a])) for n, (a, b) in self.gauges.items()}

    def strain(self, x: Array, before: Array) -> dict[str, float]:
        """Engineering strain of each gauge from its length on the sheet at `before`, per cent."""
        first = self.lengths(before)
        return {name: 100 * (length / first[name] - 1) for name, length in self.lengths(x).items()}

    def grid_strains(self, x: Array, before: Array) -> dict[str, tuple[Array, Array]]:
        """Strains between neighbours of each grid from `before`, as `neighbour_strains`."""
        first, moved = self.positions(before), self.positions(x)
        return {name: neighbour_strains(first[k], moved[k]) for name, k in self.grids.items()}

    def displacements(self, x: Array, before: Array) -> dict[str, dict[str, float]]:
        """The displacement (mm) of each point, from the sheet at `before`, along the world's
        axes."""
        moved = 1e3 * (self.positions(x) - self.positions(before))
        return {
            name: dict(zip(AXES, map(float, way), strict=True))
            for name, way in zip(self.points, moved, strict=True)
        }


def points_on(config: ShellHoodConfig, x: Array, quads: np.ndarray) -> Gauges:
    """The points and gauges of a case on its undeformed sheet with nodes at x (n, 3) m and elements
    (ne, 4 or 9).

    Raises InputError for a point that is not on it."""
    shown = display_quads(quads)
    triangles = np.concatenate([shown[:, [0, 1, 2]], shown[:, [0, 2, 3]]])
    element = np.tile(np.arange(len(shown)) // (len(shown) // len(quads)), 2)
    points: dict[str, Sequence[float]] = dict(config.points)
    if config.points_file is not None:
        points |= read_points(config.points_file)
    for name, grid in config.grids.items():
        points |= zip(grid.names(name), _lay_grid(name, grid, x[triangles]), strict=True)
    placed = place_gauges(points, config.gauges, x, triangles, element)
    index = {name: k for k, name in enumerate(placed.points)}
    grids = {
        name: np.array([index[n] for n in grid.names(name)]).reshape(grid.count)
        for name, grid in config.grids.items()
    }
    return replace(placed, grids=grids)


def neighbour_strains(first: Array, last: Array) -> tuple[Array, Array]:
    """Longitudinal (rows - 1, columns) and lateral (rows, columns - 1) engineering strains between
    neighbours of points (rows, columns, 3), from `first` to `last`."""

    def stretch(axis: int) -> Array:
        l0, l1 = (np.linalg.norm(np.diff(x, axis=axis), axis=2) for x in (first, last))
        return np.asarray(l1 / l0 - 1)

    return stretch(0), stretch(1)


def _lay_grid(name: str, grid: GridConfig, corners: Array) -> Array:
    """Lay the grid's points (k, 3) m on triangles with corners (m, 3, 3): the most dorsal ones.

    Raises InputError where the grid leaves the sheet."""
    distal = np.linspace(*grid.distal, grid.count[0])
    radial = np.linspace(*grid.radial, grid.count[1])
    places = np.stack(np.meshgrid(distal, radial, indexing="ij"), axis=-1).reshape(-1, 2)
    height = np.array([_most_dorsal(place, corners) for place in places])
    if (beside := np.isnan(height)).any():
        low, high = (1e3 * end(corners[..., :2], axis=(0, 1)) for end in (np.min, np.max))
        first = 1e3 * places[beside][0]
        raise InputError(
            f"hood.grids.{name}: {beside.sum()} of {len(places)} points are not over the "
            f"undeformed hood, the first at distal {first[0]:.2f} mm and radial {first[1]:.2f} mm. "
            f"The hood lies within distal {low[0]:.1f} to {high[0]:.1f} mm and radial "
            f"{low[1]:.1f} to {high[1]:.1f} mm, and is narrower in places"
        )
    return np.column_stack([places, height])


def _most_dorsal(place: Array, corners: Array) -> float:
    """The largest dorsal coordinate (m) of triangles (m, 3, 3) at distal and radial ones (2,); NaN
    where there is none."""
    a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d = place - a[:, :2]
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles that stand upright
        v = (d[:, 0] * f[:, 1] - d[:, 1] * f[:, 0]) / area
        w = (e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0]) / area
        on = (v >= -EDGE) & (w >= -EDGE) & (v + w <= 1 + EDGE)
    height = (a[:, 2] + v * e[:, 2] + w * f[:, 2])[on]
    return float(height.max()) if height.size else np.nan


def strain_between(before: Array, now: Array) -> Array:
    """Green-Lagrange strains (k, 3) E11, E22, E12 of states with strains (k, 3) E11, E22, 2 E12
    from one reference, seen from the first: axis 1 is the line that was axis 1 in the reference, as
    it lies in the first state, axis 2 is perpendicular to it there.

    With F the first state's gradient and U upper triangular in F^T F = U^T U, it is U^-T (E_now -
    E_before) U^-1."""
    first, change = _tensor(before), _tensor(now) - _tensor(before)
    lower = np.linalg.cholesky(np.eye(2) + 2 * first)
    half = np.linalg.solve(lower, change)
    strain = np.linalg.solve(lower, half.swapaxes(1, 2))
    return np.stack([strain[:, 0, 0], strain[:, 1, 1], strain[:, 0, 1]], axis=1)


def _tensor(strain: Array) -> Array:
    """Tensors (k, 2, 2) of E11, E22, 2 E12 (k, 3)."""
    e1, e2, shear = strain.T
    return np.stack([e1, shear / 2, shear / 2, e2], axis=1).reshape(-1, 2, 2)


def place_gauges(
    points: Mapping[str, Sequence[float]],
    gauges: Mapping[str, tuple[str, str]],
    x: Array,
    triangles: np.ndarray,
    element: np.ndarray | None = None,
) -> Gauges:
    """The points (3,) m on a sheet with nodes at x (n, 3) and triangles (m, 3), which are parts of
    elements (m,), each of its own where none are given.

    Raises InputError for a point farther than FARTHEST from it."""
    element = np.arange(len(triangles)) if element is None else element
    nodes, weights, quads, faults = [], [], [], []
    for name, point in points.items():
        weight, distance = _nearest_points(np.asarray(point, dtype=float), x[triangles])
        best = int(np.argmin(distance))
        if distance[best] > FARTHEST:
            nearest = 1e3 * weight[best] @ x[triangles[best]]
            faults.append(
                f"hood.points.{name}: is {1e3 * distance[best]:.1f} mm off the undeformed hood, "
                f"whose nearest point is ({', '.join(f'{v:.2f}' for v in nearest)}) mm"
            )
        nodes.append(triangles[best])
        weights.append(weight[best])
        quads.append(element[best])
    if faults:
        raise InputError("\n  ".join(faults))
    places = np.array(nodes, dtype=int).reshape(-1, 3), np.array(weights).reshape(-1, 3)
    return Gauges(tuple(points), *places, np.array(quads, dtype=int), dict(gauges))


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
