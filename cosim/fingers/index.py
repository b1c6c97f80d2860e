"""What a case may say of the index finger."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import HeldTip, Limit, Passive, Posture, Tip
from cosim.schema.fields import fault, name_of
from cosim.schema.types import Acceleration, BodyName, File, Number, Table
from meshes.skeleton import JOINTS


class Bone(Table):
    """A watertight surface (STL or OBJ) in place of our bone."""

    surface: File
    unit: Literal["m", "mm"]
    frame: Literal["ours", "myohand"]


class IndexFinger(Table):
    """The MuJoCo index finger: ours, or with `path` the user's."""

    kind: Literal["index"]
    path: File | None = None
    """A MuJoCo model with joints, lengths and tendons in place of ours: bodies, joints, tendons and
    the site "tip" are called as `cosim mjcf` calls them (`cosim new` makes such a file of another).
    """
    posture: Posture
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    width_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    tip: Tip = HeldTip(kind="point")
    limit: Limit | None = None
    passive: dict[Annotated[str, name_of("joint", JOINTS)], Passive] = Field(default_factory=dict)
    bones: dict[BodyName, Bone] = Field(default_factory=dict)
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _of_one_size(self) -> IndexFinger:
        if self.path is not None and (self.length_scale, self.width_scale) != (1.0, 1.0):
            raise fault(
                "gives a path and length_scale or width_scale; a finger out of a file has its size"
            )
        return self
