"""What a reduced hood takes for one state: the angles of a chain's joints from the poses of its
bodies, and products of functions with their derivatives.

Compiled by numba where it is installed, see `cosim.kernels`.  `rigid.hoods.hinge_angle` and
`rigid.hoods.universal_angle` say what the angles are; a hinge's is computed here from 4 w times the
quaternion of its turn Q, (1 + tr Q, vee(Q - Q^T)): all that follows is the same at any scale.
"""

from __future__ import annotations

from math import atan2

import numpy as np
from numpy.typing import NDArray

from cosim.kernels.kernel import compile_kernel
from cosim.port import Array

Turned = tuple[float, Array, Array]
"""An angle, its derivative (3,) by the child's turn in the parent's frame, and that one's
(3, 3)."""


@compile_kernel
def _skew(a: Array) -> Array:
    """(3, 3), which times b is a x b."""
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
def chain_angles(
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
            found = _twist(relative, first)
        elif place[i, 2] == 1:
            image, along = _multiply(relative, second), _normal(second, first)
            found = _about(image, along, image, _cross(first, along))
        else:
            along = _normal(first, second)
            across = _cross(along, second)
            found = _about(_multiply(relative, along), first, _multiply(relative, across), first)
        value[i] = found[0]
        axis = _multiply(turn, found[1])
        by_child = _times(_times(turn, found[2]), turn.T)
        by_parent = -by_child - _skew(axis)
        p, c = 6 * place[i, 0] + 3, 6 * place[i, 1] + 3
        rate[i, c : c + 3], rate[i, p : p + 3] = axis, -axis
        curve[i, c : c + 3, c : c + 3], curve[i, c : c + 3, p : p + 3] = by_child, by_parent
        curve[i, p : p + 3, c : c + 3], curve[i, p : p + 3, p : p + 3] = -by_child, -by_parent
    return value, rate, curve


@compile_kernel
def derivatives(index: NDArray[np.int64], table: Array) -> Array:
    """(1 + n, 1 + n, A) of A products of one function of each of n variables: [0, 0] their values,
    [1 + i, 0] their derivatives by variable i, [1 + i, 1 + k] by i and k.

    index (A, n): which function of each variable; table (3, n, K): all functions' values and first
    and second derivatives."""
    count, n = index.shape
    out = np.ones((1 + n, 1 + n, count))
    for i in range(1 + n):
        for k in range(1 + i):
            for j in range(n):
                order = int(i == j + 1) + int(k == j + 1)
                out[i, k] *= table[order, j][index[:, j]]
            out[k, i] = out[i, k]
    return out
