"""A user's own anatomy: hood mesh, bones and finger read and checked, for a case.

The work is done by `meshes.imported` (the hood), `cosim.anatomy.bones` and `rigid.mjcf.read`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.anatomy.bones import BoneFrame, Bones, read_bones
from cosim.anatomy.feb import read_feb_mesh
from cosim.anatomy.muscles import imported_muscles
from cosim.errors import InputError
from cosim.hoods.fe_supports import contact_levels, head_arcs, pose_surfaces
from cosim.hoods.supports import ContactConfig
from cosim.port import Array
from cosim.schema.types import MUSCLES
from meshes.bones import bone_surface
from meshes.coarseness import coarse_rows
from meshes.hood_mesh import HoodMesh
from meshes.hull import Centreline, Level
from meshes.imported.checks import Placing
from meshes.imported.hood import hood_of, read_sheet
from meshes.imported.names import check_names
from meshes.imported.raw import FORMATS, RawMesh, read_raw
from meshes.skeleton import BODIES, JOINTS, Skeleton, index_finger
from rigid.mjcf.read import read_mjcf, skeleton_of
from rigid.model import FingerModel

FINGER_NAMES = (*BODIES, *JOINTS, "tip", *MUSCLES)
"""What may be called otherwise in a MuJoCo model."""
DEEP = 0.5e-3
"""m, a node of the mid-surface deeper than that in a bone is a fault; others are pushed out."""
MOST_FORCE = 1000.0
"""N, of a tendon in a case."""
FEW, MOST = 0.2, 0.8
"""Shares of the nodes that are beyond the bones' reach: to be reported, and a fault."""


@dataclass(frozen=True)
class UserAnatomy:
    """What a user gives."""

    hood: Path | None = None
    bones: Sequence[Path] = ()
    """None, or four surfaces from the metacarpal to the distal phalanx."""
    finger: Path | None = None
    """A MuJoCo model; without it our index finger times `length_scale`."""
    names: Mapping[str, str] = field(default_factory=dict)
    """The user's name of each of our sets, bodies, joints and tendons."""
    placing: Placing = field(default_factory=Placing)
    bone_unit: str = "mm"
    bone_frame: BoneFrame = "body"
    posture: Mapping[str, float] = field(default_factory=dict)
    """rad, in which the hood was laid and is free of stress."""
    thickness: float | None = None
    """m; without it the file's, or the base case's."""
    length_scale: float = 1.0
    assumed_tip: float | None = None
    """As `rigid.mjcf.read.read_mjcf` takes it, of a finger without a site at its tip."""


@dataclass(frozen=True)
class Built:
    """What a case is written from."""

    model: FingerModel | None
    tendons: Mapping[str, Mapping[str, Any]]
    """What each tendon's table of the case says."""
    bones: Bones | None
    hood: HoodMesh | None
    offset: Mapping[str, float]
    """m by body."""
    report: tuple[str, ...]
    """What was read, assumed, repaired and dropped, a line each."""


@dataclass(frozen=True)
class Defaults:
    """The base case's: the sheet's thickness, m, and its contact with the bones."""

    thickness: float
    contact: ContactConfig


def read_anatomy(given: UserAnatomy, defaults: Defaults) -> Built:
    """Read and check all that the user gives.  Raises InputError."""
    if given.hood is None and given.finger is None:
        raise InputError(
            "give a hood's mesh (--hood), a finger (--finger), or both; or bones alone (--bones), "
            "that our hood is laid on"
        )
    check_names(given.names, FINGER_NAMES)
    report: list[str] = []
    model, tendons, skeleton = _finger(given, report)
    if given.bones and len(given.bones) != len(BODIES):
        raise InputError(f"--bones: expected four surfaces, {', '.join(BODIES)}, in this order")
    if given.hood is None:
        bones = _bones(given, skeleton, report) if given.bones else None
        return Built(model, tendons, bones, None, {}, tuple(report))
    if given.finger is not None and not given.bones:
        raise InputError(
            "--finger: a hood lies on bones, and ours do not fit a finger of your own; give its "
            "surfaces too: --bones metacarpal.stl proximal.stl middle.stl distal.stl"
        )
    return _with_hood(given, defaults, model, tendons, skeleton, report)


