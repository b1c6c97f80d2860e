"""What a case may say of a planar finger."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.fingers.common import HeldTip, Limit, Passive, PlanarPosture, Tip
from cosim.schema.fields import name_of
from cosim.schema.types import Acceleration, Inertia, Mass, Phalanx, Table


class PlanarFinger(Table):
    """Three links in a plane on MuJoCo: lengths, distances of the centres of mass from the proximal
    joints, masses, and moments of inertia about the centres of mass."""

    kind: Literal["planar"]
    lengths: tuple[Phalanx, Phalanx, Phalanx]
    centres: tuple[Phalanx, Phalanx, Phalanx]
    masses: tuple[Mass, Mass, Mass]
    inertias: tuple[Inertia, Inertia, Inertia]
    posture: PlanarPosture
    tip: Tip = HeldTip(kind="point")
    limit: Limit | None = None
    passive: dict[Annotated[str, name_of("joint", ("MCP", "PIP", "DIP"))], Passive] = Field(
        default_factory=dict
    )
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
