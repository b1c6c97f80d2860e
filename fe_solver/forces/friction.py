"""Friction of points on rigid bodies: Coulomb's law with limits that are held.

An incremental potential: elastic up to the limit, then of constant force (Huber's function of the
slip since the anchor); convex, with a symmetric tangent (Laursen and Simo 1993, Int J Numer Meth
Eng 36:3451, for the augmented treatment with a limit that follows).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array


class Sliding(NamedTuple):
    """Which of k points slide, and how."""

    slides: NDArray[np.bool_]
    """(k,)."""
    along: Array
    """(k, 3), the unit direction of the slip; zero of a point that sticks."""
    size: Array
    """(k,) m, of the slip by which the force's direction turns."""


class Friction(NamedTuple):
    """What the friction of k points acts on, in one frame."""

    slip: Array
    """(k, 3) m since the anchor, in the plane of contact."""
    normal: Array
    """(k, 3), unit, of that plane."""
    stick: Array
    """(k,) N/m, the elastic stiffness of sticking."""
    limit: Array
    """(k,) N."""

    @staticmethod
    def of(away: Array, normal: Array, stick: Array, limit: Array) -> Friction:
        """The friction of points `away` (k, 3) m from their anchors."""
        return Friction(_in_plane(away, normal), normal, stick, limit)

    @staticmethod
    def none(count: int) -> Friction:
        """The friction of points that slide freely."""
        return Friction(*np.zeros((2, count, 3)), *np.zeros((2, count)))

    def turned(self, rotation: Array) -> Friction:
        """In another frame, by the rotation (3, 3) to it."""
        return self._replace(slip=self.slip @ rotation.T, normal=self.normal @ rotation.T)

    def take(self, which: NDArray[np.intp]) -> Friction:
        """The friction of some of the points."""
        return Friction(*(column[which] for column in self))

    def sliding(self) -> Sliding:
        """Which points slide at their present slip."""
        size = np.linalg.norm(self.slip, axis=1)
        slides = self.stick * size > self.limit
        return Sliding(slides, _units(self.slip, np.where(slides, size, 0.0)), size)

    def after(self, before: Sliding, travel: Array) -> Sliding:
        """Which points a step makes slide that moves them by `travel` (k, 3) m, found with them
        sliding as `before`: one that turns back sticks first."""
        end = self.slip + _in_plane(travel, self.normal)
        size = np.linalg.norm(end, axis=1)
        reach = np.where(before.slides, np.einsum("ki,ki->k", end, before.along), size)
        slides = self.stick * reach > self.limit
        new = slides & ~before.slides
        along = np.where(slides[:, None], before.along, 0.0) + _units(end, np.where(new, size, 0.0))
        return Sliding(slides, along, np.where(new, size, before.size))

    def energy(self) -> Array:
        """J (k,)."""
        slides, _, size = self.sliding()
        lost = np.divide(
            self.limit**2, 2 * self.stick, out=np.zeros_like(size), where=self.stick > 0
        )
        return np.where(slides, self.limit * size - lost, self.stick * size**2 / 2)

    def linear(self, s: Sliding) -> tuple[Array, Array]:
        """Gradient (k, 3) N at the present slip and Hessian (k, 3, 3) N/m by the points' places,
        as far as these go on to slide or stick so."""
        ratio = np.divide(self.limit, s.size, out=self.stick.copy(), where=s.slides)
        n, t = self.normal, s.along
        plane = np.eye(3) - n[:, :, None] * n[:, None, :] - t[:, :, None] * t[:, None, :]
        hessian = ratio[:, None, None] * plane
        return self.limit[:, None] * t + np.einsum("kij,kj->ki", hessian, self.slip), hessian


def join_friction(parts: Sequence[Friction]) -> Friction:
    """All points as one."""
    return Friction(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _in_plane(vectors: Array, normal: Array) -> Array:
    return vectors - np.einsum("ki,ki->k", vectors, normal)[:, None] * normal


def _units(vectors: Array, size: Array) -> Array:
    """The vectors (k, 3) over their sizes, zero where these are."""
    size = size[:, None]
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0)
