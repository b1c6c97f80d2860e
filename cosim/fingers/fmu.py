"""The finger in an FMU: what a case may say of it, and how it is started."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.fingers.common import FingerConfig
from cosim.fingers.kind import FingerKind
from cosim.fmu.quantity import FINGER_QUANTITIES
from cosim.fmu.table import FmuTable
from cosim.schema.fields import fault, name_of
from cosim.schema.types import BodyName, TendonName
from meshes.skeleton import BODIES

if TYPE_CHECKING:
    from cosim.fmu.finger import FmuFinger as Unit
    from cosim.fmu.finger import FmuMovingFinger


class FmuFingerConfig(FmuTable, FingerConfig):
    """A finger in an FMU of FMI 2 or 3, which is a program and runs as one; it holds its posture,
    joints and fingertip.  `bodies`, `joints` and `tendons` name its own, in its order; `map` says,
    by quantity, how its variables are called where they are not called as in our own units."""

    title: ClassVar[str] = "a finger in an FMU"
    is_native: ClassVar[bool] = False
    kind: Literal["fmu"]
    bodies: Annotated[tuple[BodyName, ...], Field(min_length=2)] = BODIES
    """Its bodies, in its order, from proximal to distal."""
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    """Its joints, in its order."""
    tendons: tuple[TendonName, ...] = ()
    """Its tendons, in its order; none: it has none of its own."""
    map: dict[Annotated[str, name_of("quantity", FINGER_QUANTITIES)], str] = Field(
        default_factory=dict
    )
    """How its variables are called, by quantity, where not as in our own units."""

    @model_validator(mode="after")
    def _once(self) -> FmuFingerConfig:
        for what in ("bodies", "joints", "tendons"):
            names = getattr(self, what)
            if len(set(names)) < len(names):
                raise fault(f"{what}: names one twice")
        return self

    def at_rest(self) -> Unit:
        """The unit, for equilibria.  Raises InputError."""
        from cosim.fmu.finger import FmuFinger as Unit

        names = self.bodies, self.joints, self.tendons
        return Unit(self.path, *names, self.map, **self.speech())

    def in_motion(self) -> FmuMovingFinger:
        """The unit, for a motion in time.  Raises InputError."""
        from cosim.fmu.finger import FmuMovingFinger

        names = self.bodies, self.joints, self.tendons
        return FmuMovingFinger(self.path, *names, self.map, **self.speech())


KIND = FingerKind(FmuFingerConfig)
