"""How high the lateral bands pass the PIP, and how the sagittal bands stand over the MCP.

The height of a lateral band is the signed distance of its middle line from the PIP's flexion axis,
positive on the dorsal side, measured in the plane through that axis that halves the angle between
the proximal and the middle phalanx.  Where the band crosses that plane at right angles the height
is its moment arm.

A sagittal band's angle is that of a line from its anchor on the palmar plate up to the hood, seen
along the radial axis of the metacarpal (near the MCP's flexion axis), from the square of the
tendon; it is positive where the line leans distally.  The lines and the squares are:

    edge            from the anchors to the edge of the sheet over the MCP that they hold
    tendon          from the anchors to the middle of the tendon, at the MCP's station as laid
    square          dorsal, at right angles to the metacarpal's long axis
    local square    dorsal, at right angles to the tendon over the MCP
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from meshes.cable_net import CableNet
from meshes.glide import NET, SHEET, crossing, net_edges, sheet_edges
from meshes.hood_lines import SAGITTAL_ROWS
from meshes.hood_mesh import HoodMesh
from meshes.skeleton import BODIES

SIDES = ("radial", "ulnar")
OVER_MCP = ("extensor_tendon_proximal", "extensor_tendon_distal", "central_band")
"""Regions of the tendon where it passes the MCP."""
ROW = 1.0
"""mm between the points of a middle line, as laid."""
PROXIMAL, MIDDLE = BODIES.index("proximal"), BODIES.index("middle")


@dataclass(frozen=True)
class HoodLine:
    """Points that a hood carries, each the weighted mean of some of its nodes."""

    points: tuple[tuple[Ints, Array], ...]
    """Nodes (k,) and weights (k,) of each."""

    def at(self, x: Array) -> Array:
        """The line's points (m, 3) m, with the hood's nodes at x (n, 3) m."""
        return np.array([weight @ x[nodes] for nodes, weight in self.points]).reshape(-1, 3)


def sheet_bands(mesh: HoodMesh) -> dict[str, HoodLine]:
    """Return the middle line of each lateral band of a sheet, by side, proximal end first.

    >>> from importlib.resources import files
    >>> from meshes.bands import sheet_bands
    >>> from meshes.hood_mesh import read
    >>> mesh = read(files("meshes") / "hoods" / "index_416.json")
    >>> lines = sheet_bands(mesh)
    >>> {side: line.at(mesh.points).shape[1] for side, line in lines.items()}
    {'radial': 3, 'ulnar': 3}
    """
    edges = {side: sheet_edges(mesh, SHEET[f"lateral_band_{side}"]) for side in SIDES}
    return _middle_lines(mesh.station, edges)


def net_bands(net: CableNet) -> dict[str, HoodLine]:
    """Return the middle line of each lateral band of a net of cables, by side, from proximal."""
    edges = {side: net_edges(net, NET[f"lateral_band_{side}"]) for side in SIDES}
    return _middle_lines(net.station, edges)


def _middle_lines(station: Array, edges: Mapping[str, Ints]) -> dict[str, HoodLine]:
    """Middle lines of parts of a hood by their edges (m, 2); parts without any are left out."""
    return {
        side: HoodLine(tuple(_crossings(station, pairs, _rows(station[pairs]))))
        for side, pairs in edges.items()
        if len(pairs)
    }


def _rows(station: Array) -> Array:
    """The rows between the least and the greatest of some stations, mm."""
    low, high = float(station.min()), float(station.max())
    return np.linspace(low, high, max(2, 1 + round((high - low) / ROW)))


def _crossings(station: Array, pairs: Ints, rows: Array) -> Iterator[tuple[Ints, Array]]:
    for row in rows:
        if (crossed := crossing(station, pairs, float(row))) is not None:
            yield crossed


def band_heights(
    bands: Mapping[str, HoodLine], points: Array, position: Array, rotation: Array, axis: Array
) -> dict[str, float]:
    """The heights of lateral bands over the PIP's axis, m by side; not a number where a band does
    not cross the plane through it.

    Nodes at `points` (n, 3) m, BODIES at `position` (nb, 3) m and `rotation` (nb, 3, 3), all in one
    frame; `axis` (3,) unit, the PIP's in the middle phalanx's."""
    turning = rotation[MIDDLE] @ axis
    return {
        side: _height(
            band.at(points) - position[MIDDLE],
            turning,
            rotation[PROXIMAL][:, 0] + rotation[MIDDLE][:, 0],
        )
        for side, band in bands.items()
    }


def _height(line: Array, axis: Array, distal: Array) -> float:
    """The height, m, of a line (m, 3) where it crosses the plane through the origin and the unit
    `axis` whose normal is nearest to `distal` (3,)."""
    normal = distal - (distal @ axis) * axis
    normal /= np.linalg.norm(normal)
    along, height = line @ normal, line @ np.cross(normal, axis)
    crosses = np.flatnonzero((along[:-1] <= 0) & (along[1:] > 0))
    if not len(crosses):
        return float("nan")
    i = int(crosses[-1])
    share = -along[i] / (along[i + 1] - along[i])
    return float(height[i] + share * (height[i + 1] - height[i]))


@dataclass(frozen=True)
class SagittalBands:
    """What holds a sheet over the MCP at either side."""

    body: int
    """Index of the bone of the palmar plate, of BODIES."""
    nodes: Mapping[str, Ints]
    """(k,) of the sheet's edge, by side."""
    anchors: Mapping[str, Array]
    """(k, 3) m, in the bone's frame."""
    shares: Mapping[str, Array]
    """(k,) of each node in what the side bears, adding up to one."""
    tendon: HoodLine
    """Its middle, a little proximal of the MCP, at it and a little distal of it."""


