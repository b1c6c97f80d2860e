"""A shell mesh of the user's, with its named sets, as any reader leaves it; and its meshio reader.

What a hood needs of names: each quad in one set of the regions' names; sets of nodes
`end_central`, `end_radial`, `end_ulnar` (loaded ends), `tied_BODY` (nodes fixed to a bone) and
`spring_NAME` (nodes that a set of springs holds), the latter also as two-node lines from a node of
the hood to the spring's anchor.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.mesh_file import read_mesh_file
from cosim.port import Array, Hand, Ints, mirror

FORMATS = (".vtu", ".vtp", ".vtk", ".msh", ".inp")
CORNERS = {
    "quad": [0, 1, 2, 3],
    "triangle": [0, 1, 2, 2],
    "quad8": [0, 1, 2, 3],
    "quad9": [0, 1, 2, 3],
    "triangle6": [0, 1, 2, 2],
}
"""Number of nodes of the cells that are shells; a triangle repeats its last node."""
LINES = ("line", "line3")
MOST_VALUES = 64
"""An array of whole numbers with more values than that is data and no sets."""
THICKNESS, FIBRE = "thickness", "fibre"
"""Arrays of the quads with a meaning: lengths in the file's unit, and directions of the fibres."""


@dataclass(frozen=True)
class RawMesh:
    """Points (n, 3), quads (ne, 4) and sets by name, all in the file's unit and axes; sets of quads
    and nodes are indices, lines are pairs of nodes (k, 2)."""

    points: Array
    quads: Ints
    cells: Mapping[str, Ints]
    nodes: Mapping[str, Ints]
    lines: Mapping[str, Ints]
    dropped: tuple[str, ...]
    """What the file holds beside that."""
    thickness: Array | None = None
    """(ne,) of a file that states it; the points lie on the mid-surface."""
    fields: Mapping[str, Array] = field(default_factory=dict)
    """Vectors (ne, 3) of the quads by name, in the file's axes, none of them zero."""
    hand: Hand = "right"
    """Of a left one y is ulnar."""

    def of(self, hand: Hand) -> RawMesh:
        """Return the mesh of a right hand as that of another: a left one is its mirror image."""
        if hand == "right":
            return self
        fields = {name: mirror(values) for name, values in self.fields.items()}
        return replace(
            self, points=mirror(self.points), quads=self.quads[:, ::-1], fields=fields, hand=hand
        )


def read_raw(path: Path) -> RawMesh:
    """A .vtu, .msh or .inp file.  Raises InputError where it cannot be read or has no shells."""
    mesh = read_mesh_file(path)
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{path}: expected points with three finite coordinates")
    sets = _Sets()
    for i, block in enumerate(mesh.cells):
        sets.add_block(i, block.type, np.asarray(block.data, dtype=np.intp))
    if not sets.quads:
        raise InputError(f"{path}: holds no shell cells; a hood is made of four-node quads")
    sets.add_cell_sets(mesh)
    sets.add_point_sets(mesh, len(points))
    fields = sets.whole_fields()
    cells, thickness = sets.join(sets.cells), sets.thickness()
    sets.dropped += (mesh.info or {}).get("dropped", ())
    return RawMesh(
        points,
        np.concatenate(sets.quads),
        cells,
        sets.join(sets.nodes),
        {name: np.concatenate(parts) for name, parts in sets.lines.items()},
        tuple(sets.dropped),
        thickness,
        fields,
    )


