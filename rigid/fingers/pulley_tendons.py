"""Tendons of a builder's own: over pulleys of constant radius, through points of bones.

A pulley is a cylinder about a flexion axis that turns with the bone beyond it.  The tendon runs to
it along the bone before and ends on that cylinder so far round that it stays wound on over the
joint's range: there its arm is the radius.  In abduction the MCP's cylinder is no longer about the
flexion axis, which is of the bone before: the arm is off the radius by up to 1.6 % at 10, 6.4 % at
20, 14 % at 30 and 19 % at 35 degrees, and there is one in abduction, up to 0.53 of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from rigid.fingers.anatomy import RANGES
from rigid.model import PathElement, Segment, Strand, Tendon, Vector, Via, WrapCylinder, vector

WOUND = np.radians(20.0)
"""rad, that a pulley is wrapped by at least within the joint's range."""
LEAD = 1.5
"""From where before a pulley the tendon runs along the bone, over the pulley's radius: from further
off MuJoCo takes the straight line for the shorter way once a pulley is half wrapped."""
TURN = np.radians(50.0)
"""Between the points of the turn that keeps a palmar tendon wound on."""
FIRST_BONE = 0.03
"""m, of the tendon on the first bone that pictures show."""


@dataclass(frozen=True)
class TendonRoute:
    """Where a tendon runs: from bone to bone over a pulley or else straight on, on each bone
    through its points."""

    name: str
    radius: tuple[tuple[str, float], ...] = ()
    """m by joint: positive palmar of the axis, where the tendon flexes; zero through the axis."""
    points: tuple[tuple[str, tuple[Vector, ...]], ...] = ()
    """m in the bones' frames, by bone, from proximal to distal."""


def routed_tendon(route: TendonRoute, segments: Sequence[Segment]) -> Tendon:
    """The tendon along a route over bones in a row.  It crosses a joint that has no pulley through
    the axis, or straight where it has points on both bones.

    Raises InputError for a name that the finger lacks, and for a route that crosses no joint."""
    joints = {s.hinges[0].name: i for i, s in enumerate(segments) if s.hinges}
    bodies = [s.name for s in segments]
    radius, points = dict(route.radius), dict(route.points)
    _check(route, "joint", radius, joints)
    _check(route, "bone", points, bodies)
    ends = [joints[j] for j in radius] + [bodies.index(b) for b in points]
    first = 0 if radius else min(ends, default=0)
    path: list[PathElement] = []
    for i in range(first, max(ends, default=0) + 1):
        own = [Via(bodies[i], vector(point)) for point in points.get(bodies[i], ())]
        if i > first:
            guided = bodies[i - 1] in points, bool(own)
            path += _crossing(segments[i - 1], segments[i], radius, guided, starts=not path)
        path += own
    if len(path) < 2 or path[0].body == path[-1].body:
        raise InputError(
            f"tendon {route.name}: crosses no joint; give it a pulley, or points on two bones"
        )
    return Tendon(route.name, (Strand(tuple(path)),))


def _check(route: TendonRoute, what: str, names: Iterable[str], known: Collection[str]) -> None:
    for name in names:
        if name not in known:
            raise InputError(f"tendon {route.name}: the finger has no {what} {name}")


def _crossing(
    before: Segment,
    beyond: Segment,
    radii: Mapping[str, float],
    guided: tuple[bool, bool],
    *,
    starts: bool,
) -> list[PathElement]:
    """From one bone over the joint to the next; `guided`: whether it has points on either;
    `starts`: whether it begins here."""
    hinge = beyond.hinges[0]
    radius = radii.get(hinge.name)
    if radius is None and all(guided):
        return []
    x, y, z = beyond.position
    if not radius:
        start = [Via(before.name, (x - FIRST_BONE, y, z))] if starts else []
        return [*start, Via(beyond.name, (0.0, 0.0, 0.0))]
    low, high = hinge.range if np.isfinite(hinge.range).all() else RANGES[hinge.name]
    side, size = float(np.sign(radius)), abs(radius)
    wound = WOUND + (high if radius > 0 else -low)  # of the straight finger
    begins = (low + high) / 2 * side  # in the mean posture, seen from the bone beyond

    def spoke(angle: float) -> np.ndarray:
        return np.array([np.sin(angle), 0.0, -side * np.cos(angle)])

    along = np.array([np.cos(wound), 0.0, side * np.sin(wound)])
    outside = vector(1.5 * size * spoke((begins + wound) / 2))
    # what is wound on stays on the bone beyond: to the tangent where it leaves, a turn later
    rest = np.arange(wound + TURN, 2 * np.pi, TURN) if radius > 0 else ()
    start = [Via(before.name, (x - FIRST_BONE, y, z - radius))] if starts else []
    return [
        *start,
        Via(before.name, (x - LEAD * size, y, z - radius)),
        WrapCylinder(beyond.name, (0.0, 0.0, 0.0), hinge.axis, size, outside),
        Via(beyond.name, vector(size * (spoke(wound) + 0.1 * along))),
        *(Via(beyond.name, vector(1.1 * size * spoke(at))) for at in rest),
    ]
