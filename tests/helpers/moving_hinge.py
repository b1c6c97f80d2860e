"""A planar chain of one to three links in motion: the closed-form truth for fingers in time.

The links of `rigid.chain.planar_chain` turn about hinges with springs, limits and viscous damping.
A step from (q, v) over h solves for v+, by Newton's method with exact derivatives,

    M(q+) (v+ - v_) / k + c(q+, v+) + g(q+) = joints(q+, v+) + J(q+)^T w(q+),    q+ = q_ + k v+,

implicit in everything, the load included.  Backward Euler (order 1) has q_ = q, v_ = v, k = h.  The
backward differentiation formula of order 2 has, with r = h over the step before (Hairer, Norsett
and Wanner, Solving Ordinary Differential Equations I; stable for
r < 1 + sqrt 2),

    y_ = [(1 + r)^2 y - r^2 y_before] / (1 + 2 r),      k = h (1 + r) / (1 + 2 r).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import AffineLoad, Array, Motion
from rigid.chain.hinge import BODIES
from rigid.chain.joint_torques import JointLaw, by_joint
from rigid.chain.kinematics import Chain, body_jacobian, geometric_stiffness
from rigid.chain.planar_chain import PlanarChain

SETTLED = 1e-13
"""rad, the change of the angles in Newton's last iteration."""
MOST_ITERATIONS = 30


@dataclass(frozen=True)
class HingeMoment:
    """A moving hinge finger at one time: rad, rad/s, s."""

    angles: Array
    rates: Array
    time: float
    before: tuple[Array, Array, float]
    """Angles and rates before the step that ended here, and its length, for the formula of order 2;
    at the start itself, an endless one, which makes the first step backward Euler's."""


