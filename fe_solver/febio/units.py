"""The units of a FEBio 4 file, which has none of its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """The file's units of length and force, those of all else following with the second.

    >>> from fe_solver.febio.units import Units
    >>> Units(1e-3, 1.0).stress  # MPa, of mm and N
    1000000.0
    """

    length: float
    """m."""
    force: float
    """N."""

    @property
    def stress(self) -> float:
        """Pa."""
        return self.force / self.length**2

    @property
    def density(self) -> float:
        """kg/m3."""
        return self.force / self.length**4
