"""Bodies that equilibrium moves, with the nodes that are tied to them: one sparse system.

The unknowns are the free components of the nodes, then the free motions of the bodies: a velocity v
of the body's origin and a spin w in the world's axes (times a length, so that all are m).  A tied
node at the arm r moves by v + w x r.  A part of the balance whose forces f depend on where the
nodes are as a body sees them changes by df = K (dz - v - w x r) + w x f, and the body bears -f
and -r x f.  The tangent is that of these sums; a moment that keeps its axis makes it unsymmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array, Ints, skew
from fe_solver.solver.linear_algebra import RANK
from fe_solver.vectors import cross


class Pull(NamedTuple):
    """Forces on nodes, with their change."""

    nodes: Ints
    """(k, m)."""
    force: Array
    """(k, m, 3) N, with which the nodes resist."""
    stiffness: Array
    """(k, 3m, 3m) N/m, its derivative as the body sees the nodes."""
    body: Ints | None
    """(k,) that bears them; None where there is none."""


class SingularError(ConvergenceError):
    """The system has a motion that nothing resists: of `nodes` (2n, 3) and of `bodies` (nb, 6)."""

    nodes: Array
    bodies: Array

    @classmethod
    def of(cls, nodes: Array, bodies: Array) -> SingularError:
        """The error of a motion."""
        error = cls("a body or the sheet can move without resistance")
        error.nodes, error.bodies = nodes, bodies
        return error


@dataclass(frozen=True)
class BodySystem:
    """The balance of nodes z (N, 3) m and of nb bodies at their poses."""

    free: NDArray[np.bool_]
    """(N, 3) components of nodes that no condition and no body gives."""
    motions: NDArray[np.bool_]
    """(nb, 6) motions of the bodies that equilibrium finds."""
    tied: Ints
    """(N,) the body that a node moves with, -1 where none."""
    length: float
    """m, by which spins are multiplied."""

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return int(self.free.sum() + self.motions.sum())

    def arms(self, z: Array, position: Array) -> tuple[Ints, Ints, Array]:
        """Nodes (k,) that are tied to bodies which may move, these (k,) and the arms (k, 3) m."""
        moves = np.asarray(self.motions.any(axis=1))
        nodes = np.flatnonzero((self.tied >= 0) & moves[self.tied])
        body = self.tied[nodes]
        return nodes, body, z[nodes] - position[body]

    def spread(self, z: Array, position: Array) -> sp.csr_array:
        """The motion (3N + 6nb, size) of all nodes and bodies by the unknowns."""
        nz, nb = self.free.size, len(self.motions)
        own = np.concatenate([self.free.ravel(), self.motions.ravel()])
        number = np.where(own, np.cumsum(own) - 1, -1)
        scale = np.ones(len(own))
        scale[nz:].reshape(nb, 6)[:, 3:] = 1 / self.length
        rows, columns = [np.flatnonzero(own)], [number[own]]
        data = [scale[own]]
        nodes, body, arm = self.arms(z, position)
        moved = np.concatenate([np.tile(np.eye(3), (len(nodes), 1, 1)), -skew(arm)], axis=2)
        row = np.broadcast_to((3 * nodes[:, None] + np.arange(3))[:, :, None], moved.shape)
        slot = nz + 6 * body[:, None] + np.arange(6)
        column = np.broadcast_to(number[slot][:, None], moved.shape)
        kept = (column >= 0) & (moved != 0)
        moved = moved * scale[slot][:, None]
        rows, columns = [*rows, row[kept]], [*columns, column[kept]]
        data = [*data, moved[kept]]
        place = np.concatenate(rows), np.concatenate(columns)
        shape = (len(own), self.size)
        return sp.csr_array(sp.coo_array((np.concatenate(data), place), shape=shape))

    def tangent(
        self,
        z: Array,
        position: Array,
        pulls: Sequence[Pull],
        unbalanced: Array,
        follower: Array,
    ) -> sp.csr_array:
        """The derivative (3N + 6nb) of what does not balance by the motions of nodes and bodies:
        of the `pulls`, of the nodes' `unbalanced` forces (N, 3) N at the arms of ties, and of
        forces `follower` (nb, 3) N that turn with their bodies."""
        nz, nb = self.free.size, len(self.motions)
        blocks = [_block(p, z, position, nz) for p in pulls if len(p.nodes)]
        nodes, body, arm = self.arms(z, position)
        turned = np.zeros((nb, 6, 6))
        np.add.at(turned[:, 3:, 3:], body, skew(unbalanced[nodes]) @ skew(arm))
        turned[:, :3, 3:] += skew(follower)
        blocks.append((nz + 6 * np.arange(nb)[:, None] + np.arange(6), turned))
        rows = np.concatenate([np.repeat(d, d.shape[1], axis=1).ravel() for d, _ in blocks])
        columns = np.concatenate([np.tile(d, (1, d.shape[1])).ravel() for d, _ in blocks])
        data = np.concatenate([b.ravel() for _, b in blocks])
        size = nz + 6 * nb
        return sp.csr_array(sp.coo_array((data, (rows, columns)), shape=(size, size)))

    def unbalanced(
        self, z: Array, position: Array, pulls: Sequence[Pull], nodal: Array, loads: Array
    ) -> Array:
        """What does not balance (3N + 6nb,) N and N m, of nodes `nodal` (N, 3) N and of bodies
        under `loads` (nb, 6); forces of ties come with `spread`."""
        bodies = -loads
        for p in pulls:
            if p.body is not None and len(p.body):
                arm = z[p.nodes] - position[p.body][:, None]
                wrench = np.concatenate([p.force, cross(arm, p.force)], axis=2).sum(axis=1)
                np.subtract.at(bodies, p.body, wrench)
        return np.concatenate([nodal.ravel(), bodies.ravel()])

    def borne(self, z: Array, position: Array, full: Array) -> Array:
        """What does not balance of the bodies (nb, 6) N and N m, with what their ties bear."""
        nodal, bodies = self.split(full)
        nodes, body, arm = self.arms(z, position)
        out, force = bodies.copy(), nodal[nodes]
        np.add.at(out, body, np.concatenate([force, cross(arm, force)], axis=1))
        return out

    def split(self, motion: Array) -> tuple[Array, Array]:
        """The motions of the nodes (N, 3) and of the bodies (nb, 6) among all (3N + 6nb,)."""
        nz = self.free.size
        return motion[:nz].reshape(-1, 3), motion[nz:].reshape(-1, 6)


def _block(p: Pull, z: Array, position: Array, nz: int) -> tuple[Ints, Array]:
    """The degrees of freedom (k, j) of nodes and bodies that pulls join, and the tangent's blocks
    (k, j, j)."""
    k, m = p.nodes.shape
    dofs = (3 * p.nodes[:, :, None] + np.arange(3)).reshape(k, 3 * m)
    if p.body is None:
        return dofs, p.stiffness
    arm, turned = z[p.nodes] - position[p.body][:, None], skew(p.force)
    unit = np.broadcast_to(np.eye(3), (*arm.shape, 3))
    follows = np.concatenate([unit, -skew(arm)], axis=3).reshape(k, 3 * m, 6)
    by_body = -p.stiffness @ follows
    by_body[:, :, 3:] -= turned.reshape(k, 3 * m, 3)
    of_nodes = np.concatenate([p.stiffness, by_body], axis=2)
    of_body = -np.swapaxes(follows, 1, 2) @ of_nodes
    of_body[:, 3:, : 3 * m] += np.swapaxes(turned, 1, 2).reshape(k, 3, 3 * m)
    of_body[:, 3:, 3 * m : 3 * m + 3] -= turned.sum(axis=1)
    dofs = np.concatenate([dofs, nz + 6 * p.body[:, None] + np.arange(6)], axis=1)
    return dofs, np.concatenate([of_nodes, of_body], axis=1)


@dataclass(frozen=True)
class BodyFactor:
    """The factorised tangent of the unknowns."""

    full: sp.csr_array
    """(3N + 6nb) the tangent by all motions."""
    spread: sp.csr_array
    lu: spla.SuperLU

    @classmethod
    def of(cls, system: BodySystem, full: sp.csr_array, spread: sp.csr_array) -> BodyFactor:
        """Raises SingularError where a motion meets no resistance."""
        matrix = sp.csc_array(spread.T @ full @ spread)
        try:
            lu = spla.splu(matrix)
        except RuntimeError:
            lu = None
        if lu is None or (pivots := np.abs(lu.U.diagonal())).min() < RANK * pivots.max():
            raise SingularError.of(*system.split(spread @ _loosest(matrix)))
        return cls(full, spread, lu)

    def step(self, left: Array) -> Array:
        """The motion (3N + 6nb,) of all nodes and bodies that takes away what is left of the
        unknowns' balance (size,)."""
        return np.asarray(self.spread @ -self.lu.solve(left))


def _loosest(matrix: sp.csc_array) -> Array:
    """The motion (size,) that a matrix resists least, by inverse iteration."""
    size = abs(matrix).max()
    shifted = spla.splu(sp.csc_array(matrix + 1e-10 * size * sp.eye_array(matrix.shape[0])))
    motion = np.random.default_rng(0).standard_normal(matrix.shape[0])
    for _ in range(5):
        motion = shifted.solve(motion)
        motion /= np.abs(motion).max()
    return np.asarray(motion)
