"""What a case may say of the middle finger."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.fingers.common import HeldTip, Limit, Passive, Posture, Tip
from cosim.schema.fields import name_of
from cosim.schema.types import Acceleration, Number, Table
from meshes.skeleton import JOINTS


class MiddleFinger(Table):
    """The MuJoCo middle finger of Synek et al. 2019."""

    kind: Literal["middle"]
    posture: Posture
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    tip: Tip = HeldTip(kind="point")
    limit: Limit | None = None
    passive: dict[Annotated[str, name_of("joint", JOINTS)], Passive] = Field(default_factory=dict)
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
