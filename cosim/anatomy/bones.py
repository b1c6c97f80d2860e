"""The user's bones: read, checked, and brought into the frames of the finger's bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cosim.errors import InputError
from cosim.files import check_file_size
from cosim.mesh_file import read_triangles
from cosim.port import Array
from cosim.schema.types import MOST_SURFACE
from meshes.bones import bone_surface
from meshes.hull import Centreline
from meshes.imported.checks import UNITS, Placing, wind_alike
from meshes.skeleton import BODIES, index_finger

Triangles = tuple[Array, np.ndarray]
BoneFrame = Literal["body", "hood", "myohand"]
"""Each in its own body's frame; all in the hood's (one scan); or in MyoHand's frames."""
SPECK = 0.02
"""The part of the largest piece's area below which a piece is left out."""
ALONG = (0.6, 1.9)
"""Range of the length of a phalanx's surface over the distance of its joints; our own bones' are
1.0 to 1.2."""
TURNED = np.cos(np.deg2rad(30.0))
"""Between a bone's long axis and its body's x."""
OTHER_FRAME = (
    "is it in another frame (--bone-frame body, hood or myohand), or the hood's posture another "
    "(--posture)?"
)
MIRRORED, DOUBTFUL = 0.6, 0.85
"""Parts of the metacarpal's distance from ours that it may lie off ours mirrored at least: below
the first its side is a fault, below the second a doubt.  Ours, 15 % wider or narrower, turned by 10
deg and bent at random by 0.3 to 1 mm (RMS), come to 2.4 and more, mirrored to 0.2 to 0.66."""
SAMPLED, WIDTHS = 800, (0.85, 1.0, 1.18)
OFF = 0.4
"""The part of its length that a bone's middle may lie off the middle between its joints."""


@dataclass(frozen=True)
class Bones:
    """Surfaces by body, in its frame, m; what was repaired or looks odd."""

    surfaces: Mapping[str, Triangles]
    notes: tuple[str, ...]


def read_bones(
    files: Sequence[Path], frame: BoneFrame, unit: str, hood: Placing, chain: Centreline
) -> Bones:
    """Four surfaces from metacarpal to distal phalanx; `hood`: the placing of a scan with the hood,
    `chain`: the finger's joints in the posture of it.

    Raises InputError that lists all faults."""
    faults: list[str] = []
    notes: list[str] = []
    surfaces = {}
    for body, path in zip(BODIES, files, strict=True):
        points, faces = read_surface(path, f"{body} ({path.name})", faults, notes)
        if len(faces):
            surfaces[body] = _place(body, points, faces, frame, unit, hood, chain)
    faults += _duplicates(surfaces)
    if len(surfaces) == len(BODIES) and not faults:
        faults += _placement_faults(surfaces, chain, unit)
    if len(surfaces) == len(BODIES) and not faults:
        _check_side(surfaces[BODIES[0]][0], frame, faults, notes)
    if faults:
        count = f"{len(faults)} fault" + ("s" if len(faults) > 1 else "")
        raise InputError("\n  ".join([f"the bones have {count}", *faults]))
    return Bones(surfaces, tuple(notes))


def read_surface(path: Path, what: str, faults: list[str], notes: list[str]) -> Triangles:
    """A closed surface of one piece, normals outward; of no faces where that cannot be had."""
    none = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp)
    mesh = load_surface(path, what)
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        faults.append(f"{what}: holds no triangles, or corners that are not finite")
        return none
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    once = mesh.unique_faces()
    if not once.all():
        mesh.update_faces(once)
        notes.append(f"{what}: {(~once).sum()} triangles that are there twice are left out")
    thin = ~mesh.nondegenerate_faces()
    if thin.any():
        mesh.update_faces(~thin)
        notes.append(f"{what}: {thin.sum()} triangles without area are left out")
    if not len(mesh.faces) or not (mesh.area_faces > 0).any():
        faults.append(f"{what}: none of its triangles has an area")
        return none
    mesh = _largest(mesh, what, faults, notes)
    if not mesh.is_watertight:
        loose = len(_open_edges(mesh))
        faults.append(
            f"{what}: its surface is not closed ({loose} edges do not join two triangles); close "
            "its holes, for example in MeshLab or with trimesh.repair"
        )
        return none
    points, stated = np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.intp)
    try:
        faces, turned = wind_alike(stated)
    except InputError as error:
        faults.append(f"{what}: {error}")
        return none
    if less := min(len(turned), len(faces) - len(turned)):
        notes.append(f"{what}: {less} triangles were wound against the others and are turned over")
    if _volume(points, faces) < 0:
        faces = faces[:, ::-1]
    if (faces != stated).any(axis=1).all():
        notes.append(f"{what}: its triangles faced inward and are turned over")
    return points, faces


