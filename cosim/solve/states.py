"""The equilibria of a case at rest, and the audit of the loaded one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.coupling.equilibrium import Equilibrium
from cosim.coupling.one_way import OneWayPass
from cosim.port import OpenFinger
from cosim.tendons.muscles import MusclePull


@dataclass(frozen=True)
class SecondStart:
    """The loaded equilibrium that was found from another start."""

    scheme: str
    """By which scheme of the coupling."""
    found: Equilibrium | None
    """None where it did not converge."""
    failure: str = ""
    """Why it did not; empty where it did."""


@dataclass(frozen=True)
class OneWaySlide:
    """The loaded equilibrium with all tendons that have friction sliding one way."""

    finger: OpenFinger
    found: Equilibrium | None
    """None where it did not converge."""
    failure: str = ""
    """Why it did not; empty where it did."""


@dataclass(frozen=True)
class States:
    """The two equilibria of an isometric case, and the audit of the loaded one."""

    unloaded: Equilibrium
    loaded: Equilibrium
    reciprocity: float | None
    """None where the hood has no tendons to pull, or rubs on the bones."""
    pull: MusclePull
    """The pull of the muscles that have a fibre, in the loaded state."""
    one_way: OneWayPass | None = None
    """What a one-way pass handed over; None of a coupled equilibrium."""
    second: SecondStart | None = None
    """Where the case asks for it."""
    ways: Mapping[str, OneWaySlide] = field(default_factory=dict)
    """By way of sliding, loading and unloading, of a case whose tendons have friction: what lies
    between them friction can hold."""
