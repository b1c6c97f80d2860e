"""The inner loop of a finger in motion: laws of contact and one implicit step in time.

Compiled by numba where it is installed; without it the same code runs, some fifty times slower.
All in one file, since numba looks at no other one when it decides whether to compile anew.
`rigid.device` says which laws these are, `rigid.dynamics` which step.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from rigid.jit import compiled

Indices = NDArray[np.intp]
FREE, CAGE, SHELL = 0, 1, 2
HERTZ_DAMPING, BED_DAMPING = 1.5, 1.0
NO_SLIP = 1e-12
"""m/s, below which the direction of slip is not asked for."""
MOST_ROUNDS = 60
MOST_HALVINGS = 30
Answer = tuple[Array, Array, Array]
"""Wrench (6,), its derivatives (6, 3) by the position and (6, 6) by the twist."""


class Surface(NamedTuple):
    """A device in plain numbers."""

    kind: int
    stiffness: float
    """Cage: N/m^1.5 of Hertz's law; shell: Pa/m."""
    gap: float
    """m."""
    radius: float
    dissipation: float
    static_friction: float
    dynamic_friction: float
    viscous_friction: float
    transition_velocity: float


class Joints(NamedTuple):
    """Springs, limits and damping of the joints, (nq,) each but for what all share."""

    stiffness: Array
    rest: Array
    damping: Array
    lower: Array
    upper: Array
    limit_stiffness: float
    transition: float
    limit_damping: float


class Readings(NamedTuple):
    """MuJoCo's buffers at the start of a step, and what does not change with it."""

    mass: Array
    """Entries of the mass matrix, which stand where `mass_at` (nq, nq) says."""
    mass_at: Indices
    bias: Array
    """(nq,) N m, inertial torques less gravity's."""
    path: Array
    """Derivatives of the tendons' lengths, in `path_row` and `path_column`."""
    path_row: Indices
    path_column: Indices
    jacobian: Array
    """(6, nq) of the tip, in the world."""
    tip: Array
    """(3,) m, in the world."""
    target: Array
    """(3,) m, where the tip is held, or the device's centre."""
    frame: Array
    """(3, 3) the device's axes as columns."""
    basis: Array
    """(m, 6) unit wrenches of the support."""


class Instant(NamedTuple):
    """What is known at the start of a step."""

    angles: Array
    rates: Array
    mass: Array
    """(nq, nq)."""
    torque: Array
    """(nq,) of tendons, curves and gravity less the inertial ones; constant over the step but for"""
    by_rate: Array
    """(nq, nq) its derivative by the rates at the end of the step."""
    tip: Array
    """(6, nq) its Jacobian, in the device's axes."""
    position: Array
    """(3,) m, in the device's axes."""
    held: Array
    """(m, nq) rows of the constraint and"""
    drift: Array
    """(m,) how far it is off."""


@compiled
def cross_matrix(a: Array) -> Array:
    """(3, 3), which times b is a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@compiled
def times(a: Array, b: Array) -> Array:
    """a b of small matrices, for which a call of BLAS takes longer than the work."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@compiled
def applied(a: Array, x: Array) -> Array:
    """a x of a small matrix and a vector."""
    out = np.zeros(a.shape[0])
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            out[i] += a[i, k] * x[k]
    return out


@compiled
def friction(surface: Surface, speed: float) -> tuple[float, float]:
    """Coefficient of friction at a slip speed (m/s), and its slope (s/m)."""
    v = speed / surface.transition_velocity
    excess = 2.0 * (surface.static_friction - surface.dynamic_friction) / (1.0 + v * v)
    dry, slope = surface.dynamic_friction + excess, -2.0 * v * excess / (1.0 + v * v)
    if v < 1.0:
        dry, slope = v * dry, dry + v * slope
    slope = slope / surface.transition_velocity + surface.viscous_friction
    return dry + surface.viscous_friction * speed, slope


