"""What is known of one time of a `q4ans` model: loads, and the parts of the balance."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from cosim.port import Array, Ints, rotation_matrix
from fe_solver.job.curves import Curve
from fe_solver.q4ans.element import Stressed


class Loads(NamedTuple):
    """The loads of one time, where the bodies are, and the state of contact."""

    time: float
    """s."""
    position: Array
    """(nb, 3) m, of the bodies."""
    rotation: Array
    """(nb, 3, 3), of the bodies."""
    dead: Array
    """(2n, 3) N."""
    pressure: Array | None
    """(ne,) Pa, which follows the quads."""
    multipliers: tuple[Array | float, ...]
    """(k, 4) Pa of each contact pair."""
    met: tuple[Ints | None, ...]
    """(k, 4) triangles of each contact pair; None where they are to be looked for."""

    def carry(self, twists: Array) -> Loads:
        """With the bodies moved by twists (nb, 6) m and rad."""
        turned = rotation_matrix(twists[:, 3:]) @ self.rotation
        return self._replace(position=self.position + twists[:, :3], rotation=turned)


class Unbalanced(NamedTuple):
    """What does not balance."""

    nodes: Array
    """(2n, 3) N with which the nodes resist more than the dead loads ask for: zero at free
    components in equilibrium, reactions at given ones."""
    left: Array
    """(size,) N, of the unknowns."""

    @property
    def size(self) -> float:
        """The norm (N) of what is left; infinite where a law has no answer."""
        size = float(np.linalg.norm(self.left))
        return size if np.isfinite(size) else np.inf


class Source(Enum):
    """What resists."""

    ELEMENT = "element"
    CONTACT = "contact"
    SPRING = "spring"
    LINK = "spring between nodes"
    PRESSURE = "pressure"


class Coming(NamedTuple):
    """What the begin of a phase changes, which comes in over its first increment."""

    fade: Curve
    """What is left of it."""
    off: Array
    """(2n, 3) m by which given components are off their places."""
    force: Array
    """(2n, 3) N with which released conditions still act."""
    wrench: Array
    """(nb, 6) N and N m, likewise on the bodies."""


class Term(NamedTuple):
    """A part of the balance."""

    source: Source
    nodes: Ints
    """(k, m)."""
    force: Array
    """(k, m, 3) N, with which the nodes resist."""
    stiffness: Array
    """(k, 3m, 3m) N/m, its derivative."""
    body: Ints | None = None
    """(k,) on which the nodes act; None where there is none."""
    stressed: Stressed | None = None
    """What elements bear."""

    def product(self, moved: Array) -> Array:
        """The change (k, m, 3) N of the forces by displacements (k, m, 3) m of the nodes."""
        flat = moved.reshape(len(moved), 3 * moved.shape[1], 1)
        return np.asarray((self.stiffness @ flat).reshape(moved.shape))


def turns(before: Array, after: Array) -> Array:
    """The rotation vectors (nb, 3) rad between rotations (nb, 3, 3)."""
    if not len(before):
        return np.zeros((0, 3))
    return Rotation.from_matrix(after @ np.swapaxes(before, 1, 2)).as_rotvec()
