"""What the force at a clamped fingertip says of moment arms, whatever moment the clamp bears.

In the plane of flexion two equations are left where the distal phalanx is held, with flexion
positive, F the change of the tip's force on the world and T that of the tension:

    T (r_MCP - r_PIP) = (x_PIP - x_MCP) x F,    T (r_PIP - r_DIP) = (x_DIP - x_PIP) x F,

about the axis of flexion, which is radial (Qiu et al. 2017, J Biomech 65:82).  Across the plane
T r_abd = F_radial * reach, the reach from the MCP along the proximal phalanx to the tip, is a
convention only: a clamp bears a moment there as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.port import AXES, Array

RADIAL = AXES.index("radial")
STRAIGHT = np.sin(np.radians(1.0))
"""Sine of the PIP angle below which both equations are one."""


def arm_differences(points: Array, force: Array, tension: float) -> dict[str, Any]:
    """Differences of moment arms (mm) that a clamped fingertip's force tells, by the keys of a
    summary, flexion and radial abduction positive.

    points: (4, 3) m, the centres of MCP, PIP and DIP and the tip; force: (3,) N, of the tip on the
    world, loaded less unloaded; tension: N, the loaded tendon's change, or the sum of several,
    whose arms then count by their tensions.  Empty with a straight PIP, where the two differences
    are one number."""
    bones = np.diff(points[:3], axis=0)
    lengths = np.linalg.norm(bones, axis=1)
    if np.linalg.norm(np.cross(*bones)) < STRAIGHT * lengths.prod():
        return {}
    first, second = 1e3 * np.cross(bones, force)[:, RADIAL] / tension
    reach = (points[3] - points[0]) @ bones[0] / lengths[0]
    return {
        "arm_difference_mm": {"MCP_PIP": float(first), "PIP_DIP": float(second)},
        "abduction_arm_mm": float(1e3 * force[RADIAL] * reach / tension),
    }


def chain_points(lengths: Sequence[float] | Array, posture: Sequence[float]) -> Array:
    """The centres of MCP, PIP and DIP and the tip (4, 3), world frame, of a finger of three
    phalanges (unit as given) that flexes by `posture`, deg, in a plane."""
    bend = np.radians(np.cumsum(posture))
    along = np.stack([np.cos(bend), np.zeros(3), -np.sin(bend)], axis=1)
    steps = np.asarray(lengths)[:, None] * along
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def to_world(force: Array, posture: Sequence[float]) -> Array:
    """Turn a force (3,) along the distal phalanx's axes (distal, radial, dorsal) to the world's."""
    bend = np.radians(np.sum(posture))
    c, s = np.cos(bend), np.sin(bend)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ force


def force_over_tension(points: Array, first: float, second: float) -> Array:
    """The distal and dorsal force over tension (2,), world, that differences of arms make: the
    inverse of `arm_differences`, in the unit of both."""
    distal, dorsal = np.diff(points[:3], axis=0)[:, [0, 2]].T
    return np.linalg.solve(np.stack([dorsal, -distal], axis=1), [first, second])
