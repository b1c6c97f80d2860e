"""A joint's angle from the poses of its two bodies, and its derivatives by their twists.

With Q = R_p^T R_c Z^T, the turn of the child in its parent since zero, and its unit quaternion
(w, v), the angle about the axis n is that of the swing-twist decomposition,

    theta = 2 atan2(v . n, w),
    d theta = g . d omega,   g = (w^2 n + w v x n + (v . n) v) / (w^2 + (v . n)^2),

omega being the child's turn less the parent's, in the parent's frame.  For a turn about n alone g
is n; a turn about an axis normal to n, before or after, leaves theta as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion, skew
from rigid.model import NO_TURN, FingerModel, Vector, vector


@dataclass(frozen=True)
class HingeAngle:
    """The angle of a hinge between two bodies; `axis` (unit after construction) in the parent's
    frame, `zero` the child's rotation in its parent at zero angle.

    Raises InputError for an axis without a direction."""

    name: str
    parent: str
    child: str
    axis: Vector = (0.0, 1.0, 0.0)
    zero: tuple[Vector, Vector, Vector] = NO_TURN

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.axis))
        if not length > 0.0:
            raise InputError(f"joint {self.name}: expected an axis other than zero")
        object.__setattr__(self, "axis", vector(np.array(self.axis) / length))

    @property
    def names(self) -> tuple[str]:
        """The joint's name, as the names of a joint of several angles."""
        return (self.name,)

    @property
    def axes(self) -> tuple[Vector, Vector]:
        """Twice its own: of two hinges in one joint each has one."""
        return self.axis, self.axis


@dataclass(frozen=True)
class Angles:
    """Angles of n hinges between nb bodies at one motion."""

    value: Array
    """(n,) rad."""
    rate: Array
    """(n, 6 nb) their derivatives by the bodies' twists (of positions: zero)."""
    moment_rate: Array
    """(n, 6 nb, 6 nb) derivatives of `rate`, read as wrenches in the world, by the twists."""


def flexion_angles(model: FingerModel) -> tuple[HingeAngle, ...]:
    """The first hinge of each body of a finger, which is its flexion."""
    return tuple(
        HingeAngle(
            body.hinges[0].name,
            before.name,
            body.name,
            vector(np.array(body.rotation) @ body.hinges[0].axis),
            body.rotation,
        )
        for before, body in zip(model.segments[:-1], model.segments[1:], strict=True)
        if body.hinges
    )


def angles(hinges: Sequence[HingeAngle], motion: Motion) -> Angles:
    """All angles at once, continuous up to half a turn to either side."""
    width = 6 * len(motion.bodies)
    value, rate = np.zeros(len(hinges)), np.zeros((len(hinges), width))
    curve = np.zeros((len(hinges), width, width))
    for i, hinge in enumerate(hinges):
        p, c = (motion.bodies.index(body) for body in (hinge.parent, hinge.child))
        turn = motion.rotation[p]
        value[i], local, local_rate = _twist(
            turn.T @ motion.rotation[c] @ np.transpose(hinge.zero), np.array(hinge.axis)
        )
        axis = turn @ local
        by_child = turn @ local_rate @ turn.T
        by_parent = -by_child - skew(axis)
        rows = {s: slice(6 * b + 3, 6 * b + 6) for s, b in ((1.0, c), (-1.0, p))}
        for sign, row in rows.items():
            rate[i, row] = sign * axis
            curve[i, row, rows[1.0]] = sign * by_child
            curve[i, row, rows[-1.0]] = sign * by_parent
    return Angles(value, rate, curve)


def _twist(turn: Array, axis: Array) -> tuple[float, Array, Array]:
    """theta, g (3,) and dg / d omega (3, 3) of a turn Q about the axis n."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(turn).as_quat()
    sign = 1.0 if quaternion[3] >= 0 else -1.0
    v, w = sign * quaternion[:3], sign * float(quaternion[3])
    along, across = float(v @ axis), np.cross(v, axis)
    whole, size = w * w * axis + w * across + along * v, w * w + along * along
    dw, dv = -0.5 * v, 0.5 * (w * np.eye(3) - skew(v))
    d_along = axis @ dv
    d_whole = (
        np.outer(2 * w * axis + across, dw)
        - w * skew(axis) @ dv
        + np.outer(v, d_along)
        + along * dv
    )
    d_size = 2 * w * dw + 2 * along * d_along
    g = whole / size
    return 2 * float(np.arctan2(along, w)), g, (d_whole - np.outer(g, d_size)) / size
