"""The units of a FEBio 4 file, which has none of its own, and its `Mesh` section in them: nodes,
elements and the sets of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from cosim.port import Array, Ints
from fe_solver.febio.xml import FebTag

SHELLS = {
    **{"quad4": 4, "q4ans": 4, "q4eas": 4, "quad4eas": 4, "tri3": 3},
    **{"tri6": 6, "quad8": 8, "quad9": 9},
}
SOLIDS = {"hex8": 8, "tet4": 4, "penta6": 6, "pyra5": 5, "tet10": 10, "hex20": 20, "hex27": 27}
EDGES = {"line2": 2, "line3": 3}
FACES = {
    3: [[0, 1, 2, 2]],
    4: [[0, 1, 2, 3]],
    6: [[0, 3, 5, 5], [3, 1, 4, 4], [5, 4, 2, 2], [3, 4, 5, 5]],
    8: [[0, 4, 7, 7], [4, 1, 5, 5], [5, 2, 6, 6], [7, 6, 3, 3], [4, 5, 6, 7]],
    9: [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]],
}
"""By the number of nodes of a face, corners first, then the middles of the edges from the first on:
the flat faces through all of them, a triangle repeating its last node."""
MIDDLE = np.array([-1.0] * 4 + [2.0] * 4) / 4
"""(8,) shape functions of an eight-node quadrilateral at its middle."""


@dataclass(frozen=True)
class Units:
    """The file's units of length and force, those of all else following with the second.

    >>> Units(1e-3, 1.0).stress  # MPa, of mm and N
    1000000.0
    """

    length: float
    """m."""
    force: float
    """N."""

    @property
    def stress(self) -> float:
        """Pa."""
        return self.force / self.length**2

    @property
    def density(self) -> float:
        """kg/m3."""
        return self.force / self.length**4


def corners_of(nodes: Ints) -> Ints:
    """The corners (k, 4) of faces or shells with nodes (k, m); a triangle repeats its last node."""
    return nodes[:, [0, 1, 2, 2]] if nodes.shape[1] in (3, 6) else nodes[:, :4]


def pieces_of(nodes: Ints) -> Ints:
    """The flat faces (k p, 4) through all nodes (k, m) of faces or shells, face by face."""
    return nodes[:, FACES[nodes.shape[1]]].reshape(-1, 4)


class Facets(NamedTuple):
    """The facets of a surface."""

    corners: Ints
    """(k, 4) node indices; a triangle repeats its last node."""
    pieces: Ints
    """(kp, 4), the flat faces through all of their nodes."""

    @property
    def nodes(self) -> Ints:
        """The nodes (n,) of the surface, ascending."""
        return np.unique(self.pieces)

    @classmethod
    def join(cls, groups: list[Ints]) -> Facets:
        """Those with nodes (k, m) in groups of equal m."""
        none = np.zeros((0, 4), dtype=np.intp)
        return cls(
            np.concatenate([none, *map(corners_of, groups)]),
            np.concatenate([none, *map(pieces_of, groups)]),
        )


class Block(NamedTuple):
    """An `Elements` block."""

    tag: FebTag
    kind: str
    """The kind of its elements."""
    ids: Ints
    """(k,) numbers."""
    nodes: Ints
    """(k, m) node indices; those of an eight-node shell with its middle node."""

    @property
    def corners(self) -> Ints:
        """The corners (k, 4) of a shell block; a triangle repeats its last node."""
        return corners_of(self.nodes)

    @property
    def pieces(self) -> Ints:
        """The flat faces (k p, 4) through all nodes of a shell block."""
        return pieces_of(self.nodes)


@dataclass(frozen=True)
class FebMesh:
    """The nodes of a file in its order, its blocks of elements, and its sets by name."""

    node_ids: Ints
    """(n,) numbers."""
    points: Array
    """(n, 3), in the file's units."""
    blocks: dict[str, Block]
    """By name."""
    node_sets: dict[str, Ints]
    """Node indices (k,) each."""
    element_sets: dict[str, Ints]
    """Numbers (k,) of elements each."""
    part_lists: dict[str, list[str]]
    """Names of blocks each; a block is a list of one."""
    edges: dict[str, Ints]
    """Node indices (k,) each."""
    surfaces: dict[str, Facets]
    """By name."""
    pairs: dict[str, tuple[str, str]]
    """The two surfaces of each surface pair."""
    discrete: dict[str, Ints]
    """Pairs (k, 2) of node indices each."""

    def nodes_of(self, tag: FebTag, name: str) -> Ints:
        """Node indices of a set, or of the `@surface:`, `@edge:`, `@elem_set:`, `@part_list:` or
        `@part:` of that name.

        Raises InputError where there is no such set."""
        kind, _, inner = name.rpartition(":")
        if kind == "@surface":
            return self.surface_of(tag, inner).nodes
        if kind == "@edge":
            return _find_set(tag, "edge", self.edges, inner)
        if kind in ("@elem_set", "@part_list", "@part"):
            ids = self.elements_of(tag, name)
            of = [b.nodes[np.isin(b.ids, ids)].ravel() for b in self.blocks.values()]
            return np.unique(np.concatenate(of))
        return _find_set(tag, "node set", self.node_sets, name)

    def held_nodes_of(self, tag: FebTag, name: str) -> Ints:
        """Node indices of a set, with the middles of the eight-node shells all of whose nodes are
        in it."""
        nodes = self.nodes_of(tag, name)
        eight = [b.nodes for b in self.blocks.values() if b.kind == "quad8"]
        whole = [q[np.isin(q[:, :8], nodes).all(axis=1), 8] for q in eight]
        return np.union1d(nodes, np.concatenate(whole)) if whole else nodes

    def surface_of(self, tag: FebTag, name: str) -> Facets:
        """The facets of a surface, or the shells of a `@part_list:`.  Raises InputError where there
        is none of that name."""
        kind, _, inner = name.rpartition(":")
        if kind in ("@part_list", "@part", "@elem_set"):
            ids = self.elements_of(tag, name)
            groups = []
            for b in self.blocks.values():
                chosen = np.isin(b.ids, ids)
                if chosen.any() and b.kind not in SHELLS:
                    raise tag.fault(f"the surface of {inner!r} is read of shells, not of {b.kind}")
                groups += [b.nodes[chosen]] if chosen.any() else []
            return Facets.join(groups)
        return _find_set(tag, "surface", self.surfaces, name)

    def elements_of(self, tag: FebTag, name: str) -> Ints:
        """Element numbers, in its order, of a set, a part or a list of parts, with or without its
        kind before it.  Raises InputError where there is none."""
        kind, _, inner = name.rpartition(":")
        if kind in ("@part_list", "@part"):
            parts = _find_set(tag, "part or part list", self.part_lists, inner)
            return np.concatenate([self.blocks[part].ids for part in parts])
        plain = inner if kind == "@elem_set" else name
        if plain in self.part_lists and plain not in self.element_sets:
            return self.elements_of(tag, f"@part_list:{plain}")
        return _find_set(tag, "element set or part", self.element_sets, plain)


