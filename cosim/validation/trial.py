"""What a validation is made of: trials, targets, and the trials' results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from cosim.results.compare import Comparison, Kind, Target

Summaries = Mapping[str, Mapping[str, Any]]
"""The summaries of the trials that converged, by name."""


@dataclass(frozen=True)
class Trial:
    """A case with settings of its own, or the `study` of experiments on lengths and cuts of
    this name."""

    name: str
    case: str
    settings: tuple[str, ...] = ()
    study: str = ""
    muscle: str = ""
    """That which is loaded, or of several the one that the measured number is of."""
    posture: str = ""
    """MCP/PIP/DIP, deg; empty where the case's own is asked for."""
    published: str = ""
    """The moduli of a published hood's own file, which is the case: soft, average or stiff."""


def angles_of(posture: str) -> tuple[float, float, float]:
    """MCP, PIP and DIP, deg, of a posture in words."""
    mcp, pip, dip = map(float, posture.split("/"))
    return mcp, pip, dip


def posture_settings(mcp: float, pip: float, dip: float) -> tuple[str, ...]:
    """The settings of a posture, deg."""
    angles = {"MCP": mcp, "PIP": pip, "DIP": dip}
    return tuple(f'finger.posture.{j}="{a:g} deg"' for j, a in angles.items())


@dataclass(frozen=True)
class TrialGroup:
    """Trials, and the rows that compare what they said with references of one kind.

    A `variant` is another model beside numbers that the shipped hood is judged by, or those numbers
    once more in another form: it has a tally of its own and does not count in that of its kind."""

    name: str
    kind: Kind
    trials: tuple[Trial, ...]
    targets: tuple[Target, ...]
    """The measured values by trial, which their `case` names."""
    variant: bool = False
    partners: Mapping[str, str] = field(default_factory=dict)
    """By trial, the same load's trial with the fixed split, which is a null model."""
    hands: Mapping[str, tuple[Target, ...]] = field(default_factory=dict)
    """What was measured hand by hand."""
    derived: Callable[[Summaries], Iterator[Comparison]] | None = None
    """Rows that take more than one trial."""

    @property
    def listed(self) -> str:
        """The group's name and kind, as a list of all names it."""
        return f"{self.name} ({self.kind}{', variant' if self.variant else ''})"
