"""A virtual testbed: a planar finger in time whose tendons rub where they are routed.

It stands in for the testbed of Development and Validation of Modeling Framework for Interconnected
Tendon Networks in Robotic and Human Fingers (figure 5), whose measurements are not published.  Each
muscle's force enters at a load cell, crosses the MCP, meets a junction and goes on over connecting
tendons.  Before each joint the tendon turns by the joint's angle round a routing point and rubs
there, as `rigid.chain.capstan` has it of every tendon.  Joints have Coulomb friction that sticks
with a bristle, and viscosity, the fingertip's holder a stiffness.  Time steps are
implicit Euler's; inertia is left out, as slow as the runs are.

Tensions in N, lengths in m, angles in rad; several runs at once, (b, ...).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cases.papers.models.networks.point_contact import VISCOSITY
from cases.papers.models.networks.share_models import tip_jacobians
from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.chain.capstan import free_grip, grip_after, tension_ratio
from rigid.hoods.network import Network

BALANCED = 1e-7
"""N, of a step's residual; torques over ARM."""
ARM = 5e-3
MOST_ITERATIONS, HALVINGS = 60, 12
ROUNDED = 0.02
"""Share of the span between friction's limits that is rounded."""
TOE = 1e-7
"""m, of stretch over which a tendon begins to bear."""
TURN, SHIFT = 1e-8, 1e-10
"""rad and m, of the derivatives' differences."""


@dataclass(frozen=True)
class Bed:
    """A finger on the testbed: joints MCP, PIP and DIP; muscles cross the MCP themselves, all that
    crosses PIP and DIP is connecting tendons."""

    network: Network
    length: Array
    """(3,) m, of the links."""
    friction: float
    """mu, of all routing points."""
    joint_friction: float
    """N m, of each joint."""
    sticking: float = 1e-6
    """m, the presliding distance of the tendons."""
    joint_bristle: float = 10.0
    """N m/rad, of a joint that sticks."""
    viscosity: float = VISCOSITY


class Course(NamedTuple):
    """What is done to the finger at the ends of n equal steps of `dt` s."""

    force: Array
    """(b, n, m) N, at the load cells."""
    dt: float
    tip_stiffness: float
    """N/m, of what holds the fingertip where it begins; 0: free."""
    hold: Array
    """(n, 3) N m/rad by which a hand holds joints at `target`."""
    target: Array
    """(n, 3) rad, of the held joints."""


class BedRecord(NamedTuple):
    """What the finger did, at the ends of the steps."""

    angle: Array
    """(b, n, 3) rad."""
    tip_force: Array
    """(b, n, 2) N on the world, distal and dorsal."""
    tension: Array
    """(b, n, k) N of the connecting tendons at their ends."""


class _State(NamedTuple):
    """Joint angles (b, 3), junctions (b, m), and the grip at both crossings of each tendon
    (b, 2, k) and of each muscle (b, m) at the MCP, and the friction of the joints (b, 3) N m."""

    angle: Array
    junction: Array
    crossing: Array
    entry: Array
    joint: Array


class _Rub(NamedTuple):
    """Friction (N, N m), and the grip or friction that the next step begins with: the corners'
    rounding must not make what sticks creep."""

    force: Array
    memory: Array


class _Forces(NamedTuple):
    """A trial's: residual (b, 3 + m), end tensions (b, k), and friction as in the state."""

    residual: Array
    end: Array
    crossing: Array
    entry: Array
    joint: Array


def tip(length: Array, angle: Array) -> Array:
    """The fingertip's place (..., 2) m, distal and dorsal, at angles (..., 3)."""
    flexion = np.cumsum(angle, axis=-1)
    return np.stack([np.cos(flexion) @ length, -np.sin(flexion) @ length], axis=-1)


def hold_posture(force: Array, dt: float, tip_stiffness: float) -> Course:
    """A course of muscle forces (b, n, m) alone, the fingertip held."""
    none = np.zeros((force.shape[1], 3))
    return Course(force, dt, tip_stiffness, none, none)


def simulate(bed: Bed, start: Array, course: Course) -> BedRecord:
    """The finger from angles `start` (3,), tendons lying without friction there.

    Raises ConvergenceError where a step finds no balance."""
    batch, steps, _ = course.force.shape
    angle = np.broadcast_to(start, (batch, 3)).copy()
    position, _ = bed.network.solve(angle, course.force[:, 0])
    crossing = np.zeros((batch, 2, len(bed.network.stiffness)))
    state = _State(angle, position, crossing, np.zeros_like(position), np.zeros((batch, 3)))
    point, kept = tip(bed.length, start), []
    for k in range(steps):
        state, end = _step(bed, state, course, k, point)
        pushed = course.tip_stiffness * (tip(bed.length, state.angle) - point)
        kept.append((state.angle, pushed, end))
    return BedRecord(*(np.stack(each, axis=1) for each in zip(*kept, strict=True)))


def _step(bed: Bed, before: _State, course: Course, k: int, point: Array) -> tuple[_State, Array]:
    """The state one step on, and the end tensions (b, k): Newton's method with halved steps."""
    x = np.concatenate([before.angle, before.junction], axis=-1)
    change = np.diag([TURN] * 3 + [SHIFT] * before.junction.shape[-1])

    def trial(y: Array) -> _Forces:
        return _balance(bed, before, course, k, point, y)

    found = trial(x)
    for _ in range(MOST_ITERATIONS):
        size = _size(found.residual)
        if (size < BALANCED).all():
            state = _State(x[:, :3], x[:, 3:], found.crossing, found.entry, found.joint)
            return state, found.end
        moved = trial(x + change[:, None]).residual - found.residual
        slope = np.moveaxis(moved, 0, -1) / change.sum(axis=0)
        way = -_solve(slope, found.residual, k)
        x = x + _halve(trial, x, way, size)[:, None] * way
        found = trial(x)
    raise _losses(k, f"off balance by {size.max():.1e} N after {MOST_ITERATIONS} iterations")