def _volume(points: Array, faces: np.ndarray) -> float:
    """m3 times the file's unit's cube; negative where the faces look inward."""
    a, b, c = points[faces].transpose(1, 0, 2)
    return float(np.einsum("nk,nk->", a, np.cross(b, c)) / 6)


def load_surface(path: Path, what: str) -> Any:
    """A surface of triangles as trimesh has it.  Raises InputError where the file is none."""
    if not path.is_file():
        raise InputError(f"--bones: {what}: there is no file {path}")
    check_file_size(path, MOST_SURFACE)
    return read_triangles(path, f"--bones: {what}")


def _open_edges(mesh: Any) -> np.ndarray:
    _, times = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    return np.flatnonzero(times != 2)


def _largest(mesh: Any, what: str, faults: list[str], notes: list[str]) -> Any:
    """The one piece; specks beside it are left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges, n = mesh.edges_unique, len(mesh.vertices)
    graph = coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    of_face = label[mesh.faces[:, 0]]
    area = np.bincount(of_face, weights=mesh.area_faces)
    pieces = np.flatnonzero(area > 0)
    if len(pieces) == 1:
        return mesh
    big = int(area.argmax())
    rest = np.sort(np.delete(area, big))[::-1] / area[big]
    if rest[0] > SPECK:
        faults.append(
            f"{what}: falls into {len(pieces)} pieces, the second {100 * rest[0]:.0f} % of the "
            "first's area; a bone is one piece (are two bones, or one twice, in the file?)"
        )
        return mesh
    notes.append(f"{what}: {len(pieces) - 1} specks beside the bone are left out")
    kept = mesh.copy()
    kept.update_faces(of_face == big)
    kept.remove_unreferenced_vertices()
    return kept


def _place(
    body: str,
    points: Array,
    faces: np.ndarray,
    frame: BoneFrame,
    unit: str,
    hood: Placing,
    chain: Centreline,
) -> Triangles:
    if frame == "body":
        return points * UNITS[unit], faces
    if frame == "myohand":
        return index_finger().from_source(body, points * UNITS[unit]), faces
    i = BODIES.index(body)
    world = replace(hood, unit=unit, origin=hood.origin * UNITS[hood.unit] / UNITS[unit]).of(points)
    local = (world - chain.position[i]) @ chain.rotation[i]
    return local, faces[:, ::-1] if hood.mirrors else faces


def _duplicates(surfaces: Mapping[str, Triangles]) -> list[str]:
    """Bones that are one and the same surface, wherever they lie."""
    seen: dict[tuple[Any, ...], str] = {}
    out = []
    for body, (points, faces) in surfaces.items():
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        key = (len(faces), *(float(f"{value:.5g}") for value in spread))
        if key in seen:
            out.append(f"{seen[key]} and {body} are the same surface; give each bone its own")
        seen[key] = body
    return out


def _placement_faults(surfaces: Mapping[str, Triangles], chain: Centreline, unit: str) -> list[str]:
    """Bones of another size, or not along their bodies' x from joint to joint."""
    length = chain.skeleton.length
    spans = {b: float(np.ptp(p @ _long(p))) for b, (p, _) in surfaces.items()}
    ratio = np.array([spans[BODIES[i]] / length[i] for i in (1, 2, 3)])
    if not ((ratio > ALONG[0]) & (ratio < ALONG[1])).all():
        return [_wrong_size(spans, length, ratio, unit)]
    ahead = 1e3 * float(surfaces[BODIES[0]][0][:, 0].mean())
    first = (
        [f"metacarpal: its middle lies {ahead:.1f} mm distal of the MCP's centre; {OTHER_FRAME}"]
        if ahead > 0
        else []
    )
    return first + [
        fault
        for i in (1, 2, 3)
        if (fault := _wrong_place(BODIES[i], surfaces[BODIES[i]][0], float(length[i])))
    ]


