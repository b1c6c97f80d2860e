"""Springs between hood nodes and points of a rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Springs:
    """Springs of energy k (l - l0)^2 / 2, zero for l < l0 where `tension_only`.

    node (k,), body (k,) indices; anchor (k, 3) in the body frame, m; stiffness (k,) N/m; length
    (k,) slack length l0, m; tension_only (k,) bool; group (k,) index of the set that a spring is
    of."""

    node: Ints
    body: Ints
    anchor: Array
    stiffness: Array
    length: Array
    tension_only: NDArray[np.bool_]
    group: Ints

    @staticmethod
    def none() -> Springs:
        i, f = np.zeros(0, dtype=np.intp), np.zeros(0)
        return Springs(i, i, np.zeros((0, 3)), f, f, np.zeros(0, dtype=bool), i)


@dataclass(frozen=True)
class PointForces:
    """Forces between hood nodes and bodies that act along one line at one point.

    gradient (k, 3) of the energy by the node's position (so the node feels its opposite and the
    body feels it); hessian (k, 3, 3); arm (k, 3) point of action from the body's origin, world;
    turns (k,) bool: the force turns with the body (contact) or follows the point (spring).

    Each force is that of a one-sided spring of `stiffness` (k,) N/m in its `depth` (k,) m, which
    grows along the unit `direction` (k, 3): penetration, or stretch; a two-sided spring has no
    depth (inf). Those that are open are listed too, with no force; within `ramp` (k,) m of depth
    zero the force is smoothed."""

    node: Ints
    body: Ints
    energy: float
    gradient: Array
    hessian: Array
    arm: Array
    turns: NDArray[np.bool_]
    group: Ints
    depth: Array
    direction: Array
    stiffness: Array
    ramp: Array


def spring_forces(
    springs: Springs, x: Array, position: Array, rotation: Array, curvature: bool
) -> PointForces:
    """Spring energies at node positions x (n, 3) and body poses (nb, 3), (nb, 3, 3); `curvature`
    keeps the (negative) term of the Hessian that compression makes across a spring."""
    arm = np.einsum("kij,kj->ki", rotation[springs.body], springs.anchor)
    reach = x[springs.node] - position[springs.body] - arm
    length = np.linalg.norm(reach, axis=1)
    direction = reach / np.where(length > 0, length, 1.0)[:, None]
    stretch = length - springs.length
    taut = ~springs.tension_only | (stretch > 0)
    force = np.where(taut, springs.stiffness * stretch, 0.0)
    along = direction[:, :, None] * direction[:, None, :]
    slope = np.where(taut, springs.stiffness, 0.0)
    across = np.divide(force, length, out=slope.copy(), where=length > 0)
    if not curvature:
        across = np.maximum(across, 0)
    hessian = slope[:, None, None] * along + across[:, None, None] * (np.eye(3) - along)
    return PointForces(
        springs.node,
        springs.body,
        0.5 * float(force @ stretch),
        force[:, None] * direction,
        hessian,
        arm,
        np.zeros(len(length), dtype=bool),
        springs.group,
        np.where(springs.tension_only, stretch, np.inf),
        direction,
        springs.stiffness,
        np.zeros(len(length)),
    )