@dataclass
class _Sets:
    """What has been found so far."""

    quads: list[Ints] = field(default_factory=list)
    first: dict[int, int] = field(default_factory=dict)
    """The first quad of each block of shells."""
    data: dict[int, tuple[str, Ints]] = field(default_factory=dict)
    """Kind and nodes of each block."""
    cells: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    nodes: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    lines: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    dropped: list[str] = field(default_factory=list)
    count: int = 0
    vectors: dict[str, list[Array]] = field(default_factory=lambda: defaultdict(list))
    """By name the vectors of each block of shells that has them."""
    thick: list[Array] = field(default_factory=list)

    def thickness(self) -> Array | None:
        """The quads' thickness (ne,), where every quad has one."""
        if not self.thick:
            return None
        out = np.concatenate(self.thick)
        if len(out) == self.count and (out > 0).all():
            return out
        self.dropped.append("the thickness, which not all quads have")
        return None

    def whole_fields(self) -> dict[str, Array]:
        """The vectors (ne, 3) by name, those that every quad has; the others are dropped."""
        out = {name: np.concatenate(parts) for name, parts in self.vectors.items()}
        whole = {
            name: values
            for name, values in out.items()
            if len(values) == self.count and (np.linalg.norm(values, axis=1) > 0).all()
        }
        self.dropped += [
            f"the vectors {n!r}, which not all quads have" for n in out if n not in whole
        ]
        return whole

    @staticmethod
    def join(sets: Mapping[str, list[Ints]]) -> dict[str, Ints]:
        return {name: np.unique(np.concatenate(parts)) for name, parts in sets.items() if parts}

    def add_block(self, i: int, kind: str, nodes: Ints) -> None:
        self.data[i] = (kind, nodes)
        if kind in CORNERS:
            self.first[i] = self.count
            self.quads.append(nodes[:, CORNERS[kind]])
            self.count += len(nodes)
            if kind not in ("quad", "triangle"):
                self.dropped.append(
                    f"the mid-side nodes of {len(nodes)} cells of type {kind}, whose sides are "
                    "straight then"
                )
        elif kind not in (*LINES, "vertex"):
            self.dropped.append(f"{len(nodes)} cells of type {kind}, which are no shells")

    def put(self, name: str, i: int, chosen: Ints) -> None:
        """Cells `chosen` of block i into the set `name` of their kind."""
        kind, nodes = self.data[i]
        if not len(chosen):
            return
        if kind in CORNERS:
            self.cells[name].append(self.first[i] + chosen)
        elif kind in LINES:
            self.lines[name].append(nodes[chosen][:, :2])
            self.nodes[name].append(nodes[chosen].ravel())
        elif kind == "vertex":
            self.nodes[name].append(nodes[chosen].ravel())

    def add_cell_sets(self, mesh: Any) -> None:
        for name, parts in mesh.cell_sets.items():
            if name.startswith("gmsh:"):
                continue
            for i, part in enumerate(parts):
                if part is not None:
                    self.put(name, i, np.asarray(part, dtype=np.intp))
        physical = {(int(v[0]), int(v[1])): k for k, v in mesh.field_data.items() if len(v) == 2}
        for name, blocks in mesh.cell_data.items():
            if name == "gmsh:geometrical" or (physical and mesh.cell_sets and "gmsh:" in name):
                continue
            for i, values in enumerate(blocks):
                if name == THICKNESS and np.ndim(values) == 1 and np.isfinite(values).all():
                    self.thick += [np.asarray(values, dtype=float)] if i in self.first else []
                else:
                    self._add_values(name, i, np.asarray(values), physical)

    def _add_values(
        self, name: str, i: int, values: Any, physical: Mapping[tuple[int, int], str]
    ) -> None:
        for value, chosen in _groups(values):
            dimension = {"vertex": 0, "line": 1, "line3": 1}.get(self.data[i][0], 2)
            if name == "gmsh:physical":
                self.put(physical.get((value, dimension), f"physical:{value}"), i, chosen)
            else:
                self.put(name if value == 1 and _is_mask(values) else f"{name}:{value}", i, chosen)
        if values.ndim == 2 and values.shape[1] == 3 and values.dtype.kind == "f":
            if i in self.first and np.isfinite(values).all():
                self.vectors[name].append(np.asarray(values, dtype=float))
            return
        if not _has_groups(values) and i == min(self.data):
            self.dropped.append(f"the values {name!r} of the cells")

    def add_point_sets(self, mesh: Any, count: int) -> None:
        for name, part in mesh.point_sets.items():
            nodes = np.asarray(part, dtype=np.intp)
            if len(nodes):
                self.nodes[name].append(nodes)
        for name, values in mesh.point_data.items():
            values = np.asarray(values)
            if name.startswith("gmsh:"):
                continue
            if not _has_groups(values):
                self.dropped.append(f"the values {name!r} of the nodes")
            for value, chosen in _groups(values):
                label = name if value == 1 and _is_mask(values) else f"{name}:{value}"
                self.nodes[label].append(chosen)


def _has_groups(values: Any) -> bool:
    whole = values.ndim == 1 and values.dtype.kind in "iub"
    return bool(whole and len(np.unique(values)) <= MOST_VALUES)


def _is_mask(values: Any) -> bool:
    return bool(np.isin(values, (0, 1)).all())


def _groups(values: Any) -> Iterable[tuple[int, Ints]]:
    """Where an array of whole numbers has each of its values; of zeros and ones where it is one."""
    if not _has_groups(values):
        return
    for value in np.unique(values):
        if value or not _is_mask(values):
            yield int(value), np.flatnonzero(values == value)
