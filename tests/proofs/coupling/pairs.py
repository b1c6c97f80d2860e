"""Pairs of a finger and a hood whose equations are known, and their monolithic solutions.

The references know neither port nor schemes: the pair's equations in joint angles, integrated by
scipy to 1e-11, or stepped by backward Euler with all unknowns in one system.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from cosim.port import Array, HoodJacobian, Load, Motion, Response
from rigid.chain.hinge import BODIES, JOINTS
from rigid.chain.joint_torques import joint_law
from rigid.chain.planar_chain import BUCHNER, PlanarChain
from rigid.hoods.pulley import Cable, PulleyHood
from tests.helpers.moving_hinge import MovingHinge


@dataclass(frozen=True)
class Drum:
    """A hood whose torques about the joints of a planar finger are linear,
    tau = arm^T T - stiffness (q - rest), q the bodies' turns about y between neighbours: tendons
    on drums of constant radius, and a spring.  Its excursions are arm q."""

    bodies: tuple[str, ...]
    arm: Array
    """(nt, nq) m."""
    stiffness: Array
    """(nq, nq) N m/rad."""
    rest: Motion

    sources = ("drum", "spring")

    @property
    def tendons(self) -> tuple[str, ...]:
        return tuple(f"tendon {k + 1}" for k in range(len(self.arm)))

    def start(self, motion: Motion) -> None:
        return None

    def advance(self, state: None, motion: Motion, tension: Array, dt: float) -> Response:
        angles = self._turns @ self.rest.twist_to(motion).ravel()
        torques = np.stack([self.arm.T @ tension, -self.stiffness @ angles])
        wrench = (torques @ self._turns).reshape(2, -1, 6).swapaxes(0, 1)
        load = Load(self.bodies, self.sources, wrench, np.zeros((len(self.arm), 6)))
        return Response(None, load, self.arm @ angles)

    def jacobian(self, state: None) -> HoodJacobian:
        turns, nt = self._turns, len(self.arm)
        along = self.arm @ turns
        return HoodJacobian(-turns.T @ self.stiffness @ turns, along.T, along, np.zeros((nt, nt)))

    def with_tolerance(self, tolerance: float) -> Drum:
        return self

    @property
    def _turns(self) -> Array:
        """The joint angles by the bodies' twists (nq, 6 nb)."""
        n = len(self.bodies) - 1
        out = np.zeros((n, n + 1, 6))
        i = np.arange(n)
        out[i, i + 1, 4], out[i, i, 4] = 1.0, -1.0
        return out.reshape(n, -1)


# The stiff pair: one joint, a spring of K and a damper, tau = r T - K q.

STIFFNESS, INERTIA, DAMPING, RADIUS = 2.0, 1e-6, 1e-4, 0.005
"""N m/rad, kg m2, N m s/rad (issue: the stiff pair), and a tendon's radius in m."""
FULL, RISE = 10.0, 0.04
"""N, the tension after a smooth rise of so many s."""
LASTS = 0.06
"""s."""


def stiff_pair(joints: int = 1) -> tuple[MovingHinge, Drum]:
    """Links without weight, each with the inertia about its centre, hardly any mass, and a spring
    and a damper at its joint; one link turns about its centre, which makes the pair linear."""
    one = np.ones(joints)
    mass, centre = (1e-3, 0.0) if joints == 1 else (1e-6, 0.5)
    length = BUCHNER.length[:joints]
    links = PlanarChain(length, centre * length, mass * one, INERTIA * one, gravity=0.0)
    names = JOINTS[:joints]
    finger = MovingHinge(links, joint_law(names, damping=dict.fromkeys(names, DAMPING)))
    rest = finger.motion(0.0 * one)
    return finger, Drum(rest.bodies, RADIUS * one[None], STIFFNESS * np.eye(joints), rest)


def smooth_rise(time: float) -> float:
    """A tension (N) that rises with a continuous slope."""
    u = min(max(time / RISE, 0.0), 1.0)
    return FULL * u**2 * (3 - 2 * u)


def pulls_on_drum(time: float) -> tuple[Array, Array]:
    """The drum's tensions (1,) N at a time in s, and those of the finger, which has no tendons."""
    return np.array([smooth_rise(time)]), np.zeros(0)


def stiff_truth(times: Array) -> Array:
    """The stiff pair's true angles (n, 1) rad."""

    def slope(t: float, y: Array) -> list[float]:
        torque = RADIUS * smooth_rise(t) - STIFFNESS * y[0] - DAMPING * y[1]
        return [y[1], torque / INERTIA]

    return integrate(slope, np.zeros(2), times)[:, :1]


