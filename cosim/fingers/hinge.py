"""What a case may say of a finger of hinges."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.fingers.common import HeldTip, Limit, Passive, PlanarPosture, Tip
from cosim.schema.fields import name_of
from cosim.schema.types import Phalanx, Table


class HingeFinger(Table):
    """The analytic planar finger: three hinges in a row."""

    kind: Literal["hinge"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    posture: PlanarPosture
    tip: Tip = HeldTip(kind="point")
    limit: Limit | None = None
    passive: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], Passive] = Field(
        default_factory=dict
    )
