"""OpenSim's joints as MuJoCo's: slides and hinges one after the other, in the child body's frame.

A joint places its frame M (fixed in the child) in its frame F (fixed in the parent): translations
along axes of F, then rotations about axes that turn with those before.  Each is a function of a
coordinate; what is read are straight lines of slope 1 or -1 and constants, one coordinate each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, rotation_matrix
from rigid.opensim.components import Components, OsimFrame, Transform
from rigid.opensim.xml import OsimTag

SLIDES = ("translation1", "translation2", "translation3")
TURNS = ("rotation1", "rotation2", "rotation3")
X, Y, Z = np.eye(3)
STRAIGHT = 1e-12
"""How far the knots of a spline may lie from a line, of their range, to be read as one."""


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
    """Motion along or about a unit vector by slope * coordinate + intercept (m or rad)."""

    slide: bool
    direction: Array
    coordinate: str | None
    slope: float = 1.0
    intercept: float = 0.0

    def transform(self, amount: float) -> Transform:
        """Return the motion by `amount` (m or rad) along or about the axis."""
        if self.slide:
            return Transform(np.eye(3), self.direction * amount)
        return Transform(rotation_matrix(self.direction * amount), np.zeros(3))


@dataclass(frozen=True)
class Screw:
    """MuJoCo's joint: a slide or a hinge along `direction` through `point` of the child's frame."""

    coordinate: str
    slide: bool
    direction: Array
    point: Array


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
    place, screws = chain_axes(parent, axes, child, locked)
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
    parent: OsimFrame, axes: list[TransformAxis], child: OsimFrame, locked: Mapping[str, float]
) -> tuple[Transform, tuple[Screw, ...]]:
    """The chain F, axes, M as one fixed transform followed by motions in the child's frame: each
    motion J with all that is fixed behind it, S, is S (S^-1 J S)."""
    behind, screws = child.transform.inverse(), list[Screw]()
    for axis in reversed(axes):
        held = axis.coordinate is None or axis.coordinate in locked
        at = locked.get(axis.coordinate, 0.0) if axis.coordinate else 0.0
        behind = axis.transform(axis.slope * at + axis.intercept) @ behind
        if held or axis.coordinate is None:
            continue
        direction = axis.slope * behind.rotation.T @ axis.direction
        point = behind.inverse().position
        screws.insert(0, Screw(axis.coordinate, axis.slide, direction, point))
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
    used = [axis.coordinate for axis in axes if axis.coordinate]
    for name in names:
        if used.count(name) != 1:
            raise transform.fault(
                f"the coordinate {name!r} moves {used.count(name)} axes; only coordinates that "
                "move one axis each can be imported"
            )
    if unknown_names := sorted(set(used) - set(names)):
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
    slope, intercept = _line(tag, bool(names))
    if not names:
        return TransformAxis(slide, vector / length, None, 0.0, intercept)
    if abs(slope) != 1.0:
        raise tag.fault(
            f"the axis moves by {slope:g} times the coordinate; only 1 and -1 can be imported"
        )
    return TransformAxis(slide, vector / length, names[0], slope, intercept)


def _line(tag: OsimTag, moving: bool) -> tuple[float, float]:
    """Slope and intercept of an axis's function; constant zero where it has none."""
    functions = [c for c in tag.children if c.kind not in ("coordinates", "axis")]
    if not functions:
        if moving:
            raise tag.fault("the coordinate's function is missing; expected <LinearFunction>")
        return 0.0, 0.0
    slope, intercept = line(_inner(functions[0]))
    if slope and not moving:
        raise functions[0].fault("a function that is not constant, but of no coordinate")
    return slope, intercept


def _inner(tag: OsimTag) -> OsimTag:
    """The function itself where it is wrapped in <function>."""
    tag.used = True
    if tag.kind == "function" and len(tag.children) == 1:
        return _inner(tag.children[0])
    return tag


def line(tag: OsimTag) -> tuple[float, float]:
    """A function's slope and intercept.  Raises InputError for one that is no straight line."""
    tag.used = True
    if tag.kind == "Constant":
        return 0.0, tag.value("value", 0.0)
    if tag.kind == "LinearFunction":
        slope, intercept = tag.values("coefficients", (1.0, 0.0))
        return slope, intercept
    if tag.kind == "MultiplierFunction":
        inner, scale = tag.one("function"), tag.value("scale", 1.0)
        if inner is None or len(inner.children) != 1:
            raise tag.fault("expected one function within <function>")
        slope, intercept = line(inner.children[0])
        return scale * slope, scale * intercept
    if tag.kind in ("SimmSpline", "PiecewiseLinearFunction", "NaturalCubicSpline"):
        return _through_knots(tag)
    raise tag.fault(f"a {tag.kind} cannot be imported; expected a straight line or a constant")


def _through_knots(tag: OsimTag) -> tuple[float, float]:
    knots = [tag.one("x"), tag.one("y")]
    x, y = [np.array(k.numbers()) if k else np.zeros(0) for k in knots]
    if len(x) != len(y) or len(x) < 2 or not (np.diff(x) > 0).all():
        raise tag.fault("expected at least two knots, as many in <y> as in <x>, <x> increasing")
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    off = np.abs(y - y[0] - slope * (x - x[0])).max()
    if off > STRAIGHT * max(np.ptp(y), np.ptp(x)):
        raise tag.fault("its knots lie on no straight line; MuJoCo has no joint for it")
    return float(slope), float(y[0] - slope * x[0])
