"""The `Mesh` section of a FEBio 4 file: nodes, elements and the sets of them, in the file's
units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array, Ints
from fe_solver.febio.xml import FebTag

SHELLS = {"quad4": 4, "q4ans": 4, "q4eas": 4, "quad4eas": 4, "tri3": 3}
SOLIDS = {"hex8": 8, "tet4": 4, "penta6": 6, "pyra5": 5, "tet10": 10, "hex20": 20, "hex27": 27}


class Block(NamedTuple):
    """An `Elements` block."""

    tag: FebTag
    kind: str
    """Of its elements."""
    ids: Ints
    """(k,) numbers."""
    nodes: Ints
    """(k, m) node indices."""

    @property
    def quads(self) -> Ints:
        """The elements (k, 4) of a shell block; a triangle repeats its last node."""
        return self.nodes if self.nodes.shape[1] == 4 else self.nodes[:, [0, 1, 2, 2]]


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
    surfaces: dict[str, Ints]
    """Facets (k, 4) of node indices each."""
    pairs: dict[str, tuple[str, str]]
    """The two surfaces of each surface pair."""
    discrete: dict[str, Ints]
    """Pairs (k, 2) of node indices each."""

    def nodes_of(self, tag: FebTag, name: str) -> Ints:
        """Node indices of a set, `@surface:` and `@elem_set:` included.

        Raises InputError where there is no such set."""
        kind, _, inner = name.rpartition(":")
        if kind == "@surface":
            return np.unique(self.surface_of(tag, inner))
        if kind in ("@elem_set", "@part", "@part_list") and inner in self.blocks:
            return np.unique(self.blocks[inner].nodes)
        return _find_set(tag, "node set", self.node_sets, name)

    def surface_of(self, tag: FebTag, name: str) -> Ints:
        """Facets (k, 4) of a surface.  Raises InputError where there is none of that name."""
        return _find_set(tag, "surface", self.surfaces, name)

    def elements_of(self, tag: FebTag, name: str) -> Ints:
        """Element numbers of a set or part.  Raises InputError where there is none."""
        return _find_set(tag, "element set or part", self.element_sets, name)


def _find_set(tag: FebTag, what: str, table: dict[str, Ints], name: str) -> Ints:
    if name not in table:
        known = ", ".join(map(repr, list(table)[:10])) or "none"
        raise tag.fault(f"there is no {what} {name!r}; the file has {known}")
    if not len(table[name]):
        raise tag.fault(f"the {what} {name!r} is empty")
    return table[name]


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
    surfaces: dict[str, Ints] = {}
    _add(surfaces, mesh, "Surface", lambda t: _facets(t, numbering))
    discrete: dict[str, Ints] = {}
    _add(discrete, mesh, "DiscreteSet", lambda t: _pairs_of_nodes(t, numbering))
    pairs: dict[str, tuple[str, str]] = {}
    for t in mesh.all("SurfacePair"):
        if t.attribute("name") in pairs:
            raise t.fault(f"two surface pairs are called {t.attribute('name')!r}")
        pairs[t.attribute("name")] = (t.word("primary", ""), t.word("secondary", ""))
    return FebMesh(node_ids, points, blocks, node_sets, element_sets, surfaces, pairs, discrete)


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


def _add(into: dict[str, Ints], mesh: FebTag, kind: str, read: Callable[[FebTag], Ints]) -> None:
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


def _facets(tag: FebTag, numbering: _Numbering) -> Ints:
    rows = tag.table()
    start = np.array(rows.start, dtype=np.intp)
    line, length = np.array(rows.line, dtype=np.intp), np.diff(start)
    wrong = np.flatnonzero((length != 3) & (length != 4))
    if len(wrong) or tag.children or not len(length):
        at = int(line[wrong[0]]) if len(wrong) else None
        raise tag.fault("a surface is made of <quad4> and <tri3> here, and of at least one", at)
    last = np.minimum(3, length - 1)
    pick = start[:-1, None] + np.minimum(np.arange(4), last[:, None])
    ids = whole(tag, np.array(rows.values, dtype=float)[pick], line)
    _, first, times = np.unique(np.sort(ids, axis=1), axis=0, return_index=True, return_counts=True)
    if (times > 1).any():
        i = first[np.argmax(times > 1)]
        raise tag.fault(f"the facet with nodes {ids[i].tolist()} comes twice", int(line[i]))
    return numbering.find(tag, ids, line)


def _pairs_of_nodes(tag: FebTag, numbering: _Numbering) -> Ints:
    _, line, values = rows_of(tag, 2)
    return numbering.find(tag, whole(tag, values, line), line)
