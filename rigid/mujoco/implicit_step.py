"""The inner loop of a finger in motion: laws of contact and one implicit step in time.

Compiled by numba where it is installed; without it the same code runs, some fifty times slower.
All in one file, see `cosim.kernels`; `rigid.mujoco.step_data` holds what goes in.
`rigid.mujoco.tip_device` says which laws these are, `rigid.mujoco.dynamics` which step.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from cosim.kernels.kernel import compile_kernel
from cosim.port import Array
from rigid.mujoco.step_data import CAGE, SHELL, DeviceData, Joints, Readings, StepStart

HERTZ_DAMPING, BED_DAMPING = 1.5, 1.0
NO_SLIP = 1e-12
"""m/s, below which the direction of slip is not asked for."""
MOST_TRIALS = 60
"""Most rounds of Newton's iteration in a step, and most halvings in a round."""
Answer = tuple[Array, Array, Array]
"""Wrench (6,), its derivatives (6, 3) by the position and (6, 6) by the twist."""


@compile_kernel
def cross_matrix(a: Array) -> Array:
    """The matrix (3, 3) that times b is a x b."""
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2], out[1, 2] = -a[2], a[1], -a[0]
    out[1, 0], out[2, 0], out[2, 1] = a[2], -a[1], a[0]
    return out


@compile_kernel
def times(a: Array, b: Array) -> Array:
    """a b of small matrices, for which a call of BLAS takes longer than the work."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@compile_kernel
def multiply_transpose(a: Array, b: Array) -> Array:
    """a^T b."""
    out = np.zeros((a.shape[1], b.shape[1]))
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[k, i] * b[k, j]
    return out


@compile_kernel
def apply(a: Array, x: Array) -> Array:
    """a x of a small matrix and a vector."""
    out = np.zeros(a.shape[0])
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            out[i] += a[i, k] * x[k]
    return out


@compile_kernel
def apply_transpose(a: Array, x: Array) -> Array:
    """a^T x."""
    out = np.zeros(a.shape[1])
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            out[i] += a[k, i] * x[k]
    return out


@compile_kernel
def dot(a: Array, b: Array) -> float:
    """a . b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@compile_kernel
def plus(a: Array, s: float, b: Array) -> Array:
    """a + s b of vectors."""
    out = np.zeros(len(a))
    for i in range(len(a)):
        out[i] = a[i] + s * b[i]
    return out


@compile_kernel
def dyad(a: Array, s: float, x: Array, y: Array) -> Array:
    """A matrix a + s x y^T."""
    out = np.zeros(a.shape)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = a[i, j] + s * x[i] * y[j]
    return out


@compile_kernel
def combine(r: float, a: Array, s: float, b: Array) -> Array:
    """r a + s b of matrices."""
    out = np.zeros(a.shape)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = r * a[i, j] + s * b[i, j]
    return out


@compile_kernel
def put(out: Array, row: int, column: int, block: Array) -> None:
    """A block of a matrix."""
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            out[row + i, column + j] = block[i, j]


@compile_kernel
def concatenate(a: Array, b: Array) -> Array:
    """One vector after the other."""
    out = np.zeros(len(a) + len(b))
    for i in range(len(a)):
        out[i] = a[i]
    for i in range(len(b)):
        out[len(a) + i] = b[i]
    return out


