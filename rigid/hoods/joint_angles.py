"""The angles of a finger's joints from the poses of its bodies, and their derivatives by twists.

Q = R_p^T R_c Z^T is the turn of the child in its parent since zero.  With its unit quaternion
(w, v), the angle of one hinge about the axis n is that of the swing-twist decomposition,

    theta = 2 atan2(v . n, w),
    d theta = g . d omega,   g = (w^2 n + w v x n + (v . n) v) / (w^2 + (v . n)^2),

omega being the child's turn less the parent's, in the parent's frame.  For a turn about n alone g
is n; a turn about an axis normal to n, before or after, leaves theta as it is.  The quaternion is
taken times 4 w, which is (1 + tr Q, vee(Q - Q^T)): all that follows is the same at any scale.

Two hinges in a row, which no body stands between, turn by Q = R(n1, a) R(n2, b), axes n1 and n2 in
the parent's frame at zero angles, so that

    Q n2 = R(n1, a) n2   and   n1^T Q = n1^T R(n2, b),

and a is the turn about n1 of n2's image and b that about n2 of n1's preimage: exact whether or not
the axes are normal to each other, and smooth functions of any Q near by.

Compiled by numba where it is installed, see `cosim.kernels`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.kernels.kernel import compile_kernel
from cosim.port import Array, Motion
from rigid.model import NO_TURN, FingerModel, Vector, vector


@dataclass(frozen=True)
class Joint:
    """A hinge between two bodies, or two hinges in a row.

    Raises InputError for an axis without a direction, or more than two."""

    names: tuple[str, ...]
    """The names of its angles."""
    parent: str
    child: str
    axes: tuple[Vector, ...] = ((0.0, 1.0, 0.0),)
    """The hinges' axes, in the parent's frame at zero angles; unit after construction."""
    zero: tuple[Vector, Vector, Vector] = NO_TURN
    """The child's rotation in its parent at zero angles."""

    def __post_init__(self) -> None:
        lengths = np.linalg.norm(self.axes, axis=1)
        if not (lengths > 0.0).all() or len(lengths) > 2:
            name = " and ".join(self.names)
            raise InputError(f"joint {name}: expected an axis other than zero, or two of them")
        unit = (vector(np.array(a) / n) for a, n in zip(self.axes, lengths, strict=True))
        object.__setattr__(self, "axes", tuple(unit))


def joints_of(model: FingerModel, most: int = 2) -> tuple[Joint, ...]:
    """Every joint of a finger, in its order, each with at most so many of its hinges."""
    joints = []
    for before, body in zip(model.segments[:-1], model.segments[1:], strict=True):
        if hinges := body.hinges[:most]:
            names = tuple(hinge.name for hinge in hinges)
            axes = tuple(vector(np.array(body.rotation) @ hinge.axis) for hinge in hinges)
            joints.append(Joint(names, before.name, body.name, axes, body.rotation))
    return tuple(joints)


def flexion_joints(model: FingerModel) -> tuple[Joint, ...]:
    """The first hinge of each body of a finger, which is its flexion."""
    return joints_of(model, 1)


def hinges_between(names: Sequence[str], bodies: Sequence[str]) -> tuple[Joint, ...]:
    """A hinge about y from each body to the next, as in a plane."""
    ends = zip(names, bodies[:-1], bodies[1:], strict=True)
    return tuple(Joint((name,), parent, child) for name, parent, child in ends)


@dataclass(frozen=True)
class Angles:
    """The angles of n hinges between nb bodies at one motion."""

    value: Array
    """(n,) rad."""
    rate: Array
    """(n, 6 nb) their derivatives by the bodies' twists (of positions: zero)."""
    moment_rate: Array
    """(n, 6 nb, 6 nb) derivatives of `rate`, read as wrenches in the world, by the twists."""


class JointChain:
    """Joints between bodies by name, as the numbers that `_chain_angles` takes."""

    def __init__(self, joints: Sequence[Joint], bodies: Sequence[str]) -> None:
        place, axes, zero = [], [], []
        for joint in joints:
            ends = [bodies.index(body) for body in (joint.parent, joint.child)]
            for kind in (0,) if len(joint.names) == 1 else (1, 2):
                place.append([*ends, kind])
                axes.append([joint.axes[0], joint.axes[-1]])
                zero.append(joint.zero)
        self._place = np.array(place, dtype=np.int64).reshape(-1, 3)
        self._axes, self._zero = np.array(axes), np.array(zero)

    def angles(self, motion: Motion) -> Angles:
        """All angles at a motion, in the joints' order; that of one hinge is continuous up to half
        a turn to either side."""
        rotation = np.ascontiguousarray(motion.rotation)
        return Angles(*_chain_angles(self._place, self._axes, self._zero, rotation))


Turned = tuple[float, Array, Array]
"""An angle, its derivative (3,) by the child's turn in the parent's frame, and that one's
(3, 3)."""


