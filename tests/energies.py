"""What a motion's energies must add up to."""

from __future__ import annotations

from collections.abc import Mapping

DONE = ("tendons", "own_tendons", "gravity")


def work_done(energy: Mapping[str, float]) -> float:
    """mJ, by tendons and gravity."""
    return sum(energy.get(name, 0.0) for name in DONE)


def work_kept(energy: Mapping[str, float]) -> float:
    """mJ: stored, dissipated, or taken by the method."""
    return sum(value for name, value in energy.items() if name not in DONE)