def integrate(slope: Callable[..., object], start: Array, times: Array) -> Array:
    """The solution (n, len(start)) at increasing times from the first on, to 1e-11."""
    span = (times[0], times[-1])
    solution = solve_ivp(slope, span, start, "DOP853", times, rtol=1e-11, atol=1e-13)
    return np.asarray(solution.y.T)


def stiff_by_backward_euler(dt: float, steps: int) -> Array:
    """The angles (steps + 1, 1) rad of the same equation, both unknowns in one step."""
    matrix = np.array([[1.0, -dt], [dt * STIFFNESS / INERTIA, 1 + dt * DAMPING / INERTIA]])
    y = np.zeros((steps + 1, 2))
    for i in range(steps):
        pull = dt * RADIUS * smooth_rise((i + 1) * dt) / INERTIA
        y[i + 1] = np.linalg.solve(matrix, y[i] + [0.0, pull])
    return y[:, :1]


def stability_limit() -> float:
    """The staggered pair's limit (s): with the damper implicit the step's characteristic polynomial
    leaves the unit circle where h^2 K = 4 I + 2 h c, a little above 2 sqrt(I/K)."""
    c = DAMPING / STIFFNESS
    return float(c + np.sqrt(c**2 + 4 * INERTIA / STIFFNESS))


# The soft pair: the finger of Buchner et al. under two cables of eyelets beside each joint.

HEIGHT, BESIDE = 0.006, 0.008
"""m, of the eyelets above or below each joint, and to either side."""
SPRING = np.array([0.20, 0.12, 0.08])
REST = np.array([0.7, 0.9, 0.4])
SOFT_DAMPING = np.array([1e-3, 5e-4, 2.5e-4])
"""N m/rad, rad, N m s/rad, assumed."""


def soft_pair(order: Literal[1, 2] = 1) -> tuple[MovingHinge, PulleyHood]:
    """A finger with soft joint springs, of first or second order in time, and two cables over it,
    dorsal and palmar."""
    by = lambda values: dict(zip(JOINTS, values, strict=True))  # noqa: E731
    law = joint_law(JOINTS, by(SPRING), by(REST), damping=by(SOFT_DAMPING))
    finger = MovingHinge(BUCHNER, law, order)
    cables = {"dorsal": _cable(HEIGHT), "palmar": _cable(-HEIGHT)}
    return finger, PulleyHood(cables, finger.motion(np.zeros(3)))


def _cable(height: float) -> Cable:
    points = [(BODIES[0], (-BESIDE, 0.0, height))]
    for body, length in zip(BODIES[1:], BUCHNER.length, strict=True):
        points += [(body, (BESIDE, 0.0, height)), (body, (length - BESIDE, 0.0, height))]
    return Cable(tuple(points[:-1]))


def soft_tensions(time: float) -> Array:
    """The dorsal and the palmar tension (N) of the soft pair."""
    return np.array([3.0 + np.sin(30 * time), 3.0 * (1 - np.cos(40 * time))])


def pulls_on_cables(time: float) -> tuple[Array, Array]:
    """The two cables' tensions (2,) N at a time in s, and those of the finger, which has no
    tendons."""
    return soft_tensions(time), np.zeros(0)


def soft_acceleration(time: float, q: Array, v: Array) -> Array:
    """The soft pair's acceleration (3,) rad/s2.  A cable's span over a joint is a chord of the
    circle on which both eyelets lie, 2 rho sin(atan(a/h) +- q/2), and its arm the span's
    derivative."""
    rho, angle = np.hypot(HEIGHT, BESIDE), np.arctan(BESIDE / HEIGHT)
    dorsal, palmar = rho * np.cos(angle + q / 2), -rho * np.cos(angle - q / 2)
    pull = soft_tensions(time)
    torque = -SPRING * (q - REST) - SOFT_DAMPING * v - pull[0] * dorsal - pull[1] * palmar
    return BUCHNER.acceleration(q, v, torque, np.zeros(2))


def soft_truth(times: Array) -> Array:
    """The soft pair's true angles (n, 3) rad."""

    def slope(t: float, y: Array) -> Array:
        return np.concatenate([y[3:], soft_acceleration(t, y[:3], y[3:])])

    return integrate(slope, np.concatenate([REST, np.zeros(3)]), times)[:, :3]


def soft_by_backward_euler(dt: float, steps: int) -> Array:
    """The soft pair's angles (steps + 1, 3) rad: finger and cables in one system a step."""
    q, v, out = REST, np.zeros(3), [REST]
    for i in range(1, steps + 1):
        rest = lambda new, q=q, v=v, t=i * dt: (  # noqa: E731
            new - v - dt * soft_acceleration(t, q + dt * new, new)
        )
        v = root(rest, v, tol=1e-13).x
        q = q + dt * v
        out.append(q)
    return np.array(out)
