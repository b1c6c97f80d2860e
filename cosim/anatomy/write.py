"""A hood mesh in a file of the format that its ending names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cosim.anatomy.feb import write_feb_mesh
from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Hand
from meshes.hood_mesh import HoodMesh, to_json
from meshes.imported.raw import RawMesh
from meshes.imported.write import WRITERS, raw_of
from meshes.skeleton import Skeleton

OWN = ".json"
FORMATS: dict[str, Callable[[RawMesh, Path], None]] = WRITERS | {".feb": write_feb_mesh}


def check_ending(path: Path) -> None:
    """Check that hood meshes are written to files of this ending.  Raises InputError."""
    if path.suffix.lower() not in (OWN, *FORMATS):
        raise InputError(
            f"{path}: a hood mesh is written to a file ending in {OWN} (for hood.mesh.path), "
            f"{', '.join(sorted(FORMATS))}; name one of these"
        )


def write_hood(mesh: HoodMesh, skeleton: Skeleton, path: Path, hand: Hand = "right") -> str:
    """Write the mesh, whole or not at all, its springs anchored to the bones of `skeleton`, of the
    left `hand` mirrored but in our own format; what the file cannot hold, as words.  Raises
    InputError."""
    check_ending(path)
    ending = path.suffix.lower()
    with output_file(path) as part:
        if ending == OWN:
            part.write_text(to_json(mesh), encoding="utf-8")
            return ""
        FORMATS[ending](raw_of(mesh, skeleton).of(hand), part)
    return ", ".join(_lost(mesh, ending))


def _lost(mesh: HoodMesh, ending: str) -> list[str]:
    if ending == ".stl":
        return ["all but the surface: regions, sets, thickness, fibres"]
    shared = any(held.shares is not None for held in mesh.springs.values())
    losses = (
        (mesh.quadratic, "elements of nine nodes (four quads each)"),
        (ending in (".inp", ".msh"), "directions of the fibres"),
        (ending == ".msh", "the thickness (cosim new --thickness)"),
        (mesh.lift is not None, "lifts of nodes over the bones"),
        (shared, "shares of springs"),
    )
    return [what for applies, what in losses if applies]
