"""The fingers of the normative tables: what a case may say of one, and how it is built."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field

from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import Extensor, HeldTipConfig, TipConfig
from cosim.fingers.kind import Eyelets, FingerKind
from cosim.fingers.own import AnatomicalFingerConfig
from cosim.port import Triangles
from cosim.schema.types import Number
from meshes.skeleton import BODIES, Skeleton, myohand_finger

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.fingers.normative import NormativeFinger, Ways
    from rigid.model import FingerModel

T = TypeVar("T", bound="NormativeFingerConfig")


class NormativeFingerConfig(AnatomicalFingerConfig):
    """What the table of a finger says that is one record of `rigid.fingers`."""

    tip: TipConfig = HeldTipConfig(kind="clamped")
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Lengths over those of this finger."""

    def record(self) -> NormativeFinger:
        """Its record."""
        raise NotImplementedError

    def bone_scale(self) -> tuple[float, float, float]:
        return self.length_scale, self.length_scale, self.length_scale

    def muscle_areas(self, names: Collection[str]) -> tuple[Mapping[str, float], str]:
        finger = self.record()
        areas = dict(finger.areas)
        for muscle, share in finger.to_bone.items():
            if f"{muscle}p" in names:
                whole = areas[muscle]
                areas |= {muscle: (1.0 - share) * whole, f"{muscle}p": share * whole}
        return areas, finger.areas_source


class MiddleFingerConfig(NormativeFingerConfig):
    """The MuJoCo middle finger of Synek et al. 2019."""

    title: ClassVar[str] = "middle finger of a human hand"
    shell_case: ClassVar[str | None] = "base/middle_hood"
    flexed: ClassVar[tuple[float, float, float]] = (40.0, 55.0, 35.0)
    kind: Literal["middle"]
    interosseous: Literal["myohand", "an1979"] = "myohand"
    """Path of the radial interosseous at the MCP: MyoHand's, or the normative table's, whose depth
    of 0.565 O2O3 is perhaps a misprint for 0.265 (arm 8.1 mm in the straight finger for 3.6)."""
    terminal: Literal["myohand", "an1979"] = "myohand"
    """Path of the terminal slip at the DIP, of hoods that lie on no bone: MyoHand's (arm of 3.3
    mm), or the normative table's (4.0 mm, where its index finger has 2.0)."""

    def record(self) -> NormativeFinger:
        from rigid.fingers import middle

        return middle.record(self.interosseous, self.terminal)


class RingFingerConfig(NormativeFingerConfig):
    """The MuJoCo ring finger: joints and bones of MyoHand, tendons of An et al. 1979."""

    title: ClassVar[str] = "ring finger of a human hand"
    shell_case: ClassVar[str | None] = "base/ring_hood"
    kind: Literal["ring"]

    def record(self) -> NormativeFinger:
        from rigid.fingers.ring import RING

        return RING


class LittleFingerConfig(NormativeFingerConfig):
    """The MuJoCo little finger: joints and bones of MyoHand, tendons of An et al. 1979.  Its ulnar
    intrinsic is the abductor digiti minimi (ADM)."""

    title: ClassVar[str] = "little finger of a human hand"
    shell_case: ClassVar[str | None] = "base/little_hood"
    kind: Literal["little"]

    def record(self) -> NormativeFinger:
        from rigid.fingers.little import LITTLE

        return LITTLE


def model(finger: NormativeFingerConfig, extensor: Extensor) -> FingerModel:
    """With the tendons that end on bones under a sheet, with those alone that enter no hood under
    any other hood, with all where they part by fixed shares."""
    record = finger.record()
    ways: Ways = record.on_bones
    if extensor.central is not None:
        ways = record.strands(extensor.central)
    elif extensor.lies_on_bones:
        ways = record.bone_strands()
    return record.scaled_model(ways, finger.length_scale)


def build(finger: NormativeFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def skeleton(finger: NormativeFingerConfig) -> Skeleton:
    """Joints and lengths that a hood is laid out on."""
    return finger.record().skeleton().scale(finger.length_scale)


def width(finger: NormativeFingerConfig) -> float:
    """After O2O3, the unit of the fingers' tendon paths."""
    from rigid.fingers.index import O2O3

    return finger.record().o2o3 / O2O3 * finger.length_scale


def bones(finger: NormativeFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """Its own bones, in its bodies' frames, scaled; each as long as its phalanx and as wide as
    measured, the metacarpal longer by the phalanges' mean."""
    from meshes.bones import bone_surface

    measured = finger.record().bones
    longer = skeleton(finger).length[1:] / myohand_finger(measured).length[1:]
    along = np.concatenate([[longer.mean()], longer])
    return {
        body: bone_surface(body, float(factor), finger.length_scale, measured)
        for body, factor in zip(BODIES, along, strict=True)
    }


def eyelets(finger: NormativeFingerConfig) -> Eyelets:
    """Points from which the intrinsic tendons run to a sheet."""
    record = finger.record()
    unit = record.o2o3 * finger.length_scale
    return record.eyelets(unit, unit)


def kind_of(table: type[T]) -> FingerKind[T]:
    """The kind of a finger of one record."""
    return FingerKind(table, build, bones, model, skeleton, width, eyelets)


KINDS: tuple[FingerKind[Any], ...] = tuple(
    kind_of(t) for t in (MiddleFingerConfig, RingFingerConfig, LittleFingerConfig)
)