def _solve(slope: Array, residual: Array, k: int) -> Array:
    try:
        return np.asarray(np.linalg.solve(slope, residual[..., None])[..., 0])
    except np.linalg.LinAlgError as error:
        raise _losses(k, "without resistance to some motion") from error


def _losses(k: int, how: str) -> ConvergenceError:
    return ConvergenceError(
        f"virtual testbed: step {k} is {how}; keep both ways of the extensors taut, pull and push "
        "less abruptly, or take shorter steps"
    )


def _balance(bed: Bed, before: _State, course: Course, k: int, point: Array, y: Array) -> _Forces:
    """Forces at angles and junctions y (..., b, 3 + m) at the end of step k."""
    network, angle, junction = bed.network, y[..., :3], y[..., 3:]
    turn, slid = angle - before.angle, junction - before.junction
    owner = network.connection.argmax(axis=1)
    crosses = (network.connecting.constant != 0) | (network.connecting.slope != 0)
    stretch = junction[..., owner] - network.lengths(angle)
    end = 0.5 * network.stiffness * (stretch + np.hypot(stretch, TOE))
    passed = _pip_length(network, angle) - _pip_length(network, before.angle)
    distal = _rub(
        bed, before.crossing[..., 1, :], slid[..., owner] - passed, end, angle[..., 2:] * crosses[2]
    )
    over_pip = end + distal.force
    proximal = _rub(
        bed, before.crossing[..., 0, :], slid[..., owner], over_pip, angle[..., 1:2] * crosses[1]
    )
    over_mcp = (over_pip + proximal.force) @ network.connection
    at_mcp = network.direct.lengths(angle) - network.direct.lengths(before.angle)
    entry = _rub(bed, before.entry, slid + at_mcp, over_mcp, angle[..., :1])
    most = np.full_like(turn, bed.joint_friction)
    joint = _limit(before.joint + bed.joint_bristle * turn, -most, most)
    torque = _pull(network, angle, over_mcp, over_pip, end) - joint.force
    torque = torque - bed.viscosity * turn / course.dt
    off = torque + _from_outside(bed, course, k, point, angle)
    pull = course.force[:, k] - over_mcp - entry.force
    return _Forces(
        np.concatenate([off / ARM, pull], axis=-1),
        end,
        np.stack([proximal.memory, distal.memory], axis=-2),
        entry.memory,
        joint.memory,
    )


def _pull(
    network: Network, angle: Array, over_mcp: Array, over_pip: Array, over_dip: Array
) -> Array:
    """The torques (..., 3) N m of tensions over the MCP (..., m), the PIP and the DIP (..., k)."""
    direct, ways = network.direct.at(angle), network.connecting.at(angle)
    arms_and_tensions = (
        (direct[..., 0, :], over_mcp),
        (ways[..., 1, :], over_pip),
        (ways[..., 2, :], over_dip),
    )
    return np.stack([(arms * pull).sum(axis=-1) for arms, pull in arms_and_tensions], axis=-1)


def _from_outside(bed: Bed, course: Course, k: int, point: Array, angle: Array) -> Array:
    """The torques (..., 3) N m of the hand and of what holds the fingertip."""
    pushed = course.tip_stiffness * (tip(bed.length, angle) - point)
    by_tip = np.einsum("...in,...i->...n", tip_jacobians(bed.length, angle)[..., :2, :], pushed)
    return np.asarray(course.hold[k] * (course.target[k] - angle) - by_tip)


def _rub(bed: Bed, before: Array, slid: Array, beyond: Array, bend: Array) -> _Rub:
    """Friction after tendons have slid towards their muscles by `slid` m round points at which they
    turn by `bend` rad, under tensions `beyond` N, from the grip `before`."""
    turn = bed.friction * np.abs(bend)
    free = free_grip(before, slid, bed.sticking)
    rounded = 0.5 * (np.hypot(free + 1.0, 2 * ROUNDED) - np.hypot(free - 1.0, 2 * ROUNDED))
    ratio = tension_ratio(turn, rounded)
    return _Rub(beyond / ratio - beyond, grip_after(before, slid, bed.sticking))


def _limit(stuck: Array, least: Array, most: Array) -> _Rub:
    """Friction between its limits, with rounded corners for Newton's sake."""
    corner = ROUNDED * (most - least) + 1e-12
    force = 0.5 * (least + most + np.hypot(stuck - least, corner) - np.hypot(stuck - most, corner))
    return _Rub(force, np.clip(stuck, least, most))


def _pip_length(network: Network, angle: Array) -> Array:
    """The part (..., k) m of the lengths that the PIP makes."""
    pip, arms = angle[..., 1:2], network.connecting
    return arms.constant[1] * pip + 0.5 * arms.slope[1] * pip**2


def _halve(trial: Callable[[Array], _Forces], x: Array, way: Array, size: Array) -> Array:
    """Shares (b,) of a Newton step, each halved until the residual falls or HALVINGS are done."""
    share = np.ones(len(x))
    for _ in range(HALVINGS):
        worse = ~(_size(trial(x + share[:, None] * way).residual) < size) & (size >= BALANCED)
        if not worse.any():
            break
        share = np.where(worse, share / 2, share)
    return share


def _size(residual: Array) -> Array:
    return np.asarray(np.abs(residual).max(axis=-1))
