"""Passive torques of the joints: springs, curves, damping and the coordinate limit.

Pure functions of the joint angles and rates, each with its derivative; rad, rad/s, N m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.kernels.kernel import compile_kernel
from cosim.port import Array

LIMIT_STIFFNESS = float(np.degrees(20.0))
"""20 N m/deg (Jadelis, thesis, section 2.2.2) in N m/rad."""
LIMIT_TRANSITION = float(np.radians(5.0))
"""5 deg (same source)."""
LIMIT_MARGIN = float(np.radians(5.0))
"""The joints are held within +-5 deg of the posture (same source)."""
SPLINT_TRANSITION = float(np.radians(0.5))
"""rad beyond its range over which a splint takes hold: small beside what a finger moves."""


def spring_torque(q: Array, stiffness: Array, rest: Array) -> tuple[Array, Array]:
    """tau = -k (q - rest) and d tau / dq, both of the shape of `q`."""
    return -stiffness * (q - rest), -stiffness * np.ones(np.shape(q))


@compile_kernel
def _smooth_step(u: float) -> tuple[float, float]:
    """A smooth step and its slope: s = 10 u^3 - 15 u^4 + 6 u^5 between 0 and 1 (constant outside)
    and ds/du."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10 + u * (6 * u - 15)), 30 * u**2 * (1 - u) ** 2


@compile_kernel
def _smooth_steps(u: Array, out: Array) -> None:
    for i in range(len(u)):
        out[i] = _smooth_step(u[i])[0]


@compile_kernel
def _limit_torques(
    q: Array, lower: Array, upper: Array, stiffness: Array, transition: Array, out: Array
) -> None:
    for i in range(len(q)):
        above, below = max(q[i] - upper[i], 0.0), max(lower[i] - q[i], 0.0)
        x = above + below  # at most one of them is not zero
        s, slope = _smooth_step(x / transition[i])
        sign = 0.0 if below == above else 1.0 if below > above else -1.0
        out[0, i] = sign * stiffness[i] * s * x
        out[1, i] = -stiffness[i] * (s + slope * x / transition[i])


def limit_torque(
    q: Array,
    lower: Array | float,
    upper: Array | float,
    stiffness: Array | float = LIMIT_STIFFNESS,
    transition: Array | float = LIMIT_TRANSITION,
) -> tuple[Array, Array]:
    """Restoring torque K s(x / transition) x at x rad beyond a limit, and d tau / dq.

    The law of OpenSim's CoordinateLimitForce at rest (`limit_damping` has the rest); zero between
    the limits, `stiffness` N m/rad in full at `transition` rad beyond one.  An infinite limit is
    none.
    """
    shape = np.broadcast_shapes(np.shape(q), np.shape(lower), np.shape(upper))
    q, lower, upper, stiffness, transition = (
        np.array(np.broadcast_to(x, shape), dtype=float).ravel()
        for x in (q, lower, upper, stiffness, transition)
    )
    out = np.empty((2, len(q)))
    _limit_torques(q, lower, upper, stiffness, transition, out)
    return out[0].reshape(shape), out[1].reshape(shape)


def limit_damping(
    q: Array, lower: Array, upper: Array, damping: float, transition: Array | float
) -> Array:
    """The damping, N m s/rad, of OpenSim's CoordinateLimitForce: s(x / transition) `damping` at x
    rad beyond a limit, against the motion in either direction."""
    beyond = np.maximum(q - upper, 0.0) + np.maximum(lower - q, 0.0)
    share = np.empty(np.shape(beyond))
    _smooth_steps(np.ravel(beyond / transition), share.reshape(-1))
    return damping * share


def limit_energy(
    q: Array,
    lower: Array | float,
    upper: Array | float,
    stiffness: Array | float,
    transition: Array | float,
) -> Array:
    """The energy in a limit, J: the integral of the limit's torque K s(x / t) x over x."""
    beyond = np.maximum(q - upper, 0.0) + np.maximum(lower - q, 0.0)
    u = np.minimum(beyond / transition, 1.0)
    rising = transition**2 * u**5 * (2 - 2.5 * u + 6 / 7 * u**2)
    return stiffness * (rising + 0.5 * np.maximum(beyond**2 - transition**2, 0.0))


@dataclass(frozen=True)
class TorqueCurve:
    """A joint's passive torque through points: monotone where they are (PCHIP: Fritsch and Carlson
    1980, SIAM J Numer Anal 17:238), straight beyond the ends, with a continuous slope."""

    angle: tuple[float, ...]
    torque: tuple[float, ...]

    def __post_init__(self) -> None:
        values = np.array([*self.angle, *self.torque])
        paired = len(self.angle) == len(self.torque) >= 2
        if not paired or not np.isfinite(values).all() or (np.diff(self.angle) <= 0).any():
            raise InputError(
                "torque curve: expected two or more points (rad, N m) whose angles rise, got "
                f"angles {self.angle} and torques {self.torque}"
            )

    def __call__(self, q: float) -> tuple[float, float]:
        """The torque, N m, and its slope, N m/rad, at q rad."""
        inside = min(max(q, self.angle[0]), self.angle[-1])
        spline, slope = self._splines
        gradient = float(slope(inside))
        return float(spline(inside)) + gradient * (q - inside), gradient

    def energy(self, q: float) -> float:
        """The energy stored, J: minus the integral of the torque from the first angle to q."""
        inside = min(max(q, self.angle[0]), self.angle[-1])
        torque, slope = self(inside)
        beyond = q - inside
        within = float(self._splines[0].integrate(self.angle[0], inside))
        return -(within + torque * beyond + 0.5 * slope * beyond**2)

    @cached_property
    def _splines(self) -> tuple[Any, Any]:
        from scipy.interpolate import PchipInterpolator

        spline = PchipInterpolator(self.angle, self.torque)
        return spline, spline.derivative()


