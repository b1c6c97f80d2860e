"""What a case may say of parts that relax under load."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Count, Number, Table

Tissue = Literal["aponeurosis_of_the_sole", "ligament"]
Lasting = Annotated[float, quantity(units.PATIENCE, above="0 s", most="1e7 s")]


class RelaxationLawConfig(Table):
    """How what a part bears falls while it is held, quasi-linearly (Fung): a `tissue` that was
    measured, terms with `weights` and `times`, or Fung's `spectrum` over the times from `shortest`
    to `longest`."""

    tissue: Tissue | None = None
    """A tissue that was measured.  "aponeurosis_of_the_sole": human plantar aponeurosis, 40 % in
    240 s at strains of 4 to 8 % (Pavan et al. 2014, Biomed Res Int 530242), as the spectrum 0.118
    from 0.5 to 1500 s.  "ligament": three terms of 15.4, 16.1 and 68.2 % with 3.77, 148 and 10988 s
    (PMC4407883).  Nobody measured an extensor of the finger."""
    weights: (
        Annotated[tuple[Annotated[Number, Field(ge=0, le=1)], ...], Field(min_length=1)] | None
    ) = None
    """Shares of what is borne at once that each term loses in the end; together at most 1."""
    times: Annotated[tuple[Lasting, ...], Field(min_length=1)] | None = None
    """In which each term falls to 37 %."""
    spectrum: Annotated[Number, Field(ge=0, le=10)] | None = None
    """Fung's C."""
    shortest: Lasting | None = None
    """The spectrum's shortest time."""
    longest: Lasting | None = None
    """The spectrum's longest time."""

    @model_validator(mode="after")
    def _one_way(self) -> RelaxationLawConfig:
        terms, span = (self.weights, self.times), (self.spectrum, self.shortest, self.longest)
        stated = (self.tissue is not None, terms != (None, None), span != (None, None, None))
        if sum(stated) != 1:
            raise fault(
                "write one of the three: tissue; weights and times; or spectrum, shortest and "
                'longest, for example tissue = "aponeurosis_of_the_sole"'
            )
        if (stated[1] and None in terms) or (stated[2] and None in span):
            raise fault("needs both weights and times, or all of spectrum, shortest and longest")
        if self.weights is not None and self.times is not None:
            if len(self.weights) != len(self.times):
                raise fault(f"has {len(self.weights)} weights and {len(self.times)} times")
            if sum(self.weights) > 1 + 1e-12:
                raise fault("weights: add up to more than 1")
        if (self.longest or inf) <= (self.shortest or 0.0):
            raise fault("longest: must be above shortest")
        return self


TISSUES: Mapping[Tissue, RelaxationLawConfig] = {
    "aponeurosis_of_the_sole": RelaxationLawConfig.model_construct(
        spectrum=0.118, shortest=0.5, longest=1500.0
    ),
    "ligament": RelaxationLawConfig.model_construct(
        weights=(0.154, 0.161, 0.682), times=(3.77, 148.0, 10988.0)
    ),
}
"""Their laws; the sources stand at `RelaxationLawConfig.tissue`."""


class CyclesConfig(Table):
    """Loads and unloads one after the other, each half of a period long."""

    count: Annotated[Count, Field(ge=1, le=1_000_000_000)]
    """How many."""
    period: Lasting
    """How long each takes, up and down."""
    least: Annotated[Number, Field(ge=0, le=1)] = 0.0
    """To which share of the stated tensions, activations and excursions the load falls."""


class RelaxationConfig(Table):
    """What relaxes under load, from the start of the load on; what is borne at rest before that
    does not.  The stiffnesses that the case states are those at once."""

    hood: RelaxationLawConfig | None = None
    """Sheet or cables and springs of the hood."""
    tendons: RelaxationLawConfig | None = None
    """The elastic tendons whose ends are drawn (`excursion`)."""
    joints: RelaxationLawConfig | None = None
    """The passive joint torques."""
    held: Lasting | None = None
    """In an equilibrium: how long after the load was put on."""
    cycles: CyclesConfig | None = None
    """In an equilibrium, in place of `held`: the last of so many loads."""

    @model_validator(mode="after")
    def _of_something(self) -> RelaxationConfig:
        if (self.hood, self.tendons, self.joints) == (None, None, None):
            raise fault(
                'says nothing of what relaxes; add for example hood = { tissue = "ligament" }'
            )
        return self
