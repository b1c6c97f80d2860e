"""Kinematics of a serial chain of hinges at one posture, with exact second derivatives.

A point p of a body moves with joint i (unit axis a_i through c_i) by a_i x (p - c_i).  Joint j
before i carries a_i and c_i along, so that with lo = min(i, j), hi = max(i, j)

    d2 p / dq_i dq_j = a_lo x (a_hi x (p - c_hi)),     d a_i / dq_j = a_j x a_i  (j < i, else 0)

(Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.kernels.kernel import compile_kernel
from cosim.port import Array, Motion

Indices = NDArray[np.integer]


@dataclass(frozen=True)
class Chain:
    """Poses, joints and fingertip of a serial chain in the world frame, m."""

    motion: Motion
    """Bodies in order from the fixed one to the last."""
    child: Indices
    """(nq,) index of the body that each joint moves first, not decreasing."""
    anchor: Array
    """(nq, 3) a point on each joint's axis."""
    axis: Array
    """(nq, 3) unit axes."""
    tip: Array
    """(3,) a point of the last body."""

    @cached_property
    def jacobian(self) -> Array:
        """The twists (nb + 1, 6, nq) of the bodies at their origins and of the last one at the tip,
        per joint rate."""
        position = self.motion.position
        body = np.append(np.arange(len(position)), len(position) - 1)
        return point_jacobian(self, body, np.vstack([position, self.tip]))


def point_jacobian(chain: Chain, body: Indices, point: Array) -> Array:
    """The velocities (k, 6, nq) of points (k, 3) of the bodies with indices `body` (k,) and those
    bodies' angular velocities, per joint rate."""
    return _point_jacobian(chain.axis, chain.anchor, chain.child, body, point)


# The kernels below take vectors apart: numba compiles sums and slices of arrays ten times longer.
Vector = tuple[float, float, float]


@compile_kernel
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compile_kernel
def _arm(point: Array, k: int, anchor: Array, j: int) -> Vector:
    """From anchor j to point k."""
    a, b, c = point[k, 0] - anchor[j, 0], point[k, 1] - anchor[j, 1], point[k, 2] - anchor[j, 2]
    return a, b, c


@compile_kernel
def _row(of: Array, i: int, first: int) -> Vector:
    return of[i, first], of[i, first + 1], of[i, first + 2]


@compile_kernel
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compile_kernel
def _point_jacobian(
    axis: Array, anchor: Array, child: Indices, body: Indices, point: Array
) -> Array:
    out = np.zeros((len(body), 6, len(axis)))
    for k in range(len(body)):
        for j in range(len(axis)):
            if child[j] <= body[k]:
                turned = _cross(_row(axis, j, 0), _arm(point, k, anchor, j))
                out[k, 0, j], out[k, 1, j], out[k, 2, j] = turned
                out[k, 3, j], out[k, 4, j], out[k, 5, j] = _row(axis, j, 0)
    return out


def body_jacobian(chain: Chain) -> Array:
    """The twists (6 nb, nq) of the bodies at their origins per joint rate."""
    return chain.jacobian[:-1].reshape(-1, len(chain.axis))


def tip_jacobian(chain: Chain) -> Array:
    """Return (6, nq) velocity of the fingertip and angular velocity of its body per joint rate.

    >>> from rigid.chain.hinge import HingeFinger
    >>> from rigid.chain.kinematics import tip_jacobian
    >>> finger = HingeFinger((0.04, 0.025, 0.02))
    >>> jacobian = tip_jacobian(finger.chain(finger.start({}).angles))
    >>> jacobian[2]  # m: flexion moves a straight finger's tip palmar
    array([-0.085, -0.045, -0.02 ])
    """
    return chain.jacobian[-1]


def geometric_stiffness(chain: Chain, body: Indices, point: Array, wrench: Array) -> Array:
    """The derivative (nq, nq) of sum J^T w over the joint angles: forces and moments `wrench` (k,
    6) keep their direction in the world and the forces their points (k, 3) on the bodies (k,)."""
    return _geometric_stiffness(chain.axis, chain.anchor, chain.child, body, point, wrench)


@compile_kernel
def _geometric_stiffness(
    axis: Array, anchor: Array, child: Indices, body: Indices, point: Array, wrench: Array
) -> Array:
    """By f . (a_lo x (a_hi x p)) = (f x a_lo) . (a_hi x p), and so for the moments."""
    nq = len(axis)
    out = np.zeros((nq, nq))
    for k in range(len(body)):
        for i in range(nq):
            if child[i] > body[k]:
                continue
            bend = _cross(_row(wrench, k, 0), _row(axis, i, 0))
            turn = _cross(_row(wrench, k, 3), _row(axis, i, 0))
            for j in range(i, nq):
                if child[j] > body[k]:
                    continue
                value = _dot(bend, _cross(_row(axis, j, 0), _arm(point, k, anchor, j)))
                out[i, j] += value
                if j > i:
                    out[j, i] += value + _dot(turn, _row(axis, j, 0))
    return out


def move_wrench(wrench: Array, lever: Array) -> Array:
    """The same wrench (..., 6) about a point from which its own point lies at `lever` (..., 3)."""
    moment = wrench[..., 3:] + np.cross(lever, wrench[..., :3])
    return np.concatenate([wrench[..., :3], moment], axis=-1)


def joint_wrenches(chain: Chain, torque: Array) -> Array:
    """The equal and opposite moments (nb, 6) on child and parent that do the work of the joint
    torques (nq,).  Where one body has several joints the moment M lies in the span of their axes
    with a_i . M = tau_i, since oblique axes share the work of a moment."""
    out = np.zeros((len(chain.motion.bodies), 6))
    for body in np.unique(chain.child):
        axes = chain.axis[chain.child == body]
        moment = axes.T @ np.linalg.solve(axes @ axes.T, torque[chain.child == body])
        out[body, 3:] += moment
        out[body - 1, 3:] -= moment
    return out


def joint_reactions(chain: Chain, applied: Array) -> Array:
    """The wrench (nb, 6) through each body's proximal joint, about the body's origin, that balances
    the wrenches `applied` (nb, 6) to it and all bodies beyond; zero for the fixed body."""
    reaction = np.zeros_like(applied)
    position = chain.motion.position
    reaction[-1] = -applied[-1]
    for b in range(len(applied) - 2, 0, -1):
        reaction[b] = move_wrench(reaction[b + 1], position[b + 1] - position[b]) - applied[b]
    return reaction


def joint_loads(chain: Chain, reaction: Array) -> Array:
    """What the joints together do to each body, (nb, 6): its own reaction less the next one's."""
    position = chain.motion.position
    out = reaction.copy()
    out[:-1] -= move_wrench(reaction[1:], np.diff(position, axis=0))
    return out


def ground_reaction(wrench: Array) -> Array:
    """The wrench (nb, 6) of the ground, which holds the fixed body against all that acts on it,
    given what acts on each body (nb, 6)."""
    out = np.zeros_like(wrench)
    out[0] = -wrench[0]
    return out
