"""The mesh of a FEBio 4 file with its named sets, as a user's hood."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.elements.mesh_geometry import node_directors
from fe_solver.febio.materials import vector_in
from fe_solver.febio.mesh import SHELLS, FebMesh, read_mesh_section
from fe_solver.febio.middle import shell_nodes
from fe_solver.febio.write import axes_tag, domain_tag, elements_tag, nodes_tag
from fe_solver.febio.xml import FebTag, read_xml, tag, write_xml
from meshes.imported.raw import FIBRE, RawMesh

USED = ("Module", "Mesh", "MeshDomains", "MeshData")
RIGID = "rigid body"
ROUNDS = 50
"""Most rounds in which the mid-surface is moved to the face."""
PLACEHOLDER = "placeholder"
"""The format wants a material; a hood's own are in what `cosim export` writes."""


def read_feb_mesh(path: Path) -> RawMesh:
    """The deformable shells by their numbers, each part a set of quads; node sets, surfaces and
    discrete sets.

    FEBio's nodes lie on the face that the normals point to: they are moved to the mid-surface.
    Raises InputError."""
    root = read_xml(path, "febio_spec")
    if root.attributes.get("version") != "4.0":
        raise root.fault("only version 4.0 is read; FEBio Studio exports older files as 4.0")
    section = root.one("Mesh")
    if section is None:
        raise root.fault("the section <Mesh> is missing")
    mesh = read_mesh_section(section)
    over = shell_nodes(mesh.node_ids, [t for s in root.all("Boundary") for t in s.all("bc")])
    discrete = {name: over[ends] for name, ends in mesh.discrete.items()}
    dropped: list[str] = []
    thickness = _thicknesses(root, mesh, dropped)
    if not thickness:
        raise InputError(f"{path}: holds no deformable shells; a hood is made of quad4 elements")
    names = list(thickness)
    counts = [len(mesh.blocks[name].ids) for name in names]
    ids = np.concatenate([mesh.blocks[name].ids for name in names])
    order = np.argsort(ids)
    ids, quads = ids[order], np.concatenate([mesh.blocks[name].corners for name in names])[order]
    cells = {n: np.flatnonzero(np.isin(ids, e)) for n, e in mesh.element_sets.items()}
    h = np.repeat([thickness[name] for name in names], counts)[order]
    fibre = _fibres(root, mesh, names)
    dropped += _sections(root)
    return RawMesh(
        _mid_surface(mesh.points, quads, h),
        quads,
        {name: of_set for name, of_set in cells.items() if len(of_set)},
        {
            **{name: np.unique(nodes) for name, nodes in discrete.items() if len(nodes)},
            **{n: f.nodes for n, f in mesh.surfaces.items()},
            **mesh.node_sets,
        },
        discrete,
        tuple(dropped),
        h if h.any() else None,
        {} if fibre is None else {FIBRE: fibre[order]},
    )


def _mid_surface(points: Array, quads: np.ndarray, thickness: Array) -> Array:
    """Half a mean thickness against the normal."""
    out = points.copy()
    used = np.unique(quads)
    corners = np.searchsorted(used, quads)
    total = np.bincount(corners.ravel(), weights=np.repeat(thickness, 4), minlength=len(used))
    mean = total / np.bincount(corners.ravel(), minlength=len(used))
    out[used] -= mean[:, None] / 2 * node_directors(points[used], corners)
    return out


def _thicknesses(root: FebTag, mesh: FebMesh, dropped: list[str]) -> dict[str, float]:
    """By deformable shell part, in the file's unit; 0 where the file does not say."""
    rigid, domains, by_element = _rigid(root), root.one("MeshDomains"), _by_element(root)
    tags = {t.attribute("name"): t for t in (domains.children if domains else [])}
    out = {}
    for name, block in mesh.blocks.items():
        tag = tags.get(name)
        what = f"part {name!r} ({len(block.ids)} {block.kind} elements)"
        if tag is not None and tag.attributes.get("mat") in rigid:
            dropped.append(f"{what}: it is rigid; give bones as surfaces")
        elif block.kind not in SHELLS:
            dropped.append(f"{what}: they are no shells")
        elif block.nodes.shape[1] > 4:
            raise block.tag.fault(f"{what}: a hood is read of 3- and 4-node shells")
        else:
            thickness = tag.value("shell_thickness", 0.0) if tag is not None else 0.0
            out[name] = by_element.get(name, thickness)
            if not out[name]:
                dropped.append(
                    f"{what}: it states no thickness; its nodes are taken to lie on the mid-surface"
                )
    return out


