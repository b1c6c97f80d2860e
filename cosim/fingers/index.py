"""The index finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import Extensor
from cosim.fingers.kind import Eyelets, FingerKind
from cosim.fingers.own import AnatomicalFingerConfig
from cosim.port import Triangles
from cosim.schema.fields import fault
from cosim.schema.types import Number
from meshes.skeleton import BODIES, Skeleton, index_finger

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel


class IndexFingerConfig(AnatomicalFingerConfig):
    """The MuJoCo index finger: ours, or with `path` the user's."""

    title: ClassVar[str] = "index finger of a human hand"
    has_literature: ClassVar[bool] = True
    kind: Literal["index"]
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Lengths over those of our index finger."""
    width_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Widths of the bones over those of our index finger."""
    intrinsics: Literal["an1979", "myohand"] = "an1979"
    """Path of the lumbrical and the palmar interosseous at the MCP: the normative table's (arms of
    8.8 and 6.6 mm at 30 deg), or MyoHand's (3.7 and 3.6 mm)."""

    @model_validator(mode="after")
    def _check_size(self) -> IndexFingerConfig:
        if self.path is not None and (self.length_scale, self.width_scale) != (1.0, 1.0):
            raise fault(
                "gives a path and length_scale or width_scale; a finger out of a file has its size"
            )
        return self

    def bone_scale(self) -> tuple[float, float, float]:
        return self.length_scale, self.width_scale, self.width_scale


def skeleton(finger: IndexFingerConfig) -> Skeleton:
    """Joints and lengths of its MuJoCo model."""
    return index_finger().scale(finger.length_scale)


def width(finger: IndexFingerConfig) -> float:
    """The finger's width over that of our index finger."""
    return finger.width_scale


def model(finger: IndexFingerConfig, extensor: Extensor) -> FingerModel:
    """Bones, joints, and the tendons that the hood leaves to the finger."""
    return _model_of_size(finger.length_scale, extensor.central, finger.intrinsics)


@lru_cache(maxsize=64)
def _model_of_size(
    length: float, central: float | None, intrinsics: Literal["an1979", "myohand"]
) -> FingerModel:
    from rigid.fingers import index

    size = index_finger().scale(length), index.O2O3 * length
    return index.finger_model(*size, central=central, intrinsics=intrinsics)


def build(finger: IndexFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def bones(finger: IndexFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Ours, scaled."""
    from meshes.bones import bone_surface

    return {body: bone_surface(body, finger.length_scale, finger.width_scale) for body in BODIES}


def eyelets(finger: IndexFingerConfig) -> Eyelets:
    """Points from which the intrinsic tendons run to a sheet."""
    from rigid.fingers.index import O2O3, record

    along, across = O2O3 * finger.length_scale, O2O3 * finger.width_scale
    return record(finger.intrinsics).eyelets(along, across)


KIND = FingerKind(IndexFingerConfig, build, bones, model, skeleton, width, eyelets)