def sagittal_bands(mesh: HoodMesh) -> SagittalBands | None:
    """Those of a sheet; None where it has none or no tendon over the MCP."""
    held = {side: mesh.springs.get(f"sagittal_{side}") for side in SIDES}
    found = {side: spring for side, spring in held.items() if spring is not None}
    pairs = sheet_edges(mesh, OVER_MCP)
    if len(found) < len(SIDES) or not len(pairs):
        return None
    tendon = tuple(
        _crossings(mesh.station, pairs, np.array([SAGITTAL_ROWS[0], 0, SAGITTAL_ROWS[1]]))
    )
    if len(tendon) < 3:
        return None
    shares = {
        side: np.full(len(s.nodes), 1 / len(s.nodes)) if s.shares is None else s.shares
        for side, s in found.items()
    }
    return SagittalBands(
        BODIES.index(found[SIDES[0]].body),
        {side: s.nodes for side, s in found.items()},
        {side: s.anchors for side, s in found.items()},
        {side: share / share.sum() for side, share in shares.items()},
        HoodLine(tendon),
    )


def sagittal_angles(
    bands: SagittalBands, points: Array, position: Array, rotation: Array
) -> dict[str, dict[str, float]]:
    """The angles of sagittal bands, rad by side, then "edge", "tendon", "edge_local" and
    "tendon_local": the line, and whether it is told from the local square.  Arguments as of
    `band_heights`."""
    before, over, beyond = bands.tendon.at(points)
    metacarpal = rotation[0]
    squares = {"": metacarpal[:, 0], "_local": beyond - before}
    out: dict[str, dict[str, float]] = {}
    for side, nodes in bands.nodes.items():
        share = bands.shares[side]
        anchor = position[bands.body] + rotation[bands.body] @ (share @ bands.anchors[side])
        lines = {"edge": share @ points[nodes] - anchor, "tendon": over - anchor}
        out[side] = {
            f"{name}{square}": _lean(line, tangent, metacarpal[:, 1])
            for square, tangent in squares.items()
            for name, line in lines.items()
        }
    return out


def _lean(line: Array, tangent: Array, radial: Array) -> float:
    """The angle, rad, of a line (3,) from the square of a tangent (3,) towards it, seen along
    `radial`."""
    along = tangent - (tangent @ radial) * radial
    along /= np.linalg.norm(along)
    return float(np.arctan2(line @ along, line @ np.cross(along, radial)))
