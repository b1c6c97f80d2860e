"""What the steps of a hood tell of the next one beyond its tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array

MOST_GROWTH = 2.0
"""Of the nodes' travel over that of the step before: beyond it that step says nothing of this."""


@dataclass(frozen=True)
class Bend:
    """What the last step of a hood tells of the next: the nodes' `travel` (n, 3) m to the place
    that its tangent foresaw, how far beyond it they came to rest, x (n, 3) m and directors d (n,
    3), and what of that the step before had told as well: a node that meets a bone bends once."""

    travel: Array
    x: Array
    d: Array
    steady_x: Array
    steady_d: Array

    @classmethod
    def told(cls, before: Bend | None, travel: Array, x: Array, d: Array) -> Bend:
        """After a step, from what the step before told."""
        growth = 0.0 if before is None else before.growth(travel)
        if before is None or growth == 0.0:
            return cls(travel, x, d, np.zeros_like(x), np.zeros_like(d))
        told = growth**2 * before.x, growth**2 * before.d
        return cls(travel, x, d, _shared(x, told[0]), _shared(d, told[1]))

    def growth(self, travel: Array) -> float:
        """How much of this step's travel another has; 0 where it is too far from it to tell."""
        size = np.vdot(self.travel, self.travel)
        growth = float(np.vdot(travel, self.travel) / (size or np.inf))
        return growth if abs(growth) <= MOST_GROWTH else 0.0


def _shared(a: Array, b: Array) -> Array:
    """(n, 3) by node the shorter of two vectors where they point to the same side, else none."""
    alike = np.einsum("ni,ni->n", a, b) > 0
    shorter = np.einsum("ni,ni->n", a, a) < np.einsum("ni,ni->n", b, b)
    return np.where(alike[:, None], np.where(shorter[:, None], a, b), 0.0)
