"""The middle finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import Extensor
from cosim.fingers.kind import Eyelets, FingerKind
from cosim.fingers.own import AnatomicalFingerConfig
from cosim.port import Triangles
from cosim.schema.types import Number
from meshes.skeleton import BODIES, Skeleton, index_finger

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel

AREAS = {"FDP": 4.1, "FDS": 4.2, "EDC": 1.7, "LUM": 0.2, "UI": 2.2, "RI": 2.8}
"""cm2: Chao et al. 1989, digit III, as Synek et al. 2019 take them."""


class MiddleFingerConfig(AnatomicalFingerConfig):
    """The MuJoCo middle finger of Synek et al. 2019."""

    title: ClassVar[str] = "middle finger of a right hand"
    shell_case: ClassVar[str | None] = "base/middle_hood"
    flexed: ClassVar[tuple[float, float, float]] = (40.0, 55.0, 35.0)
    kind: Literal["middle"]
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Lengths over those of Synek's middle finger."""
    interosseous: Literal["myohand", "an1979"] = "myohand"
    """Path of the radial interosseous at the MCP: MyoHand's, or the normative table's, whose depth
    of 0.565 O2O3 is perhaps a misprint for 0.265 (arm 8.1 mm in the straight finger for 3.6)."""
    terminal: Literal["myohand", "an1979"] = "myohand"
    """Path of the terminal slip at the DIP, of hoods that lie on no bone: MyoHand's (arm of 3.3
    mm), or the normative table's (4.0 mm, where its index finger has 2.0)."""

    def bone_scale(self) -> tuple[float, float, float]:
        return self.length_scale, self.length_scale, self.length_scale

    def muscle_areas(self, names: Collection[str]) -> tuple[Mapping[str, float], str]:
        areas = dict(AREAS)
        if "RIp" in names:  # half of the radial interosseous ends on the bone
            areas |= {"RI": AREAS["RI"] / 2, "RIp": AREAS["RI"] / 2}
        return areas, "Chao 1989, digit III, in Synek 2019"


def model(finger: MiddleFingerConfig, extensor: Extensor) -> FingerModel:
    """With the tendons that end on bones under a sheet, with the flexors alone under any other
    hood, with all where they part by fixed shares."""
    from rigid.fingers.middle import finger_model, finger_model_for_hood

    if extensor.lies_on_bones:
        return finger_model_for_hood(finger.length_scale, finger.interosseous)
    if extensor.central is None:
        return finger_model(finger.length_scale).with_only("FDP", "FDS")
    sources = finger.interosseous, finger.terminal
    return finger_model(finger.length_scale, extensor.central, *sources)


def build(finger: MiddleFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def skeleton(finger: MiddleFingerConfig) -> Skeleton:
    """Joints and lengths that a hood is laid out on."""
    from rigid.fingers.middle import skeleton

    return skeleton().scale(finger.length_scale)


def width(finger: MiddleFingerConfig) -> float:
    """After O2O3, the unit of the fingers' tendon paths."""
    from rigid.fingers import index, middle

    return middle.O2O3 / index.O2O3 * finger.length_scale


def bones(finger: MiddleFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """The index finger's bones, each as long as the middle finger's and as much wider as its tendon
    paths are, in its bodies' frames; the metacarpal longer by the phalanges' mean."""
    from meshes.bones import bone_surface

    longer = skeleton(finger).length[1:] / index_finger().length[1:]
    along = np.concatenate([[longer.mean()], longer])
    return {
        body: bone_surface(body, float(factor), width(finger))
        for body, factor in zip(BODIES, along, strict=True)
    }


def eyelets(finger: MiddleFingerConfig) -> Eyelets:
    """Points from which the intrinsic tendons run to a sheet."""
    from rigid.fingers.anatomy import eyelets
    from rigid.fingers.middle import INTRINSIC, O2O3, rows

    unit = O2O3 * finger.length_scale
    return eyelets(rows(finger.interosseous), INTRINSIC, unit, unit)


KIND = FingerKind(MiddleFingerConfig, build, bones, model, skeleton, width, eyelets)
