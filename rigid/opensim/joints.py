"""OpenSim's joints as MuJoCo's: slides and hinges one after the other, in the child body's frame.

A joint places its frame M (fixed in the child) in its frame F (fixed in the parent): translations
along axes of F, then rotations about axes that turn with those before.  Each is a function of one
coordinate.  One axis that a coordinate moves by as much as it changes carries it; the others are
joints that MuJoCo's equalities tie to it, by quartics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array, rotation_matrix
from rigid.opensim.components import Components, OsimFrame, Transform
from rigid.opensim.functions import Curve, read_function, straight
from rigid.opensim.xml import OsimTag

SLIDES = ("translation1", "translation2", "translation3")
TURNS = ("rotation1", "rotation2", "rotation3")
X, Y, Z = np.eye(3)
ITSELF = straight(1.0, 0.0)


@dataclass(frozen=True)
class Coordinate:
    """A generalised coordinate, rad or m."""

    name: str
    tag: OsimTag
    default: float
    range: tuple[float, float]
    clamped: bool
    locked: bool


@dataclass(frozen=True)
class TransformAxis:
    """Motion along or about a unit vector by a function of a coordinate (m or rad), or by as much
    as that is at zero where it has none."""

    slide: bool
    direction: Array
    coordinate: str | None
    curve: Curve = ITSELF
    name: str = ""

    @property
    def carries(self) -> bool:
        """Whether it moves by as much as its coordinate, one way or the other."""
        return self.curve.line is not None and abs(self.curve.line[0]) == 1.0

    def transform(self, amount: float) -> Transform:
        """Return the motion by `amount` (m or rad) along or about the axis."""
        if self.slide:
            return Transform(np.eye(3), self.direction * amount)
        return Transform(rotation_matrix(self.direction * amount), np.zeros(3))


@dataclass(frozen=True)
class Screw:
    """MuJoCo's joint: a slide or a hinge along `direction` through `point` of the child's frame;
    with a `curve` it moves by that function of the coordinate, else it is the coordinate."""

    name: str
    coordinate: str
    slide: bool
    direction: Array
    point: Array
    curve: Curve | None = None


@dataclass(frozen=True)
class Joint:
    """A joint between two bodies (paths); `place` is the child in the parent where all its
    coordinates are zero, `screws` move it from there, the first one outermost."""

    tag: OsimTag
    parent: str
    child: str
    coordinates: tuple[Coordinate, ...]
    place: Transform
    screws: tuple[Screw, ...]

    def renamed(self, new: Mapping[str, str]) -> Joint:
        """The joint with other names of coordinates, by their old ones."""
        coordinates = tuple(replace(c, name=new.get(c.name, c.name)) for c in self.coordinates)
        screws = tuple(
            replace(s, name=new.get(s.name, s.name), coordinate=new.get(s.coordinate, s.coordinate))
            for s in self.screws
        )
        return replace(self, coordinates=coordinates, screws=screws)

    @property
    def unborne(self) -> tuple[str, ...]:
        """The coordinates that no joint of MuJoCo is, though some follow them."""
        borne = {screw.coordinate for screw in self.screws if screw.curve is None}
        return tuple(dict.fromkeys(s.coordinate for s in self.screws if s.coordinate not in borne))


def _simple(*axes: tuple[bool, Array]) -> list[tuple[bool, Array]]:
    return list(axes)


FIXED_AXES = {
    "WeldJoint": _simple(),
    "PinJoint": _simple((False, Z)),
    "SliderJoint": _simple((True, X)),
    "UniversalJoint": _simple((False, X), (False, Y)),
    "BallJoint": _simple((False, X), (False, Y), (False, Z)),
    "GimbalJoint": _simple((False, X), (False, Y), (False, Z)),
    "PlanarJoint": _simple((False, Z), (True, X), (True, Y)),
    "FreeJoint": _simple((False, X), (False, Y), (False, Z), (True, X), (True, Y), (True, Z)),
}
"""Slide or hinge and axis of each coordinate, in OpenSim's order of coordinates."""
KINDS = (*FIXED_AXES, "CustomJoint")


def read_joint(tag: OsimTag, model: Components) -> Joint:
    """Read a joint.  Raises InputError for a joint that MuJoCo's slides and hinges cannot make."""
    parent, child = model.frame(tag, "parent_frame"), model.frame(tag, "child_frame")
    coordinates = tuple(_coordinate(c) for c in tag.within("coordinates"))
    axes = _axes(tag, [c.name for c in coordinates])
    locked = {c.name: c.default for c in coordinates if c.locked}
    place, screws = chain_axes(parent, axes, child, locked, tag.name)
    return Joint(tag, parent.body, child.body, coordinates, place, screws)


