"""What a case may say of a hood in an FMU."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.fmu.quantity import HOOD_QUANTITIES
from cosim.schema import units
from cosim.schema.fields import name_of, quantity
from cosim.schema.types import File, Switch, Table, TendonName


class FmuHood(Table):
    """A hood in an FMU of FMI 2 or 3, which is a program and runs as one.  `tendons` and `sources`
    name its own, in its order; `map` says, by quantity, how its variables are called where they are
    not called as in our own units; `rest_step` is a communication step in which it comes to rest,
    for one without the switch `static`."""

    kind: Literal["fmu"]
    path: File
    tendons: Annotated[tuple[TendonName, ...], Field(min_length=1)]
    sources: Annotated[tuple[str, ...], Field(min_length=1)]
    map: dict[Annotated[str, name_of("quantity", HOOD_QUANTITIES)], str] = Field(
        default_factory=dict
    )
    rest_step: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] | None = None
    assume_si: Switch = False
