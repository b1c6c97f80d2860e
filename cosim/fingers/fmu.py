"""What a case may say of a finger in an FMU."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cosim.fmu.quantity import FINGER_QUANTITIES
from cosim.schema.fields import fault, name_of
from cosim.schema.types import BodyName, File, Switch, Table, TendonName
from meshes.skeleton import BODIES


class FmuFinger(Table):
    """A finger in an FMU of FMI 2 or 3, which is a program and runs as one; it holds its posture,
    joints and fingertip.  `bodies`, `joints` and `tendons` name its own, in its order; `map` says,
    by quantity, how its variables are called where they are not called as in our own units."""

    kind: Literal["fmu"]
    path: File
    bodies: Annotated[tuple[BodyName, ...], Field(min_length=2)] = BODIES
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    tendons: tuple[TendonName, ...] = ()
    map: dict[Annotated[str, name_of("quantity", FINGER_QUANTITIES)], str] = Field(
        default_factory=dict
    )
    assume_si: Switch = False

    @model_validator(mode="after")
    def _once(self) -> FmuFinger:
        for what in ("bodies", "joints", "tendons"):
            names = getattr(self, what)
            if len(set(names)) < len(names):
                raise fault(f"{what}: names one twice")
        return self
