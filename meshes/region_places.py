"""Where points of a hood lie in its regions: along the finger, across it, and on which side.

A sheet's `turn` about the finger is the angle about the chain of joint centres, 0 dorsal, positive
radial.  A region whose name ends in `radial` or `ulnar` lies on that side; any other lies over the
midline and has both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from meshes.hood_mesh import REGIONS, HoodMesh, display_quads
from meshes.hull import Centreline, along
from meshes.skeleton import Skeleton

ROWS = 65
"""Lines across a region at which its edges are looked up."""


@dataclass(frozen=True)
class Turns:
    """The nodes' turn (n,) about the finger, rad, and the direction (n, 3) away from it."""

    turn: Array
    outward: Array


def turns(mesh: HoodMesh, skeleton: Skeleton) -> Turns:
    """How a mesh's nodes lie about the finger in its rest posture."""
    chain = Centreline(skeleton, *skeleton.pose(mesh.rest_posture))
    centre, axes = chain.frames(along(skeleton, mesh.station))
    away = mesh.points - centre
    radial, dorsal = (np.einsum("nk,nk->n", away, axes[:, :, i]) for i in (1, 2))
    out = radial[:, None] * axes[:, :, 1] + dorsal[:, None] * axes[:, :, 2]
    return Turns(np.arctan2(radial, dorsal), out)


def side_of(region: int, turn: Array) -> Array:
    """1 on the radial side, -1 on the ulnar one, of points of a region at `turn` (...,)."""
    name = REGIONS[region]
    if name.endswith("_radial"):
        return np.ones_like(turn)
    if name.endswith("_ulnar"):
        return -np.ones_like(turn)
    return np.where(turn >= 0, 1.0, -1.0)


def region_places(
    mesh: HoodMesh, region: int, node_turn: Array, station: Array, turn: Array
) -> tuple[Array, Array]:
    """How far along and across a region, each from 0 to 1, points at `station` (...,) mm and `turn`
    (...,) lie: from its proximal to its distal end; and from the edge nearest to the midline (of a
    region over it: from the midline) to the far edge at that station.  `node_turn` (n,) is the
    nodes'."""
    quads = display_quads(mesh.quads[mesh.region == region])
    s = mesh.station[quads]
    low, high = float(s.min()), float(s.max())
    rows = np.linspace(low, high, ROWS)
    lateral = side_of(region, node_turn) * node_turn
    inner, outer = _edges(quads, mesh.station, lateral, rows)
    if not REGIONS[region].endswith(("_radial", "_ulnar")):
        inner = np.zeros_like(outer)
    near, far = np.interp(station, rows, inner), np.interp(station, rows, outer)
    across = (side_of(region, turn) * turn - near) / np.maximum(far - near, 1e-9)
    distal = (station - low) / max(high - low, 1e-9)
    return np.clip(distal, 0, 1), np.clip(across, 0, 1)


def _edges(quads: Ints, station: Array, lateral: Array, rows: Array) -> tuple[Array, Array]:
    """The least and the greatest `lateral` (n,), (ROWS,) each, of the nodes, where lines of
    constant station cross the edges of quads (m, 4)."""
    ends = np.stack([quads, np.roll(quads, 1, axis=1)], axis=-1).reshape(-1, 2)
    ends = ends[np.ptp(station[ends], axis=1) > 0]
    s, u = station[ends], lateral[ends]
    share = (rows[:, None] - s[:, 0]) / (s[:, 1] - s[:, 0])
    there = u[:, 0] + share * (u[:, 1] - u[:, 0])
    on = (share >= -1e-9) & (share <= 1 + 1e-9)
    least = np.where(on, there, np.inf).min(axis=1)
    most = np.where(on, there, -np.inf).max(axis=1)
    met = on.any(axis=1)
    return np.interp(rows, rows[met], least[met]), np.interp(rows, rows[met], most[met])
