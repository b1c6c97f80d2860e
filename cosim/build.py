"""From a case to live models.  With `build_shell` the only file that knows the solvers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cosim.build_shell import HoodLook, Triangles, laid_mesh, linear, look, shell_hood_of
from cosim.case_schema import (
    Bone,
    Case,
    HingeFinger,
    IndexFinger,
    MeshFile,
    PulleyHood,
    ShellHood,
)
from cosim.port import Array, Finger, Hood, InputError, State

if TYPE_CHECKING:
    from meshes.hood_mesh import HoodMesh
    from meshes.skeleton import Skeleton
    from rigid.joint_torques import JointLaw
    from rigid.statics import ChainFinger

LEAST_ARM = 1e-3
"""m, of the joints about a held tip; some 2 deg of flexion in all."""
BONE_SIZE = (5, 200)
"""mm, the longest side of a user's bone."""
UNREADABLE = (
    OSError,
    ValueError,
    TypeError,
    AttributeError,
    KeyError,
    IndexError,
    NotImplementedError,
)
"""What a reader of surfaces raises over files that it does not understand."""


@dataclass(frozen=True)
class Models:
    """What a case builds: a finger and a hood behind the port, and what pictures need."""

    finger: Finger
    hood: Hood
    posture: Mapping[str, float]
    resting: float
    bones: Mapping[str, Triangles]
    look: Callable[[State], HoodLook] | None
    """What a state of a shell hood looks like; None for the analytic hoods."""
    linear: Callable[[State], tuple[float, float]] | None
    """Seconds of one assembly and of one factorisation at a state of a shell hood."""


def build(case: Case) -> Models:
    """Models of a case.  Raises InputError for what only building finds out."""
    posture, resting = case.finger.posture.angles(), case.solve.resting_tension
    if isinstance(case.finger, HingeFinger):
        if not isinstance(case.hood, PulleyHood):
            raise InputError(
                'hood.kind = "shell" needs finger.kind = "index", whose bones it lies on'
            )
        hinges = _hinge_finger(case.finger)
        return Models(hinges, _pulley_hood(case.hood, hinges), posture, resting, {}, None, None)
    skeleton, bones = _skeleton(case.finger), _bones(case.finger)
    finger = _index_finger(case.finger, skeleton)
    if isinstance(case.hood, PulleyHood):
        return Models(finger, _pulley_hood(case.hood, finger), posture, resting, bones, None, None)
    mesh = hood_mesh(case)
    hood = shell_hood_of(case, case.hood, skeleton, bones, mesh)
    return Models(
        finger,
        hood,
        posture,
        resting,
        bones,
        lambda state: look(hood, mesh, state),
        lambda state: linear(hood, state),
    )


def tensions(case: Case, models: Models) -> tuple[Array, Array]:
    """N, of the hood's and of the finger's own tendons; InputError for one that neither has."""
    hood, finger = models.hood.tendons, models.finger.tendons
    for name, tendon in case.tendons.items():
        if tendon.force is not None and name not in (*hood, *finger):
            raise InputError(
                f"tendons.{name}: this finger and hood have no such tendon; they have "
                f"{', '.join((*hood, *finger))}"
            )
    return np.array([case.tension(t) for t in hood]), np.array([case.tension(t) for t in finger])


def hood_mesh(case: Case) -> HoodMesh:
    """The mesh of a case's shell hood, read or generated."""
    if not (isinstance(case.finger, IndexFinger) and isinstance(case.hood, ShellHood)):
        raise InputError(f"{case.name}: has no shell hood, so it has no mesh")
    return laid_mesh(case.hood, case.finger, _skeleton(case.finger), _bones(case.finger))


def check_mesh_file(case: Case) -> None:
    """Read the mesh file that a case names, if any.  Raises InputError."""
    if isinstance(case.hood, ShellHood) and isinstance(case.hood.mesh, MeshFile):
        from meshes.hood_mesh import read

        read(case.hood.mesh.path)


def _skeleton(finger: IndexFinger) -> Skeleton:
    from meshes.skeleton import index_finger

    return index_finger().scaled(finger.length_scale)


