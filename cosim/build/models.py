"""From a case to live models.  One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from cosim.build.fit import check_fit, check_tendons
from cosim.case.schema import Case, our_finger
from cosim.fingers.hinge import HingeFinger
from cosim.fingers.index import Bone, IndexFinger
from cosim.fingers.kinds import finger_model, live_finger, skeleton_of, width_of
from cosim.fingers.middle import MiddleFinger
from cosim.fingers.robot import RobotFinger
from cosim.hoods.cable.build import ENDS, CableLook, cable_hood_of, laid_net
from cosim.hoods.cable.build import looking_at as looking_at_cables
from cosim.hoods.cable.robot import ROBOT_ENDS, robot_bones, robot_net, robot_skeleton
from cosim.hoods.cable.table import CableHood
from cosim.hoods.fe_view import slip_forces
from cosim.hoods.fmu import FmuHood
from cosim.hoods.injury import injured_mesh, injured_net, injured_network
from cosim.hoods.lumped.build import lumped_hood, slips_of
from cosim.hoods.lumped.table import NetworkHood, TwoBandHood
from cosim.hoods.pulley import PathPoint, PulleyHood
from cosim.hoods.shell.build import UnderHood, laid_mesh, linear, shell_hood_of
from cosim.hoods.shell.table import MeshFile, ShellHood
from cosim.hoods.shell.view import HoodLook, looking_at
from cosim.port import Array, Finger, Hood, InputError, Motion, State, Triangles
from cosim.tendons.muscles import CaseMuscles, live_muscles
from meshes.skeleton import BODIES

if TYPE_CHECKING:
    from meshes.hood_mesh import HoodMesh

THIN = 1e-3
"""m, of the rods that stand for the robotic finger's bones in pictures: its extensor runs 1.2 mm
above them at the DIP."""
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
    muscles: CaseMuscles
    look: Callable[[State], HoodLook | CableLook] | None
    """What a state of a hood of shells or cables looks like; None for the analytic hoods."""
    linear: Callable[[State], tuple[float, float]] | None
    """Seconds of one assembly and of one factorisation at a state of a shell hood."""
    cables: Mapping[str, Sequence[tuple[str, Array]]]
    """Of a pulley hood, by tendon: bodies and points (3,) m in their frames, for pictures."""
    slips: Callable[[State], Mapping[str, float]] | None = None
    """N in the slips at a state, central and terminal; None for a hood without."""

    def strings(self, motion: Motion) -> dict[str, Array]:
        """(k, 3) m, the cables' points in the world at some poses."""
        return drawn_cables(self.cables, motion)


def drawn_cables(
    cables: Mapping[str, Sequence[tuple[str, Array]]], motion: Motion
) -> dict[str, Array]:
    """(k, 3) m, points of cables (bodies and points in their frames, by tendon) in the world."""
    return {
        f"{name} cable": np.array([_placed(motion, *point) for point in points])
        for name, points in cables.items()
    }


def _placed(motion: Motion, body: str, point: Array) -> Array:
    position, rotation = motion.of(body)
    return position + rotation @ point


