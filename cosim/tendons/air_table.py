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
    """Voltage of the valve: 0 V exhausts, 10 V fills."""
    pressure: GaugePressure | None = None
    """Wanted pressure above the atmosphere's, in place of `voltage`."""
    supply: Supply | None = None
    """Pressure of the supply above the atmosphere's; by default 90 psi (0.62 MPa)."""
    delay: Annotated[float, quantity(units.TIME, least="0 s", most="1 s")] | None = None
    """Dead time from a command to the valve; by default 30 ms."""
    lag: Annotated[float, quantity(units.TIME, least="1e-4 s", most="1 s")] | None = None
    """Time constant of the spool; by default 1.3 ms."""
    conductance: (
        Annotated[float, quantity(units.CONDUCTANCE, above="0 m**3/s/Pa", most="1e-6 m**3/s/Pa")]
        | None
    ) = None
    """Sonic conductance of the open valve (ISO 6358); by default 3.8 mm**3/s/Pa."""
    critical_ratio: Annotated[Number, Field(ge=0.05, le=0.9)] | None = None
    """Pressure ratio below which the flow is sonic (ISO 6358); by default 0.35."""
    underlap: Annotated[Number, Field(ge=0.01, le=1)] | None = None
    """Opening of both edges at 5 V over the full one; by default 0.1."""
    bore: Diameter | None = None
    """Diameter of the cylinder; by default 9.3 mm."""
    rod: RodDiameter | None = None
    """Diameter of the rod; by default 3 mm."""
    stroke: Stroke | None = None
    """Greatest travel of the piston; by default 37.5 mm."""
    start: Annotated[Number, Field(ge=0, le=1)] = 0.5
    """How far the piston is drawn in at the start, over the stroke."""
    dead_volume: (
        Annotated[float, quantity(units.VOLUME, least="100 mm**3", most="1e6 mm**3")] | None
    ) = None
    """Volume of air that no piston empties, tube included; by default 5000 mm**3."""
    friction: Annotated[float, quantity(units.FORCE, least="0 N", most="100 N")] | None = None
    """Coulomb friction of the piston; by default 0.05 N."""
    heat: Annotated[float, quantity(units.HEAT, least="0 W/K", most="100 W/K")] | None = None
    """Heat from the walls to the air: 0 is adiabatic, much is isothermal; by default 0.5 W/K."""

    @model_validator(mode="after")
    def _one_way(self) -> PneumaticConfig:
        if (self.voltage is None) == (self.pressure is None):
            raise fault(
                'takes one command: a voltage (for example voltage = "5.2 V") or a wanted pressure '
                '(pressure = "0.2 MPa")'
            )
        return self