def _wrong_size(spans: Mapping[str, float], length: Array, ratio: Array, unit: str) -> str:
    measured = ", ".join(f"{body} {1e3 * span:.4g}" for body, span in spans.items())
    joints = ", ".join(f"{1e3 * part:.4g}" for part in length[1:])
    factor = np.median(ratio)
    near = [u for u, m in UNITS.items() if ALONG[0] < factor * m / UNITS[unit] < ALONG[1]]
    given = [spans[BODIES[i]] for i in (1, 2, 3)]
    hint = "check --bones, --length-scale and --finger"
    if near and near[0] != unit:
        hint = f"they would fit in {near[0]}: --bone-unit {near[0]}"
    elif given != sorted(given, reverse=True):
        hint = "are they in order, from the metacarpal to the distal phalanx?"
    return (
        f"they are {measured} mm long as {unit}, while the finger's phalanges are {joints} mm from "
        f"joint to joint; {hint}"
    )


def _wrong_place(body: str, points: Array, length: float) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    aside = np.abs((low + high) / 2 - [length / 2, 0, 0]).max()
    cosine = abs(_long(points)[0])
    if cosine > TURNED and aside < OFF * length:
        return ""
    turned = np.degrees(np.arccos(min(1.0, cosine)))
    return (
        f"{body}: runs from x {1e3 * low[0]:.1f} to {1e3 * high[0]:.1f} mm, its middle "
        f"{1e3 * aside:.1f} mm off and its long axis {turned:.0f} deg from its body's x, which "
        f"runs from joint to joint over {1e3 * length:.1f} mm; {OTHER_FRAME}"
    )


def _check_side(points: Array, frame: BoneFrame, faults: list[str], notes: list[str]) -> None:
    """Compare the metacarpal, whose base tells the side, with ours and with ours mirrored, as long,
    turned about x and as wide as fits best; a fault where the mirrored one fits far better."""
    from scipy.spatial import cKDTree

    ours = _unit_long(bone_surface(BODIES[0])[0])
    given = _unit_long(points)
    given = given[:: max(1, len(given) // SAMPLED)]
    right, left = (
        min(
            float(np.sqrt(np.mean(tree.query(given @ turn * [1, width, width])[0] ** 2)))
            for turn in _turns_about_x()
            for width in WIDTHS
        )
        for tree in (cKDTree(ours), cKDTree(ours * [1, -1, 1]))
    )
    if left > DOUBTFUL * right:
        return
    span = 1e3 * float(np.ptp(points[:, 0]))
    text = (
        f"metacarpal: is like one of a left hand ({left * span:.2g} mm off ours mirrored, "
        f"{right * span:.2g} mm off ours in the mean)"
    )
    if left > MIRRORED * right:
        notes.append(f"{text}; were the bones mirrored as the hood was?")
        return
    advice = "mirror the four bones as the hood was mirrored (their y, radial, turned to -y)"
    if frame == "hood":
        advice = "--axes mirrors hood and bones alike: was one of their files mirrored already?"
    faults.append(f"{text}, and the finger is of a right one; {advice}")


def _unit_long(points: Array) -> Array:
    """The points (n, 3) about the middle of their box, over its length along x."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray((points - (low + high) / 2) / (high - low)[0])


def _turns_about_x() -> list[Array]:
    """Rotations (3, 3) about x by up to 20 deg: how a frame's y may lie otherwise."""
    from scipy.spatial.transform import Rotation

    angles = np.arange(-20.0, 21.0, 5.0)
    return list(Rotation.from_euler("x", angles[:, None], degrees=True).as_matrix())


def _long(points: Array) -> Array:
    """The longest principal axis (3,) of the corners."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0])