@compiled
def _drag(surface: Surface, slip: Array) -> tuple[float, Array]:
    """mu(v) / v, s/m, and the derivative (3, 3) of mu(v) s / v by the slip s, where v = |s|."""
    speed = sqrt((slip**2).sum())
    if speed < NO_SLIP:
        secant = friction(surface, 0.0)[1]
        return secant, secant * np.eye(3)
    value, slope = friction(surface, speed)
    secant = value / speed
    along = slip / speed
    return secant, secant * np.eye(3) + (slope - secant) * np.outer(along, along)


@compiled
def bed(surface: Surface, d: float) -> tuple[float, float]:
    """N and N/m: a sphere in a hollow one lined with springs, their centres d apart."""
    r, x = surface.radius, d - surface.gap
    outer = r + surface.gap
    around = outer**2 - r**2 - d**2
    total = x**2 * around / 2 + 2 * r * x**3 / 3 - x**4 / 4
    slope = x * around - x**2 * d + 2 * r * x**2 - x**3
    factor = pi * outer * surface.stiffness / d**2
    return factor * total, factor * (slope - 2 * total / d)


@compiled
def pressed(
    surface: Surface,
    damping: float,
    normal: Array,
    turn: Array,
    elastic: tuple[float, float],
    depth: float,
    twist: Array,
    slopes: bool,
) -> Answer:
    """One touch with inward normal (3,), its derivative (3, 3) by the position, the elastic force
    and its slope by the depth.  The lever from the centre to the point is (depth / 2 - R) n, which
    is where Simbody has it between two bodies of one stiffness."""
    n, reach = normal, 0.5 * depth - surface.radius
    spin, arm = cross_matrix(twist[3:]), cross_matrix(n)
    velocity = twist[:3] + reach * applied(spin, n)
    along = (n * velocity).sum()
    c = damping * surface.dissipation
    rate = 1.0 - c * along
    wrench, by_position, by_twist = np.zeros(6), np.zeros((6, 3)), np.zeros((6, 6))
    if rate <= 0.0:
        return wrench, by_position, by_twist
    f, slip = elastic[0] * rate, velocity - along * n
    secant, by_slip = _drag(surface, slip)
    push = n - secant * slip
    force, lever = f * push, reach * arm
    wrench[:3], wrench[3:] = force, applied(lever, force)
    if not slopes:
        return wrench, by_position, by_twist
    velocity_p = reach * times(spin, turn) - 0.5 * np.outer(applied(spin, n), n)
    along_p = applied(velocity_p.T, n) + applied(turn.T, velocity)
    f_v = -elastic[0] * c * n
    f_p = -elastic[1] * rate * n - elastic[0] * c * along_p
    slip_v = np.eye(3) - np.outer(n, n)
    slip_p = velocity_p - along * turn - np.outer(n, along_p)
    force_v = np.outer(push, f_v) - f * times(by_slip, slip_v)
    force_p = np.outer(push, f_p) + f * (turn - times(by_slip, slip_p))
    lever_p = reach * turn - 0.5 * np.outer(n, n)
    by_position[:3] = force_p
    by_position[3:] = times(lever, force_p) - times(cross_matrix(force), lever_p)
    by_twist[:3, :3], by_twist[:3, 3:] = force_v, -times(force_v, lever)
    by_twist[3:] = times(lever, by_twist[:3])
    return wrench, by_position, by_twist


@compiled
def touched(surface: Surface, position: Array, twist: Array, slopes: bool) -> Answer:
    """What a device does to the sphere at a position (3,) and twist (6,); its derivatives are zero
    where `slopes` are not asked for."""
    wrench, by_position, by_twist = np.zeros(6), np.zeros((6, 3)), np.zeros((6, 6))
    if surface.kind == CAGE:
        for i in range(3):
            depth = abs(position[i]) - surface.gap
            if depth > 0.0:
                normal = np.zeros(3)
                normal[i] = -1.0 if position[i] > 0.0 else 1.0
                slope = surface.stiffness * sqrt(depth)
                hertz = (slope * depth, 1.5 * slope)
                a, b, c = pressed(
                    surface, HERTZ_DAMPING, normal, np.zeros((3, 3)), hertz, depth, twist, slopes
                )
                wrench, by_position, by_twist = wrench + a, by_position + b, by_twist + c
    elif surface.kind == SHELL:
        d = sqrt((position**2).sum())
        if d > surface.gap:
            normal = -position / d
            turn = (np.outer(normal, normal) - np.eye(3)) / d
            depth = d - surface.gap
            return pressed(
                surface, BED_DAMPING, normal, turn, bed(surface, d), depth, twist, slopes
            )
    return wrench, by_position, by_twist


