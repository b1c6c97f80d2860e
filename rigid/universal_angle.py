"""The angles of two hinges in a row, which no body stands between, from the poses of the bodies.

With Q = R_p^T R_c Z^T = R(n1, a) R(n2, b), axes n1 and n2 in the parent's frame at zero angles,

    Q n2 = R(n1, a) n2   and   n1^T Q = n1^T R(n2, b),

so that a is the turn about n1 of n2's image and b that about n2 of n1's preimage: exact whether or
not the axes are normal to each other, and smooth functions of any Q near by.  `Angles` of
`hinge_angle` holds them with their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Motion, skew
from rigid.hinge_angle import Angles, HingeAngle, angles
from rigid.model import FingerModel, Segment, Vector, vector


@dataclass(frozen=True)
class Universal:
    """Two hinges from `parent` to `child`; unit axes in the parent's frame at zero angles, `zero`
    the child's rotation in its parent there."""

    names: tuple[str, str]
    parent: str
    child: str
    axes: tuple[Vector, Vector]
    zero: tuple[Vector, Vector, Vector]


Joint = HingeAngle | Universal


def joints_of(model: FingerModel) -> tuple[Joint, ...]:
    """Every joint of a finger, in its order."""
    pairs = zip(model.segments[:-1], model.segments[1:], strict=True)
    return tuple(_joint(before.name, body) for before, body in pairs if body.hinges)


def _joint(parent: str, body: Segment) -> Joint:
    axes = [_unit(np.array(body.rotation) @ hinge.axis) for hinge in body.hinges]
    names = [hinge.name for hinge in body.hinges]
    if len(axes) == 1:
        return HingeAngle(names[0], parent, body.name, vector(axes[0]), body.rotation)
    first, second = axes
    both = (vector(first), vector(second))
    return Universal((names[0], names[1]), parent, body.name, both, body.rotation)


def names_of(joints: Sequence[Joint]) -> tuple[str, ...]:
    """Of their angles."""
    each = ((j.name,) if isinstance(j, HingeAngle) else j.names for j in joints)
    return tuple(name for names in each for name in names)


def all_angles(joints: Sequence[Joint], motion: Motion) -> Angles:
    """The angles of every joint, in order."""
    parts = [angles((j,), motion) if isinstance(j, HingeAngle) else _two(j, motion) for j in joints]
    return Angles(*(np.concatenate([p[k] for p in map(_fields, parts)]) for k in range(3)))


def _fields(a: Angles) -> tuple[Array, Array, Array]:
    return a.value, a.rate, a.moment_rate


def _two(joint: Universal, motion: Motion) -> Angles:
    p, c = (motion.bodies.index(body) for body in (joint.parent, joint.child))
    turn, width = motion.rotation[p], 6 * len(motion.bodies)
    relative = turn.T @ motion.rotation[c] @ np.transpose(joint.zero)
    first, second = np.array(joint.axes)
    value, rate, curve = np.zeros(2), np.zeros((2, width)), np.zeros((2, width, width))
    child, parent = (slice(6 * b + 3, 6 * b + 6) for b in (c, p))
    for i, found in enumerate((_first(relative, first, second), _second(relative, first, second))):
        value[i], local, local_rate = found
        axis, by_child = turn @ local, turn @ local_rate @ turn.T
        by_parent = -by_child - skew(axis)
        for sign, row in ((1.0, child), (-1.0, parent)):
            rate[i, row] = sign * axis
            curve[i, row, child] = sign * by_child
            curve[i, row, parent] = sign * by_parent
    return Angles(value, rate, curve)


def _first(turn: Array, first: Array, second: Array) -> tuple[float, Array, Array]:
    """a, its derivative g (3,) by the child's turn in the parent's frame, and that of g (3, 3)."""
    along = _unit(second - (first @ second) * first)
    image = turn @ second
    crosses = [np.cross(image, e) for e in (along, np.cross(first, along))]
    slopes = [skew(e) @ skew(image) for e in (along, np.cross(first, along))]
    return _turned(float(image @ along), float(image @ np.cross(first, along)), *crosses, *slopes)


def _second(turn: Array, first: Array, second: Array) -> tuple[float, Array, Array]:
    """b, and its derivatives as of `_first`."""
    along = _unit(first - (first @ second) * second)
    images = [turn @ e for e in (along, -np.cross(second, along))]
    crosses = [np.cross(image, first) for image in images]
    slopes = [skew(first) @ skew(image) for image in images]
    return _turned(float(first @ images[0]), float(first @ images[1]), *crosses, *slopes)


def _turned(
    x: float, y: float, by_x: Array, by_y: Array, curve_x: Array, curve_y: Array
) -> tuple[float, Array, Array]:
    """atan2(y, x) and its derivatives, from those of x and y."""
    size = x * x + y * y
    g = (x * by_y - y * by_x) / size
    slope = np.outer(by_y, by_x) + x * curve_y - np.outer(by_x, by_y) - y * curve_x
    slope -= np.outer(g, 2 * x * by_x + 2 * y * by_y)
    return float(np.arctan2(y, x)), g, slope / size


def _unit(v: Array) -> Array:
    out: Array = v / np.linalg.norm(v)
    return out