def _finger(
    given: UserAnatomy, report: list[str]
) -> tuple[FingerModel | None, Mapping[str, Mapping[str, Any]], Skeleton]:
    if given.finger is None:
        skeleton = index_finger().scale(given.length_scale)
        lengths = ", ".join(f"{1e3 * part:.1f}" for part in skeleton.length[1:])
        report.append(f"finger: our index finger, phalanges {lengths} mm from joint to joint")
        return None, {}, skeleton

    names = {ours: theirs for ours, theirs in given.names.items() if ours in FINGER_NAMES}
    read = read_mjcf(given.finger, names, MUSCLES, given.assumed_tip)
    skeleton = skeleton_of(read.model)
    lengths = ", ".join(f"{1e3 * part:.1f}" for part in skeleton.length[1:])
    report.append(
        f"finger: {given.finger.name}, phalanges {lengths} mm, tendons "
        f"{', '.join(read.model.muscles) or 'none'}"
    )
    report += [f"finger: {loss}" for loss in read.losses]
    tables, told = imported_muscles(given.finger, names, read.model.muscles)
    report += [f"finger: {line}" for line in told]
    force = {tendon: most for tendon, most in read.max_force.items() if most <= MOST_FORCE}
    for tendon in sorted(set(read.max_force) - set(force)):
        report.append(
            f"finger: dropped: greatest force of {tendon}, {read.max_force[tendon]:.4g} N: a case "
            f"takes {MOST_FORCE:g} N at most"
        )
    stated = {tendon: {"max_force": f"{most:.6g} N"} for tendon, most in force.items()}
    tendons = {key: {**tables.get(key, {}), **stated.get(key, {})} for key in {**tables, **stated}}
    return read.model, tendons, skeleton


def _bones(given: UserAnatomy, skeleton: Skeleton, report: list[str]) -> Bones:
    chain = Centreline(skeleton, *skeleton.pose(given.posture))
    bones = read_bones(given.bones, given.bone_frame, given.bone_unit, given.placing, chain)
    sizes = ", ".join(
        f"{body} {1e3 * np.ptp(points[:, 0]):.1f} mm, {len(faces)} triangles"
        for body, (points, faces) in bones.surfaces.items()
    )
    report.append(f"bones: {sizes}; closed, of one piece")
    report += [f"bones: {note}" for note in bones.notes]
    return bones


def _with_hood(
    given: UserAnatomy,
    defaults: Defaults,
    model: FingerModel | None,
    tendons: Mapping[str, Mapping[str, Any]],
    skeleton: Skeleton,
    report: list[str],
) -> Built:
    assert given.hood is not None
    chain = Centreline(skeleton, *skeleton.pose(given.posture))
    names = {ours: theirs for ours, theirs in given.names.items() if ours not in FINGER_NAMES}
    raw, thickness = read_hood(given.hood), given.thickness or defaults.thickness
    if given.thickness is not None:
        raw = replace(raw, thickness=None)
    sheet = read_sheet(raw, names, given.placing, chain, thickness)
    if given.bones:
        bones = _bones(given, skeleton, report)
        surfaces = bones.surfaces
    else:
        bones, scale = None, given.length_scale
        surfaces = {b: bone_surface(b, scale) for b in BODIES}
        report.append(f"bones: ours, {scale:g} times as long")
    level = Level(
        pose_surfaces(surfaces), dict.fromkeys(BODIES, 0.0), chain.position, chain.rotation
    )
    mesh, assumed = hood_of(sheet, chain, level, given.posture)
    angles = ", ".join(f"{j} {np.rad2deg(given.posture.get(j, 0.0)):g}" for j in JOINTS)
    report.append(
        f"hood: {len(mesh.quads)} quads, {len(mesh.points)} nodes, {1e3 * mesh.thickness:.3g} mm "
        f"thick, free of stress at {angles} deg"
    )
    if given.placing.mirrors:
        report.append("hood: mirrored by --axes; a left hand becomes a right one")
    report += [f"hood: {note}" for note in (*sheet.notes, *assumed)]
    touched, wanted = contact_levels(defaults.contact, surfaces, skeleton)
    offset = _clearance(mesh, level, replace(level, surfaces=touched), wanted, report)
    over = head_arcs(defaults.contact, surfaces, skeleton, mesh.thickness / 2)
    report += [str(rows) for rows in coarse_rows(mesh, skeleton, over)]
    return Built(model, tendons, bones, mesh, offset, tuple(report))


