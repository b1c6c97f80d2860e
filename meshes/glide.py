"""How far a hood has glided along the bones, from where it was laid, at named places.

Glide is measured in the frame of the bone beneath: the stress-free hood is carried along rigidly
with that bone from the posture in which it was laid, and a place has glided by as much as it now
lies distal of there, along the bone's long axis.  Each place is the middle of a part of the hood
where a line across the finger crosses it:

    central_tendon        halfway along the proximal phalanx, against that phalanx
    lateral_band_radial   at the PIP, against the proximal phalanx
    lateral_band_ulnar    the same
    terminal_slip         its proximal end, against the middle phalanx
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from meshes.cable_net import CableNet
from meshes.hood_mesh import HoodMesh, display_quads
from meshes.hull import PIP
from meshes.skeleton import BODIES

PLACES = ("central_tendon", "lateral_band_radial", "lateral_band_ulnar", "terminal_slip")
SHEET = {
    "central_tendon": ("extensor_tendon_distal", "central_band", "central_slip"),
    "lateral_band_radial": ("lateral_band_radial",),
    "lateral_band_ulnar": ("lateral_band_ulnar",),
    "terminal_slip": ("terminal_slip",),
}
"""Regions of a sheet in which each place lies."""
NET = {
    "central_tendon": ("extensor_tendon", "central_band", "central_slip"),
    "lateral_band_radial": ("lateral_band_radial",),
    "lateral_band_ulnar": ("lateral_band_ulnar",),
    "terminal_slip": ("terminal_slip",),
}
"""Strands of a net of cables in which each place lies."""
STATION = {"central_tendon": PIP / 2, "lateral_band_radial": PIP, "lateral_band_ulnar": PIP}
"""mm of the straight index finger from the MCP; a place without begins its part of the hood."""
BENEATH = {"terminal_slip": "middle"}
"""The bone beneath a place, where it is not the proximal phalanx."""


@dataclass(frozen=True)
class CarriedPoint:
    """A point that a hood carries: the weighted mean of its nodes (k,)."""

    name: str
    body: int
    """Index of the bone beneath, of BODIES."""
    nodes: Ints
    weight: Array

    def across(self, points: Array, position: Array, rotation: Array) -> float:
        """The distance, m, radial of the bone's axis; as `along`."""
        from_origin = self.weight @ points[self.nodes] - position[self.body]
        return float(from_origin @ rotation[self.body][:, 1])

    def along(self, points: Array, position: Array, rotation: Array) -> float:
        """The distance of places, m, distal of the bone's origin along the bone, with nodes at
        `points` (n, 3) m and bodies at `position` (nb, 3) m, `rotation` (nb, 3, 3), all in one
        frame."""
        from_origin = self.weight @ points[self.nodes] - position[self.body]
        return float(from_origin @ rotation[self.body][:, 0])


def sheet_places(mesh: HoodMesh) -> tuple[CarriedPoint, ...]:
    """The places of a sheet; those whose regions the mesh lacks are left out."""
    edges = {name: sheet_edges(mesh, regions) for name, regions in SHEET.items()}
    return tuple(_places(mesh.station, edges))


def net_places(net: CableNet) -> tuple[CarriedPoint, ...]:
    """The places of a net of cables; those whose strands it lacks are left out."""
    edges = {name: net_edges(net, strands) for name, strands in NET.items()}
    return tuple(_places(net.station, edges))


def sheet_edges(mesh: HoodMesh, regions: Sequence[str]) -> Ints:
    """The nodes (m, 2) at the ends of the edges of quads in the named regions, each edge once."""
    quads = display_quads(mesh.quads[mesh.cells(*regions)])
    sides = np.stack([quads, np.roll(quads, 1, axis=1)], axis=-1).reshape(-1, 2)
    return np.unique(np.sort(sides, axis=1), axis=0)


def net_edges(net: CableNet, strands: Sequence[str]) -> Ints:
    """The nodes (m, 2) at the ends of the cells of the named strands."""
    return net.cells[np.isin(np.array(net.strands)[net.strand], strands)]


def tendon_over_mcp(station: Array, edges: Ints) -> CarriedPoint | None:
    """The middle of the extensor tendon, of `edges` (m, 2), over the MCP, against the metacarpal;
    None where nothing of it is left there."""
    crossed = crossing(station, edges, 0.0)
    return None if crossed is None else CarriedPoint("mcp", BODIES.index("metacarpal"), *crossed)


def tendon_shift(
    tendon: CarriedPoint | None,
    laid: tuple[Array, Array, Array],
    now: tuple[Array, Array, Array],
) -> float | None:
    """How far (m) the tendon of `tendon_over_mcp` has gone radially, from `laid` as in `glide`."""
    return None if tendon is None else tendon.across(*now) - tendon.across(*laid)


def _places(station: Array, edges: Mapping[str, Ints]) -> Iterator[CarriedPoint]:
    """Where lines across the finger cross the edges (m, 2) of each part of a hood whose nodes were
    laid at `station` (n,) mm."""
    for name, pairs in edges.items():
        pairs = pairs[np.ptp(station[pairs], axis=1) > 0]
        if not len(pairs):
            continue
        crossed = crossing(station, pairs, STATION.get(name, station[pairs].min()))
        if crossed is not None:
            yield CarriedPoint(name, BODIES.index(BENEATH.get(name, "proximal")), *crossed)


def crossing(station: Array, pairs: Ints, row: float) -> tuple[Ints, Array] | None:
    """Nodes (k,) and weights (k,) of the mean point at which the line of constant station `row`
    (mm) crosses edges (m, 2) of nodes laid at `station` (n,) mm; None where it crosses none."""
    pairs = pairs[np.ptp(station[pairs], axis=1) > 0]
    first, last = station[pairs].T
    on = (np.minimum(first, last) <= row) & (row <= np.maximum(first, last))
    if not on.any():
        return None
    share = (row - first[on]) / (last[on] - first[on])
    return pairs[on].ravel(), np.column_stack([1 - share, share]).ravel() / on.sum()


def glide(
    places: Sequence[CarriedPoint],
    laid: tuple[Array, Array, Array],
    now: tuple[Array, Array, Array],
) -> dict[str, float]:
    """How far places on the hood glide along the bones, m by place, positive distally.

    `laid` and `now`: points (n, 3) m of the hood, positions (nb, 3) m and rotations (nb, 3, 3) of
    BODIES, each of the two in a frame of its own."""
    return {place.name: place.along(*now) - place.along(*laid) for place in places}