T = TypeVar("T", Ints, Facets, list[str])


def _find_set(tag: FebTag, what: str, table: dict[str, T], name: str) -> T:
    if name not in table:
        known = ", ".join(map(repr, list(table)[:10])) or "none"
        raise tag.fault(f"there is no {what} {name!r}; the file has {known}")
    found = table[name]
    if not (len(found.corners) if type(found) is Facets else len(found)):
        raise tag.fault(f"the {what} {name!r} is empty")
    return found


def rows_of(tag: FebTag, width: int | None = None) -> tuple[Ints, Ints, Array]:
    """Numbers (k,), lines (k,) and values (k, width) of a tag's rows, all equally long.

    Raises InputError where one is not."""
    rows = tag.table()
    start = np.array(rows.start, dtype=np.intp)
    line = np.array(rows.line, dtype=np.intp)
    length = np.diff(start)
    if width is None:
        width = int(length[0]) if len(length) else 0
    wrong = np.flatnonzero(length != width)
    if len(wrong):
        i = wrong[0]
        raise tag.fault(f"expected {width} numbers in a row, got {length[i]}", int(line[i]))
    values = np.array(rows.values, dtype=float).reshape(-1, width)
    return np.array(rows.number, dtype=np.intp), line, values


def whole(tag: FebTag, values: Array, line: Ints) -> Ints:
    """Values (k, m) as integers.  Raises InputError where one is not a whole number."""
    wrong = np.flatnonzero((values != np.round(values)).any(axis=1) | (values < 0).any(axis=1))
    wrong = np.union1d(wrong, np.flatnonzero((values > 2**31).any(axis=1)))
    if len(wrong):
        i = wrong[0]
        raise tag.fault(f"expected numbers of nodes, got {values[i].tolist()}", int(line[i]))
    return values.astype(np.intp)


