"""One line of the verification table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Row:
    """A computed quantity beside its target.

    `measure` says how the error is taken: relative to the target, as the absolute difference, or
    "bound" for a quantity that must not exceed its target.  `order` is the measured order of
    convergence where two meshes were solved; `source` says where the target is from."""

    name: str
    quantity: str
    target: float
    computed: float
    tolerance: float
    source: str
    measure: Literal["relative", "absolute", "bound"] = "relative"
    order: float | None = None

    @property
    def error(self) -> float:
        """Relative or absolute error; of a bound, what exceeds it (0 where nothing does)."""
        difference = self.computed - self.target
        if self.measure == "bound":
            return max(difference, 0.0)
        scale = abs(self.target) if self.measure == "relative" else 1.0
        return abs(difference) / scale

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; NaN never is."""
        return self.error <= self.tolerance