def _coordinate(tag: OsimTag) -> Coordinate:
    low, high = tag.values("range", (-10.0, 10.0))
    if low > high:
        raise tag.fault(
            f"<range>: the first number ({low:g}) must not exceed the second ({high:g})"
        )
    default = tag.value("default_value", 0.0)
    clamped, locked = tag.flag("clamped", False), tag.flag("locked", False)
    return Coordinate(tag.name, tag, default, (low, high), clamped, locked)


def chain_axes(
    parent: OsimFrame,
    axes: list[TransformAxis],
    child: OsimFrame,
    locked: Mapping[str, float],
    joint: str = "",
) -> tuple[Transform, tuple[Screw, ...]]:
    """The chain F, axes, M as one fixed transform followed by motions in the child's frame: each
    motion J with all that is fixed behind it, S, is S (S^-1 J S)."""
    carriers = {axis.coordinate: axis for axis in reversed(axes) if axis.carries}
    behind, screws = child.transform.inverse(), list[Screw]()
    for axis in reversed(axes):
        of = axis.coordinate
        if of is None or of in locked:
            behind = axis.transform(axis.curve(locked.get(of or "", 0.0))) @ behind
            continue
        name, slope = f"{joint}_{axis.name}", 1.0
        curve: Curve | None = axis.curve
        if carriers.get(of) is axis and axis.curve.line is not None:
            slope, at_zero = axis.curve.line
            name, curve, behind = of, None, axis.transform(at_zero) @ behind
        direction = slope * behind.rotation.T @ axis.direction
        point = behind.inverse().position
        screws.insert(0, Screw(name, of, axis.slide, direction, point, curve))
    return parent.transform @ behind, tuple(screws)


def _axes(tag: OsimTag, names: list[str]) -> list[TransformAxis]:
    """From the parent's side: the translations, then the rotations."""
    if tag.kind == "CustomJoint":
        return _custom_axes(tag, names)
    fixed = FIXED_AXES[tag.kind]
    if len(names) != len(fixed):
        raise tag.fault(f"expected {len(fixed)} coordinates, got {len(names)}")
    axes = [
        TransformAxis(slide, way, name) for (slide, way), name in zip(fixed, names, strict=True)
    ]
    return sorted(axes, key=lambda axis: not axis.slide)


def _custom_axes(tag: OsimTag, names: list[str]) -> list[TransformAxis]:
    transform = tag.one("SpatialTransform")
    if transform is None:
        raise tag.fault("<SpatialTransform> is missing; expected the axes of the joint")
    given = {axis.name: axis for axis in transform.all("TransformAxis")}
    unknown = [axis for name, axis in given.items() if name not in (*SLIDES, *TURNS)]
    if unknown:
        raise unknown[0].fault(f"expected a name among {', '.join((*TURNS, *SLIDES))}")
    axes = [_axis(given[name], name in SLIDES) for name in (*SLIDES, *TURNS) if name in given]
    used = {axis.coordinate for axis in axes if axis.coordinate}
    if idle := [name for name in names if name not in used]:
        raise transform.fault(f"the coordinate {idle[0]!r} moves 0 axes; expected one or more")
    if unknown_names := sorted(used - set(names)):
        raise transform.fault(f"no coordinate of this joint is named {unknown_names[0]!r}")
    return axes


def _axis(tag: OsimTag, slide: bool) -> TransformAxis:
    names = tag.word("coordinates", "").split()
    if len(names) > 1:
        raise tag.fault("a function of several coordinates cannot be imported")
    vector = np.array(tag.values("axis", (0.0, 0.0, 0.0)))
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise tag.fault("<axis> is missing or has no length")
    functions = [c for c in tag.children if c.kind not in ("coordinates", "axis")]
    if functions:
        curve = read_function(functions[0])
    elif names:
        raise tag.fault("the coordinate's function is missing; expected <LinearFunction>")
    else:
        curve = straight(0.0, 0.0)
    if not names and (curve.line is None or curve.line[0]):
        raise functions[0].fault("a function that is not constant, but of no coordinate")
    of = names[0] if names and (curve.line is None or curve.line[0]) else None
    return TransformAxis(slide, vector / length, of, curve, tag.name)