class _Numbering:
    """From node numbers to indices."""

    def __init__(self, ids: Ints) -> None:
        self.ids = ids
        self.order = np.argsort(ids)
        self.sorted = ids[self.order]

    def find(self, tag: FebTag, ids: Ints, line: Ints | None = None) -> Ints:
        """Indices of node numbers (k,) or (k, m).  Raises InputError where one is not known."""
        at = np.minimum(np.searchsorted(self.sorted, ids), len(self.sorted) - 1)
        unknown = np.argwhere(self.sorted[at] != ids)
        if len(unknown):
            first = tuple(unknown[0])
            where = int(line[first[0]]) if line is not None else None
            raise tag.fault(f"there is no node {ids[first]}", where)
        return self.order[at]


def read_mesh_section(mesh: FebTag) -> FebMesh:
    """The mesh of a file.  Raises InputError, with its line, for anything missing, doubled or
    unknown to this reader."""
    node_ids, points, node_sets = _nodes(mesh)
    numbering = _Numbering(node_ids)
    blocks = _blocks(mesh, numbering)
    element_sets = {name: block.ids for name, block in blocks.items()}
    _add(element_sets, mesh, "ElementSet", lambda t: _elements(t, blocks))
    _add(node_sets, mesh, "NodeSet", lambda t: numbering.find(t, _once(t, "node", _id_list(t))))
    surfaces: dict[str, Facets] = {}
    _add(surfaces, mesh, "Surface", lambda t: _facets(t, numbering))
    edges: dict[str, Ints] = {}
    _add(edges, mesh, "Edge", lambda t: _edge_nodes(t, numbering))
    part_lists = {name: [name] for name in blocks}
    _add(part_lists, mesh, "PartList", lambda t: _parts(t, blocks))
    discrete: dict[str, Ints] = {}
    _add(discrete, mesh, "DiscreteSet", lambda t: _pairs_of_nodes(t, numbering))
    pairs: dict[str, tuple[str, str]] = {}
    for t in mesh.all("SurfacePair"):
        if t.attribute("name") in pairs:
            raise t.fault(f"two surface pairs are called {t.attribute('name')!r}")
        pairs[t.attribute("name")] = (t.word("primary", ""), t.word("secondary", ""))
    blocks, middles = _with_middles(blocks, points)
    ids = np.concatenate([node_ids, node_ids.max() + 1 + np.arange(len(middles))])
    points = np.concatenate([points, middles])
    sets = (node_sets, element_sets, part_lists, edges, surfaces, pairs, discrete)
    return FebMesh(ids, points, blocks, *sets)


def _with_middles(blocks: dict[str, Block], points: Array) -> tuple[dict[str, Block], Array]:
    """The blocks, a middle node after the eight of each eight-node shell; and the points (m, 3) of
    these nodes, which come after the file's."""
    out, added = {}, [np.zeros((0, 3))]
    count = len(points)
    for name, b in blocks.items():
        if b.kind == "quad8":
            added.append(np.einsum("a,kai->ki", MIDDLE, points[b.nodes]))
            own = count + np.arange(len(b.nodes))
            count += len(own)
            b = b._replace(nodes=np.column_stack([b.nodes, own]))
        out[name] = b
    return out, np.concatenate(added)


def _nodes(mesh: FebTag) -> tuple[Ints, Array, dict[str, Ints]]:
    ids, places, sets, count = [], [], {}, 0
    for t in mesh.all("Nodes"):
        number, _, values = rows_of(t, 3)
        ids.append(number)
        places.append(values)
        if t.attributes.get("name") in sets:
            raise t.fault(f"two lists of nodes are called {t.attribute('name')!r}")
        if "name" in t.attributes:
            sets[t.attribute("name")] = np.arange(count, count + len(number))
        count += len(number)
    if not count:
        raise mesh.fault("there are no nodes: expected <Nodes><node id=...>x,y,z</node>...")
    everything = np.concatenate(ids)
    known, times = np.unique(everything, return_counts=True)
    if times.max() > 1:
        raise mesh.fault(f"node {known[times > 1][0]} is given twice")
    return everything, np.concatenate(places), sets


