"""Shell meshes of any format that meshio knows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.mesh_file import read_mesh_file
from cosim.port import InputError
from fe_solver.job.checks import check_mesh, within

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

IGNORED = ("vertex", "line", "line3")
"""Cells that carry no shell and that mesh generators leave beside it."""


@dataclass(frozen=True)
class ShellMesh:
    """points (n, 3) m, of which every one belongs to a quad; quads (ne, 4), a triangle as (a, b, c,
    c); arrays by name at the points (n, ...) and on the elements (ne, ...); what was left out."""

    points: Array
    quads: Ints
    point_data: dict[str, Array]
    cell_data: dict[str, Array]
    notes: tuple[str, ...]


def read_mesh(path: Path | str, unit: float = 1.0) -> ShellMesh:
    """The quads and triangles of a mesh file whose lengths are in `unit` m.

    Raises InputError where the file cannot be read, holds cells that are no shells, or its mesh has
    a fault (see `check_mesh`); nodes and elements are counted from 0 then."""
    path = Path(path)
    mesh = read_mesh_file(path)
    points = np.asarray(mesh.points, dtype=float) * unit
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(f"{path}: expected points in two or three dimensions, got {points.shape}")
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    kept, quads, notes = [], [np.zeros((0, 4), dtype=np.intp)], []
    for i, block in enumerate(mesh.cells):
        if block.type in ("quad", "triangle"):
            corners = [0, 1, 2, 3] if block.type == "quad" else [0, 1, 2, 2]
            kept.append(i)
            quads.append(np.asarray(block.data, dtype=np.intp)[:, corners])
        elif block.type in IGNORED:
            notes.append(f"{path}: {len(block.data)} cells of type {block.type} are left out")
        else:
            raise InputError(
                f"{path}: it holds {len(block.data)} cells of type {block.type}; a shell is "
                "made of four-node quads and three-node triangles"
            )
    cells = np.concatenate(quads)
    with within(str(path)):
        check_mesh(points, cells, lambda i: f"node {i}", lambda i: f"element {i}")
    used = np.unique(cells)
    if len(used) < len(points):
        notes.append(f"{path}: {len(points) - len(used)} points that no element uses are left out")
    return ShellMesh(
        points[used],
        np.searchsorted(used, cells),
        {k: np.asarray(v)[used] for k, v in mesh.point_data.items()},
        {k: np.concatenate([np.asarray(v[i]) for i in kept]) for k, v in mesh.cell_data.items()},
        tuple(notes),
    )