@compiled
def elastic_force(surface: Surface, position: Array) -> Array:
    """(3,) N, what the device would do to a sphere at rest."""
    out = np.zeros(3)
    if surface.kind == CAGE:
        for i in range(3):
            depth = max(abs(position[i]) - surface.gap, 0.0)
            out[i] = -np.sign(position[i]) * surface.stiffness * depth * sqrt(depth)
    elif surface.kind == SHELL:
        d = sqrt((position**2).sum())
        if d > surface.gap:
            out = -bed(surface, d)[0] * position / d
    return out


@compiled
def joint_torques(joints: Joints, q: Array, v: Array) -> Answer:
    """(nq,) N m of springs, limits and damping, and their derivatives by angles and rates."""
    n = len(q)
    torque, by_angle, by_rate = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        beyond = max(q[i] - joints.upper[i], 0.0) + max(joints.lower[i] - q[i], 0.0)
        sign = 1.0 if q[i] < joints.lower[i] else -1.0
        u = min(beyond / joints.transition, 1.0)
        s = u**3 * (10.0 + u * (6.0 * u - 15.0))
        slope = 30.0 * u**2 * (1.0 - u) ** 2 / joints.transition
        viscous = joints.damping[i] + joints.limit_damping * s
        torque[i] = -joints.stiffness[i] * (q[i] - joints.rest[i]) - viscous * v[i]
        torque[i] += sign * joints.limit_stiffness * s * beyond
        by_angle[i] = -joints.stiffness[i] - joints.limit_stiffness * (s + slope * beyond)
        by_angle[i] += sign * joints.limit_damping * slope * v[i]
        by_rate[i] = -viscous
    return torque, by_angle, by_rate


@compiled
def residual(
    surface: Surface, joints: Joints, at: Instant, h: float, v: Array, r: Array, slopes: bool
) -> tuple[Array, Array, Array]:
    """Momentum and constraint left over (n + m,), their tangent if `slopes` are asked for, and the
    device's wrench, where the rates at the end of the step are v (nq,) and the reactions r (m,)."""
    n, m = len(v), len(r)
    twist = applied(at.tip, v)
    wrench, by_position, by_twist = touched(surface, at.position + h * twist[:3], twist, slopes)
    torque, by_angle, by_rate = joint_torques(joints, at.angles + h * v, v)
    out, tangent = np.zeros(n + m), np.zeros((n + m, n + m))
    out[:n] = applied(at.mass, v - at.rates) - h * (torque + at.torque + applied(at.by_rate, v))
    out[:n] -= h * (applied(at.tip.T, wrench) + applied(at.held.T, r))
    out[n:] = applied(at.held, v) + at.drift / h
    if not slopes:
        return out, tangent, wrench
    by_twist[:, :3] += h * by_position
    tangent[:n, :n] = at.mass - h * (at.by_rate + times(at.tip.T, times(by_twist, at.tip)))
    for i in range(n):
        tangent[i, i] -= h * (by_rate[i] + h * by_angle[i])
    tangent[n:, :n] = at.held
    tangent[:n, n:] = -h * at.held.T
    return out, tangent, wrench


