"""Markers on a hood, as an experiment glues them on: the same places of the sheet on any mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from meshes.hood_mesh import HoodMesh, display_quads

ROWS = 6
"""About 8 mm apart over the central region; an assumption."""


@dataclass(frozen=True)
class Markers:
    """Points that the sheet carries: means of nodes (rows, columns, k) with weights."""

    nodes: Ints
    weight: Array

    def at(self, points: Array) -> Array:
        """The markers' places (rows, columns, 3), where they are when the nodes are at `points` (n,
        3)."""
        return np.einsum("rck,rckj->rcj", self.weight, points[self.nodes])


def markers(mesh: HoodMesh, regions: Sequence[str]) -> Markers:
    """Return ROWS by 3 points on the radial edge, in the middle and on the ulnar edge of the named
    regions, in rows evenly spaced along the finger.

    Raises InputError where the regions are not in the mesh.

    >>> from importlib.resources import files
    >>> from meshes.hood_mesh import read
    >>> from meshes.markers import markers
    >>> mesh = read(files("meshes") / "hoods" / "index_416.json")
    >>> markers(mesh, ["central_slip"]).at(mesh.points).shape
    (6, 3, 3)
    """
    quads = display_quads(mesh.quads[mesh.cells(*regions)])
    if not len(quads):
        raise InputError(f"the mesh has none of the regions {', '.join(regions)}")
    edges = np.stack([quads, np.roll(quads, 1, axis=1)], axis=-1).reshape(-1, 2)
    edges = edges[np.ptp(mesh.station[edges], axis=1) > 0]
    s = mesh.station[edges]
    tried = np.linspace(s.min(), s.max(), 101)
    across = (_crossing_edges(mesh, edges, row)[2] for row in tried)
    width = np.array([np.ptp(y) if len(y) else 0.0 for y in across])
    whole = tried[width > np.median(width) / 4]  # an end may be ragged or come to a point
    rows = whole[np.linspace(0, len(whole) - 1, ROWS).round().astype(int)]
    nodes, weight = zip(*(_across(mesh, edges, row) for row in rows), strict=True)
    return Markers(np.array(nodes), np.array(weight))


def _crossing_edges(mesh: HoodMesh, edges: Ints, row: float) -> tuple[Ints, Array, Array]:
    """Those of `edges` that the line at station `row` (mm) crosses, from ulnar to radial, the
    shares (k, 2) of their ends there, and how far radial that is, m."""
    s = mesh.station[edges]
    on = (s.min(axis=1) <= row) & (row <= s.max(axis=1))
    t = (row - s[on, 0]) / (s[on, 1] - s[on, 0])
    share = np.column_stack([1 - t, t])
    radial = (share * mesh.points[edges[on], 1]).sum(axis=1)
    order = np.argsort(radial)
    return edges[on][order], share[order], radial[order]


def _across(mesh: HoodMesh, edges: Ints, row: float) -> tuple[Ints, Array]:
    """Nodes (3, 4) and weights of the radial edge, the middle and the ulnar edge where the line at
    station `row` crosses `edges`."""
    edges, share, y = _crossing_edges(mesh, edges, row)
    place = np.interp([y[-1], (y[0] + y[-1]) / 2, y[0]], y, np.arange(len(y)))
    i = place.astype(int)
    j, u = np.minimum(i + 1, len(y) - 1), (place - i)[:, None]
    return np.hstack([edges[i], edges[j]]), np.hstack([(1 - u) * share[i], u * share[j]])
