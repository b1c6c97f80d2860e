"""Where the markers sit on their bones, and where each cylinder's zero is, from many poses at once.

All angles q_i, places p and zeros z together make the least

    sum_i |x(q_i, p) - x_i|^2 / s_x^2 + |L(q_i) + z - l_i|^2 / s_l^2 + |q_i past its stop|^2 / s_q^2

by Gauss-Newton; the angles of each pose are eliminated from the normal equations (their blocks are
apart), which leaves the places and zeros.  Markers alone cannot tell the DIP's zero from a turn of
the fingertip's marker about its axis.  The excursions do, by arms that change with the angle, but
weakly: from 460 poses the marker has a standard deviation of 0.95 mm, and no weighting of these
data has less.  What tells it is that the finger has stops: where the poses span the workspace,
angles of a wrong zero leave table II at one end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.chain.kinematics import Indices
from rigid.chain.pose import BodyMarkers
from rigid.mujoco.finger import MujocoFinger

MOST_ROUNDS = 30
SMALL_MOVE = 1e-6
"""m, a move of the places that ends the search."""
WEIGHT = 1e-6
"""Weight of the angles against the weighted squares: bounds what no measurement determines."""
STOP = float(np.radians(1.0))
"""rad, by which a stop gives ("approximate joint motion limits", table II).  Assumption; with 2 to
0.1 deg the places are found to 0.9 mm or better in 12 worlds."""
UNTOLD = 1e9
"""Condition number of the equations of places and zeros beyond which some of them are not told."""


@dataclass(frozen=True)
class Seen:
    """Averages over the times of rest: markers (n, nm, 3) m in the finger's frame and positions of
    the pistons (n, nt) m, growing as the tendons lengthen."""

    marker: Array
    piston: Array


@dataclass(frozen=True)
class Spread:
    """m: what a marker's coordinate and the pistons' positions (nt,) are off by; `counted`: the
    pistons that are used at all (nt,), those of slack tendons left out."""

    marker: float
    piston: Array
    counted: Array


@dataclass(frozen=True)
class Calibration:
    """The markers as found, the pistons' zeros (nt,) m (NaN of those not counted), the angles
    (n, nq) rad."""

    markers: BodyMarkers
    zero: Array
    angle: Array


def calibrate(
    finger: MujocoFinger, markers: BodyMarkers, seen: Seen, start: Array, spread: Spread
) -> Calibration:
    """From places nearly known and poses `start` (n, nq) of a finger whose ranges are its stops.

    Raises ConvergenceError where the poses do not tell the places, or the search does not end."""
    counted = np.flatnonzero(spread.counted)
    lengths = np.array([finger.tendon_lengths(q) for q in start])
    zero = np.mean(seen.piston - lengths, axis=0)
    angle = np.array(start, dtype=float)
    for _ in range(MOST_ROUNDS):
        parts = [
            _linear(finger, markers, zero, q, (x, y), spread, counted)
            for q, x, y in zip(angle, seen.marker, seen.piston, strict=True)
        ]
        move, turn = _step(parts)
        angle = angle + turn
        places, zeros = np.split(move, [markers.place.size])
        markers = replace(markers, place=markers.place + places.reshape(-1, 3))
        zero[counted] += zeros
        if np.abs(move).max() < SMALL_MOVE:
            return Calibration(markers, np.where(spread.counted, zero, np.nan), angle)
    raise ConvergenceError(
        f"marker places: they still move by {1e3 * np.abs(move).max():.2g} mm after {MOST_ROUNDS} "
        "rounds. Add poses that bend every joint, or measure the places better"
    )


def _linear(
    finger: MujocoFinger,
    markers: BodyMarkers,
    zero: Array,
    angle: Array,
    seen: tuple[Array, Array],
    spread: Spread,
    counted: Indices,
) -> tuple[Array, Array, Array]:
    """The weighted residuals (nr,) of one pose, their derivatives over the angles (nr, nq) and over
    places and zeros (nr, 3 nm + n_counted); residuals are of markers, pistons and stops."""
    point, jacobian = markers.at(finger, angle)
    turn = finger.chain(angle).motion.rotation[markers.body]
    nm, nz = len(point), len(counted)
    piston = spread.piston[counted]
    off = (point - seen[0]).ravel() / spread.marker
    miss = (finger.tendon_lengths(angle) + zero - seen[1])[counted] / piston
    by_angle = np.vstack(
        [
            jacobian.reshape(3 * nm, -1) / spread.marker,
            -finger.moment_arms(angle)[counted] / piston[:, None],
        ]
    )
    beyond, at_stop = _beyond(finger, angle)
    by_place = np.zeros((3 * nm + nz + len(angle), 3 * nm + nz))
    for m in range(nm):
        by_place[3 * m : 3 * m + 3, 3 * m : 3 * m + 3] = turn[m] / spread.marker
    by_place[3 * nm : 3 * nm + nz, 3 * nm :] = np.diag(1 / piston)
    return np.concatenate([off, miss, beyond]), np.vstack([by_angle, at_stop]), by_place


def _beyond(finger: MujocoFinger, angle: Array) -> tuple[Array, Array]:
    """How far the angles are beyond their ranges (nq,), over what a stop gives; its derivatives."""
    low, high = np.array([finger.ranges[joint] for joint in finger.joints]).T
    beyond = (angle - np.clip(angle, low, high)) / STOP
    return beyond, np.diag((beyond != 0.0) / STOP)


def _step(parts: list[tuple[Array, Array, Array]]) -> tuple[Array, Array]:
    """Moves of places and zeros, and turns of the angles (n, nq)."""
    off, by_angle, by_place = (np.array(x) for x in zip(*parts, strict=True))
    own = np.swapaxes(by_angle, 1, 2) @ by_angle + WEIGHT * np.eye(by_angle.shape[2])
    cross = np.swapaxes(by_angle, 1, 2) @ by_place
    pull = np.einsum("irq,ir->iq", by_angle, off)
    held = np.linalg.solve(own, np.concatenate([cross, pull[:, :, None]], axis=2))
    across, along = held[:, :, :-1], held[:, :, -1]
    normal = np.einsum("irp,irs->ps", by_place, by_place) - np.einsum("iqp,iqs->ps", cross, across)
    right = np.einsum("irp,ir->p", by_place, off) - np.einsum("iqp,iq->p", cross, along)
    if np.linalg.cond(normal) > UNTOLD:
        raise ConvergenceError(
            "marker places: these poses do not tell them all. Add poses that bend every joint, and "
            "count the pistons whose tendons stay tight"
        )
    move = -np.linalg.solve(normal, right)
    return move, -(along + across @ move)
