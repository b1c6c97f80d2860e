"""What a case may say of a tendon that stretches, and of a motor or an air cylinder behind it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Number, Table


class ElasticConfig(Table):
    """A tendon as a spring that only pulls, between what draws its end and its path:

        T = k (drawn - shortening of the path - slack),    at least 0,

    with k stated, or modulus times section over length."""

    stiffness: (
        Annotated[float, quantity(units.STIFFNESS, least="0.01 N/mm", most="1e5 N/mm")] | None
    ) = None
    """Stiffness of the whole tendon."""
    modulus: Annotated[float, quantity(units.PRESSURE, least="1 MPa", most="500 GPa")] | None = None
    """Young's modulus, in place of the stiffness; tendons have some 1 GPa."""
    section: (
        Annotated[float, quantity(units.AREA, least="0.001 mm**2", most="100 mm**2")] | None
    ) = None
    """Cross-section, beside the modulus."""
    length: Annotated[float, quantity(units.LENGTH, least="1 mm", most="2000 mm")] | None = None
    """Length that stretches, beside the modulus."""
    slack: Annotated[float, quantity(units.LENGTH, least="0 mm", most="50 mm")] = 0.0
    """How far the end is drawn before the tendon bears."""

    @model_validator(mode="after")
    def _one_way(self) -> ElasticConfig:
        parts = (self.modulus, self.section, self.length)
        if (self.stiffness is None) == (None in parts) or (
            self.stiffness is not None and parts != (None, None, None)
        ):
            raise fault(
                'takes a stiffness (for example stiffness = "50 N/mm"), or modulus, section and '
                "length together"
            )
        return self

    @property
    def rate(self) -> float:
        """The stiffness k, N/m."""
        if self.stiffness is not None:
            return self.stiffness
        modulus, section, length = self.modulus, self.section, self.length
        assert modulus is not None
        assert section is not None
        assert length is not None
        return modulus * section / length


class MotorConfig(Table):
    """A motor that winds an elastic tendon on a spool, through a gear, in a motion.

    The command, times the tendon's signal: a torque, or how far the tendon's end is drawn; the
    motor then turns towards it with a torque that rises to the greatest over `band`, critically
    damped.  Its torque falls from the greatest, at rest, to none at the greatest speed, as a
    direct-current motor's does.  The tendon holds the gear on one flank, so that its backlash is
    passed once, at first."""

    kind: Literal["motor"]
    torque: Annotated[float, quantity(units.TORQUE, least="0 N*mm", most="1e5 N*mm")] | None = None
    """Torque of the motor that is commanded."""
    position: Annotated[float, quantity(units.LENGTH, least="-100 mm", most="100 mm")] | None = None
    """In place of the torque: how far the tendon's end is drawn."""
    spool: Annotated[float, quantity(units.LENGTH, least="0.5 mm", most="200 mm")]
    """Radius of the spool."""
    gear: Annotated[Number, Field(ge=0.01, le=10000)] = 1.0
    """Turns of the motor for one turn of the spool."""
    efficiency: Annotated[Number, Field(ge=0.05, le=1)] = 1.0
    """The part of the motor's power that the gear brings to the spool, or of the spool's to a motor
    that is turned back."""
    backlash: Annotated[float, quantity(units.ANGLE, least="0 deg", most="45 deg")] = 0.0
    """Play of the gear at the spool."""
    greatest_torque: Annotated[float, quantity(units.TORQUE, above="0 N*mm", most="1e5 N*mm")]
    """Greatest torque of the motor, at rest."""
    greatest_speed: (
        Annotated[float, quantity(units.ANGULAR_RATE, above="0 rad/s", most="1e5 rad/s")] | None
    ) = None
    """Speed of the motor at which it has no torque left; without it the torque has no such end."""
    inertia: Annotated[float, quantity(units.INERTIA, least="0 kg*mm**2", most="1e4 kg*mm**2")] = (
        0.0
    )
    """Moment of inertia of motor and gear about the motor's axis; at the tendon it counts times
    the square of gear over spool."""
    band: Annotated[float, quantity(units.LENGTH, least="0.001 mm", most="10 mm")] = 5e-4
    """Way from the commanded position at which the motor has its greatest torque."""

    @model_validator(mode="after")
    def _one_way(self) -> MotorConfig:
        if (self.torque is None) == (self.position is None):
            raise fault(
                'takes one command: a torque (for example torque = "20 N*mm") or how far the '
                'tendon is drawn (position = "8 mm")'
            )
        return self


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
