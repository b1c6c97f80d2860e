"""What holds a finger in a static problem: directions in which its tip cannot move or turn, or all
its joints.

The gap of a held turn is a . g with g = (1/2) sum_i t_i x r_i, over the columns t_i of the rotation
that is held and r_i of the moment's: sin(angle) a for a turn about the unit vector a.  With
Q = sum_i r_i t_i^T its derivative by the angular velocity is (tr(Q) 1 - Q) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array


@dataclass(frozen=True)
class Support:
    """Orthonormal world directions in which the tip's point cannot move, and whether it cannot
    turn about the last joint's axis in the posture that it was put in.  With `holds_joints` every
    joint is held there instead, by as much torque as it takes."""

    directions: Array
    """(m, 3)."""
    clamps_turn: bool = False
    holds_joints: bool = False

    def basis(self, last_axis: Array) -> Array:
        """The unit wrenches (m or m + 1, 6) with which the support can answer: forces, then the
        moment about the last joint's axis (3,)."""
        forces = np.hstack([self.directions, np.zeros_like(self.directions)])
        if not self.clamps_turn:
            return forces
        return np.vstack([forces, np.concatenate([np.zeros(3), last_axis])])


HELD = Support(np.eye(3))
"""The point is held, free to turn about it."""
FREE = Support(np.zeros((0, 3)))
JOINTS_HELD = Support(np.zeros((0, 3)), holds_joints=True)
"""Bones that cannot move, as on a rig; nothing touches the tip."""
CLAMPED = Support(np.eye(3), clamps_turn=True)
"""Held, and clamped against flexion: of as many unknowns as a finger of four joints has torques."""
IN_PLANE = Support(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
"""The support of a planar finger: held in the flexion plane."""
CLAMPED_IN_PLANE = Support(IN_PLANE.directions, clamps_turn=True)


def turn_gap(held: Array, now: Array) -> tuple[Array, Array]:
    """g (3,) and its derivative (3, 3) by the angular velocity of `now`; rotations (3, 3)."""
    gap = 0.5 * np.cross(held.T, now.T).sum(axis=0)
    q = now @ held.T
    return gap, 0.5 * (np.trace(q) * np.eye(3) - q)