@compile_kernel
def solve_dense(a: Array, b: Array) -> Array:
    """x of a x = b by elimination with row pivots; it compiles in a tenth of LAPACK's time."""
    n = len(b)
    a, x = a.copy(), b.copy()
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[p, k]):
                p = i
        for j in range(n):
            a[k, j], a[p, j] = a[p, j], a[k, j]
        x[k], x[p] = x[p], x[k]
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            x[i] -= factor * x[k]
            for j in range(k, n):
                a[i, j] -= factor * a[k, j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    return x


@compile_kernel
def friction(surface: DeviceData, speed: float) -> tuple[float, float]:
    """Coefficient of friction at a slip speed (m/s), and its slope (s/m)."""
    v = speed / surface.transition_velocity
    excess = 2.0 * (surface.static_friction - surface.dynamic_friction) / (1.0 + v * v)
    dry, slope = surface.dynamic_friction + excess, -2.0 * v * excess / (1.0 + v * v)
    if v < 1.0:
        dry, slope = v * dry, dry + v * slope
    slope = slope / surface.transition_velocity + surface.viscous_friction
    return dry + surface.viscous_friction * speed, slope


@compile_kernel
def _drag(surface: DeviceData, slip: Array) -> tuple[float, Array]:
    """mu(v) / v, s/m, and the derivative (3, 3) of mu(v) s / v by the slip s, where v = |s|."""
    speed, one = sqrt(dot(slip, slip)), np.eye(3)
    if speed < NO_SLIP:
        secant = friction(surface, 0.0)[1]
        return secant, combine(secant, one, 0.0, one)
    value, slope = friction(surface, speed)
    secant = value / speed
    return secant, dyad(combine(secant, one, 0.0, one), (slope - secant) / speed**2, slip, slip)


@compile_kernel
def bed(surface: DeviceData, d: float) -> tuple[float, float]:
    """The force, N, and stiffness, N/m, of a sphere in a hollow one lined with springs, centres d
    apart."""
    r, x = surface.radius, d - surface.gap
    outer = r + surface.gap
    around = outer**2 - r**2 - d**2
    total = x**2 * around / 2 + 2 * r * x**3 / 3 - x**4 / 4
    slope = x * around - x**2 * d + 2 * r * x**2 - x**3
    factor = pi * outer * surface.stiffness / d**2
    return factor * total, factor * (slope - 2 * total / d)


@compile_kernel
def press(
    surface: DeviceData,
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
    # velocity of the point of contact; no pull where the bodies part fast
    n, reach, one = normal, 0.5 * depth - surface.radius, np.eye(3)
    spin, lever = cross_matrix(twist[3:]), combine(reach, cross_matrix(n), 0.0, one)
    rolling = apply(spin, n)
    velocity = plus(twist[:3], reach, rolling)
    along, c = dot(n, velocity), damping * surface.dissipation
    rate = 1.0 - c * along
    if rate <= 0.0:
        return np.zeros(6), np.zeros((6, 3)), np.zeros((6, 6))
    # normal force with damping, friction against the slip, and the wrench about the centre
    f, slip = elastic[0] * rate, plus(velocity, -along, n)
    secant, by_slip = _drag(surface, slip)
    push = plus(n, -secant, slip)
    force = plus(np.zeros(3), f, push)
    wrench = concatenate(force, apply(lever, force))
    by_position, by_twist = np.zeros((6, 3)), np.zeros((6, 6))
    if not slopes:
        return wrench, by_position, by_twist
    # derivatives by the position (_p) and by the velocity at the point (_v)
    velocity_p = dyad(combine(reach, times(spin, turn), 0.0, one), -0.5, rolling, n)
    along_p = plus(apply_transpose(velocity_p, n), 1.0, apply_transpose(turn, velocity))
    f_p = plus(plus(np.zeros(3), -elastic[1] * rate, n), -elastic[0] * c, along_p)
    slip_p = dyad(combine(1.0, velocity_p, -along, turn), -1.0, n, along_p)
    push_p = combine(1.0, turn, -1.0, times(by_slip, slip_p))
    force_p = dyad(combine(f, push_p, 0.0, one), 1.0, push, f_p)
    push_v = times(by_slip, dyad(one, -1.0, n, n))
    force_v = dyad(combine(-f, push_v, 0.0, one), -elastic[0] * c, push, n)
    lever_p = dyad(combine(reach, turn, 0.0, one), -0.5, n, n)
    moment_p = combine(1.0, times(lever, force_p), -1.0, times(cross_matrix(force), lever_p))
    # the blocks of the wrench's derivatives; _w: by the angular velocity
    put(by_position, 0, 0, force_p)
    put(by_position, 3, 0, moment_p)
    force_w = combine(-1.0, times(force_v, lever), 0.0, one)
    put(by_twist, 0, 0, force_v)
    put(by_twist, 0, 3, force_w)
    put(by_twist, 3, 0, times(lever, force_v))
    put(by_twist, 3, 3, times(lever, force_w))
    return wrench, by_position, by_twist


@compile_kernel
def device_response(surface: DeviceData, position: Array, twist: Array, slopes: bool) -> Answer:
    """What a device does to the sphere at a position (3,) and twist (6,); no derivatives, but
    zeros, where `slopes` are not asked for."""
    wrench, by_position, by_twist = np.zeros(6), np.zeros((6, 3)), np.zeros((6, 6))
    damping = BED_DAMPING if surface.kind == SHELL else HERTZ_DAMPING
    distance = sqrt(dot(position, position))
    for i in range(3):
        normal, turn = np.zeros(3), np.zeros((3, 3))
        if surface.kind == CAGE:
            depth = abs(position[i]) - surface.gap
            normal[i] = -1.0 if position[i] > 0.0 else 1.0
            slope = surface.stiffness * sqrt(max(depth, 0.0))
            elastic = (slope * depth, 1.5 * slope)
        elif surface.kind == SHELL and i == 0 and distance > surface.gap:
            depth = distance - surface.gap
            normal = plus(normal, -1.0 / distance, position)
            turn = dyad(np.eye(3), -1.0, normal, normal)
            turn = combine(-1.0 / distance, turn, 0.0, turn)
            elastic = bed(surface, distance)
        else:
            depth, elastic = 0.0, (0.0, 0.0)
        if depth > 0.0:
            a, b, c = press(surface, damping, normal, turn, elastic, depth, twist, slopes)
            wrench = plus(wrench, 1.0, a)
            by_position, by_twist = (
                combine(1.0, by_position, 1.0, b),
                combine(1.0, by_twist, 1.0, c),
            )
    return wrench, by_position, by_twist


@compile_kernel
def elastic_force(surface: DeviceData, position: Array) -> Array:
    """The force (3,) N that the device would exert on a sphere at rest."""
    out, distance = np.zeros(3), sqrt(dot(position, position))
    for i in range(3):
        if surface.kind == CAGE:
            depth = max(abs(position[i]) - surface.gap, 0.0)
            out[i] = -np.sign(position[i]) * surface.stiffness * depth * sqrt(depth)
        elif surface.kind == SHELL and distance > surface.gap:
            out[i] = -bed(surface, distance)[0] * position[i] / distance
    return out


@compile_kernel
def joint_torques(joints: Joints, q: Array, v: Array) -> Answer:
    """The torques (nq,) N m of springs, limits and damping, and their derivatives by angles and
    rates."""
    n = len(q)
    torque, by_angle, by_rate = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        beyond = max(q[i] - joints.upper[i], 0.0) + max(joints.lower[i] - q[i], 0.0)
        sign = 1.0 if q[i] < joints.lower[i] else -1.0
        u = min(beyond / joints.transition[i], 1.0)
        s = u**3 * (10.0 + u * (6.0 * u - 15.0))
        slope = 30.0 * u**2 * (1.0 - u) ** 2 / joints.transition[i]
        viscous = joints.damping[i] + joints.limit_damping * s
        torque[i] = -joints.stiffness[i] * (q[i] - joints.rest[i]) - viscous * v[i]
        torque[i] += sign * joints.limit_stiffness[i] * s * beyond
        by_angle[i] = -joints.stiffness[i] - joints.limit_stiffness[i] * (s + slope * beyond)
        by_angle[i] += sign * joints.limit_damping * slope * v[i]
        by_rate[i] = -viscous
    return torque, by_angle, by_rate


@compile_kernel
def residual(
    surface: DeviceData, joints: Joints, at: StepStart, h: float, v: Array, r: Array, slopes: bool
) -> tuple[Array, Array, Array]:
    """Momentum and constraint left over (n + m,), their tangent if `slopes` are asked for, and the
    device's wrench, where the rates at the end of the step are v (nq,) and the reactions r (m,)."""
    # the device and the joints at the end of the step
    n, m = len(v), len(r)
    twist = apply(at.tip, v)
    wrench, by_position, by_twist = device_response(
        surface, plus(at.position, h, twist[:3]), twist, slopes
    )
    torque, by_angle, by_rate = joint_torques(joints, plus(at.angles, h, v), v)
    # momentum: M (v - v0) - h tau; constraint: J v + drift / h
    total = plus(plus(torque, 1.0, at.torque), 1.0, apply(at.by_rate, v))
    total = plus(total, 1.0, apply_transpose(at.tip, wrench))
    total = plus(total, 1.0, apply_transpose(at.held, r))
    left = plus(apply(at.mass, plus(v, -1.0, at.rates)), -h, total)
    off = plus(apply(at.held, v), 1.0 / h, at.drift)
    tangent = np.zeros((n + m, n + m))
    if not slopes:
        return concatenate(left, off), tangent, wrench
    # tangent by rates and reactions; a position at the end follows its rate by h
    for i in range(6):
        for j in range(3):
            by_twist[i, j] += h * by_position[i, j]
    by_tip = multiply_transpose(at.tip, times(by_twist, at.tip))
    put(tangent, 0, 0, combine(1.0, at.mass, -h, combine(1.0, at.by_rate, 1.0, by_tip)))
    for i in range(n):
        tangent[i, i] -= h * (by_rate[i] + h * by_angle[i])
        for k in range(m):
            tangent[n + k, i], tangent[i, n + k] = at.held[k, i], -h * at.held[k, i]
    return concatenate(left, off), tangent, wrench


@compile_kernel
def step(
    surface: DeviceData, joints: Joints, at: StepStart, h: float, reaction: Array, tolerance: float
) -> tuple[bool, Array, Array, Array, float]:
    """Whether Newton's iteration came below `tolerance` (N m, of the torques); then, at the end of
    the step, rates (nq,), reactions (m,), the device's wrench (6,), and what it dissipated (J).

    A step is halved while it does not lower the residual: the law of friction has kinks."""
    n, v, r, size = len(at.rates), at.rates, reaction, np.inf
    move, left, tangent = np.zeros(n + len(reaction)), np.zeros(0), np.zeros((0, 0))
    for k in range(MOST_TRIALS):
        # residual ahead of the last point by the move (the first time: none)
        slopes = k > 0  # at rest the first guess is the answer
        ahead, after = plus(v, -1.0, move[:n]), plus(r, -1.0, move[n:])
        trial, slope, wrench = residual(surface, joints, at, h, ahead, after, slopes)
        trial_size = _size(trial, n, h)
        if trial_size <= tolerance:
            lost = h * _dissipation(surface, at, h, ahead, wrench)
            return True, ahead, after, wrench, lost
        if not slopes:
            continue
        # accept it and take Newton's move from there, or halve the move
        if trial_size < size or k == 1:
            v, r, size, left, tangent = ahead, after, trial_size, trial, slope
            move = solve_dense(tangent, left)
        else:
            move = plus(move, -0.5, move)
    return False, v, r, np.zeros(6), 0.0


@compile_kernel
def _dissipation(surface: DeviceData, at: StepStart, h: float, v: Array, wrench: Array) -> float:
    """W: the elastic part's power less the device's."""
    twist = apply(at.tip, v)
    elastic = elastic_force(surface, plus(at.position, h, twist[:3]))
    return dot(elastic, twist[:3]) - dot(wrench, twist)


@compile_kernel
def _size(left: Array, n: int, h: float) -> float:
    """The residual's size, N m: the largest torque left over; a rate of 1 m/s off a constraint
    counts as 1 N m."""
    largest = 0.0
    for i in range(len(left)):
        size = abs(left[i]) / h if i < n else abs(left[i])
        if not size <= largest:
            largest = size
    return largest


@compile_kernel
def arms(now: Readings, tendons: int) -> Array:
    """The moment arms (nt, nq) m: the shortening of each tendon per rad."""
    out = np.zeros((tendons, len(now.bias)))
    for k in range(len(now.path)):
        out[now.path_row[k], now.path_column[k]] = -now.path[k]
    return out


@compile_kernel
def instant(
    now: Readings,
    angles: Array,
    rates: Array,
    tension: Array,
    stiffness: Array,
    turned: Array,
    h: float,
) -> StepStart:
    """The start of a step under tensions (nt,) N that fall with the tendons' shortening by
    `stiffness` (nt,) N/m; turned: (3,) gap of the tip's turn from the one held."""
    # mass, and damping of tendons whose tension falls as they shorten
    n = len(angles)
    mass, by_rate = np.zeros((n, n)), np.zeros((n, n))
    arm = arms(now, len(tension))
    for i in range(n):
        for j in range(n):
            mass[i, j] = now.mass[now.mass_at[i, j]]
            for t in range(len(stiffness)):
                by_rate[i, j] -= h * arm[t, i] * stiffness[t] * arm[t, j]
    torque = plus(apply_transpose(arm, tension), -1.0, now.bias)
    # the tip's Jacobian in the device's axes, the support's, and how far it has drifted
    tip, gap = np.zeros((6, n)), plus(now.tip, -1.0, now.target)
    put(tip, 0, 0, multiply_transpose(now.frame, now.jacobian[:3]))
    put(tip, 3, 0, multiply_transpose(now.frame, now.jacobian[3:]))
    held, drift = times(now.basis, now.jacobian), apply(now.basis, concatenate(gap, turned))
    place = apply_transpose(now.frame, gap)
    return StepStart(angles, rates, mass, torque, by_rate, tip, place, held, drift)


@compile_kernel
def advance_step(
    surface: DeviceData,
    joints: Joints,
    now: Readings,
    at: tuple[Array, Array, Array],
    pull: tuple[Array, Array],
    more: tuple[Array, Array, Array],
    h: float,
    tolerance: float,
) -> tuple[bool, Array, Array, Array, Array, Array, float, float]:
    """One step from angles, rates and reactions `at`, under tensions and their stiffness `pull`;
    more: the tip's turn, and torques (nq,) from elsewhere with their slopes (nq, nq).

    Whether it converged, then at its end angles, rates, reactions, the wrench on the tip (6,) in
    the world, tensions, kinetic energy and what the device dissipated (J)."""
    # the start of the step, with the torques from elsewhere
    start = instant(now, at[0], at[1], pull[0], pull[1], more[0], h)
    for i in range(len(at[1])):
        start.torque[i] += more[1][i]
        for j in range(len(at[1])):
            start.by_rate[i, j] += h * more[2][i, j]
    # Newton on rates and reactions
    done, v, r, local, slip = step(surface, joints, start, h, at[2], tolerance)
    # back to the world: wrench on the tip, tensions at the end
    device = concatenate(apply(now.frame, local[:3]), apply(now.frame, local[3:]))
    wrench = plus(apply_transpose(now.basis, r), 1.0, device)
    tension, shortening = pull[0].copy(), apply(arms(now, len(pull[0])), v)
    for t in range(len(tension)):
        tension[t] -= h * pull[1][t] * shortening[t]
    kinetic = 0.5 * dot(v, apply(start.mass, v))
    return done, plus(at[0], h, v), v, r, wrench, tension, kinetic, slip