def build(case: Case) -> Models:
    """Models of a case.  Raises InputError for what only building finds out."""
    check_fit(case)
    check_lesion(case)
    stated, resting = our_finger(case), case.solve.resting_tension
    posture, finger = stated.posture.angles(), live_finger(stated, case.hood)
    muscles = live_muscles(case.tendons)
    bones = drawn_bones(case)
    if isinstance(case.finger, IndexFinger | RobotFinger) and isinstance(case.hood, CableHood):
        if isinstance(case.finger, RobotFinger):
            skeleton, ends = robot_skeleton(), ROBOT_ENDS
            net = robot_net(case.hood, skeleton, bones)
        else:
            skeleton, ends = skeleton_of(case.finger), ENDS
            net = laid_net(case.hood, case.finger, skeleton, bones)
        net = injured_net(net, case.lesion)
        tolerance = case.solve.hood_tolerance
        cables = cable_hood_of(case.hood, skeleton, bones, net, tolerance, case.lesion, ends)
        return Models(
            finger,
            cables,
            posture,
            resting,
            bones,
            muscles,
            looking_at_cables(cables, net, skeleton),
            partial(linear, cables),
            {},
            partial(slip_forces, cables),
        )
    if not (isinstance(case.finger, UnderHood) and isinstance(case.hood, ShellHood)):
        hood = hood_on(case, finger.motion(finger.start({})))
        return Models(
            finger,
            hood,
            posture,
            resting,
            bones,
            muscles,
            None,
            None,
            cables_of(case),
            slips_of(_lumped(case) or case.hood, stated),
        )
    mesh = injured_mesh(hood_mesh(case), case.lesion)
    skeleton = skeleton_of(case.finger)
    shell = shell_hood_of(case, case.hood, skeleton, bones, mesh)
    return Models(
        finger,
        shell,
        posture,
        resting,
        bones,
        muscles,
        looking_at(shell, mesh, skeleton),
        partial(linear, shell),
        {},
        partial(slip_forces, shell),
    )


def check_lesion(case: Case) -> None:
    """Raises InputError for a lesion that the hood cannot have, of a case whose hood was replaced
    since it was read."""
    if wrong := case.unfit_lesion():
        raise InputError(wrong)


def tensions(case: Case, models: Models) -> tuple[Array, Array]:
    """N, of the hood's and of the finger's own tendons, a muscle's fibre left out; InputError for
    one that neither has."""
    hood, finger = models.hood.tendons, models.finger.tendons
    check_tendons(case, (*hood, *finger))
    return np.array([case.tension(t) for t in hood]), np.array([case.tension(t) for t in finger])


def hood_mesh(case: Case) -> HoodMesh:
    """The mesh of a case's shell hood, read or generated, before any lesion."""
    if isinstance(case.hood, CableHood):
        raise InputError(
            f"{case.name}: its hood is a net of cables, which has no mesh of quads; a run writes "
            "its line cells into hood.vtu"
        )
    if not (isinstance(case.finger, UnderHood) and isinstance(case.hood, ShellHood)):
        raise InputError(f"{case.name}: has no shell hood, so it has no mesh")
    return _laid(_Laying(case.mesh_key(), case))


@dataclass(frozen=True)
class _Laying:
    """A case as far as its mesh is laid out by it."""

    key: str
    case: Case = field(compare=False)


@lru_cache(maxsize=8)
def _laid(laying: _Laying) -> HoodMesh:
    hood, finger = laying.case.hood, laying.case.finger
    assert isinstance(finger, UnderHood)
    assert isinstance(hood, ShellHood)
    return laid_mesh(hood, finger, skeleton_of(finger), drawn_bones(laying.case))


def check_mesh_file(case: Case) -> None:
    """Read the mesh file that a case names, if any.  Raises InputError."""
    if isinstance(case.hood, ShellHood) and isinstance(case.hood.mesh, MeshFile):
        from meshes.hood_mesh import read

        read(case.hood.mesh.path)


def _bones(finger: IndexFinger) -> dict[str, Triangles]:
    """Surfaces of the bones in their bodies' frames, m."""
    from meshes.bones import load_bone

    out = {}
    for body in BODIES:
        user = finger.bones.get(body)
        if user is not None:
            out[body] = _user_bone(body, user, finger)
        else:
            scaled = load_bone(body).scaled(finger.length_scale, finger.width_scale)
            out[body] = scaled.surface()
    return out


def drawn_bones(case: Case) -> dict[str, Triangles]:
    """Surfaces of the bones in their bodies' frames, m."""
    finger = our_finger(case)
    if isinstance(finger, IndexFinger):
        return _bones(finger)
    if isinstance(finger, MiddleFinger):
        return _longer_bones(finger)
    if isinstance(finger, RobotFinger):
        return robot_bones() if isinstance(case.hood, CableHood) else _thin_rods()
    return _thick_rods(finger.lengths)


def _thick_rods(lengths: tuple[float, float, float]) -> dict[str, Triangles]:
    from rigid.fingers.anatomy import VIEW_RADIUS

    return _rods(lengths, VIEW_RADIUS)


