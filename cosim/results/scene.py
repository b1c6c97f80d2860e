"""What a picture shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.errors import InputError
from cosim.fingers.kinds import live_finger
from cosim.hoods.view import HoodField, HoodView, hood_field
from cosim.models.build import Models, bone_surfaces
from cosim.port import Array, Motion, Triangles
from cosim.results.arrays import Arrays
from cosim.results.frames import Frame
from cosim.results.parts import Scene

MOST_TRIANGLES = 2500
PULLED = 1e-3
"""Share of the resting tension beyond which a tendon is pulled."""


def scene(models: Models, e: Equilibrium, view: HoodView | None) -> Scene:
    """The loaded finger."""
    of_hood = {} if view is None else view.lines()
    paths = {**models.lines(e.motion), **of_hood, **models.finger.tendon_paths(e.finger_state)}
    tip = (models.finger.tip(e.finger_state), models.finger.tip_force(e.finger_state))
    hood = None if view is None else hood_field(view)
    return posed_scene(hood, coarse_bones(models.bones), e.motion, paths, tip, models.finger.joints)


def posed_scene(
    hood: HoodField | None,
    bones: Mapping[str, Triangles],
    motion: Motion,
    lines: Mapping[str, Array],
    tip: tuple[Array, Array] | None,
    joints: Sequence[str],
    frames: tuple[tuple[float, HoodField], ...] = (),
) -> Scene:
    """A scene of what is in the world (m, N) and of `bones` in their bodies' frames."""
    out = []
    for body, (vertices, faces) in bones.items():
        position, rotation = motion.of(body)
        out.append((body, vertices @ rotation.T + position, faces))
    origins = dict(zip(motion.bodies, motion.position, strict=True))
    centres = joint_centres(motion, joints)
    return Scene(hood, tuple(out), tuple(lines.items()), tip, frames, origins, centres)


def with_measures(scene: Scene, arrays: Arrays, k: int, case: Case) -> Scene:
    """Return the scene with what the arrays have at the k-th state or time of the tensions and of
    the user's points on the hood."""
    tensions = {
        str(name): float(value)
        for array, names in (("tension", "tendon"), ("own_tension", "muscle"))
        if array in arrays.variables and names in arrays.coordinates
        for name, value in zip(
            arrays.coordinates[names].values, arrays.variables[array].values[k], strict=True
        )
    }
    least = (1 + PULLED) * case.solve.resting_tension
    points: dict[str, Array] = {}
    if "hood_point_position" in arrays.variables:
        names = map(str, arrays.coordinates["hood_point"].values)
        points = dict(zip(names, arrays.variables["hood_point_position"].values[k], strict=True))
    gauges = getattr(case.hood, "gauges", {}) if points else {}
    pulled = {name: value for name, value in tensions.items() if value > least}
    hand = case.finger.side()
    return replace(scene, pulled=pulled, points=points, gauges=gauges, hand=hand)


def tension_of(scene: Scene, line: str) -> float:
    """Return the tension (N) of the tendon that a line is of, where that is pulled, else zero: the
    line is named NAME, NAME 2 of a tendon that parts, or "NAME cable"."""
    return scene.pulled.get(line, scene.pulled.get(line.rpartition(" ")[0], 0.0))


def joint_centres(motion: Motion, joints: Sequence[str]) -> tuple[tuple[str, Array], ...]:
    """Return the name and the centre (3,) m of each joint that bends: the origin of the bone distal
    of it.  Empty where the joints that bend are not one to each body but the first."""
    names = [name for name in joints if not name.endswith("abduction")]
    if len(names) != len(motion.bodies) - 1:
        return ()
    return tuple(zip(names, motion.position[1:], strict=True))


def coarse_bones(bones: Mapping[str, Triangles]) -> Mapping[str, Triangles]:
    """Return surfaces of the bones in their frames with MOST_TRIANGLES each at most, so that
    a bone looks the same in every posture."""
    return {body: decimate(*surface) for body, surface in bones.items()}


@dataclass(frozen=True)
class RebuiltFinger:
    """A case's finger in postures: the bones in their bodies' frames, and for each posture the
    poses of the bodies, the lines (k, 3) m of the tendons and the fingertip (3,) m."""

    bones: Mapping[str, Triangles]
    motions: Sequence[Motion]
    tendons: Sequence[Mapping[str, Array]]
    tips: Sequence[Array]
    joints: tuple[str, ...]


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
    return RebuiltFinger(
        coarse_bones(bone_surfaces(case)),
        motions,
        tendons,
        [*map(finger.tip, states)],
        finger.joints,
    )


def scenes_of(frames: Sequence[Frame], arrays: Arrays, case: Case) -> tuple[Scene, ...]:
    """Return what there is to see in each frame of a run: the hood as it was stored, and bones,
    tendons and fingertip built again from the case.  Raises InputError where its finger is in an
    FMU."""
    rebuilt = rebuild_finger(case, np.array([frame.angles for frame in frames]))
    every = zip(frames, rebuilt.motions, rebuilt.tendons, rebuilt.tips, strict=True)
    return tuple(
        with_measures(
            posed_scene(
                frame.hood,
                rebuilt.bones,
                motion,
                {**({} if frame.hood is None else frame.hood.lines), **tendons},
                (tip, frame.force),
                rebuilt.joints,
            ),
            *(arrays, frame.step, case),
        )
        for frame, motion, tendons, tip in every
    )


def decimate(vertices: Array, faces: np.ndarray, most: int = MOST_TRIANGLES) -> tuple:
    """A coarser surface of `most` triangles or fewer: vertices within a cell become one.

    vertices (n, 3), faces (m, 3) -> the same of fewer."""
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    size = np.sqrt(2.5 * area / most)  # a surface meets some 1.25 area/size**2 cells
    while len(faces) > most:
        cell = np.round((vertices - vertices.min(axis=0)) / size).astype(np.int64)
        number = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
        _, owner, count = np.unique(number, return_inverse=True, return_counts=True)
        vertices = np.stack([np.bincount(owner, x) / count for x in vertices.T], axis=1)
        faces, size = owner[faces], 1.15 * size
        faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
    return vertices, faces
