"""The hood in an FMU: what a case may say of it, and how it is started."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from cosim.fmu.quantity import HOOD_QUANTITIES
from cosim.fmu.table import FmuTable
from cosim.hoods.kind import FINGERS, BuiltHood, HoodBuilder, HoodConfig, HoodKind, Site
from cosim.schema import units
from cosim.schema.fields import name_of, quantity
from cosim.schema.types import TendonName


class FmuHoodConfig(FmuTable, HoodConfig):
    """A hood in an FMU of FMI 2 or 3, which is a program and runs as one.  `tendons` and `sources`
    name its own, in its order; `map` says, by quantity, how its variables are called where they are
    not called as in our own units; `rest_step` is a communication step in which it comes to rest,
    for one without the switch `static`."""

    title: ClassVar[str] = "a hood in an FMU"
    fits: ClassVar[tuple[str, ...]] = (*FINGERS, "planar", "hinge", "robot", "fmu")
    needs_no_tension: ClassVar[bool] = False
    kind: Literal["fmu"]
    tendons: Annotated[tuple[TendonName, ...], Field(min_length=1)]
    """Its tendons, in its order."""
    sources: Annotated[tuple[str, ...], Field(min_length=1)]
    """Its sources of load (springs, contact, insertions), in its order."""
    map: dict[Annotated[str, name_of("quantity", HOOD_QUANTITIES)], str] = Field(
        default_factory=dict
    )
    """How its variables are called, by quantity, where not as in our own units."""
    rest_step: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] | None = None
    """Communication step in which it comes to rest, of a unit without the switch `static`."""

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return self.tendons

    def source_names(self) -> tuple[str, ...]:
        return self.sources


def build(hood: FmuHoodConfig, site: Site) -> BuiltHood:
    """The hood in an FMU, which runs code of the archive. Raises InputError for one that cannot be
    opened."""
    from cosim.fmu.hood import FmuHood as Unit

    names = site.rest.bodies, hood.tendons, hood.sources
    unit = Unit(
        hood.path,
        *names,
        hood.map,
        rest_step=hood.rest_step,
        **hood.speech(),
    )
    return BuiltHood(unit)


BUILDER = HoodBuilder(build)
KIND = HoodKind(FmuHoodConfig, f"{__name__}:BUILDER")
