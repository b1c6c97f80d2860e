"""Passive torques of the joints: a linear spring and the coordinate limit.

Pure functions of the joint angles, each with its derivative; angles in rad, torques in N m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array, InputError

LIMIT_STIFFNESS = float(np.degrees(20.0))
"""20 N m/deg (Jadelis, thesis, section 2.2.2) in N m/rad."""
LIMIT_TRANSITION = float(np.radians(5.0))
"""5 deg (same source)."""
LIMIT_MARGIN = float(np.radians(5.0))
"""The joints are held within +-5 deg of the posture (same source)."""


def spring_torque(q: Array, stiffness: Array, rest: Array) -> tuple[Array, Array]:
    """tau = -k (q - rest) and d tau / dq, both of the shape of `q`."""
    return -stiffness * (q - rest), np.broadcast_to(-stiffness, np.shape(q)).astype(float)


def smooth_step(u: Array) -> tuple[Array, Array]:
    """s = 10 u^3 - 15 u^4 + 6 u^5 between 0 and 1 (constant outside) and ds/du."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 + u * (6 * u - 15)), 30 * u**2 * (1 - u) ** 2


def limit_torque(
    q: Array,
    lower: Array,
    upper: Array,
    stiffness: float = LIMIT_STIFFNESS,
    transition: float = LIMIT_TRANSITION,
) -> tuple[Array, Array]:
    """Restoring torque K s(x / transition) x at x rad beyond a limit, and d tau / dq.

    The law of OpenSim's CoordinateLimitForce without its damping; zero between the limits,
    `stiffness` N m/rad in full at `transition` rad beyond one.  An infinite limit is none.
    """
    above, below = np.maximum(q - upper, 0.0), np.maximum(lower - q, 0.0)
    x = above + below  # at most one of them is not zero
    s, slope = smooth_step(x / transition)
    torque = np.sign(below - above) * stiffness * s * x
    return torque, -stiffness * (s + slope * x / transition)


@dataclass(frozen=True)
class JointLaw:
    """Passive properties of a finger's joints: arrays (nq,) in the finger's order of joints."""

    joints: tuple[str, ...]
    stiffness: Array
    """N m/rad."""
    rest: Array
    """rad, where the spring is free of torque."""
    lower: Array
    upper: Array
    """rad, where the coordinate limit begins; infinite for none."""
    limit_stiffness: float = LIMIT_STIFFNESS
    transition: float = LIMIT_TRANSITION

    def __post_init__(self) -> None:
        low = self.lower > self.upper
        if low.any():
            j = int(np.argmax(low))
            raise InputError(
                f"limits of joint {self.joints[j]}: the lower one ({self.lower[j]} rad) must lie "
                f"below the upper one ({self.upper[j]} rad)"
            )
        if not (self.transition > 0 and self.limit_stiffness >= 0 and (self.stiffness >= 0).all()):
            raise InputError(
                f"joints {self.joints}: a stiffness must not be negative and the limits' "
                f"transition must be positive; got stiffness {self.stiffness} N m/rad, limit "
                f"stiffness {self.limit_stiffness} N m/rad, transition {self.transition} rad"
            )

    def passive(self, q: Array) -> tuple[Array, Array]:
        """Spring torques (nq,) and their derivatives (nq,)."""
        return spring_torque(q, self.stiffness, self.rest)

    def limit(self, q: Array) -> tuple[Array, Array]:
        """Limit torques (nq,) and their derivatives (nq,)."""
        return limit_torque(q, self.lower, self.upper, self.limit_stiffness, self.transition)

    def held_about(self, posture: Mapping[str, float], margin: float = LIMIT_MARGIN) -> JointLaw:
        """The same joints with limits at `posture` (rad) +- `margin` for each joint named there."""
        q = by_joint(posture, self.joints, np.nan, "the posture to hold")
        free = np.isnan(q)
        return replace(
            self,
            lower=np.where(free, self.lower, q - margin),
            upper=np.where(free, self.upper, q + margin),
        )


def joint_law(
    joints: Sequence[str],
    stiffness: Mapping[str, float] | None = None,
    rest: Mapping[str, float] | None = None,
    lower: Mapping[str, float] | None = None,
    upper: Mapping[str, float] | None = None,
    limit_stiffness: float = LIMIT_STIFFNESS,
    transition: float = LIMIT_TRANSITION,
) -> JointLaw:
    """A law from values by joint (rad, N m/rad); a joint not named has no spring and no limit.

    Raises InputError for an unknown joint, a negative stiffness or limits that cross."""
    joints = tuple(joints)
    return JointLaw(
        joints,
        by_joint(stiffness, joints, 0.0, "passive stiffness"),
        by_joint(rest, joints, 0.0, "rest angles"),
        by_joint(lower, joints, -np.inf, "lower limits"),
        by_joint(upper, joints, np.inf, "upper limits"),
        limit_stiffness,
        transition,
    )


def by_joint(
    values: Mapping[str, float] | None, joints: Sequence[str], default: float, what: str
) -> Array:
    """(nq,) values in the order of `joints`; raises InputError for a name not among them."""
    values = {} if values is None else values
    unknown = [name for name in values if name not in joints]
    if unknown:
        raise InputError(f"{what}: unknown joint {', '.join(unknown)}; the joints are {joints}")
    return np.array([float(values.get(j, default)) for j in joints])
