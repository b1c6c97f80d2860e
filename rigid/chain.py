"""Kinematics of a serial chain of hinges at one posture, with exact second derivatives.

A point p of a body moves with joint i (unit axis a_i through c_i) by a_i x (p - c_i).  Joint j
before i carries a_i and c_i along, so that with lo = min(i, j), hi = max(i, j)

    d2 p / dq_i dq_j = a_lo x (a_hi x (p - c_hi)),     d a_i / dq_j = a_j x a_i  (j < i, else 0)

(Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def point_jacobian(chain: Chain, body: Indices, point: Array) -> Array:
    """(k, 6, nq) velocities of points (k, 3) of the bodies with indices `body` (k,) and those
    bodies' angular velocities, per joint rate."""
    moved = chain.child <= body[:, None]
    velocity = np.cross(chain.axis, point[:, None] - chain.anchor)
    turn = np.broadcast_to(chain.axis, velocity.shape)
    return (np.concatenate([velocity, turn], axis=2) * moved[:, :, None]).swapaxes(1, 2)


def body_jacobian(chain: Chain) -> Array:
    """(6 nb, nq) twists of the bodies at their origins per joint rate."""
    position = chain.motion.position
    return point_jacobian(chain, np.arange(len(position)), position).reshape(-1, len(chain.axis))


def tip_jacobian(chain: Chain) -> Array:
    """(6, nq) velocity of the fingertip and angular velocity of its body per joint rate."""
    return point_jacobian(chain, np.array([len(chain.motion.bodies) - 1]), chain.tip[None])[0]


def geometric_stiffness(chain: Chain, body: Indices, point: Array, wrench: Array) -> Array:
    """(nq, nq) derivative of sum J^T w over the joint angles: forces and moments `wrench` (k, 6)
    keep their direction in the world and the forces their points (k, 3) on the bodies (k,)."""
    moved = (chain.child <= body[:, None]).astype(float)
    lever = np.cross(chain.axis, point[:, None] - chain.anchor)
    bend = np.cross(chain.axis[:, None], lever[:, None])  # (k, lo, hi, 3)
    turn = np.cross(chain.axis, chain.axis[:, None])  # (i, j, 3): a_j x a_i
    both = moved[:, :, None] * moved[:, None, :]
    force = np.einsum("kijx,kx,kij->ij", bend, wrench[:, :3], both)
    moment = np.einsum("ijx,kx,kij->ij", turn, wrench[:, 3:], both)
    return np.triu(force) + np.triu(force, 1).T + np.tril(moment, -1)


def moved_to(wrench: Array, lever: Array) -> Array:
    """The same wrench (..., 6) about a point from which its own point lies at `lever` (..., 3)."""
    moment = wrench[..., 3:] + np.cross(lever, wrench[..., :3])
    return np.concatenate([wrench[..., :3], moment], axis=-1)


def joint_wrenches(chain: Chain, torque: Array) -> Array:
    """(nb, 6) equal and opposite moments on child and parent that do the work of the joint torques
    (nq,).  Where one body has several joints the moment M lies in the span of their axes with
    a_i . M = tau_i, since oblique axes share the work of a moment."""
    out = np.zeros((len(chain.motion.bodies), 6))
    for body in np.unique(chain.child):
        axes = chain.axis[chain.child == body]
        moment = axes.T @ np.linalg.solve(axes @ axes.T, torque[chain.child == body])
        out[body, 3:] += moment
        out[body - 1, 3:] -= moment
    return out


def joint_reactions(chain: Chain, applied: Array) -> Array:
    """(nb, 6) wrench through each body's proximal joint, about the body's origin, that balances
    the wrenches `applied` (nb, 6) to it and all bodies beyond; zero for the fixed body."""
    reaction = np.zeros_like(applied)
    position = chain.motion.position
    reaction[-1] = -applied[-1]
    for b in range(len(applied) - 2, 0, -1):
        reaction[b] = moved_to(reaction[b + 1], position[b + 1] - position[b]) - applied[b]
    return reaction


def joint_loads(chain: Chain, reaction: Array) -> Array:
    """(nb, 6) what the joints together do to each body: its own reaction less the next one's."""
    position = chain.motion.position
    out = reaction.copy()
    out[:-1] -= moved_to(reaction[1:], np.diff(position, axis=0))
    return out
