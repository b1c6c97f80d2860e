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
from cosim.results.frames import Frame
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


def scenes_of(frames: Sequence[Frame], case: Case) -> tuple[Scene, ...]:
    """What there is to see in each frame: the hood as it was stored, and bones, tendons and
    fingertip built again from the case.  Raises InputError where its finger is in an FMU."""
    rebuilt = rebuild_finger(case, np.array([frame.angles for frame in frames]))
    every = zip(frames, rebuilt.motions, rebuilt.tendons, rebuilt.tips, strict=True)
    return tuple(
        Scene(
            frame.hood,
            bones_in_world(rebuilt.bones, motion),
            tuple({**({} if frame.hood is None else frame.hood.lines), **tendons}.items()),
            (tip, frame.force),
        )
        for frame, motion, tendons, tip in every
    )
