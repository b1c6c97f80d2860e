"""A correction of a hood's prediction by what the tangents of the last two steps missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array

MOST_GROWTH = 2.0
"""Largest ratio of the nodes' travel to that of the step before: beyond it that step says nothing
of this one."""


@dataclass(frozen=True)
class Bend:
    """What the tangent of a hood's last step missed.

    `travel` (n, 3) m leads the nodes to the place that the tangent predicted; x (n, 3) m and d (n,
    3) are how far beyond it nodes and directors came to rest; `steady_x` and `steady_d` are what
    of these the step before had shown as well: a node that meets a bone bends once."""

    travel: Array
    x: Array
    d: Array
    steady_x: Array
    steady_d: Array

    @classmethod
    def after_step(cls, before: Bend | None, travel: Array, x: Array, d: Array) -> Bend:
        """The correction after a step, from that of the step before."""
        growth = 0.0 if before is None else before.growth(travel)
        if before is None or growth == 0.0:
            return cls(travel, x, d, np.zeros_like(x), np.zeros_like(d))
        expected = growth**2 * before.x, growth**2 * before.d
        return cls(travel, x, d, _common_part(x, expected[0]), _common_part(d, expected[1]))

    def growth(self, travel: Array) -> float:
        """How much of this step's travel another has; 0 where it is too far from it to tell."""
        size = np.vdot(self.travel, self.travel)
        growth = float(np.vdot(travel, self.travel) / (size or np.inf))
        return growth if abs(growth) <= MOST_GROWTH else 0.0


def _common_part(a: Array, b: Array) -> Array:
    """(n, 3) by node the shorter of two vectors where they point to the same side, else none."""
    alike = np.einsum("ni,ni->n", a, b) > 0
    shorter = np.einsum("ni,ni->n", a, a) < np.einsum("ni,ni->n", b, b)
    return np.where(alike[:, None], np.where(shorter[:, None], a, b), 0.0)
