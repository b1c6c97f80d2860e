"""What a validation is made of: trials, targets, and what the trials said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cosim.compare import Kind, Target

Summaries = Mapping[str, Mapping[str, Any]]
"""Of the trials that converged, by name."""


@dataclass(frozen=True)
class Trial:
    """A case with settings of its own."""

    name: str
    case: str
    settings: tuple[str, ...] = ()

    @property
    def published(self) -> bool:
        """Whether its case is a published hood's own file."""
        return self.name.startswith("published")


@dataclass(frozen=True)
class Group:
    """Trials, and the rows that compare what they said."""

    name: str
    trials: tuple[Trial, ...]
    targets: tuple[Target, ...]
    """By trial, as their `case`."""


def at_most(name: str, quantity: str, unit: str, high: float, source: str, kind: Kind) -> Target:
    """A target that is but an upper bound."""
    return Target(name, quantity, unit, None, None, None, high, source, kind)