@compile_kernel
def _skew(a: Array) -> Array:
    """The matrix (3, 3) that times b is a x b."""
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2], out[1, 2] = -a[2], a[1], -a[0]
    out[1, 0], out[2, 0], out[2, 1] = a[2], -a[1], a[0]
    return out


@compile_kernel
def _times(a: Array, b: Array) -> Array:
    """a b of (3, 3)."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@compile_kernel
def _multiply(a: Array, x: Array) -> Array:
    out = np.zeros(3)
    for i in range(3):
        out[i] = a[i, 0] * x[0] + a[i, 1] * x[1] + a[i, 2] * x[2]
    return out


@compile_kernel
def _outer(a: Array, b: Array) -> Array:
    return a.reshape(3, 1) * b.reshape(1, 3)


@compile_kernel
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compile_kernel
def _cross(a: Array, b: Array) -> Array:
    out = np.zeros(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@compile_kernel
def _twist(turn: Array, axis: Array) -> Turned:
    """The angle of a hinge, 2 atan2(v . n, w), and its derivatives."""
    w = 1.0 + turn[0, 0] + turn[1, 1] + turn[2, 2]
    v = np.zeros(3)
    v[0], v[1] = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0]
    v[2] = turn[1, 0] - turn[0, 1]
    along, across = _dot(v, axis), _cross(v, axis)
    whole, size = w * w * axis + w * across + along * v, w * w + along * along
    dw, dv = -0.5 * v, 0.5 * (w * np.eye(3) - _skew(v))
    d_along = _multiply(dv.T, axis)
    d_whole = _outer(2 * w * axis + across, dw) - w * _times(_skew(axis), dv)
    d_whole += _outer(v, d_along) + along * dv
    g = whole / size
    slope = (d_whole - _outer(g, 2 * w * dw + 2 * along * d_along)) / size
    return 2 * atan2(along, w), g, slope


@compile_kernel
def _about(of_x: Array, along: Array, of_y: Array, across: Array) -> Turned:
    """atan2(y, x) of x = of_x . along and y = of_y . across, where of_x and of_y turn with the
    child."""
    x, y = _dot(of_x, along), _dot(of_y, across)
    by_x, by_y, size = _cross(of_x, along), _cross(of_y, across), x * x + y * y
    curve_x, curve_y = _times(_skew(along), _skew(of_x)), _times(_skew(across), _skew(of_y))
    g = (x * by_y - y * by_x) / size
    slope = _outer(by_y, by_x) + x * curve_y - _outer(by_x, by_y) - y * curve_x
    slope -= _outer(g, 2 * x * by_x + 2 * y * by_y)
    return atan2(y, x), g, slope / size


@compile_kernel
def _normal(of: Array, to: Array) -> Array:
    """The unit vector along what `of` has normal to the unit vector `to`."""
    part = of - _dot(of, to) * to
    out: Array = part / np.sqrt(_dot(part, part))
    return out


@compile_kernel
def _chain_angles(
    place: NDArray[np.int64], axes: Array, zero: Array, rotation: Array
) -> tuple[Array, Array, Array]:
    """The n angles between nb bodies: values (n,) rad, derivatives (n, 6 nb) by the twists, and
    derivatives (n, 6 nb, 6 nb) of these, read as wrenches in the world.

    place (n, 3): the parent's and the child's number and 0 for a hinge, 1 and 2 for the first and
    second of two in a row; axes (n, 2, 3): the hinge's, or both hinges', in the parent at zero;
    zero (n, 3, 3): the child's rotation there; rotation (nb, 3, 3)."""
    n, width = len(place), 6 * len(rotation)
    value, rate, curve = np.zeros(n), np.zeros((n, width)), np.zeros((n, width, width))
    for i in range(n):
        turn, first, second = rotation[place[i, 0]], axes[i, 0], axes[i, 1]
        relative = _times(_times(turn.T, rotation[place[i, 1]]), zero[i].T)
        if place[i, 2] == 0:
            angle = _twist(relative, first)
        elif place[i, 2] == 1:
            image, along = _multiply(relative, second), _normal(second, first)
            angle = _about(image, along, image, _cross(first, along))
        else:
            along = _normal(first, second)
            across = _cross(along, second)
            angle = _about(_multiply(relative, along), first, _multiply(relative, across), first)
        value[i] = angle[0]
        axis = _multiply(turn, angle[1])
        by_child = _times(_times(turn, angle[2]), turn.T)
        by_parent = -by_child - _skew(axis)
        p, c = 6 * place[i, 0] + 3, 6 * place[i, 1] + 3
        rate[i, c : c + 3], rate[i, p : p + 3] = axis, -axis
        curve[i, c : c + 3, c : c + 3], curve[i, c : c + 3, p : p + 3] = by_child, by_parent
        curve[i, p : p + 3, c : c + 3], curve[i, p : p + 3, p : p + 3] = -by_child, -by_parent
    return value, rate, curve
