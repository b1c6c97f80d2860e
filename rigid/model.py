"""A finger in words that any engine can be built from: bones, hinges, tendon paths, fingertip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, mirror, mirror_axial

Vector = tuple[float, float, float]
Surface = tuple[Array, Array]
"""Vertices (n, 3) m and faces (m, 3) of triangles."""
NO_TURN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Hinge:
    """A joint through the origin of the body that it moves; `axis` in that body's frame."""

    name: str
    axis: Vector
    range: tuple[float, float] = (-np.inf, np.inf)
    """rad."""


@dataclass(frozen=True)
class Segment:
    """A rigid body, placed in the one before it; the first is fixed to the world."""

    name: str
    length: float
    """Length in m, along x, to the next body's origin or the finger's end; for the first, what is
    drawn."""
    position: Vector = (0.0, 0.0, 0.0)
    """The origin in the parent's frame, m."""
    rotation: tuple[Vector, Vector, Vector] = NO_TURN
    """To the parent's frame at zero angles."""
    hinges: tuple[Hinge, ...] = ()
    """In the order in which they turn the body, the first one nearest to the parent."""
    mass: float = 0.0
    inertia: Vector = (0.0, 0.0, 0.0)
    """Moments of inertia in kg m2 about the centre of mass, along the body's axes."""
    centre: Vector = (0.0, 0.0, 0.0)
    radius: float = 0.003
    """Radius of the capsule that stands for the bone in pictures, m."""


@dataclass(frozen=True)
class Via:
    """A point of a body that a tendon passes."""

    body: str
    point: Vector


@dataclass(frozen=True)
class WrapCylinder:
    """An endless round surface of a body that a tendon wraps over where the straight way would cut
    it."""

    body: str
    centre: Vector
    axis: Vector
    radius: float
    side: Vector | None = None
    """A point of the body on the side where the tendon lies; within the surface, the tendon runs
    through it as through a ring.  Without one the tendon goes the shorter way round."""


@dataclass(frozen=True)
class WrapSphere:
    """A round surface of a body that a tendon wraps over, in the plane of its centre and of the
    points before and after, where the straight way would cut it."""

    body: str
    centre: Vector
    radius: float
    side: Vector | None = None
    """As a cylinder's."""


PathElement = Via | WrapCylinder | WrapSphere


@dataclass(frozen=True)
class Strand:
    """One way from a muscle's origin to an insertion, and the share of the tension it carries."""

    path: tuple[PathElement, ...]
    share: float = 1.0


@dataclass(frozen=True)
class Tendon:
    """A muscle's tendon: its strands part and carry fixed shares of its tension."""

    name: str
    strands: tuple[Strand, ...]


@dataclass(frozen=True)
class FingerModel:
    """A serial finger.  SI units; each body's frame has x distal, y radial, z dorsal.

    Raises InputError where the parts do not fit together."""

    name: str
    segments: tuple[Segment, ...]
    tip: Vector
    """The fingertip in the last body's frame, m."""
    tendons: tuple[Tendon, ...] = ()
    meshes: Mapping[str, Surface] = field(default_factory=dict)
    """By body, in its frame, for pictures."""

    def __post_init__(self) -> None:
        for what, names in (
            ("body", self.bodies),
            ("joint", self.joints),
            ("tendon", self.muscles),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InputError(f"finger {self.name}: two of the name {what} {', '.join(twice)}")
        _check_names(self.meshes, self.bodies, f"finger {self.name}: meshes")
        for tendon in self.tendons:
            _check(tendon, self.bodies)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that are shared with the other side."""
        return tuple(s.name for s in self.segments)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the angles."""
        return tuple(hinge.name for s in self.segments for hinge in s.hinges)

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return tuple(t.name for t in self.tendons)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The joints' ranges, rad by joint."""
        return {hinge.name: hinge.range for s in self.segments for hinge in s.hinges}

    def with_only(self, *muscles: str) -> FingerModel:
        """Return the finger with these tendons alone, in the finger's order.  Raises InputError
        where it lacks one."""
        _check_names(muscles, self.muscles, f"finger {self.name}: tendons")
        return replace(self, tendons=tuple(t for t in self.tendons if t.name in muscles))

    def with_tendons_of(self, other: FingerModel) -> FingerModel:
        """Return the finger with those tendons of another too whose names it lacks."""
        more = tuple(t for t in other.tendons if t.name not in self.muscles)
        return replace(self, tendons=(*self.tendons, *more))

    def mirrored(self) -> FingerModel:
        """Return the finger of the other hand: its mirror image, with y ulnar."""
        tendons = tuple(
            Tendon(t.name, tuple(Strand(tuple(map(_mirrored, s.path)), s.share) for s in t.strands))
            for t in self.tendons
        )
        meshes = {b: (mirror(points), faces[:, ::-1]) for b, (points, faces) in self.meshes.items()}
        segments = tuple(map(_mirrored_segment, self.segments))
        return replace(self, segments=segments, tip=_at(self.tip), tendons=tendons, meshes=meshes)


def _at(point: Vector) -> Vector:
    return vector(mirror(np.array(point)))


def _axis(axis: Vector) -> Vector:
    return vector(mirror_axial(np.array(axis)))


def _mirrored(element: PathElement) -> PathElement:
    match element:
        case Via():
            return replace(element, point=_at(element.point))
        case WrapCylinder():
            centre, axis = _at(element.centre), _axis(element.axis)
            return replace(element, centre=centre, axis=axis, side=_beside(element.side))
        case WrapSphere():
            return replace(element, centre=_at(element.centre), side=_beside(element.side))


def _beside(side: Vector | None) -> Vector | None:
    return None if side is None else _at(side)


def _mirrored_segment(segment: Segment) -> Segment:
    x, y, z = np.outer(*2 * [mirror(np.ones(3))]) * np.array(segment.rotation)
    return replace(
        segment,
        position=_at(segment.position),
        rotation=(vector(x), vector(y), vector(z)),
        hinges=tuple(replace(hinge, axis=_axis(hinge.axis)) for hinge in segment.hinges),
        centre=_at(segment.centre),
    )


def _check_names(names: Iterable[str], among: tuple[str, ...], what: str) -> None:
    unknown = [name for name in names if name not in among]
    if unknown:
        raise InputError(f"{what}: unknown name {', '.join(unknown)}; expected some of {among}")


def _check(tendon: Tendon, bodies: tuple[str, ...]) -> None:
    where = f"tendon {tendon.name}"
    if not tendon.strands or not all(s.share > 0 for s in tendon.strands):
        raise InputError(f"{where}: expected strands whose shares are positive")
    for strand in tendon.strands:
        _check_names((element.body for element in strand.path), bodies, where)
        ends = strand.path[:1] + strand.path[-1:]
        if len(strand.path) < 2 or not all(isinstance(end, Via) for end in ends):
            raise InputError(f"{where}: a strand begins and ends at a point, not at a surface")


def vector(values: Iterable[float]) -> Vector:
    """Three numbers as plain floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z