@compiled
def step(
    surface: Surface, joints: Joints, at: Instant, h: float, reaction: Array, tolerance: float
) -> tuple[bool, Array, Array, Array, float]:
    """Whether Newton's iteration came below `tolerance` (N m, of the torques), then the rates (nq,),
    reactions (m,), the device's wrench (6,) and what it dissipated (J) at the end of the step.

    A step is halved while it does not lower the residual: the law of friction has kinks."""
    n, v, r = len(at.rates), at.rates, reaction
    left, _, wrench = residual(surface, joints, at, h, v, r, False)
    size = _size(left, n, h)
    for _ in range(MOST_ROUNDS):
        if size <= tolerance:
            return True, v, r, wrench, h * _dissipated(surface, at, h, v, wrench)
        left, tangent, _ = residual(surface, joints, at, h, v, r, True)
        move = np.linalg.solve(tangent, left)
        before = size
        for _ in range(MOST_HALVINGS):
            left, _, wrench = residual(surface, joints, at, h, v - move[:n], r - move[n:], False)
            size = _size(left, n, h)
            if size < before:
                break
            move *= 0.5
        v, r = v - move[:n], r - move[n:]
    return False, v, r, wrench, 0.0


@compiled
def _dissipated(surface: Surface, at: Instant, h: float, v: Array, wrench: Array) -> float:
    """W: the elastic part's power less the device's."""
    twist = applied(at.tip, v)
    elastic = elastic_force(surface, at.position + h * twist[:3])
    return (elastic * twist[:3]).sum() - (wrench * twist).sum()


@compiled
def _size(left: Array, n: int, h: float) -> float:
    """N m: the largest torque left over; a rate of 1 m/s off a constraint counts as 1 N m."""
    return max(np.abs(left[:n]).max() / h, np.abs(left[n:]).max() if len(left) > n else 0.0)


@compiled
def arms(now: Readings, tendons: int) -> Array:
    """(nt, nq) m, shortening of each tendon per rad."""
    out = np.zeros((tendons, len(now.bias)))
    for k in range(len(now.path)):
        out[now.path_row[k], now.path_column[k]] = -now.path[k]
    return out


@compiled
def instant(
    now: Readings,
    angles: Array,
    rates: Array,
    tension: Array,
    stiffness: Array,
    turned: Array,
    h: float,
) -> Instant:
    """The start of a step under tensions (nt,) N that fall with the tendons' shortening by
    `stiffness` (nt,) N/m; turned: (3,) gap of the tip's turn from the one held."""
    n = len(angles)
    mass = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            mass[i, j] = now.mass[now.mass_at[i, j]]
    arm = arms(now, len(tension))
    torque = applied(arm.T, tension) - now.bias
    by_rate = np.zeros((n, n))
    if stiffness.any():
        by_rate = -h * times(arm.T, arm * stiffness.reshape(-1, 1))
    tip, gap = np.zeros((6, n)), np.zeros(6)
    back = now.frame.T
    tip[:3], tip[3:] = times(back, now.jacobian[:3]), times(back, now.jacobian[3:])
    gap[:3], gap[3:] = now.tip - now.target, turned
    held, drift = times(now.basis, now.jacobian), applied(now.basis, gap)
    place = applied(back, gap[:3])
    return Instant(angles, rates, mass, torque, by_rate, tip, place, held, drift)


@compiled
def advanced(
    surface: Surface,
    joints: Joints,
    now: Readings,
    at: tuple[Array, Array, Array],
    pull: tuple[Array, Array],
    more: tuple[Array, Array, Array],
    h: float,
    tolerance: float,
) -> tuple[bool, Array, Array, Array, Array, Array, float, float]:
    """One step from angles, rates and reactions `at`, under tensions and their stiffness `pull`;
    more: the tip's turn, torques (nq,) of the joints' curves and their slopes.

    Whether it converged, then at its end angles, rates, reactions, the wrench on the tip (6,) in
    the world, tensions, kinetic energy and what the device dissipated (J)."""
    start = instant(now, at[0], at[1], pull[0], pull[1], more[0], h)
    start.torque[:] += more[1]
    for i in range(len(more[2])):
        start.by_rate[i, i] += h * more[2][i]
    done, v, r, local, slip = step(surface, joints, start, h, at[2], tolerance)
    wrench = applied(now.basis.T, r)
    wrench[:3] += applied(now.frame, local[:3])
    wrench[3:] += applied(now.frame, local[3:])
    tension = pull[0] - h * pull[1] * applied(arms(now, len(pull[0])), v)
    kinetic = 0.5 * (v * applied(start.mass, v)).sum()
    return done, at[0] + h * v, v, r, wrench, tension, kinetic, slip