def read_hood(path: Path) -> RawMesh:
    """A mesh file by its ending.  Raises InputError."""
    ending = path.suffix.lower()
    if ending == ".feb":
        return read_feb_mesh(path)
    if ending in FORMATS:
        return read_raw(path)
    raise InputError(
        f"--hood {path.name}: expected a mesh file ending in .feb, {', '.join(FORMATS)}"
    )


def _clearance(
    mesh: HoodMesh, bare: Level, touched: Level, wanted: Mapping[str, float], report: list[str]
) -> dict[str, float]:
    """How high (m) over each bone's back the sheet's face bears on it: the base case's height, or
    where the sheet was laid nearer to the `touched` surfaces, the least that it has there.

    Raises InputError where the hood runs through a bone, or is nowhere near one."""
    gaps = _gaps(mesh, bare)
    faults = [_through(mesh, body, gap) for body, gap in gaps.items() if (gap < -DEEP).any()]
    away = np.all([gap >= gap.max() - 1e-12 for gap in gaps.values()], axis=0)
    if away.mean() > MOST:
        faults.append(f"{away.sum()} of {len(away)} nodes are 5 mm or more from every bone")
    if faults:
        raise InputError(
            "\n  ".join(
                [
                    "hood and bones do not lie together; check --unit, --bone-unit, --bone-frame, "
                    "--axes, --origin and --posture",
                    *faults,
                ]
            )
        )
    if away.mean() > FEW:
        report.append(
            f"clearance: {away.sum()} of {len(away)} nodes are 5 mm or more from any bone"
        )
    over = _gaps(mesh, touched)
    return {body: _offset(mesh, body, over[body], wanted[body], report) for body in BODIES}


def _gaps(mesh: HoodMesh, level: Level) -> dict[str, Array]:
    """The gaps (n,) m of the nodes over each body's surface."""
    local_points = (
        (mesh.points - position) @ rotation
        for position, rotation in zip(level.position, level.rotation, strict=True)
    )
    bodies = zip(BODIES, local_points, strict=True)
    return {body: level.surfaces[body].distance(local)[0] for body, local in bodies}


def _through(mesh: HoodMesh, body: str, gap: Array) -> str:
    i = int(gap.argmin())
    x, y, z = 1e3 * mesh.points[i]
    return (
        f"{body}: {(gap < 0).sum()} nodes of the hood lie in the bone, node {i} ({x:.1f}, {y:.1f}, "
        f"{z:.1f} mm) {-1e3 * gap[i]:.2f} mm deep"
    )


def _offset(mesh: HoodMesh, body: str, gap: Array, wanted: float, report: list[str]) -> float:
    face = gap - mesh.thickness / 2
    least = float(face.min())
    if least >= wanted:
        report.append(
            f"clearance: {body}: the sheet's face is {1e3 * least:.2f} mm or more over the bone; "
            f"it bears on it at {1e3 * wanted:.2f} mm (base case)"
        )
        return wanted
    taken = max(0.0, float(np.floor(1e6 * least)) / 1e6)
    inside = f", {(gap < 0).sum()} nodes in the bone" if (gap < 0).any() else ""
    report.append(
        f"clearance: {body}: {(face < wanted).sum()} nodes are nearer than the base case's "
        f"{1e3 * wanted:.2f} mm over the bone (nearest {1e3 * least:.3f} mm{inside}); the hood "
        f"bears on it at {1e3 * taken:.3f} mm here: hood.contact.offset"
    )
    return taken
