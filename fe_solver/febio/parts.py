"""The parts of a FEBio 4 file: which elements are shells of what, which are rigid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from fe_solver.febio.materials import Material, fibre_directions, find_material
from fe_solver.febio.mesh import SHELLS, Block, FebMesh, rows_of
from fe_solver.febio.xml import FebTag
from fe_solver.sheet import Sheet, ShellPart

DOMAINS = ("elastic-shell", "elastic-shell-ans", "elastic-shell-eas", "rigid-shell", "3field-shell")


@dataclass(frozen=True)
class Parts:
    """The parts of a file, in its order."""

    sheet: Sheet
    """All deformable shell elements; their nodes lie on the face that the normal points to."""
    nodes: Ints
    """(n,) mesh nodes of the sheet's, ascending."""
    rigid: dict[str, list[Block]]
    """Blocks of each rigid material."""


def read_parts(
    domains: FebTag,
    data: FebTag | None,
    mesh: FebMesh,
    materials: list[Material],
    length_unit: float,
    notes: list[str],
) -> Parts:
    """The parts of a file, deformable and rigid; its lengths are in `length_unit` m.  Raises
    InputError for a part without a material, and for a deformable part that is no shell."""
    given, maps = _element_data(data, mesh)
    rigid: dict[str, list[Block]] = {m.name: [] for m in materials if m.rigid}
    shells: list[tuple[FebTag, Block, Material]] = []
    seen = set()
    for t in (*domains.all("ShellDomain"), *domains.all("SolidDomain")):
        block = mesh.blocks.get(t.attribute("name"))
        if block is None:
            raise t.fault(f"there are no elements called {t.attribute('name')!r}")
        seen.add(block.tag.attribute("name"))
        m = find_material(t, materials, t.attribute("mat"))
        if m.rigid:
            rigid[m.name].append(block)
            t.pass_over()
        elif block.kind in SHELLS:
            if not len(block.ids):
                raise block.tag.fault("this part has no elements")
            shells.append((t, block, m))
        else:
            raise t.fault(f"deformable {block.kind} elements are not read, only shells")
    for name, block in mesh.blocks.items():
        if name not in seen:
            raise block.tag.fault(f"the part {name!r} has no domain: it needs a material")
    if not shells:
        raise domains.fault("there is no deformable shell part, hence nothing to solve")
    for blocks in rigid.values():
        for block in blocks:
            for tag in given.pop(block.tag.attribute("name"), {}).values():
                tag.pass_over()
    sheet, nodes = _sheet(shells, mesh, given, maps, length_unit, notes)
    return Parts(sheet, nodes, rigid)


def _element_data(
    data: FebTag | None, mesh: FebMesh
) -> tuple[dict[str, dict[str, FebTag]], dict[str, FebTag]]:
    """By part and type, and the other ones by name."""
    given: dict[str, dict[str, FebTag]] = {}
    maps: dict[str, FebTag] = {}
    for t in data.all("ElementData") if data is not None else []:
        kind = t.attributes.get("type") or t.attributes.get("var") or ""
        kind = kind.replace("mat axis", "mat_axis")
        name = t.attribute("elem_set").removeprefix("@elem_set:")
        mesh.elements_of(t, name)
        if kind in ("shell thickness", "fiber", "mat_axis"):
            if name not in mesh.blocks:
                raise t.fault(f"{kind} is read for whole parts only, and {name!r} is none")
            given.setdefault(name, {})[kind] = t
        else:
            t.used = False
            maps[t.attributes.get("name", kind)] = t
    return given, maps


def _sheet(
    shells: list[tuple[FebTag, Block, Material]],
    mesh: FebMesh,
    given: dict[str, dict[str, FebTag]],
    maps: dict[str, FebTag],
    length_unit: float,
    notes: list[str],
) -> tuple[Sheet, Ints]:
    """The sheet and its mesh nodes (n,)."""
    columns = []
    for number, (t, block, m) in enumerate(shells):
        of_part = given.get(t.attribute("name"), {})
        _check_domain(t, block, notes)
        corners = mesh.points[block.quads]
        thickness = _thickness(t, block, of_part.get("shell thickness"))
        fibre = fibre_directions(m, corners, of_part, maps)
        columns.append((block.quads, block.ids, np.full(len(block.ids), number), thickness, fibre))
    quads, ids, part, thickness, fibre = (np.concatenate(c) for c in zip(*columns, strict=True))
    length, nodes = np.linalg.norm(fibre, axis=1, keepdims=True), np.unique(quads)
    sheet = Sheet(
        mesh.points[nodes] * length_unit,
        np.searchsorted(nodes, quads),
        tuple(
            ShellPart(t.attribute("name"), m.law, m.in_situ_stretch) for t, _, m in shells if m.law
        ),
        part,
        thickness * length_unit,
        fibre / np.where(length > 0, length, 1.0),
        -thickness * length_unit / 2,
        node_ids=mesh.node_ids[nodes],
        element_ids=ids,
    )
    return sheet, nodes


def _check_domain(t: FebTag, block: Block, notes: list[str]) -> None:
    t.known("shell formulation", t.attributes.get("type", DOMAINS[0]), DOMAINS)
    if not t.value("shell_normal_nodal", 1.0):
        notes.append(
            f"{t.path} {t.attribute('name')!r} (line {t.line}): element normals as directors are "
            "not kept; directors are the nodes' mean normals"
        )
    if block.kind != "q4ans":
        notes.append(
            f"{block.tag.path} {t.attribute('name')!r} (line {block.tag.line}): {block.kind} "
            "elements are taken as our locking-free shell, or as q4ans; FEBio's lock where the "
            "sheet is thin"
        )


def _thickness(t: FebTag, block: Block, data: FebTag | None) -> Array:
    """The thicknesses (k, 4) at the corners of the block's elements."""
    k, corners = block.nodes.shape
    if data is None and t.one("shell_thickness") is None:
        raise t.fault(
            "the thickness is missing: give <shell_thickness>, or ElementData of type "
            "'shell thickness'"
        )
    out = np.full((k, 4), t.value("shell_thickness", 0.0))
    if data is None:
        return out
    last = np.minimum(np.arange(4), corners - 1)
    if data.rows is None:
        out[:] = np.array(data.numbers(corners))[last]
        return out
    number, line, values = rows_of(data, corners)
    wrong = np.flatnonzero((number < 1) | (number > k))
    if len(wrong):
        i = wrong[0]
        raise data.fault(f"the part has elements 1 to {k}, not {number[i]}", int(line[i]))
    out[number - 1] = values[:, last]
    return out
