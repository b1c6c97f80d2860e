"""Muscle paths as MuJoCo's spatial tendons: fixed points, cylinders and spheres.

Whatever would give a tendon another length than OpenSim's and cannot be told at the path's points
(an ellipsoid) takes its muscle out of the import; points that move or come and go are made plain
in `plain_points`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array
from rigid.opensim.components import IDENTITY, Components, Transform, rotate_xyz
from rigid.opensim.functions import Curve, read_function
from rigid.opensim.skeleton import UNASKED, OsimSkeleton
from rigid.opensim.xml import OsimTag

WRAPS = ("WrapCylinder", "WrapSphere")
SIDE_AT = 2.0
"""Radii from the axis to MuJoCo's side site; only its direction matters outside the surface."""
SIDES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class UnusablePathError(Exception):
    """A path that cannot be kept, with the reason."""


class UnaskedPathError(Exception):
    """A path with a point on a body that was not asked for."""


@dataclass(frozen=True)
class Point:
    """A path point in the frame of a body (path), m.  One that comes and goes is there in a range
    of a coordinate; one that moves has a coordinate and a function of it for each axis."""

    name: str
    body: str
    position: Array
    shown: tuple[str, float, float] | None = None
    moves: tuple[tuple[str, Curve], ...] | None = None
    frame: Transform = IDENTITY
    """Of the functions in the body."""

    @property
    def moved_by(self) -> tuple[str, ...]:
        """The coordinates by which it moves."""
        return tuple(name for name, _ in self.moves or () if name)

    def at(self, values: Mapping[str, float]) -> Array:
        """Where it is (3,) m in its body at values of the coordinates."""
        if self.moves is None:
            return self.position
        place = [curve(values.get(name, 0.0)) for name, curve in self.moves]
        return self.frame.at(np.array(place))


@dataclass(frozen=True)
class Wrap:
    """A cylinder (axis z) or sphere fixed in a body; `side` is the direction, in its own frame, of
    the half that the path keeps to, if any."""

    tag: OsimTag
    body: str
    place: Transform
    radius: float
    half_length: float | None
    side: Array | None

    def clear_of(self, start: Array, end: Array) -> bool:
        """Whether the straight segment between two points of its body's frame misses it."""
        back = self.place.inverse()
        ends = np.array([back.at(start), back.at(end)])
        if self.half_length is not None:
            ends = ends[:, :2]  # infinite, as MuJoCo's
        along = ends[1] - ends[0]
        t = np.clip(-ends[0] @ along / max(along @ along, 1e-300), 0.0, 1.0)
        return bool(np.linalg.norm(ends[0] + t * along) > self.radius)


@dataclass(frozen=True)
class Way:
    """A path: its points, and the wrap (if any) of the segment behind each point but the last."""

    points: tuple[Point, ...]
    wraps: tuple[Wrap | None, ...]
    changes: tuple[tuple[OsimTag, str], ...]

    @property
    def is_plain(self) -> bool:
        """Whether all its points are there always and fixed in their bodies."""
        return all(point.shown is None and point.moves is None for point in self.points)


def point_wraps(way: Way, kept: Sequence[int]) -> tuple[Wrap | None, ...]:
    """The wraps between the points of a way that are kept: the first that lies between two."""
    return tuple(
        next((wrap for wrap in way.wraps[a:b] if wrap is not None), None)
        for a, b in itertools.pairwise(kept)
    )


def read_way(path: OsimTag, model: Components, skeleton: OsimSkeleton) -> Way:
    """Read a path.  Raises UnusablePathError where it cannot be kept, UnaskedPathError where it
    leads over a body that was not asked for, InputError if unreadable."""
    tags = path.within("PathPointSet", "objects")
    points = tuple(_point(tag, model, skeleton) for tag in tags)
    if len(points) < 2:
        raise path.fault(f"expected at least two path points, got {len(points)}")
    wraps: list[Wrap | None] = [None] * (len(points) - 1)
    changes: list[tuple[OsimTag, str]] = []
    for tag in path.within("PathWrapSet", "objects"):
        wrap = _wrap(tag, model)
        if wrap is not None:
            _check_there(f"wrap object {wrap.tag.name!r}", wrap.body, skeleton)
            changes += _lay(wrap, tag, points, wraps)
        else:
            changes.append((tag, "its wrap object is not active: no surface here"))
    return Way(points, tuple(wraps), tuple(changes))


def _check_there(what: str, body: str, skeleton: OsimSkeleton) -> None:
    joint = skeleton.left_out.get(body)
    if joint == UNASKED:
        raise UnaskedPathError
    if joint is not None:
        raise UnusablePathError(
            f"{what} is fixed to a body that is left out with the joint {joint!r}"
        )


def _point(tag: OsimTag, model: Components, skeleton: OsimSkeleton) -> Point:
    if tag.kind not in ("PathPoint", "ConditionalPathPoint", "MovingPathPoint"):
        raise UnusablePathError(f"path point {tag.name!r} is a {tag.kind}")
    frame = model.frame(tag, "parent_frame")
    _check_there(f"path point {tag.name!r}", frame.body, skeleton)
    if tag.kind == "MovingPathPoint":
        moves = tuple(_move(tag, axis, skeleton) for axis in "xyz")
        return Point(tag.name, frame.body, np.zeros(3), None, moves, frame.transform)
    position = frame.transform.at(np.array(tag.values("location", (0.0,) * 3)))
    shown = _range(tag, skeleton) if tag.kind == "ConditionalPathPoint" else None
    return Point(tag.name, frame.body, position, shown)


