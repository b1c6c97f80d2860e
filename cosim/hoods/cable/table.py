"""What a case may say of a hood of cables."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import Posture
from cosim.hoods.supports import Contact, Spring
from cosim.schema import units
from cosim.schema.fields import fault, name_of, quantity
from cosim.schema.types import ExtraLength, Modulus, Number, Section, Table
from meshes.cable_net import CABLES
from meshes.hood_mesh import SPRINGS


class Cable(Table):
    """A cable, or each of its kind on either side and in each row: cross-section, tangent modulus
    beyond the toe, and how much longer than laid out it is, m."""

    section: Section
    modulus: Modulus
    extra_length: ExtraLength = 0.0


class CableMesh(Table):
    """Our own net, laid out on the bones in `rest_posture`, where it is free of stress but for the
    residual tension, in cells of about `spacing`, m."""

    spacing: Annotated[float, quantity(units.LENGTH, least="0.3 mm", most="5 mm")]
    rest_posture: Posture


class CableHood(Table):
    """A net of cables that bear tension alone, over the bones: the tendinous rhombus.  The law of
    each is quadratic up to the strain `toe`, then straight; `residual_tension` (N) beside it keeps
    slack cables from being mechanisms.  `contact.offset` is where their centre lines touch."""

    kind: Literal["cable"]
    mesh: CableMesh
    cables: dict[Annotated[str, name_of("cable", CABLES)], Cable]
    toe: Annotated[Number, Field(gt=0, le=0.2)]
    residual_tension: Annotated[float, quantity(units.FORCE, least="1e-4 N", most="1 N")]
    contact: Contact
    springs: dict[Annotated[str, name_of("spring set", SPRINGS)], Spring]

    @model_validator(mode="after")
    def _complete(self) -> CableHood:
        if lacking := [name for name in CABLES if name not in self.cables]:
            raise fault(f"cables: the net also has {', '.join(lacking)}; name them")
        return self