@dataclass(frozen=True)
class JointLaw:
    """Passive properties of a finger's joints: arrays (nq,) in the finger's order of joints."""

    joints: tuple[str, ...]
    stiffness: Array
    """N m/rad."""
    rest: Array
    """Angles at which the spring is free of torque, rad."""
    lower: Array
    upper: Array
    """Angles at which the coordinate limit begins, rad; infinite for none."""
    limit_stiffness: Array | float = LIMIT_STIFFNESS
    transition: Array | float = LIMIT_TRANSITION
    limit_damping: float = 0.0
    """N m s/rad, fully beyond a limit."""
    damping: Array | None = None
    """N m s/rad; None: none."""
    curves: Mapping[str, TorqueCurve] = field(default_factory=dict)
    """By joint, added to its spring."""
    held: Array | float = 0.0
    """N m, torques that do not follow the angles."""

    def __post_init__(self) -> None:
        low = self.lower > self.upper
        if low.any():
            j = int(np.argmax(low))
            raise InputError(
                f"limits of joint {self.joints[j]}: the lower one ({self.lower[j]} rad) must lie "
                f"below the upper one ({self.upper[j]} rad)"
            )
        hard = np.all(np.greater(self.transition, 0) & np.greater_equal(self.limit_stiffness, 0))
        if not (hard and (self.stiffness >= 0).all()):
            raise InputError(
                f"joints {self.joints}: a stiffness must not be negative and the limits' "
                f"transition must be positive; got stiffness {self.stiffness} N m/rad, limit "
                f"stiffness {self.limit_stiffness} N m/rad, transition {self.transition} rad"
            )

    def passive(self, q: Array) -> tuple[Array, Array]:
        """Torques (nq,) of springs and curves, and their derivatives (nq,)."""
        torque, slope = spring_torque(q, self.stiffness, self.rest)
        if self.curves:
            slope = slope.copy()
            for joint, curve in self.curves.items():
                i = self.joints.index(joint)
                more = curve(float(q[i]))
                torque[i], slope[i] = torque[i] + more[0], slope[i] + more[1]
        return torque + self.held, slope

    def relaxed(self, factor: float, held: Array) -> JointLaw:
        """The joints in a step of their relaxation: springs and curves times `factor`, and torques
        that are `held` (nq,) N m."""
        curves = {
            joint: replace(curve, torque=tuple(factor * t for t in curve.torque))
            for joint, curve in self.curves.items()
        }
        return replace(self, stiffness=factor * self.stiffness, curves=curves, held=held)

    def energy(self, q: Array) -> float:
        """The energy, J, stored in springs, curves and limits; of what is held less its work."""
        springs = 0.5 * float(self.stiffness @ (q - self.rest) ** 2)
        curves = sum(c.energy(float(q[self.joints.index(j)])) for j, c in self.curves.items())
        limits = limit_energy(q, self.lower, self.upper, self.limit_stiffness, self.transition)
        return springs + curves + float(limits.sum()) - float(np.sum(self.held * q))

    def viscous(self, q: Array, rate: Array) -> tuple[Array, Array]:
        """Torques (nq,) of the joints' and the limits' damping, and their derivatives (nq,) by the
        rates."""
        c = limit_damping(q, self.lower, self.upper, self.limit_damping, self.transition)
        c = c if self.damping is None else c + self.damping
        return -c * rate, -c

    def limit(self, q: Array) -> tuple[Array, Array]:
        """Limit torques (nq,) and their derivatives (nq,)."""
        return limit_torque(q, self.lower, self.upper, self.limit_stiffness, self.transition)

    def splinted(self, lower: Array, upper: Array, stiffness: Array) -> JointLaw:
        """The same joints with splints in place of their limits, from `lower` to `upper` (nq,) rad
        with a stiffness (nq,) N m/rad; nan of a joint without."""
        worn = ~np.isnan(lower)
        return replace(
            self,
            lower=np.where(worn, lower, self.lower),
            upper=np.where(worn, upper, self.upper),
            limit_stiffness=np.where(worn, stiffness, self.limit_stiffness),
            transition=np.where(worn, SPLINT_TRANSITION, self.transition),
        )

    def hold_about(self, posture: Mapping[str, float], margin: float = LIMIT_MARGIN) -> JointLaw:
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
    limit_damping: float = 0.0,
    damping: Mapping[str, float] | None = None,
    curves: Mapping[str, TorqueCurve] | None = None,
) -> JointLaw:
    """A law from values by joint (rad, N m/rad, N m s/rad); a joint not named has none.

    Raises InputError for an unknown joint, a negative stiffness or limits that cross."""
    joints = tuple(joints)
    curves = {} if curves is None else dict(curves)
    by_joint(dict.fromkeys(curves, 0.0), joints, 0.0, "torque curves")
    return JointLaw(
        joints,
        by_joint(stiffness, joints, 0.0, "passive stiffness"),
        by_joint(rest, joints, 0.0, "rest angles"),
        by_joint(lower, joints, -np.inf, "lower limits"),
        by_joint(upper, joints, np.inf, "upper limits"),
        limit_stiffness,
        transition,
        limit_damping,
        by_joint(damping, joints, 0.0, "damping") if damping else None,
        curves,
    )


def by_joint(
    values: Mapping[str, float] | None, joints: Sequence[str], default: float, what: str
) -> Array:
    """The values (nq,) in the order of `joints`.  Raises InputError for a name not among them."""
    values = {} if values is None else values
    unknown = [name for name in values if name not in joints]
    if unknown:
        raise InputError(f"{what}: unknown joint {', '.join(unknown)}; the joints are {joints}")
    return np.array([float(values.get(j, default)) for j in joints])