def _coordinate(tag: OsimTag, socket: str, skeleton: OsimSkeleton) -> str:
    """The coordinate on which a point depends.  Raises UnusablePathError for one that is left
    out."""
    said = tag.one(f"socket_{socket}")
    text = (said.text if said else tag.word(socket, "")).strip()
    name = skeleton.named(text)
    if name is None:
        raise UnusablePathError(
            f"path point {tag.name!r} depends on the coordinate {text!r}, which is not there"
        )
    return name


def _range(tag: OsimTag, skeleton: OsimSkeleton) -> tuple[str, float, float] | None:
    """The coordinate and the range of it in which a point is there; None of one that always is."""
    name = _coordinate(tag, "coordinate", skeleton)
    coordinate, (low, high) = skeleton.coordinates[name], tag.values("range", (0.0, 0.0))
    least, most = (coordinate.default,) * 2 if coordinate.locked else coordinate.range
    return None if low <= least and most <= high else (name, low, high)


def _move(tag: OsimTag, axis: str, skeleton: OsimSkeleton) -> tuple[str, Curve]:
    """The coordinate and the function of it by which a point moves along an axis; of a constant no
    coordinate."""
    holder = tag.one(f"{axis}_location")
    if holder is None or len(holder.children) != 1:
        raise UnusablePathError(f"path point {tag.name!r} moves along {axis} by no function")
    curve = read_function(holder.children[0])
    holder.used = True
    if curve.line is not None and not curve.line[0]:
        return "", curve
    return _coordinate(tag, f"{axis}_coordinate", skeleton), curve


def _wrap(use: OsimTag, model: Components) -> Wrap | None:
    """The wrap object that a PathWrap names; None where it is not active."""
    name = use.word("wrap_object", "")
    found = [t for t in model.by_name.get(name, []) if t.kind.startswith("Wrap")]
    if len(found) != 1:
        raise use.fault(
            f"<wrap_object>: {len(found)} wrap objects are named {name!r}, expected one"
        )
    tag = found[0]
    if not tag.flag("active", True):
        return None
    if tag.kind not in WRAPS:
        raise UnusablePathError(
            f"it wraps over {name!r}, a {tag.kind}, which MuJoCo's tendons cannot"
        )
    return _surface(tag, model)


def _surface(tag: OsimTag, model: Components) -> Wrap:
    place = rotate_xyz(
        tag.values("xyz_body_rotation", (0.0,) * 3), tag.values("translation", (0.0,) * 3)
    )
    radius, half = tag.value("radius"), None
    if tag.kind == "WrapCylinder":
        half = tag.value("length", 1.0) / 2
    if radius <= 0 or (half is not None and half <= 0):
        raise tag.fault("radius and length must be positive")
    holder = model.path(tag).rsplit("/", 2)[0]
    if model.by_path[holder].kind not in ("Body", "Ground"):
        raise UnusablePathError(
            f"the wrap object {tag.name!r} hangs on a {model.by_path[holder].kind}"
        )
    return Wrap(tag, holder, place, radius, half, _side(tag, half is not None))


def _side(tag: OsimTag, cylinder: bool) -> Array | None:
    word = tag.word("quadrant", "all").lower()
    if word in ("all", "unassigned", ""):
        return None
    axis = word.lstrip("+-")
    if axis not in SIDES or (cylinder and axis == "z"):
        raise tag.fault(f"<quadrant>: expected all, x, -x, y or -y, got {word[:20]!r}")
    return np.array(SIDES[axis]) * (-1.0 if word.startswith("-") else 1.0)


def _lay(
    wrap: Wrap, use: OsimTag, points: tuple[Point, ...], wraps: list[Wrap | None]
) -> list[tuple[OsimTag, str]]:
    """Put a wrap into the segments of its range; what this changes."""
    count = len(points)
    stated = use.values("range", (-1.0, -1.0))
    low, high = (int(v) for v in stated)
    use.word("method", "hybrid")
    first, last = (max(low, 1), high if high >= 1 else count)
    if last > count or first >= last or stated != [low, high]:
        got = " ".join(f"{v:g}" for v in stated)
        raise use.fault(f"<range>: expected two of the path's {count} points, got {got}")
    chosen = [k for k in range(first - 1, last - 1) if not _never(wrap, points[k], points[k + 1])]
    if any(wraps[k] is not None for k in chosen):
        raise UnusablePathError(
            "two surfaces share a segment, where MuJoCo allows one; give each its own range"
        )
    for k in chosen:
        wraps[k] = wrap
    if len(chosen) > 1:
        names = ", ".join(f"{points[k].name} - {points[k + 1].name}" for k in chosen)
        why = f"OpenSim lets one segment of the path wrap, MuJoCo each of: {names}"
        return [(use, f"{why}; the length differs where two of them meet the surface")]
    return []


def _never(wrap: Wrap, start: Point, end: Point) -> bool:
    fixed = start.body == end.body == wrap.body
    return fixed and wrap.clear_of(start.position, end.position)