def _thin_rods() -> dict[str, Triangles]:
    """Of the robotic finger, thin enough to leave its extensor in sight."""
    from rigid.fingers.robot_tables import LENGTHS

    return _rods(LENGTHS, dict.fromkeys(BODIES, THIN))


def _rods(lengths: tuple[float, float, float], radius: Mapping[str, float]) -> dict[str, Triangles]:
    """For pictures only: a capsule from joint to joint, and of the first bone as much as MuJoCo's
    model shows; `radius`: m, by body."""
    from trimesh.creation import capsule

    from rigid.fingers.anatomy import VIEW_METACARPAL

    out = {}
    for body, length in zip(BODIES, (VIEW_METACARPAL, *lengths), strict=True):
        rod = capsule(abs(length), radius[body], count=[16, 16])
        points = np.array(rod.vertices - rod.bounds.mean(axis=0))[:, [2, 0, 1]]
        points[:, 0] += length / 2
        out[body] = points, np.array(rod.faces)
    return out


def _longer_bones(finger: MiddleFinger) -> dict[str, Triangles]:
    """The index finger's bones, each as long as the middle finger's and as much wider as its tendon
    paths are, in its bodies' frames; the metacarpal longer by the phalanges' mean."""
    from meshes.bones import load_bone
    from meshes.skeleton import index_finger

    longer = skeleton_of(finger).length[1:] / index_finger().length[1:]
    along = np.concatenate([[longer.mean()], longer])
    return {
        body: load_bone(body).scaled(factor, width_of(finger)).surface()
        for body, factor in zip(BODIES, along, strict=True)
    }


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


def _paths(case: Case) -> Mapping[str, Sequence[PathPoint]]:
    return case.hood.paths if isinstance(case.hood, PulleyHood) else {}


def cables_of(case: Case) -> dict[str, list[tuple[str, Array]]]:
    """Bodies and points (3,) m in their frames of a pulley hood's cables, by tendon."""
    return {
        name: [(p.body, np.array(p.point)) for p in path] for name, path in _paths(case).items()
    }


def hood_on(case: Case, rest: Motion) -> Hood:
    """A hood that is no shell, on bodies whose poses `rest` are those that cables' excursions count
    from.  Raises InputError."""
    check_lesion(case)
    if isinstance(case.hood, FmuHood):
        return _unit(case.hood, rest.bodies)
    lumped = _lumped(case)
    if lumped is not None:
        return lumped_hood(lumped, our_finger(case), rest)
    return _cables(case, rest)


def _lumped(case: Case) -> NetworkHood | TwoBandHood | None:
    """The hood in lumped form as a lesion leaves it."""
    if not isinstance(case.hood, NetworkHood | TwoBandHood):
        return None
    return injured_network(case.hood, case.lesion)


def _unit(hood: FmuHood, bodies: tuple[str, ...]) -> Hood:
    from cosim.fmu.hood import FmuHood as Unit

    return Unit(
        hood.path,
        bodies,
        hood.tendons,
        hood.sources,
        hood.map,
        rest_step=hood.rest_step,
        assume_si=hood.assume_si,
    )


def _cables(case: Case, rest: Motion) -> Hood:
    """The pulley hood, of no cables where the finger's own tendons stand for the hood."""
    from rigid.hoods.pulley import Cable
    from rigid.hoods.pulley import PulleyHood as Pulleys

    paths = _paths(case)
    cables = {name: Cable(tuple((p.body, p.point) for p in path)) for name, path in paths.items()}
    return Pulleys(cables, rest)


def mjcf_of(case: Case) -> str:
    """The finger of a case as MJCF.  Raises InputError for one that has none."""
    from rigid.mjcf.write import mjcf_xml

    finger = our_finger(case)
    if isinstance(finger, HingeFinger):
        raise InputError(
            f'{case.name}: finger.kind = "hinge" has no MuJoCo model; take another kind'
        )
    return mjcf_xml(finger_model(finger, case.hood), finger.gravity)
