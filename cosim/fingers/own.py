"""A user's own anatomy on a finger of ours: joints and tendons out of a file, bones out of others,
where the hood's tendons run from.  Any kind of finger takes it (`with_own_anatomy`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from cosim.errors import InputError
from cosim.fingers.chain import build_on_mujoco
from cosim.fingers.common import EQUAL_SHARES, Extensor, JointedFingerConfig
from cosim.fingers.kind import Eyelets, FingerKind
from cosim.mesh_file import read_triangles
from cosim.port import Hand, Triangles, mirror
from cosim.schema.types import (
    MUSCLES,
    BodyName,
    Coordinate,
    File,
    Number,
    SurfaceFile,
    Table,
    TendonName,
)
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


class AnatomicalFingerConfig(JointedFingerConfig):
    """What the table of a human finger states beside joints: what of it is the user's."""

    path: File | None = None
    """A MuJoCo model with joints, lengths and tendons in place of ours: bodies, joints, tendons and
    the site "tip" are called as `cosim export` calls them (`cosim new` makes such a file of
    another)."""
    bones: dict[BodyName, BoneConfig] = Field(default_factory=dict)
    """Surfaces in place of our bones, by body."""
    eyelets: dict[TendonName, tuple[Coordinate, Coordinate, Coordinate]] | None = None
    """Where a tendon beside the metacarpal runs to the hood from, in place of ours: distal of the
    MCP, dorsal and radial (`cosim new` carries them over to bones of yours)."""
    breadth: Annotated[Number, Field(ge=0.1, le=3)] | None = None
    """How much wider than our index finger's the hood's anchors lie; else by the finger's size."""

    def bone_scale(self) -> tuple[float, float, float]:
        """The factors of a user's bone, distal, radial and dorsal."""
        return 1.0, 1.0, 1.0

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


def with_own_anatomy(kind: FingerKind[Any]) -> FingerKind[Any]:
    """The kind with what a case states of the user's own in place of ours."""
    if not issubclass(kind.table, AnatomicalFingerConfig):
        return kind
    assert kind.bones is not None
    assert kind.model is not None
    assert kind.skeleton is not None
    assert kind.build is not None
    ours, our_model, our_bones = kind, kind.model, kind.bones
    our_skeleton, our_build = kind.skeleton, kind.build

    def model(finger: AnatomicalFingerConfig, extensor: Extensor) -> FingerModel:
        if finger.path is None:
            return our_model(finger, extensor)
        whole = _in_file(finger.path, finger.hand)
        left = set(our_model(finger, extensor).muscles)
        every = (Extensor(EQUAL_SHARES), Extensor(lies_on_bones=True))
        others = {m for e in every for m in our_model(finger, e).muscles} - left
        return whole.with_only(*(m for m in whole.muscles if m not in others))

    def build(finger: AnatomicalFingerConfig, extensor: Extensor) -> ChainFinger:
        if finger.path is None:
            return our_build(finger, extensor)
        return build_on_mujoco(finger, model(finger, extensor))

    def bones(finger: AnatomicalFingerConfig, extensor: Extensor) -> Mapping[str, Triangles]:
        if not finger.bones:
            return our_bones(finger, extensor)
        lacking = set(BODIES) - set(finger.bones)
        packaged = our_bones(finger, extensor) if lacking else {}
        return {
            body: _user_bone(body, finger.bones[body], finger)
            if body in finger.bones
            else packaged[body]
            for body in BODIES
        }

    def skeleton(finger: AnatomicalFingerConfig) -> Skeleton:
        if finger.path is None:
            return our_skeleton(finger)
        from rigid.mjcf.read import skeleton_of

        return skeleton_of(_in_file(finger.path, finger.hand))

    def width(finger: AnatomicalFingerConfig) -> float:
        return ours.width(finger) if finger.breadth is None else finger.breadth

    def eyelets(finger: AnatomicalFingerConfig) -> Eyelets:
        theirs = _scaled(finger)
        if unknown := [tendon for tendon in finger.eyelets or {} if tendon not in theirs]:
            raise InputError(
                f"finger.eyelets.{unknown[0]}: runs to no side of a hood; expected some of "
                f"{', '.join(theirs)}"
            )
        stated = {tendon: (s, d, r) for tendon, (s, d, r) in (finger.eyelets or {}).items()}
        return {**theirs, **stated}

    def _scaled(finger: AnatomicalFingerConfig) -> Eyelets:
        """Ours; under a finger out of a file as much further along as its proximal phalanx is
        longer."""
        theirs = ours.eyelets(finger)
        if finger.path is None:
            return theirs
        longer = float(skeleton(finger).length[1] / our_skeleton(finger).length[1])
        return {tendon: (longer * s, d, r) for tendon, (s, d, r) in theirs.items()}

    return replace(
        kind,
        build=build,
        bones=bones,
        model=model,
        skeleton=skeleton,
        width=width,
        eyelets=eyelets,
    )


def _in_file(path: Path, hand: Hand) -> FingerModel:
    """The finger of a MuJoCo model, with the tendons that a case can name."""
    stamp = path.stat()
    return _read(path, stamp.st_mtime_ns, stamp.st_size, hand)


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int, hand: Hand) -> FingerModel:
    from rigid.mjcf.read import read_mjcf

    return read_mjcf(path, tendons=MUSCLES, hand=hand).model


def _user_bone(body: str, bone: BoneConfig, finger: AnatomicalFingerConfig) -> Triangles:
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
    return points * np.array(finger.bone_scale()), faces
