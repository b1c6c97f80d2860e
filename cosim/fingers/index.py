"""The index finger: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from cosim.errors import InputError
from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import EQUAL_SHARES, Extensor, JointedFingerConfig
from cosim.fingers.kind import Eyelets, FingerKind
from cosim.mesh_file import read_triangles
from cosim.port import Hand, Triangles, mirror
from cosim.schema.fields import fault
from cosim.schema.types import MUSCLES, BodyName, File, Number, SurfaceFile, Table
from meshes.skeleton import BODIES, Skeleton, index_finger

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel

BONE_SIZE = (5, 200)
"""mm, the longest side of a user's bone."""


class BoneConfig(Table):
    """A watertight surface (STL or OBJ) in place of our bone."""

    surface: SurfaceFile
    """A watertight surface, STL or OBJ."""
    unit: Literal["m", "mm"]
    """Unit of the file's coordinates."""
    frame: Literal["ours", "myohand"]
    """Frame of its coordinates: "ours" is the body's own, "myohand" that of MyoHand's meshes."""


class IndexFingerConfig(JointedFingerConfig):
    """The MuJoCo index finger: ours, or with `path` the user's."""

    title: ClassVar[str] = "index finger of a human hand"
    has_literature: ClassVar[bool] = True
    kind: Literal["index"]
    path: File | None = None
    """A MuJoCo model with joints, lengths and tendons in place of ours: bodies, joints, tendons and
    the site "tip" are called as `cosim export` calls them (`cosim new` makes such a file of
    another)."""
    length_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Lengths over those of our index finger."""
    width_scale: Annotated[Number, Field(ge=0.1, le=3)] = 1.0
    """Widths of the bones over those of our index finger."""
    intrinsics: Literal["an1979", "myohand"] = "an1979"
    """Path of the lumbrical and the palmar interosseous at the MCP: the normative table's (arms of
    8.8 and 6.6 mm at 30 deg), or MyoHand's (3.7 and 3.6 mm)."""
    bones: dict[BodyName, BoneConfig] = Field(default_factory=dict)
    """Surfaces in place of our bones, by body."""

    @model_validator(mode="after")
    def _check_size(self) -> IndexFingerConfig:
        if self.path is not None and (self.length_scale, self.width_scale) != (1.0, 1.0):
            raise fault(
                "gives a path and length_scale or width_scale; a finger out of a file has its size"
            )
        return self

    def files(self) -> tuple[Path, ...]:
        surfaces = tuple(bone.surface for bone in self.bones.values())
        return surfaces if self.path is None else (*surfaces, self.path)

    def check_extensor(self, extensor: Extensor) -> None:
        if self.path is None:
            return
        if extensor.central not in (None, EQUAL_SHARES):
            raise InputError(
                "hood.central: a finger out of a file (finger.path) splits its tendons as the "
                "file says; leave it out"
            )
        lacking = [body for body in BODIES if body not in self.bones]
        if lacking and extensor.lies_on_bones:
            raise InputError(
                f"finger.bones: the hood lies on the bones, and our {lacking[0]} does not fit a "
                "finger out of a file (finger.path); give a surface for each of "
                f"{', '.join(lacking)}"
            )


def skeleton(finger: IndexFingerConfig) -> Skeleton:
    """Joints and lengths of its MuJoCo model."""
    if finger.path is not None:
        from rigid.mjcf.read import skeleton_of

        return skeleton_of(_in_file(finger.path, finger.hand))
    return index_finger().scale(finger.length_scale)


def width(finger: IndexFingerConfig) -> float:
    """The finger's width over that of our index finger."""
    return finger.width_scale


def model(finger: IndexFingerConfig, extensor: Extensor) -> FingerModel:
    """Bones, joints, and the tendons that the hood leaves to the finger."""
    from rigid.fingers import index

    if finger.path is not None:
        whole = _in_file(finger.path, finger.hand)
        hooded = index.INDEX.hooded if extensor.central is None else ()
        return whole.with_only(*(m for m in whole.muscles if m not in hooded))
    return _model_of_size(finger.length_scale, extensor.central, finger.intrinsics)


@lru_cache(maxsize=64)
def _model_of_size(
    length: float, central: float | None, intrinsics: Literal["an1979", "myohand"]
) -> FingerModel:
    from rigid.fingers import index

    size = index_finger().scale(length), index.O2O3 * length
    return index.finger_model(*size, central=central, intrinsics=intrinsics)


def _in_file(path: Path, hand: Hand) -> FingerModel:
    """The finger of a MuJoCo model, with the tendons that a case can name."""
    stamp = path.stat()
    return _read(path, stamp.st_mtime_ns, stamp.st_size, hand)


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int, hand: Hand) -> FingerModel:
    from rigid.mjcf.read import read_mjcf

    return read_mjcf(path, tendons=MUSCLES, hand=hand).model


def build(finger: IndexFingerConfig, extensor: Extensor) -> ChainFinger:
    """The live finger, with the tendons that the hood leaves to it."""
    return build_on_mujoco(finger, model(finger, extensor))


def bones(finger: IndexFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
    """The user's surfaces, and ours scaled."""
    from meshes.bones import bone_surface

    out = {}
    for body in BODIES:
        user = finger.bones.get(body)
        if user is not None:
            out[body] = _user_bone(body, user, finger)
        else:
            out[body] = bone_surface(body, finger.length_scale, finger.width_scale)
    return out


def _user_bone(body: str, bone: BoneConfig, finger: IndexFingerConfig) -> Triangles:
    loaded = read_triangles(bone.surface, f"finger.bones.{body}.surface")
    points = np.array(loaded.vertices, dtype=float) * {"m": 1.0, "mm": 1e-3}[bone.unit]
    faces = np.array(loaded.faces, dtype=np.intp)
    size = 1e3 * float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if len(faces) and not BONE_SIZE[0] <= size <= BONE_SIZE[1]:
        raise InputError(
            f"finger.bones.{body}.surface: {bone.surface.name} is {size:.3g} mm long as "
            f"{bone.unit}; expected {BONE_SIZE[0]} to {BONE_SIZE[1]} mm. Check finger.bones.{body}"
            ".unit"
        )
    if bone.frame == "myohand":
        points = index_finger().from_source(body, points)
    if finger.hand == "left":
        points, faces = mirror(points), faces[:, ::-1]
    return points * [finger.length_scale, finger.width_scale, finger.width_scale], faces


def eyelets(finger: IndexFingerConfig) -> Eyelets:
    """Points from which the intrinsic tendons run to a sheet."""
    from rigid.fingers.index import O2O3, record

    longer = float(skeleton(finger).length[1] / index_finger().length[1])
    return record(finger.intrinsics).eyelets(O2O3 * longer, O2O3 * width(finger))


KIND = FingerKind(IndexFingerConfig, build, bones, model, skeleton, width, eyelets)
