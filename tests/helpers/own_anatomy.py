"""Our generated hood and bones as the files that a user would have of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import meshio
import numpy as np

from fe_solver.elements.mesh_geometry import node_directors
from meshes.hood_mesh import REGIONS, HoodMesh
from meshes.skeleton import BODIES, index_finger


@dataclass(frozen=True)
class UserHood:
    """A hood with its springs' anchors as nodes of their own: lengths in mm, sets by our names."""

    points: np.ndarray
    quads: np.ndarray
    cells: Mapping[str, np.ndarray]
    nodes: Mapping[str, np.ndarray]
    lines: Mapping[str, np.ndarray]


def user_hood(mesh: HoodMesh) -> UserHood:
    position, rotation = index_finger().pose(mesh.rest_posture)
    points, lines = [mesh.points], {}
    count = len(mesh.points)
    for name, held in mesh.springs.items():
        i = BODIES.index(held.body)
        points.append(position[i] + held.anchors @ rotation[i].T)
        anchors = count + np.arange(len(held.nodes))
        lines[f"spring_{name}"] = np.column_stack([held.nodes, anchors])
        count += len(anchors)
    regions = {name: np.flatnonzero(mesh.region == i) for i, name in enumerate(REGIONS)}
    nodes = {f"end_{name}": nodes for name, nodes in mesh.ends.items()}
    nodes |= {f"tied_{body}": nodes for body, nodes in mesh.tied.items()}
    cells = {name: cells for name, cells in regions.items() if len(cells)}
    return UserHood(1e3 * np.concatenate(points), mesh.quads, cells, nodes, lines)


def write_meshio(own: UserHood, path: Path, file_format: str | None = None) -> None:
    """.vtu with arrays of zeros and ones, .msh with physical groups, .inp with NSET and ELSET."""
    kind = path.suffix
    names = list(own.lines)
    blocks = [("quad", own.quads), *(("line", own.lines[name]) for name in names)]
    if kind == ".inp":
        empty = np.zeros(0, dtype=int)
        sets = {name: [cells, *[empty] * len(names)] for name, cells in own.cells.items()}
        for i, name in enumerate(names):
            every = np.arange(len(own.lines[name]))
            sets[name] = [empty, *(every if k == i else empty for k in range(len(names)))]
        mesh = meshio.Mesh(own.points, blocks, point_sets=dict(own.nodes), cell_sets=sets)
    elif kind == ".vtu":
        data = {name: [_mask(cells, len(own.quads))] for name, cells in own.cells.items()}
        lines = np.concatenate(list(own.lines.values()))
        owner = np.repeat(np.arange(len(names)), [len(own.lines[name]) for name in names])
        for parts in data.values():
            parts.append(np.zeros(len(lines), dtype=np.int32))
        for i, name in enumerate(names):
            zeros = np.zeros(len(own.quads), dtype=np.int32)
            data[name] = [zeros, (owner == i).astype(np.int32)]
        at_nodes = {name: _mask(nodes, len(own.points)) for name, nodes in own.nodes.items()}
        blocks = [("quad", own.quads), ("line", lines)]
        mesh = meshio.Mesh(own.points, blocks, point_data=at_nodes, cell_data=data)
    else:
        mesh = _with_groups(own, names)
    meshio.write(path, mesh, file_format=file_format)


def _mask(chosen: np.ndarray, count: int) -> np.ndarray:
    out = np.zeros(count, dtype=np.int32)
    out[chosen] = 1
    return out


def _with_groups(own: UserHood, names: list[str]) -> meshio.Mesh:
    """Physical surfaces, curves and points, as gmsh writes them."""
    groups, blocks, tags = {}, [], []
    for tag, (name, cells) in enumerate(own.cells.items(), 1):
        groups[name] = np.array([tag, 2])
        blocks.append(("quad", own.quads[cells]))
        tags.append(np.full(len(cells), tag))
    for tag, name in enumerate(names, 1):
        groups[name] = np.array([tag, 1])
        blocks.append(("line", own.lines[name]))
        tags.append(np.full(len(own.lines[name]), tag))
    for tag, (name, nodes) in enumerate(own.nodes.items(), 1):
        groups[name] = np.array([tag, 0])
        blocks.append(("vertex", nodes[:, None]))
        tags.append(np.full(len(nodes), tag))
    data = {"gmsh:physical": tags, "gmsh:geometrical": [t.copy() for t in tags]}
    return meshio.Mesh(own.points, blocks, cell_data=data, field_data=groups)


def write_feb(own: UserHood, path: Path, thickness: float = 0.65) -> None:
    """A FEBio 4 file of the mesh and its sets, nodes on the face as FEBio has them."""
    points = own.points.copy()
    used = np.unique(own.quads)
    cells = np.searchsorted(used, own.quads)
    middle = points[used]
    face = middle
    for _ in range(30):
        face = middle + thickness / 2 * node_directors(face, cells)
    points[used] = face
    places = enumerate(points.tolist(), 1)
    nodes_of = (f'<node id="{i}">{x!r},{y!r},{z!r}</node>' for i, (x, y, z) in places)
    rows = ["<Nodes>", *nodes_of, "</Nodes>"]
    domains = []
    for name, chosen in own.cells.items():
        rows.append(f'<Elements type="quad4" name="{name}">')
        rows += [
            f'<elem id="{i + 1}">{",".join(map(str, own.quads[i] + 1))}</elem>' for i in chosen
        ]
        rows.append("</Elements>")
        domains.append(
            f'<ShellDomain name="{name}" mat="skin"><shell_thickness>{thickness}</shell_thickness>'
            "</ShellDomain>"
        )
    for name, nodes in own.nodes.items():
        rows.append(f'<NodeSet name="{name}">{",".join(map(str, nodes + 1))}</NodeSet>')
    for name, pairs in own.lines.items():
        rows.append(f'<DiscreteSet name="{name}">')
        rows += [f"<delem>{a},{b}</delem>" for a, b in (pairs + 1).tolist()]
        rows.append("</DiscreteSet>")
    text = (
        '<?xml version="1.0"?><febio_spec version="4.0"><Module type="solid"/><Material>'
        '<material id="1" name="skin" type="isotropic elastic"><E>100</E><v>0.4</v></material>'
        f"</Material><Mesh>{''.join(rows)}</Mesh><MeshDomains>{''.join(domains)}</MeshDomains>"
        "</febio_spec>"
    )
    path.write_text(text)


def write_bones(bones: Mapping[str, tuple[np.ndarray, np.ndarray]], folder: Path) -> list[Path]:
    """Binary STL, mm."""
    import trimesh

    out = []
    for body, (points, faces) in bones.items():
        out.append(folder / f"{body}.stl")
        trimesh.Trimesh(1e3 * points, faces, process=False).export(out[-1])
    return out


def add_free_node(own: UserHood) -> UserHood:
    """Before all others, so that every number is one higher."""
    return UserHood(
        np.vstack([[[0.0, 0, 0]], own.points]),
        own.quads + 1,
        own.cells,
        {name: nodes + 1 for name, nodes in own.nodes.items()},
        {name: pairs + 1 for name, pairs in own.lines.items()},
    )


def move_points(own: UserHood, points: np.ndarray) -> UserHood:
    return replace(own, points=points)
