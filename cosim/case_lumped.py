"""What a case may say of a hood in lumped form: muscles, springs and moment arms at the joints."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim import units
from cosim.case_fields import fault, name_of, quantity
from cosim.case_types import Number, Table, TendonName

JOINTS = ("MCP", "PIP", "DIP")
"""The joints in flexion; a hood in lumped form has no arms in abduction."""


class Arm(Table):
    """A moment arm, flexion positive: `constant` + `slope` times the joint's angle, m, m/rad."""

    constant: Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")]
    slope: Annotated[float, quantity(units.ARM_SLOPE, least="-50 mm/rad", most="50 mm/rad")] = 0.0


Arms = dict[Annotated[str, name_of("joint", JOINTS)], Arm]
Stiffness = Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")]


class ConnectingTendon(Table):
    """A spring from a muscle's junction to the bones; `rest`: how much slack it has with all joints
    straight, m."""

    muscle: TendonName
    stiffness: Stiffness
    rest: Annotated[float, quantity(units.LENGTH, least="-20 mm", most="20 mm")] = 0.0
    arms: Annotated[Arms, Field(min_length=1)]


class NetworkHood(Table):
    """A network of tendons (Development and Validation of Modeling Framework for Interconnected
    Tendon Networks): `muscles` with the arms at which they cross joints themselves, `connecting`
    tendons from their junctions on.  With `operating_force` the shares depend on posture alone, as
    they are at that force of every muscle."""

    kind: Literal["network"]
    muscles: Annotated[dict[TendonName, Arms], Field(min_length=1)]
    connecting: dict[str, ConnectingTendon]
    operating_force: Annotated[float, quantity(units.FORCE, above="0 N", most="1000 N")] | None = (
        None
    )

    @model_validator(mode="after")
    def _joined(self) -> NetworkHood:
        for name, tendon in self.connecting.items():
            if tendon.muscle not in self.muscles:
                raise fault(
                    f"connecting.{name}: its muscle {tendon.muscle} is not among the hood's "
                    f"muscles; they are {', '.join(self.muscles)}"
                )
        return self


class TwoBandHood(Table):
    """An extensor that parts into a middle and a lateral band (Buchner, Hines and Hemami 1988),
    with the elasticity K between them and the share `lateral_share` of its tension in the lateral
    band where both shifts agree; other `muscles` cross the joints on their own."""

    kind: Literal["two_band"]
    muscles: Annotated[dict[TendonName, Arms], Field(min_length=1)]
    extensor: TendonName = "EDC"
    middle: Annotated[Arms, Field(min_length=1)]
    lateral: Annotated[Arms, Field(min_length=1)]
    elasticity: Stiffness = 500.0
    lateral_share: Annotated[Number, Field(gt=0, lt=1)] = 0.5

    @model_validator(mode="after")
    def _joined(self) -> TwoBandHood:
        if self.extensor not in self.muscles:
            raise fault(
                f"extensor: {self.extensor} is not among the hood's muscles; they are "
                f"{', '.join(self.muscles)}"
            )
        return self
