"""What a case may say of a tendon that stretches, and of a motor behind it."""

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
    """Of the gear: the part of the motor's power that reaches the spool, or of the spool's that
    reaches a motor that is turned back."""
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
