"""Our generated hood and bones as the files that a user would have of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshes.hood_mesh import HoodMesh
from meshes.imported.raw import RawMesh
from meshes.imported.write import raw_of
from meshes.skeleton import index_finger


def user_hood(mesh: HoodMesh) -> RawMesh:
    """Laid on our index finger."""
    return raw_of(mesh, index_finger())


def write_bones(bones: Mapping[str, tuple[np.ndarray, np.ndarray]], folder: Path) -> list[Path]:
    """Binary STL, mm."""
    import trimesh

    out = []
    for body, (points, faces) in bones.items():
        out.append(folder / f"{body}.stl")
        trimesh.Trimesh(1e3 * points, faces, process=False).export(out[-1])
    return out


def add_free_node(own: RawMesh) -> RawMesh:
    """Before all others, so that every number is one higher."""
    return replace(
        own,
        points=np.vstack([[[0.0, 0, 0]], own.points]),
        quads=own.quads + 1,
        nodes={name: nodes + 1 for name, nodes in own.nodes.items()},
        lines={name: pairs + 1 for name, pairs in own.lines.items()},
    )


def move_points(own: RawMesh, points: np.ndarray) -> RawMesh:
    return replace(own, points=points)