@dataclass(frozen=True)
class MovingHinge:
    """`cosim.port.MovingFinger` without tendons of its own: bones along x, flexion about +y, z up;
    the first body is fixed.

    Raises InputError for a law whose joints are not as many as the links, or that has curves."""

    links: PlanarChain
    law: JointLaw
    order: Literal[1, 2] = 1

    def __post_init__(self) -> None:
        n = len(self.links.length)
        if len(self.law.joints) != n or n >= len(BODIES):
            raise InputError(
                f"moving hinge finger: expected one to {len(BODIES) - 1} links and a joint for "
                f"each, got {n} links and the joints {self.law.joints}"
            )
        if self.law.curves:
            raise InputError(
                "moving hinge finger: its joints have springs, limits and damping, but no torque "
                f"curves; got curves of {', '.join(self.law.curves)}"
            )

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that are shared with the other side."""
        return BODIES[: len(self.joints) + 1]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the angles."""
        return self.law.joints

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of the tensions."""
        return ()

    def begin(self, posture: Mapping[str, float]) -> HingeMoment:
        """At rest; a joint not named is at zero.  Raises InputError for an unknown joint."""
        angles = by_joint(posture, self.joints, 0.0, "posture")
        rates = np.zeros(len(angles))
        return HingeMoment(angles, rates, 0.0, (angles, rates, np.inf))

    def angles(self, state: HingeMoment) -> Array:
        """Joint angles (nq,) of a state, rad."""
        return state.angles

    def rates(self, state: HingeMoment) -> Array:
        """Joint rates (nq,) of a state, rad/s."""
        return state.rates

    def motion(self, angles: Array) -> Motion:
        return self.chain(angles).motion

    def jacobian(self, angles: Array) -> Array:
        return body_jacobian(self.chain(angles))

    def path_lengths(self, angles: Array) -> Array:
        return np.zeros(0)

    def chain(self, angles: Array) -> Chain:
        """Kinematics at joint angles (nq,) rad."""
        n, flexion = len(angles), np.cumsum(angles)
        c, s, o, one = np.cos(flexion), np.sin(flexion), np.zeros(n), np.ones(n)
        bone = self.links.length[:, None] * np.column_stack([c, o, -s])
        points = np.vstack([np.zeros((2, 3)), np.cumsum(bone, axis=0)])
        turn = np.stack([c, o, s, o, one, o, -s, o, c], axis=1).reshape(n, 3, 3)
        motion = Motion(self.bodies, points[:-1], np.concatenate([np.eye(3)[None], turn]))
        axis = np.tile([0.0, 1.0, 0.0], (n, 1))
        return Chain(motion, np.arange(1, n + 1), points[1:-1], axis, points[-1])

    def step(self, state: HingeMoment, load: AffineLoad, tension: Array, dt: float) -> HingeMoment:
        """Advance the finger by a step in time.  Raises InputError for a load on other bodies,
        tensions or a step that is not positive."""
        self._check(load, tension, dt)
        (angles, rates), k = self._past(state, dt)
        v = state.rates
        for _ in range(MOST_ITERATIONS):
            residual, slope = self._residual(angles + k * v, v, (v - rates) / k, k, load)
            change = np.linalg.solve(slope, residual)
            v = v - change
            if k * np.abs(change).max() <= SETTLED * max(1.0, np.abs(angles).max()):
                before = (state.angles, state.rates, dt)
                return HingeMoment(angles + k * v, v, state.time + dt, before)
        raise ConvergenceError(
            f"moving hinge finger: the step to t = {state.time + dt:.6g} s did not converge in "
            f"{MOST_ITERATIONS} iterations. Try a smaller step than {dt:g} s or a softer load."
        )

    def energy(self, state: HingeMoment) -> float:
        return self.links.energy(state.angles, state.rates) + self.law.energy(state.angles)

    def _past(self, state: HingeMoment, dt: float) -> tuple[tuple[Array, Array], float]:
        """q_, v_ and k of the formula."""
        if self.order == 1:
            return (state.angles, state.rates), dt
        angles, rates, step = state.before
        r = dt / step
        now, then = (1 + r) ** 2 / (1 + 2 * r), r**2 / (1 + 2 * r)
        past = now * state.angles - then * angles, now * state.rates - then * rates
        return past, dt * (1 + r) / (1 + 2 * r)

    def _residual(
        self, q: Array, v: Array, a: Array, k: float, load: AffineLoad
    ) -> tuple[Array, Array]:
        """The torque (n,) N m that is missing at angles, rates and accelerations, and its
        derivative (n, n) by the rates, where dq/dv = k and da/dv = 1 / k."""
        needed, by_angle, by_rate, by_acceleration = inverse_dynamics(self.links, q, v, a)
        passive, limit, viscous = self.law.passive(q), self.law.limit(q), self.law.viscous(q, v)
        pushed, follows = self._load(q, load)
        residual = needed - passive[0] - limit[0] - viscous[0] - pushed
        slope = k * (by_angle - follows) + by_rate + by_acceleration / k
        slope -= np.diag(k * (passive[1] + limit[1]) + viscous[1])
        return residual, slope

    def _load(self, angles: Array, load: AffineLoad) -> tuple[Array, Array]:
        """Torques (n,) of the load and their derivative (n, n) by the angles."""
        chain = self.chain(angles)
        jacobian = body_jacobian(chain)
        turned = load.by_motion @ load.at.twist_to(chain.motion).ravel()
        wrench = load.wrench + turned.reshape(-1, 6)
        stiffness = jacobian.T @ load.by_motion @ jacobian
        bodies = np.arange(len(wrench))
        stiffness += geometric_stiffness(chain, bodies, chain.motion.position, wrench)
        return jacobian.T @ wrench.ravel(), stiffness

    def _check(self, load: AffineLoad, tension: Array, dt: float) -> None:
        if load.at.bodies != self.bodies:
            raise InputError(
                f"load on bodies {load.at.bodies}: the finger's are {self.bodies}, in this order"
            )
        if np.size(tension) or not 0 < dt < np.inf:
            raise InputError(
                "moving hinge finger: it has no tendons and takes positive steps (s); got "
                f"tensions {tension} and a step of {dt}"
            )


def inverse_dynamics(
    links: PlanarChain, angle: Array, rate: Array, acceleration: Array
) -> tuple[Array, Array, Array, Array]:
    """Joint torques (n,) N m that make the chain accelerate so, weight included, and their
    derivatives (n, n) by the joints' angles, rates and accelerations.

    Buchner et al. 1988, equation 7, in the links' angles theta; a joint's torque is the sum of that
    equation's sides over the links beyond."""
    n = len(angle)
    sums = np.tri(n)
    theta, speed, rise = np.pi / 2 + sums @ angle, sums @ rate, sums @ acceleration
    apart = theta[:, None] - theta
    C, S = links.coupling * np.cos(apart), links.coupling * np.sin(apart)
    lift = links.gravity * links.first_moment
    torque = C @ rise + S @ speed**2 - lift * np.sin(theta)
    by_theta = S * rise - C * speed**2
    by_theta += np.diag(C @ speed**2 - S @ rise - lift * np.cos(theta))
    by_angle, by_rate = sums.T @ by_theta @ sums, sums.T @ (2 * S * speed) @ sums
    return sums.T @ torque, by_angle, by_rate, sums.T @ C @ sums
