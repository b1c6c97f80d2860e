"""What a case may say of a tendon that a pneumatic cylinder pulls, in a motion."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Number, Table

GaugePressure = Annotated[float, quantity(units.PRESSURE, least="0 MPa", most="2 MPa")]
Supply = Annotated[float, quantity(units.PRESSURE, above="0 MPa", most="2 MPa")]
Diameter = Annotated[float, quantity(units.LENGTH, above="0 mm", most="100 mm")]
RodDiameter = Annotated[float, quantity(units.LENGTH, least="0 mm", most="100 mm")]
Stroke = Annotated[float, quantity(units.LENGTH, above="0 mm", most="500 mm")]


class PneumaticConfig(Table):
    """A double-acting cylinder, its rod's side on a proportional valve and its other side open to
    the atmosphere, so that it pulls and never pushes.

    The command, times the tendon's signal: a valve voltage, 0 (exhaust) to 10 V (fill), or a wanted
    pressure above the atmosphere's, for which the valve is given the voltage that settles there.
    What else is not stated is as `rigid.air.plant` has it, whose sizes are in part assumed."""

    kind: Literal["pneumatic"]
    voltage: Annotated[float, quantity(units.VOLTAGE, least="0 V", most="10 V")] | None = None
    pressure: GaugePressure | None = None
    supply: Supply | None = None
    """Pa above the atmosphere; 90 psi."""
    delay: Annotated[float, quantity(units.TIME, least="0 s", most="1 s")] | None = None
    """Dead time from a command to the valve."""
    lag: Annotated[float, quantity(units.TIME, least="1e-4 s", most="1 s")] | None = None
    """Time constant of the spool."""
    conductance: (
        Annotated[float, quantity(units.CONDUCTANCE, above="0 m**3/s/Pa", most="1e-6 m**3/s/Pa")]
        | None
    ) = None
    """Sonic conductance of the open valve (ISO 6358)."""
    critical_ratio: Annotated[Number, Field(ge=0.05, le=0.9)] | None = None
    underlap: Annotated[Number, Field(ge=0.01, le=1)] | None = None
    """Opening of both edges at 5 V, over the full one."""
    bore: Diameter | None = None
    rod: RodDiameter | None = None
    stroke: Stroke | None = None
    start: Annotated[Number, Field(ge=0, le=1)] = 0.5
    """How far the piston is drawn in at the start, over the stroke."""
    dead_volume: (
        Annotated[float, quantity(units.VOLUME, least="100 mm**3", most="1e6 mm**3")] | None
    ) = None
    friction: Annotated[float, quantity(units.FORCE, least="0 N", most="100 N")] | None = None
    heat: Annotated[float, quantity(units.HEAT, least="0 W/K", most="100 W/K")] | None = None
    """From the walls to the air: 0 adiabatic, much of it isothermal."""

    @model_validator(mode="after")
    def _one_way(self) -> PneumaticConfig:
        if (self.voltage is None) == (self.pressure is None):
            raise fault(
                'takes one command: a voltage (for example voltage = "5.2 V") or a wanted pressure '
                '(pressure = "0.2 MPa")'
            )
        return self
