"""The parts of a FEBio 4 file: which elements are shells of what, which are rigid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.mitc9 import FROM_VTK
from fe_solver.febio.materials import Material, fibre_directions, find_material, shell_material
from fe_solver.febio.mesh import FACES, MIDDLE, SHELLS, Block, FebMesh, Units
from fe_solver.febio.values import ElementData, Place
from fe_solver.febio.xml import FebTag
from fe_solver.sheet import Sheet, ShellPart

DOMAINS = (
    "elastic-shell",
    "elastic-shell-ans",
    "elastic-shell-eas",
    "rigid-shell",
    "three-field-shell",
    "3field-shell",
)


SPECIAL = ("shell thickness", "fiber", "mat_axis")
"""Types of ElementData that say what the elements of a set are like."""


@dataclass(frozen=True)
class Parts:
    """The parts of a file, in its order."""

    sheet: Sheet
    """All deformable shell elements; their nodes lie on the face that the normal points to."""
    nodes: Ints
    """(n,) mesh nodes of the sheet's, ascending."""
    corners: Ints
    """(k, 4) mesh nodes of the file's deformable elements."""
    first: Ints
    """(k + 1,) the sheet's element that each of these is or begins with: a quadratic one may be
    several flat ones."""
    density: Array
    """(ne,) in the file's units, of the sheet's elements; nan where it is not told."""
    rigid: dict[str, list[Block]]
    """Blocks of each rigid material."""

    def elements_of(self, file: Ints) -> tuple[Ints, Ints]:
        """The sheet's elements (n,) of the file's (k,), and of which of these (n,) each is."""
        count = np.diff(self.first)[file]
        which = np.repeat(np.arange(len(file)), count)
        within = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        return self.first[file][which] + within, which


class _Columns(NamedTuple):
    """What one part gives to the sheet, k elements of m nodes; lengths in the file's units."""

    nodes: Ints
    """(k, m) mesh nodes in the solver's order."""
    ids: Ints
    """(k,) numbers in the file."""
    thickness: Array
    """(k, m)."""
    fibre: Array
    """(k, 3)."""
    density: Array
    """(k,)."""
    pieces: Ints
    """(f,) how many elements each of the file's is."""


def read_parts(
    domains: FebTag,
    data: FebTag | None,
    mesh: FebMesh,
    materials: list[Material],
    units: Units,
    notes: list[str],
) -> Parts:
    """The parts of a file, deformable and rigid.  Raises InputError for a part without a material,
    and for a deformable part that is no shell."""
    special, maps = _element_data(data, mesh)
    rigid: dict[str, list[Block]] = {m.name: [] for m in materials if m.rigid}
    shells: list[tuple[FebTag, Block, Material]] = []
    seen, used = set(), set()
    for t in (*domains.all("ShellDomain"), *domains.all("SolidDomain")):
        block = mesh.blocks.get(t.attribute("name"))
        if block is None:
            raise t.fault(f"there are no elements called {t.attribute('name')!r}")
        seen.add(block.tag.attribute("name"))
        m = find_material(t, materials, t.attribute("mat"))
        used.add(m.name)
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
    _pass_over_rigid(special, [b for blocks in rigid.values() for b in blocks])
    for m in materials:
        if m.name not in used and not m.rigid:
            m.tag.pass_over()
            notes.append(f"{m.tag.path} {m.name!r} (line {m.tag.line}): no part is made of it")
    return _parts(shells, mesh, special, maps, units, notes, rigid)


def _element_data(
    data: FebTag | None, mesh: FebMesh
) -> tuple[dict[str, list[ElementData]], dict[str, ElementData]]:
    """Those of the special types by type, and the other ones by name."""
    special: dict[str, list[ElementData]] = {kind: [] for kind in SPECIAL}
    maps: dict[str, ElementData] = {}
    for t in data.all("ElementData") if data is not None else []:
        kind = t.attributes.get("type") or t.attributes.get("var") or ""
        kind = kind.replace("mat axis", "mat_axis")
        given = ElementData(t, mesh.elements_of(t, t.attribute("elem_set")))
        if kind in SPECIAL:
            special[kind].append(given)
        else:
            t.used = False
            maps[t.attributes.get("name", kind)] = given
    return special, maps


def _pass_over_rigid(special: dict[str, list[ElementData]], blocks: list[Block]) -> None:
    """Leave out what is given to elements of rigid parts alone."""
    ids = np.concatenate([np.zeros(0, dtype=np.intp), *[b.ids for b in blocks]])
    for given in special.values():
        for d in [d for d in given if np.isin(d.elements, ids).all()]:
            d.tag.pass_over()
            given.remove(d)