def _bones(finger: IndexFinger) -> dict[str, Triangles]:
    """Surfaces of the bones in their bodies' frames, m."""
    from meshes.bones import load_bone
    from meshes.skeleton import BODIES

    out = {}
    for body in BODIES:
        user = finger.bones.get(body)
        if user is not None:
            out[body] = _user_bone(body, user, finger)
        else:
            scaled = load_bone(body).scaled(finger.length_scale, finger.width_scale)
            out[body] = scaled.surface()
    return out


def _user_bone(body: str, bone: Bone, finger: IndexFinger) -> Triangles:
    import trimesh

    from meshes.skeleton import index_finger

    try:
        loaded = trimesh.load_mesh(bone.surface)
        points = np.array(loaded.vertices, dtype=float) * {"m": 1.0, "mm": 1e-3}[bone.unit]
        faces = np.array(loaded.faces, dtype=np.intp)
    except UNREADABLE as error:
        raise InputError(
            f"finger.bones.{body}.surface: {bone.surface.name} cannot be read as a triangle "
            f"surface ({error}); give a watertight STL or OBJ"
        ) from error
    size = 1e3 * float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if len(faces) and not BONE_SIZE[0] <= size <= BONE_SIZE[1]:
        raise InputError(
            f"finger.bones.{body}.surface: {bone.surface.name} is {size:.3g} mm long as "
            f"{bone.unit}; expected {BONE_SIZE[0]} to {BONE_SIZE[1]} mm. Check finger.bones.{body}"
            ".unit"
        )
    if bone.frame == "myohand":
        points = index_finger().from_source(body, points)
    return points * [finger.length_scale, finger.width_scale, finger.width_scale], faces


def _index_finger(finger: IndexFinger, skeleton: Skeleton) -> Finger:
    from meshes.skeleton import JOINTS
    from rigid.index_finger import O2O3, finger_model
    from rigid.mujoco_finger import MujocoFinger
    from rigid.support import FREE, HELD

    made = MujocoFinger(
        finger_model(skeleton, O2O3 * finger.length_scale),
        law=_law(finger, JOINTS),
        support=HELD if finger.tip == "held" else FREE,
        gravity=finger.gravity,
    )
    return _holdable(made, finger)


def _hinge_finger(finger: HingeFinger) -> Finger:
    from rigid.hinge import HingeFinger as Hinges
    from rigid.support import FREE, IN_PLANE

    law = _law(finger, ("MCP", "PIP", "DIP"))
    made = Hinges(finger.lengths, law=law, support=IN_PLANE if finger.tip == "held" else FREE)
    return _holdable(made, finger)


def _holdable(made: ChainFinger, finger: IndexFinger | HingeFinger) -> ChainFinger:
    """The finger, unless it is straight: its joints then cannot balance a force along it, and its
    fingertip force would be as large as rounding and the hood's slightest pull make it."""
    if made.support_arm(made.start(finger.posture.angles())) < LEAST_ARM:
        raise InputError(
            'finger.posture: a straight finger cannot be held at its tip (finger.tip = "held"): '
            "no joint torque balances a force along it. Bend PIP or DIP by some degrees, or write "
            'finger.tip = "free"'
        )
    return made


def _law(finger: IndexFinger | HingeFinger, joints: tuple[str, ...]) -> JointLaw:
    from rigid.joint_torques import joint_law

    posture = finger.posture.angles()
    rest = {
        j: posture[j] if p.rest == "posture" else float(p.rest) for j, p in finger.passive.items()
    }
    law = joint_law(
        joints,
        stiffness={j: p.stiffness for j, p in finger.passive.items()},
        rest=rest,
        limit_stiffness=finger.limit.stiffness,
        transition=finger.limit.transition,
    )
    return law.held_about(posture, margin=finger.limit.half_range)


def _pulley_hood(hood: PulleyHood, finger: Finger) -> Hood:
    from rigid.pulley import Cable
    from rigid.pulley import PulleyHood as Pulleys

    cables = {
        name: Cable(tuple((p.body, p.point) for p in path)) for name, path in hood.paths.items()
    }
    return Pulleys(cables, finger.motion(finger.start({})))
