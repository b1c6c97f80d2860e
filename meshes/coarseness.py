"""How coarse a hood's rows are where a posture brings them over the head of a bone.

Between two rows, h apart, the sheet is a chord: over a head of radius R it runs h^2 / 8R below the
arc.  As it slides, height and moment arm wave by as much as the tissue over the head gives way.
Contact is felt at points within the elements, not at the rows alone, so that what is left of the
wave is small of second order in the sag's share of that tissue's thickness: a share of SHARE is
enough, and so is a sag of LEAST_SAG where the tissue is thinner.

The rows that come onto a head lie proximal of its joint by what the arc takes in full flexion and
the hood's glide, and distal of it by what extension takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from meshes.cover import FLEXION, Joint
from meshes.hood_mesh import HoodMesh, display_quads
from meshes.hull import DIP, PIP, SmoothSurface, along
from meshes.skeleton import Skeleton

POSTURES = {"MCP": (-20.0, 90.0), "PIP": (0.0, 110.0), "DIP": (0.0, 70.0)}
"""deg, the joints' flexion in which rows are judged."""
GLIDE = 2.0
"""mm by which a hood glides distally at most: on the index finger at MCP 90, PIP 105 and DIP 70 deg
rows lie on the heads 1.6, 0.1 and 0.6 mm further proximal than the arcs reach."""
SHARE = 0.2
"""The part of the tissue's thickness that a chord's sag may be."""
LEAST_SAG = 0.14
"""mm that a chord's sag may be over any tissue: with rows half as far apart over 0.2 mm on the head
of the middle phalanx, no slip changes by more than 0.6 % of EDC's tension and no arm by more than
0.05 mm, at DIP 15 and 45 deg (measured on the index finger's shell)."""
WORDS = {"metacarpal": "metacarpal", "proximal": "proximal phalanx", "middle": "middle phalanx"}
FARTHEST = 20.0
"""mm from a joint's axis within which its head's surface is looked for."""


class Arc(NamedTuple):
    """The arc that a hood slides over on the head of a bone."""

    body: str
    first: float
    """m along the chain of joints, of the most proximal row that a posture brings there."""
    last: float
    """m along the chain, of the most distal one."""
    radius: float
    """m, the smallest of head and cover."""
    thickness: float
    """m, of the tissue over the head's face."""

    @property
    def spacing(self) -> float:
        """The distance (m) of rows whose sag may just be."""
        sag = max(SHARE * self.thickness, 1e-3 * LEAST_SAG)
        return float(np.sqrt(8 * self.radius * sag))


class Rows(NamedTuple):
    """Rows of a mesh on an arc."""

    arc: Arc
    first: float
    """mm, station of the most proximal row."""
    last: float
    """mm, of the most distal one."""
    spacing: float
    """m, the largest between two rows."""

    @property
    def share(self) -> float:
        """The chord's sag over the tissue's thickness."""
        return self.spacing**2 / (8 * self.arc.radius * self.arc.thickness)

    def __str__(self) -> str:
        arc = self.arc
        return (
            f"hood.mesh: rows {1e3 * self.spacing:.1f} mm apart at stations {self.first:.0f} to "
            f"{self.last:.0f} mm come onto the head of the {WORDS[arc.body]} as its joint flexes: "
            f"between them the sheet runs {1e3 * self.share * arc.thickness:.2f} mm too low, of "
            f"{1e3 * arc.thickness:.1f} mm of tissue, and forces may wave over posture by some "
            f"percent. Lay rows {1e3 * arc.spacing:.1f} mm apart or less there"
        )


def arcs(
    skeleton: Skeleton,
    surfaces: Mapping[str, SmoothSurface],
    offset: Mapping[str, float],
    thickness: Mapping[str, float],
) -> list[Arc]:
    """Return the arcs over the heads of bones of these `surfaces`, which the hood's face touches at
    `offset` (m) and whose faces are covered by `thickness` (m); a bone without one has none."""
    scale = skeleton.length[1] / PIP
    centre = along(skeleton, np.array([0.0, PIP, DIP]))
    out = []
    for (body, joint), place in zip(FLEXION.items(), centre, strict=True):
        low, high = np.deg2rad(POSTURES[joint])
        radius = _radius(surfaces[body], offset[body], Joint.of(skeleton, body), high, scale)
        if radius > 0 and thickness[body] > 0:
            first, last = place - radius * high - GLIDE * scale, place - radius * low
            out.append(Arc(body, first, last, radius, thickness[body]))
    return out


def _radius(
    surface: SmoothSurface, offset: float, joint: Joint, flexion: float, scale: float
) -> float:
    """The smallest distance (m) from a joint's axis, over the middle of its head from its back to
    `flexion` (rad) on, of what lies `offset` (m) over a surface; zero where there is nothing."""
    distal, dorsal = joint.directions()
    angle, far = np.linspace(0, flexion, 24), np.linspace(0, FARTHEST * scale, 200)
    rays = np.outer(np.sin(angle), distal) + np.outer(np.cos(angle), dorsal)
    points = joint.centre + far[:, None, None] * rays / np.linalg.norm(dorsal)
    over = surface.distance(points.reshape(-1, 3))[0].reshape(len(far), -1) - offset
    inside = over <= 0
    out = len(far) - 1 - inside[::-1].argmax(axis=0)  # the last place inside, on each ray
    crossed = np.flatnonzero(inside.any(axis=0) & (out < len(far) - 1))
    if not len(crossed):
        return 0.0
    i = out[crossed]
    before, after = over[i, crossed], over[i + 1, crossed]
    return float((far[i] + (far[1] - far[0]) * before / (before - after)).min())


def rows_on(mesh: HoodMesh, skeleton: Skeleton, arc: Arc) -> Iterator[tuple[float, float, float]]:
    """Stations (mm) of the two ends and length (m) of each edge along the finger whose middle some
    posture brings onto an arc."""
    quads = display_quads(mesh.quads)
    edges = np.unique(np.sort([quads, np.roll(quads, -1, axis=1)], axis=0).reshape(2, -1).T, axis=0)
    place = along(skeleton, mesh.station)[edges]
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    middle = place.mean(axis=1)
    on = (np.ptp(place, axis=1) > length / 2) & (middle >= arc.first) & (middle <= arc.last)
    for ends, h in zip(np.sort(mesh.station[edges[on]], axis=1), length[on], strict=True):
        yield float(ends[0]), float(ends[1]), float(h)


def coarse_rows(mesh: HoodMesh, skeleton: Skeleton, over: list[Arc]) -> list[Rows]:
    """Return the rows of a mesh that lie further apart than an arc's spacing: one for each arc that
    has some."""
    out = []
    for arc in over:
        coarse = [edge for edge in rows_on(mesh, skeleton, arc) if edge[2] > arc.spacing]
        if coarse:
            first, last, length = zip(*coarse, strict=True)
            out.append(Rows(arc, min(first), max(last), max(length)))
    return out