def _parts(
    shells: list[tuple[FebTag, Block, Material]],
    mesh: FebMesh,
    special: dict[str, list[ElementData]],
    maps: dict[str, ElementData],
    units: Units,
    notes: list[str],
    rigid: dict[str, list[Block]],
) -> Parts:
    nine = all(block.nodes.shape[1] == 9 for _, block, _ in shells)
    columns, parts = [], []
    for t, block, m in shells:
        _check_domain(t, block, notes)
        _tell_kind(block, nine, mesh, units.length, notes)
        pick = np.array([FROM_VTK] if nine else FACES[block.nodes.shape[1]])
        nodes = block.nodes[:, pick].reshape(-1, pick.shape[1])
        ids = np.repeat(block.ids, len(pick))
        place = Place.of(mesh, ids, nodes, maps)
        made = shell_material(m, units.stress, place)
        fibre = fibre_directions(made, mesh.points[block.corners], block.ids, special, maps)
        thickness = _thickness(t, block, special["shell thickness"], maps)
        density = np.nan if made.density is None else made.density
        density = np.broadcast_to(np.mean(np.atleast_2d(density), axis=1), len(ids))
        columns.append(
            _Columns(
                nodes,
                ids,
                thickness[:, pick].reshape(nodes.shape),
                np.repeat(fibre, len(pick), axis=0),
                density,
                np.full(len(block.ids), len(pick)),
            )
        )
        stretch, isochoric = made.in_situ
        parts.append(ShellPart(t.attribute("name"), made.law, stretch, isochoric=isochoric))
    c = _Columns(*(np.concatenate(column) for column in zip(*columns, strict=True)))
    length, nodes = np.linalg.norm(c.fibre, axis=1, keepdims=True), np.unique(c.nodes)
    sheet = Sheet(
        mesh.points[nodes] * units.length,
        np.searchsorted(nodes, c.nodes),
        tuple(parts),
        np.repeat(np.arange(len(columns)), [len(column.ids) for column in columns]),
        c.thickness * units.length,
        c.fibre / np.where(length > 0, length, 1.0),
        -c.thickness * units.length / 2,
        node_ids=mesh.node_ids[nodes],
        element_ids=c.ids,
    )
    corners = np.concatenate([block.corners for _, block, _ in shells])
    return Parts(sheet, nodes, corners, np.append(0, np.cumsum(c.pieces)), c.density, rigid)


def _check_domain(t: FebTag, block: Block, notes: list[str]) -> None:
    t.known("shell formulation", t.attributes.get("type", DOMAINS[0]), DOMAINS)
    if not t.value("shell_normal_nodal", 1.0):
        notes.append(
            f"{t.path} {t.attribute('name')!r} (line {t.line}): element normals as directors are "
            "not kept; directors are the nodes' mean normals"
        )


def _tell_kind(
    block: Block, nine: bool, mesh: FebMesh, length_unit: float, notes: list[str]
) -> None:
    """Note what a block's elements are taken as, where the sheet is of nine-node elements (`nine`)
    and where not."""
    place = f"{block.tag.path} {block.tag.attribute('name')!r} (line {block.tag.line})"
    lock = "FEBio's lock where the sheet is thin"
    width = block.nodes.shape[1]
    if width <= 4 and block.kind != "q4ans":
        words = f"are taken as our locking-free shell, or as q4ans; {lock}"
    elif nine:
        added = ", with a middle node where the eight put it" * (block.kind == "quad8")
        words = f"are taken as our locking-free nine-node shell{added}; {lock}"
    elif width > 4:
        X = mesh.points[block.nodes[:, : 6 if width == 6 else 8]]
        corners, middles = np.split(X, 2, axis=1)
        off = middles - (corners + np.roll(corners, -1, axis=1)) / 2
        # a parabola lies a quarter of its height off the two straight lines through its middle
        gap = 1e3 * length_unit * float(np.linalg.norm(off, axis=2).max()) / 4
        words = (
            f"are taken as four flat elements each, through all of their nodes: strains are those "
            f"of linear elements of half the size, and curved sides lie up to {gap:.2g} mm off"
        )
    else:
        return
    notes.append(f"{place}: {block.kind} elements {words}")


def _thickness(
    t: FebTag, block: Block, given: list[ElementData], maps: dict[str, ElementData]
) -> Array:
    """The thicknesses (k, m) at the nodes of the block's elements."""
    k, m = block.nodes.shape
    tag = t.one("shell_thickness")
    out, has = np.zeros((k, m)), np.zeros(k, dtype=bool)
    if tag is not None and tag.attributes.get("type") == "map":
        name = tag.text.strip()
        if name not in maps:
            raise tag.fault(f"there is no ElementData called {name!r}")
        given = [maps[name], *given]
    elif tag is not None:
        out[:], has[:] = tag.number(), True
    own = 8 if block.kind == "quad8" else m
    for d in given:
        if np.isin(block.ids, d.elements).any():
            values, here = d.at(block.ids, (1, own))
            if block.kind == "quad8" and values.shape[1] == 8:
                values = np.column_stack([values, values @ MIDDLE])
            out[here], has = np.broadcast_to(values, (k, m))[here], has | here
    if not has.all():
        raise t.fault(
            f"the thickness of element {block.ids[~has][0]} is missing: give <shell_thickness>, or "
            "ElementData of type 'shell thickness'"
        )
    return out