def _blocks(mesh: FebTag, numbering: _Numbering) -> dict[str, Block]:
    blocks: dict[str, Block] = {}
    for t in mesh.all("Elements"):
        name, kind = t.attribute("name"), t.attribute("type")
        width = {**SHELLS, **SOLIDS}.get(kind)
        if width is None:
            raise t.fault(f"elements of type {kind!r} are not read; known: {', '.join(SHELLS)}")
        if name in blocks:
            raise t.fault(f"two parts are called {name!r}")
        ids, line, values = rows_of(t, width)
        blocks[name] = Block(t, kind, ids, numbering.find(t, whole(t, values, line), line))
    everything = np.concatenate([b.ids for b in blocks.values()] or [np.zeros(0, dtype=np.intp)])
    if not len(everything):
        raise mesh.fault("there are no elements: expected <Elements type=... name=...>")
    known, times = np.unique(everything, return_counts=True)
    if times.max() > 1:
        raise mesh.fault(f"element {known[times > 1][0]} is given twice")
    return blocks


def _add(into: dict[str, T], mesh: FebTag, kind: str, read: Callable[[FebTag], T]) -> None:
    added: set[str] = set()
    for t in mesh.all(kind):
        name = t.attribute("name")
        if name in added:
            raise t.fault(f"two of these sets are called {name!r}")
        added.add(name)
        into[name] = read(t)


def _elements(tag: FebTag, blocks: dict[str, Block]) -> Ints:
    ids = _once(tag, "element", _id_list(tag))
    unknown = ids[~np.isin(ids, np.concatenate([b.ids for b in blocks.values()]))]
    if len(unknown):
        raise tag.fault(f"there is no element {unknown[0]}")
    return ids


def _once(tag: FebTag, what: str, ids: Ints) -> Ints:
    known, times = np.unique(ids, return_counts=True)
    if (times > 1).any():
        raise tag.fault(f"{what} {known[times > 1][0]} comes twice in this set")
    return ids


def _id_list(tag: FebTag) -> Ints:
    """Numbers as a list in the text, or one a row."""
    rows = tag.table()
    if rows.kind:
        return np.array(rows.number, dtype=np.intp)
    values = np.array(tag.numbers(), dtype=float)[:, None]
    return whole(tag, values, np.full(len(values), tag.line))[:, 0]


def _parts(tag: FebTag, blocks: dict[str, Block]) -> list[str]:
    names = [name.strip() for name in tag.text.split(",") if name.strip()]
    for name in names:
        if name not in blocks:
            raise tag.fault(f"there is no part {name!r}; the file has {', '.join(blocks)}")
    return list(dict.fromkeys(names))


def _edge_nodes(tag: FebTag, numbering: _Numbering) -> Ints:
    groups = _rows_by_length(tag, tuple(EDGES.values()), "an edge is made of <line2> and <line3>")
    none = np.zeros(0, dtype=np.intp)
    return np.unique(np.concatenate([none, *[numbering.find(tag, *g).ravel() for g in groups]]))


def _facets(tag: FebTag, numbering: _Numbering) -> Facets:
    words = "a surface is made of <tri3>, <quad4>, <tri6>, <quad8> and <quad9> here"
    groups = _rows_by_length(tag, tuple(FACES), f"{words}, and of at least one")
    if not groups:
        raise tag.fault(f"{words}, and of at least one")
    seen: set[tuple[int, ...]] = set()
    for ids, line in groups:
        for row, where in zip(
            np.sort(corners_of(ids), axis=1).tolist(), line.tolist(), strict=True
        ):
            if tuple(row) in seen:
                raise tag.fault(f"the facet with nodes {row} comes twice", where)
            seen.add(tuple(row))
    return Facets.join([numbering.find(tag, ids, line) for ids, line in groups])


def _rows_by_length(tag: FebTag, known: tuple[int, ...], words: str) -> list[tuple[Ints, Ints]]:
    """Node numbers (k, m) and lines (k,) of the rows of each length, in the order of the first.

    Raises InputError, with `words`, where one has another length."""
    rows = tag.table()
    start = np.array(rows.start, dtype=np.intp)
    line, length = np.array(rows.line, dtype=np.intp), np.diff(start)
    wrong = np.flatnonzero(~np.isin(length, known))
    if len(wrong):
        raise tag.fault(words, int(line[wrong[0]]))
    values = np.array(rows.values, dtype=float)
    out = []
    for m in dict.fromkeys(length.tolist()):
        of = length == m
        out.append((whole(tag, values[start[:-1][of, None] + np.arange(m)], line[of]), line[of]))
    return out


def _pairs_of_nodes(tag: FebTag, numbering: _Numbering) -> Ints:
    _, line, values = rows_of(tag, 2)
    return numbering.find(tag, whole(tag, values, line), line)
