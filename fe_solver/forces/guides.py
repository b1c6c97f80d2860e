"""What holds nodes of the sheet: ties to bodies, guides that leave some of their motions, and ropes
that run from them through eyelets of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints
from fe_solver.vectors import tangents


@dataclass(frozen=True)
class Ties:
    """k nodes that move rigidly with a body."""

    node: Ints
    """(k,)."""
    body: Ints
    """(k,)."""
    position: Array
    """(k, 3) m, body frame."""
    director: Array
    """(k, 3), body frame."""

    @staticmethod
    def none() -> Ties:
        """No tied nodes."""
        i, v = np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        return Ties(i, i, v, v)


@dataclass(frozen=True)
class Guides:
    """k nodes held along some directions of a body and free along the others."""

    node: Ints
    """(k,) indices."""
    body: Ints
    """(k,) of the node's body."""
    origin: Array
    """(k, 3) m, body frame."""
    axes: Array
    """(k, 3, 3), orthonormal columns, body frame, the first a tendon's pull."""
    held: NDArray[np.bool_]
    """(k, 3) which of the axes the node does not move along."""
    level: Array
    """(k, 3), body frame, the axis of the director's first turn."""
    still: NDArray[np.bool_]
    """(k, 2) whether the director's turns along `level` and across it are held (a mirror plane
    holds the turn along its normal)."""

    @staticmethod
    def along(node: Ints, body: Ints, origin: Array, direction: Array) -> Guides:
        """Nodes that slide along lines of unit `direction` (k, 3), their directors free."""
        axes = np.concatenate([direction[:, :, None], tangents(direction)], axis=2)
        held = np.tile([False, True, True], (len(node), 1))
        return Guides(node, body, origin, axes, held, *_free_turns(len(node)))

    @staticmethod
    def on_body_axes(node: Ints, body: Ints, origin: Array, held: NDArray[np.bool_]) -> Guides:
        """Nodes held along the body's axes that `held` (k, 3) marks, their directors free."""
        axes = np.tile(np.eye(3), (len(node), 1, 1))
        return Guides(node, body, origin, axes, held, *_free_turns(len(node)))

    @staticmethod
    def none() -> Guides:
        """No guided nodes."""
        i, v = np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        return Guides.along(i, i, v, v)

    @property
    def direction(self) -> Array:
        """The first axis (k, 3) of each guide, body frame."""
        return self.axes[:, :, 0]

    @property
    def steady(self) -> NDArray[np.bool_]:
        """Whether (k,) the body turns the director of each guided node."""
        return np.asarray(self.still.any(axis=1))


@dataclass(frozen=True)
class Ropes:
    """k ends of tendons that run straight from a node of the sheet to an eyelet of a body, glide
    through it without friction and go on along `pull`, where the muscle is."""

    node: Ints
    """(k,)."""
    body: Ints
    """(k,)."""
    eyelet: Array
    """(k, 3) m, body frame."""
    pull: Array
    """(k, 3), unit, body frame."""
    length: Array
    """(k,) m from node to eyelet where the excursion is zero."""
    share: Array
    """(nt, k) of each tendon's tension in each rope."""
    tendons: tuple[str, ...] = ()
    """(nt,) names, for messages."""

    @staticmethod
    def none(tendons: int = 0) -> Ropes:
        """No ropes, of so many tendons."""
        i, v = np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        return Ropes(i, i, v, v, np.zeros(0), np.zeros((tendons, 0)))

    def arm(self, rotation: Array) -> Array:
        """The arms (k, 3) m from the bodies' origins to the eyelets, world, with bodies at
        `rotation` (nb, 3, 3)."""
        return np.asarray(np.einsum("kij,kj->ki", rotation[self.body], self.eyelet))

    def along(self, rotation: Array) -> Array:
        """The unit directions (k, 3) in which the muscles pull, world."""
        return np.asarray(np.einsum("kij,kj->ki", rotation[self.body], self.pull))

    def name(self, rope: int) -> str:
        """The tendons that a rope is of, as their user knows them."""
        if not self.tendons:
            return f"rope {rope}"
        return " and ".join(self.tendons[i] for i in np.flatnonzero(self.share[:, rope]))

    def reach(self, x: Array, position: Array, rotation: Array) -> Array:
        """The vectors (k, 3) m from the eyelets to the nodes at x (n, 3), world."""
        return np.asarray(x[self.node] - position[self.body] - self.arm(rotation))

    def lines(self, x: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Lengths (k,) m and unit directions (k, 3) from the eyelets to the nodes at x (n, 3)."""
        reach = self.reach(x, position, rotation)
        length = np.linalg.norm(reach, axis=1)
        return length, reach / np.where(length > 0, length, 1.0)[:, None]


def _free_turns(count: int) -> tuple[Array, NDArray[np.bool_]]:
    return np.tile([1.0, 0.0, 0.0], (count, 1)), np.zeros((count, 2), dtype=bool)
