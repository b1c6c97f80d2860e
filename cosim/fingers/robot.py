"""What a case may say of the robotic finger; all else of it is its paper's."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.fingers.common import HeldTip, Limit, Passive, Posture, Tip
from cosim.schema.fields import name_of
from cosim.schema.types import Acceleration, Switch, Table
from meshes.skeleton import JOINTS


class RobotFinger(Table):
    """The robotic finger of Xu et al. 2012 on MuJoCo (rigid/fingers/robot.py), with its own
    tendons: over its extensor's pulley under `hood.kind = "split"`; any other hood takes that
    extensor's place."""

    kind: Literal["robot"]
    posture: Posture
    second_extensor: Switch = False
    """Six tendons: one more extensor, to the proximal phalanx alone."""
    tip: Tip = HeldTip(kind="point")
    limit: Limit | None = None
    passive: dict[Annotated[str, name_of("joint", JOINTS)], Passive] = Field(default_factory=dict)
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