def _fibres(root: FebTag, mesh: FebMesh, names: Sequence[str]) -> Array | None:
    """First material axes (ne, 3), the parts in a row, where each has one at every element."""
    data = root.one("MeshData")
    axes = {
        t.attributes.get("elem_set", ""): [vector_in(row, "a") for row in t.children]
        for t in (data.all("ElementData") if data else [])
        if t.attributes.get("type") == "mat_axis"
    }
    if any(len(axes.get(name, ())) != len(mesh.blocks[name].ids) for name in names):
        return None
    out = np.concatenate([np.array(axes[name]) for name in names])
    return out if (np.linalg.norm(out, axis=1) > 0).all() else None


def _by_element(root: FebTag) -> dict[str, float]:
    """Mean thickness of the parts that state one at each element."""
    data = root.one("MeshData")
    out = {}
    for t in data.all("ElementData") if data else []:
        if t.attributes.get("type") == "shell thickness" and t.rows is not None:
            name = t.attributes.get("elem_set", "").removeprefix("@elem_set:")
            out[name] = float(np.mean(t.rows.values))
    return out


def _rigid(root: FebTag) -> set[str]:
    """Names and numbers of the rigid materials."""
    section = root.one("Material")
    tags = section.all("material") if section else []
    rigid = [t for t in tags if t.attributes.get("type") == RIGID]
    return {t.attributes[key] for t in rigid for key in ("name", "id") if key in t.attributes}


def _sections(root: FebTag) -> list[str]:
    """What the file says beside its mesh."""
    out = []
    for section in root.children:
        if section.name in USED or not section.children:
            continue
        names = [t.attributes.get("name") or t.attributes.get("type") or t.name
                 for t in section.children]  # fmt: skip
        more = f" and {len(names) - 6} more" if len(names) > 6 else ""
        out.append(f"<{section.name}> ({', '.join(names[:6])}{more})")
    return out


def write_feb_mesh(raw: RawMesh, path: Path) -> None:
    """Write the mesh with its sets: a part of each region with its thickness and, where the mesh
    has fibres, the material axes along them; springs as discrete sets."""
    thickness = np.zeros(len(raw.quads)) if raw.thickness is None else raw.thickness
    face = _face(raw.points, raw.quads, thickness)
    values = {"density": 1, "E": 100.0, "v": 0.4}
    material = [tag(name, value) for name, value in values.items()]
    elements = [
        elements_tag("quad4", name, raw.quads[cells] + 1, cells + 1)
        for name, cells in raw.cells.items()
    ]
    sets = [tag("NodeSet", nodes + 1, name=name) for name, nodes in raw.nodes.items()]
    springs = [
        tag("DiscreteSet", *[tag("delem", pair) for pair in pairs + 1], name=name)
        for name, pairs in raw.lines.items()
    ]
    domains = [
        domain_tag(name, PLACEHOLDER, thickness[cells].mean()) for name, cells in raw.cells.items()
    ]
    axes = [
        axes_tag(name, raw.points[raw.quads[cells]], raw.fields[FIBRE][cells])
        for name, cells in raw.cells.items()
        if FIBRE in raw.fields
    ]
    root = tag(
        "febio_spec",
        tag("Module", type="solid"),
        tag(
            "Material", tag("material", *material, id=1, name=PLACEHOLDER, type="isotropic elastic")
        ),
        tag("Mesh", nodes_tag(face, range(1, len(face) + 1)), *elements, *sets, *springs),
        tag("MeshDomains", *domains),
        *([tag("MeshData", *axes)] if axes else []),
        version="4.0",
    )
    write_xml(path, root)


def _face(points: Array, quads: np.ndarray, thickness: Array) -> Array:
    """The points whose `_mid_surface` are `points`, by iteration: the directors are the face's."""
    face = points
    for _ in range(ROUNDS):
        off = points - _mid_surface(face, quads, thickness)
        face = face + off
        if np.abs(off).max() < 1e-14 * np.abs(points).max():
            break
    return face
