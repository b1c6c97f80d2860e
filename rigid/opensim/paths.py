"""Muscle paths: their points and the surfaces over which they wrap, as OpenSim's file has them and
as MuJoCo's spatial tendons can have them.

What stands between the two, and by how much a length changes, is found in `tendons`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array
from rigid.opensim.components import IDENTITY, Components, Transform, rotate_xyz
from rigid.opensim.functions import Curve, read_function, straight
from rigid.opensim.joints import Screw
from rigid.opensim.skeleton import UNASKED, OsimSkeleton
from rigid.opensim.wrapping import Arc, over_cylinder, over_ellipsoid, over_sphere, over_torus
from rigid.opensim.xml import OsimTag

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
    """The frame of the functions in the body."""

    @property
    def moved_by(self) -> tuple[str, ...]:
        """The coordinates by which it moves."""
        return tuple(name for name, _ in self.moves or () if name)

    @property
    def rest(self) -> Transform:
        """The frame in its body along whose axes it moves, at what is constant of its place."""
        if self.moves is None:
            return Transform(np.eye(3), self.position)
        constant = [0.0 if name else curve(0.0) for name, curve in self.moves]
        return self.frame @ Transform(np.eye(3), np.array(constant))

    def slides(self, name: str) -> list[Screw]:
        """The slides of `name` that move it from its place at rest."""
        return [
            Screw(f"{name}-{axis}", of, True, np.eye(3)[k], np.zeros(3), curve)
            for k, (axis, (of, curve)) in enumerate(zip("xyz", self.moves or (), strict=False))
            if of
        ]

    def at(self, values: Mapping[str, float]) -> Array:
        """Where it is (3,) m in its body at values of the coordinates."""
        if self.moves is None:
            return self.position
        place = [curve(values.get(name, 0.0)) for name, curve in self.moves]
        return self.frame.at(np.array(place))


@dataclass(frozen=True)
class Surface:
    """A wrap object fixed in a body; its size (m) is the radius and half the length of a cylinder
    (axis z), the radius of a sphere, the radii of an ellipsoid, or the radii of a torus's circle
    and tube (axis z).  `side` is the direction, in its own frame, of the half that the path keeps
    to, if any."""

    tag: OsimTag
    body: str
    place: Transform
    size: tuple[float, ...]
    side: Array | None

    def over(self, a: Array, b: Array) -> Arc | None:
        """The way from a to b (3,) m of its own frame round it, if it bends it."""
        match self.tag.kind:
            case "WrapCylinder":
                radius, half_length = self.size
                return over_cylinder(a, b, radius, half_length, self.side)
            case "WrapTorus":
                return over_torus(a, b, *self.size)
            case "WrapSphere":
                return over_sphere(a, b, self.size[0], self.side)
            case _:
                return over_ellipsoid(a, b, np.array(self.size), self.side)

    def clear_of(self, start: Array, end: Array) -> bool:
        """Whether the straight segment between two points of its body's frame misses it."""
        back = self.place.inverse()
        a, b = back.at(start), back.at(end)
        return replace(self, side=None).over(a, b) is None


@dataclass(frozen=True)
class Use:
    """A surface that may bend one of the segments of a path from `first` up to but without
    `last`."""

    surface: Surface
    first: int
    last: int


