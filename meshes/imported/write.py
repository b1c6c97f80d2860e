"""Our hood mesh with its named sets, as the files that `meshes.imported.raw` reads.

Lengths are in mm and axes ours: what a reader of such a file takes if nothing else is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.port import Ints
from meshes.hood_mesh import REGIONS, HoodMesh, display_quads
from meshes.imported.names import END, SPRING, TIED
from meshes.imported.raw import FIBRE, THICKNESS, RawMesh
from meshes.skeleton import BODIES, Skeleton

MM = 1e3
IN_ROW = 8
"""Numbers in a line of an Abaqus set, which holds up to sixteen."""


def raw_of(mesh: HoodMesh, skeleton: Skeleton) -> RawMesh:
    """The mesh as a file of others has it, mm: an element of nine nodes as four quads, the springs'
    anchors on the bones of `skeleton` as nodes that lines run to.  Lifts of nodes and shares of
    springs have no place there."""
    position, rotation = skeleton.pose(mesh.rest_posture)
    points, lines, count = [mesh.points], {}, len(mesh.points)
    for name, held in mesh.springs.items():
        i = BODIES.index(held.body)
        points.append(position[i] + held.anchors @ rotation[i].T)
        lines[SPRING + name] = np.column_stack([held.nodes, count + np.arange(len(held.nodes))])
        count += len(held.nodes)
    quads = display_quads(mesh.quads)
    parts = len(quads) // len(mesh.quads)
    region = np.repeat(mesh.region, parts)
    cells = {name: np.flatnonzero(region == i) for i, name in enumerate(REGIONS)}
    nodes = {END + name: nodes for name, nodes in mesh.ends.items()}
    nodes |= {TIED + body: nodes for body, nodes in mesh.tied.items()}
    return RawMesh(
        MM * np.concatenate(points),
        quads,
        {name: chosen for name, chosen in cells.items() if len(chosen)},
        nodes,
        lines,
        (),
        np.full(len(quads), MM * mesh.thickness),
        {
            name: np.repeat(values, parts, axis=0)
            for name, values in {**mesh.fields, FIBRE: mesh.fibre}.items()
        },
    )


def write_inp(raw: RawMesh, path: Path) -> None:
    """Abaqus: S4 elements, T3D2 from the hood to the springs' anchors, ELSET, NSET and the
    thickness as SHELL SECTION of each region, whose MATERIAL is left to the user."""
    path.write_text("\n".join(_inp_lines(raw)) + "\n", encoding="utf-8")


def _inp_lines(raw: RawMesh) -> Iterator[str]:
    side = "radial" if raw.hand == "right" else "ulnar (a left hand)"
    yield f"*HEADING\nhood mesh, mm: x distal, y {side}, z dorsal\n*NODE"
    for i, (x, y, z) in enumerate(raw.points.tolist(), 1):
        yield f"{i}, {x!r}, {y!r}, {z!r}"
    yield "*ELEMENT, TYPE=S4"
    for i, quad in enumerate((raw.quads + 1).tolist(), 1):
        yield f"{i}, {', '.join(map(str, quad))}"
    lines, owner = _lines(raw)
    yield "*ELEMENT, TYPE=T3D2"
    for i, (a, b) in enumerate((lines + 1).tolist(), len(raw.quads) + 1):
        yield f"{i}, {a}, {b}"
    springs = {
        name: len(raw.quads) + np.flatnonzero(owner == i) for i, name in enumerate(raw.lines)
    }
    for card, sets in (("*ELSET, ELSET", {**raw.cells, **springs}), ("*NSET, NSET", raw.nodes)):
        for name, chosen in sets.items():
            yield f"{card}={name}"
            for start in range(0, len(chosen), IN_ROW):
                yield ", ".join(map(str, (chosen[start : start + IN_ROW] + 1).tolist()))
    if raw.thickness is not None:
        for name, chosen in raw.cells.items():
            yield f"*SHELL SECTION, ELSET={name}, MATERIAL={name}"
            yield repr(float(raw.thickness[chosen].mean()))


def write_vtu(raw: RawMesh, path: Path) -> None:
    """Sets as arrays of zeros and ones of the quads, lines and nodes; thickness and directions as
    arrays of the quads."""
    import meshio

    lines, owner = _lines(raw)
    data = _quad_arrays(raw, len(owner))
    for name, cells in raw.cells.items():
        data[name] = [_mask(cells, len(raw.quads)), np.zeros(len(owner), np.int32)]
    for i, name in enumerate(raw.lines):
        data[name] = [np.zeros(len(raw.quads), np.int32), (owner == i).astype(np.int32)]
    at_nodes = {name: _mask(nodes, len(raw.points)) for name, nodes in raw.nodes.items()}
    blocks = [("quad", raw.quads), ("line", lines)]
    mesh = meshio.Mesh(raw.points, blocks, point_data=at_nodes, cell_data=data)
    meshio.write(path, mesh, file_format="vtu")


def write_msh(raw: RawMesh, path: Path) -> None:
    """Gmsh 2.2: sets as physical surfaces, curves and points, and no arrays."""
    import meshio

    lines, owner = _lines(raw)
    region = np.zeros(len(raw.quads), dtype=np.int64)
    for tag, cells in enumerate(raw.cells.values(), 1):
        region[cells] = tag
    held = [np.full(len(nodes), tag) for tag, nodes in enumerate(raw.nodes.values(), 1)]
    points = np.concatenate([*raw.nodes.values()])[:, None]
    blocks = [("quad", raw.quads), ("line", lines), ("vertex", points)]
    tags = [region, owner + 1, np.concatenate(held)]
    groups = {
        name: np.array([tag, dimension])
        for dimension, sets in ((2, raw.cells), (1, raw.lines), (0, raw.nodes))
        for tag, name in enumerate(sets, 1)
    }
    data = {"gmsh:physical": tags, "gmsh:geometrical": [t.copy() for t in tags]}
    mesh = meshio.Mesh(raw.points, blocks, cell_data=data, field_data=groups)
    meshio.write(path, mesh, file_format="gmsh22")


def write_stl(raw: RawMesh, path: Path) -> None:
    """The sheet's mid-surface alone, each quad as two triangles."""
    import meshio

    triangles = raw.quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    mesh = meshio.Mesh(raw.points, [("triangle", triangles)])
    meshio.write(path, mesh, file_format="stl", binary=True)


def _lines(raw: RawMesh) -> tuple[Ints, Ints]:
    """All lines (k, 2) with the number (k,) of each one's set."""
    lines = np.concatenate([np.zeros((0, 2), dtype=np.intp), *raw.lines.values()])
    owner = np.repeat(np.arange(len(raw.lines)), [len(pairs) for pairs in raw.lines.values()])
    return lines, owner


def _quad_arrays(raw: RawMesh, lines: int) -> dict[str, list[Any]]:
    """Thickness and directions, zero for the lines."""
    arrays = dict(raw.fields)
    if raw.thickness is not None:
        arrays[THICKNESS] = raw.thickness
    return {name: [a, np.zeros((lines, *a.shape[1:]))] for name, a in arrays.items()}


def _mask(chosen: Ints, count: int) -> NDArray[np.int32]:
    out = np.zeros(count, dtype=np.int32)
    out[chosen] = 1
    return out


WRITERS: dict[str, Callable[[RawMesh, Path], None]] = {
    ".inp": write_inp,
    ".msh": write_msh,
    ".stl": write_stl,
    ".vtu": write_vtu,
}
"""By the file's ending."""
