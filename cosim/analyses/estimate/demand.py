"""What muscles are asked for in a posture, as linear equations of their joint torques tau:

    spread y = rows (tau + beside),    y the components that are asked for.

A fingertip held at a point and free to turn there asks for as many torques as the finger has
joints; one clamped against flexion bears a moment too, which is free, and so for one less.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from cosim.analyses.estimate.held_finger import HeldFinger, Torques
from cosim.port import AXES, Array

NOTHING = 1e-12


@dataclass(frozen=True)
class Demand:
    """Equations (k) of d components."""

    names: tuple[str, ...]
    unit: str
    """The components' unit: N or N m."""
    spread: Array
    """(k, d)."""
    rows: Array
    """(k, nq)."""
    beside: Array
    """(nq,) N m."""

    def component_values(self, torque: Array) -> Array:
        """The components (d,) that muscles' torques (nq,) make, in the sense of least squares where
        no such components balance them."""
        need = self.rows @ (torque + self.beside)
        return np.array(np.linalg.lstsq(self.spread, need, rcond=None)[0])


def torque_demand(held: HeldFinger) -> Demand:
    """Every joint's torque of hood and muscles together."""
    joints = held.models.finger.joints
    every = np.eye(len(joints))
    return Demand(joints, "N m", every, every, np.zeros(len(joints)))


def force_demand(held: HeldFinger, at: Torques, free_axes: Collection[str] = ()) -> Demand:
    """The force of the fingertip on the world, world frame, with the finger in equilibrium: in its
    plane alone for a planar finger; what acts along `free_axes` is left open.

    Raises InputError where nothing holds the tip."""
    slope, force = held.support(at)
    borne = np.abs(force).max(axis=1) > NOTHING
    axes = [i for i, axis in enumerate(AXES) if borne[i] and axis not in free_axes]
    inverse = np.linalg.pinv(force)
    fixed = force[axes]
    free = np.linalg.svd(fixed)[2][np.linalg.matrix_rank(fixed) :].T
    rows = _left_null(slope @ free)
    spread = -rows @ slope @ inverse[:, axes]
    return Demand(tuple(AXES[i] for i in axes), "N", spread, rows, held.beside())


def _left_null(matrix: Array) -> Array:
    """Orthonormal rows (k, n) that vanish on the columns of (n, m)."""
    if matrix.shape[1] == 0:
        return np.eye(len(matrix))
    vectors, values, _ = np.linalg.svd(matrix)
    rank = int((values > NOTHING * max(values.max(initial=0.0), NOTHING)).sum())
    kept: Array = vectors[:, rank:].T
    return kept