@dataclass(frozen=True)
class Way:
    """A path as OpenSim's: its points, and the surfaces over which it wraps."""

    points: tuple[Point, ...]
    uses: tuple[Use, ...] = ()
    changes: tuple[tuple[OsimTag, str], ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether all its points are there always and fixed in their bodies, with no surface."""
        return not self.uses and all(p.shown is None and p.moves is None for p in self.points)


@dataclass(frozen=True)
class Wrap:
    """A geom of MuJoCo in a body over which a tendon wraps: a cylinder (axis z) or a sphere, m;
    `side` is as a surface's, or (0, 0, 0) where the tendon goes through it."""

    name: str
    body: str
    place: Transform
    radius: float
    half_length: float | None
    side: Array | None


@dataclass(frozen=True)
class Tendon:
    """A path as MuJoCo's: points that are always there, and the wrap (if any) of the segment behind
    each point but the last."""

    points: tuple[Point, ...]
    wraps: tuple[Wrap | None, ...]

    def slides(self, name: str) -> list[Screw]:
        """The slides of its points that move, for a tendon of a name."""
        return [s for k, point in enumerate(self.points) for s in point.slides(f"{name}-{k}")]

    @classmethod
    def straight(cls, way: Way) -> Tendon:
        """The tendon of a way with no surface."""
        return cls(way.points, (None,) * (len(way.points) - 1))


def read_way(path: OsimTag, model: Components, skeleton: OsimSkeleton) -> Way:
    """Read a path.  Raises UnusablePathError where it cannot be kept, UnaskedPathError where it
    leads over a body that was not asked for, InputError if unreadable."""
    tags = path.within("PathPointSet", "objects")
    points = tuple(_point(tag, model, skeleton) for tag in tags)
    if len(points) < 2:
        raise path.fault(f"expected at least two path points, got {len(points)}")
    uses: list[Use] = []
    changes: list[tuple[OsimTag, str]] = []
    for tag in path.within("PathWrapSet", "objects"):
        surface = _surface_of(tag, model)
        if surface is None:
            changes.append((tag, "its wrap object is not active: no surface here"))
            continue
        _check_there(f"wrap object {surface.tag.name!r}", surface.body, skeleton)
        uses.append(Use(surface, *_range_of(tag, len(points))))
    return Way(points, tuple(uses), tuple(changes))


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
        if not any(name for name, _ in moves):
            fixed = frame.transform.at(np.array([curve(0.0) for _, curve in moves]))
            return Point(tag.name, frame.body, fixed)
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
    """The coordinate and the function of it by which a point moves along an axis; of a constant or
    a locked coordinate none."""
    holder = tag.one(f"{axis}_location")
    if holder is None or len(holder.children) != 1:
        raise UnusablePathError(f"path point {tag.name!r} moves along {axis} by no function")
    curve = read_function(holder.children[0])
    holder.used = True
    if curve.line is not None and not curve.line[0]:
        return "", curve
    of = skeleton.coordinates[_coordinate(tag, f"{axis}_coordinate", skeleton)]
    return ("", straight(0.0, curve(of.default))) if of.locked else (of.name, curve)


def _surface_of(use: OsimTag, model: Components) -> Surface | None:
    """The surface of the wrap object that a PathWrap names; None where it is not active."""
    name = use.word("wrap_object", "")
    found = [t for t in model.by_name.get(name, []) if t.kind.startswith("Wrap")]
    if len(found) != 1:
        raise use.fault(
            f"<wrap_object>: {len(found)} wrap objects are named {name!r}, expected one"
        )
    tag = found[0]
    use.word("method", "hybrid")
    if not tag.flag("active", True):
        return None
    if tag.kind not in SIZES:
        raise UnusablePathError(f"it wraps over {name!r}, a {tag.kind}")
    place = rotate_xyz(
        tag.values("xyz_body_rotation", (0.0,) * 3), tag.values("translation", (0.0,) * 3)
    )
    holder = model.path(tag).rsplit("/", 2)[0]
    if model.by_path[holder].kind not in ("Body", "Ground"):
        raise UnusablePathError(
            f"the wrap object {tag.name!r} hangs on a {model.by_path[holder].kind}"
        )
    return Surface(tag, holder, place, SIZES[tag.kind](tag), _side(tag))


def _size_of_cylinder(tag: OsimTag) -> tuple[float, ...]:
    return _positive(tag, "radius and length", tag.value("radius"), tag.value("length", 1.0) / 2)


def _size_of_torus(tag: OsimTag) -> tuple[float, ...]:
    tube, circle = tag.value("inner_radius"), tag.value("outer_radius")
    if tube >= circle:
        raise tag.fault("<inner_radius> must be less than <outer_radius>")
    return _positive(tag, "both radii", circle, tube)


def _positive(tag: OsimTag, what: str, *sizes: float) -> tuple[float, ...]:
    if min(sizes) <= 0:
        raise tag.fault(f"{what} must be positive")
    return sizes


SIZES: Mapping[str, Callable[[OsimTag], tuple[float, ...]]] = {
    "WrapCylinder": _size_of_cylinder,
    "WrapSphere": lambda tag: _positive(tag, "the radius", tag.value("radius")),
    "WrapEllipsoid": lambda tag: _positive(
        tag, "the dimensions", *tag.values("dimensions", (-1.0,) * 3)
    ),
    "WrapTorus": _size_of_torus,
}
"""How the size of a wrap object is read, by its kind."""


def _side(tag: OsimTag) -> Array | None:
    word = tag.word("quadrant", "all").lower()
    if word in ("all", "unassigned", ""):
        return None
    axis = word.lstrip("+-")
    if axis not in SIDES or (tag.kind == "WrapCylinder" and axis == "z"):
        raise tag.fault(f"<quadrant>: expected all, x, -x, y or -y, got {word[:20]!r}")
    return np.array(SIDES[axis]) * (-1.0 if word.startswith("-") else 1.0)


def _range_of(use: OsimTag, count: int) -> tuple[int, int]:
    """The segments that a surface may bend, from the first up to but without the last."""
    stated = use.values("range", (-1.0, -1.0))
    low, high = (int(v) for v in stated)
    first, last = (max(low, 1), high if high >= 1 else count)
    if last > count or first >= last or stated != [low, high]:
        got = " ".join(f"{v:g}" for v in stated)
        raise use.fault(f"<range>: expected two of the path's {count} points, got {got}")
    return first - 1, last - 1
