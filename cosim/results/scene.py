"""What a picture shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.errors import InputError
from cosim.fingers.kinds import live_finger
from cosim.hoods.view import HoodView, hood_field
from cosim.models.build import Models, bone_surfaces
from cosim.port import Array, Motion, Triangles
from cosim.results.parts import Scene


def scene(models: Models, e: Equilibrium, view: HoodView | None) -> Scene:
    """The loaded finger."""
    of_hood = {} if view is None else view.lines()
    paths = {**models.lines(e.motion), **of_hood, **models.finger.tendon_paths(e.finger_state)}
    tendons = tuple(paths.items())
    tip = (models.finger.tip(e.finger_state), models.finger.tip_force(e.finger_state))
    hood = None if view is None else hood_field(view)
    return Scene(hood, bones_in_world(models.bones, e.motion), tendons, tip)


def bones_in_world(
    bones: Mapping[str, Triangles], motion: Motion
) -> tuple[tuple[str, Array, np.ndarray], ...]:
    """Name, vertices (n, 3) m in the world, and triangles of each bone."""
    out = []
    for body, (vertices, faces) in bones.items():
        position, rotation = motion.of(body)
        out.append((body, vertices @ rotation.T + position, faces))
    return tuple(out)


@dataclass(frozen=True)
class RebuiltFinger:
    """A case's finger in postures: the bones in their bodies' frames, and for each posture the
    poses of the bodies, the lines (k, 3) m of the tendons and the fingertip (3,) m."""

    bones: Mapping[str, Triangles]
    motions: Sequence[Motion]
    tendons: Sequence[Mapping[str, Array]]
    tips: Sequence[Array]


def rebuild_finger(case: Case, angles: Array) -> RebuiltFinger:
    """The finger at joint angles (n, nq) rad, without its hood but for what a picture draws of that
    as lines.  Raises InputError where the case's finger is in an FMU."""
    if not case.finger.is_native:
        raise InputError("its finger is in an FMU, a program that only a run starts")
    stated = case.native_finger()
    finger = live_finger(stated, case.hood.left_to_finger)
    start = finger.start(stated.posture.angles())
    states = [replace(start, angles=np.array(q)) for q in angles]
    motions = [finger.motion(state) for state in states]
    tendons = [
        {**case.hood.lines(motion), **finger.tendon_paths(state)}
        for motion, state in zip(motions, states, strict=True)
    ]
    return RebuiltFinger(bone_surfaces(case), motions, tendons, [*map(finger.tip, states)])


def with_finger(scene: Scene, case: Case, angles: Array, force: Array) -> Scene:
    """The scene with the finger at joint angles (nq,) rad, whose tip bears `force` (3,) N on the
    world.  Raises InputError."""
    rebuilt = rebuild_finger(case, angles[None])
    bones = bones_in_world(rebuilt.bones, rebuilt.motions[0])
    tendons = tuple(rebuilt.tendons[0].items())
    return replace(scene, bones=bones, tendons=tendons, tip=(rebuilt.tips[0], force))
