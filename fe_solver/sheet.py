"""One description of a sheet, from which a job, a hood and a proof make the solver's model.

Lengths in m, stresses in Pa; an element's normal is right-handed about its corners.

Fibres may be stretched in the sheet as it is laid out (FEBio's isochoric `in-situ stretch`).  The
stress-free sheet is then shorter along the fibre by the stretch s, and wider and thicker by its
square root, so that it has the same volume: laid out, a strip of an incompressible law that is free
across bears a uniaxial tension at the stretch s.  (Maas et al. 2016, J Mech Behav Biomed Mater
61:499.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.elements.kinds import kind_of
from fe_solver.elements.mesh_geometry import check_middles, node_directors, node_means
from fe_solver.elements.mitc9 import FROM_VTK
from fe_solver.elements.shell import shell_tables
from fe_solver.forces.loads import node_volumes
from fe_solver.given import fill, integers, numbers, spread
from fe_solver.materials.linear import Law
from fe_solver.materials.section import Patch, Section, join_sections
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver.model import ShellModel


def in_situ_growth(stretch: Array, isochoric: Array | bool = True) -> Array:
    """The growth (ne, 2) along and across the fibres (see `shell.shell_tables`) of sheets whose
    fibres are stretched by `stretch` (ne,); across there is none where it is not `isochoric` (ne,),
    and the thickness stays (FEBio's F = diag(s, 1, 1))."""
    return np.stack([1 / stretch, np.where(isochoric, np.sqrt(stretch), 1.0)], axis=1) - 1


def stress_free_thickness(laid: Array, stretch: Array) -> Array:
    """The thickness (ne, ...) m, without stress, of a sheet that is `laid` (ne, ...) thick with
    fibres stretched by `stretch` (ne,)."""
    return laid * np.sqrt(stretch).reshape(-1, *[1] * (laid.ndim - 1))


def thickness_as_laid(stress_free: Array, growth: Array) -> Array:
    """The thickness (ne, ...) m, as laid, of a sheet of growth (ne,) along or (ne, 2) along and
    across: what is wider without stress by a stretch in situ is thicker by as much."""
    if growth.ndim == 1:
        return stress_free
    return stress_free / (1 + growth[:, 1]).reshape(-1, *[1] * (stress_free.ndim - 1))


EDGES = {"x0": (0, -1), "x1": (0, 1), "y0": (1, -1), "y1": (1, 1)}
"""Axis and sense of the ends of a sheet."""
ON_EDGE = 1e-6
"""Share of the sheet's size within which a node lies on an edge."""


@dataclass(frozen=True)
class ShellPart:
    """Shell elements of one material."""

    name: str
    law: Law | TensionField
    """Its parameters have shape (k, 1) or (k, g) where they differ between the part's k elements
    or their g Gauss points."""
    in_situ_stretch: float = 1.0
    """The stretch of the fibres in the sheet as it is laid."""
    bending: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) Pa, moduli of bending besides the law's own."""
    sliding: bool = False
    """Whether its fibres slide on each other as it bends (`section`)."""
    isochoric: bool = True
    """Whether the stretch in situ keeps the volume; else it is along the fibres alone."""


@dataclass(frozen=True)
class Sheet:
    """A sheet as it is laid: its mesh, materials and thickness."""

    points: Array
    """(n, 3) m, the nodes."""
    quads: Ints
    """(ne, 4), a triangle as (a, b, c, c), or (ne, 9): nodes of the elements.  Of nine: the four
    corners 1 to 4, the middles of the edges 1-4, 2-3, 1-2 and 4-3, the centre; `quads_from_vtk`
    takes those of other programs."""
    parts: tuple[ShellPart, ...]
    """The materials."""
    part: Ints
    """(ne,) index of each element's part."""
    thickness: Array
    """m: (ne, k) at the elements' nodes, or (ne,) where it is even over each element."""
    fibre: Array
    """(ne, 3) directions, or (ne, g, 3) at the Gauss points."""
    height: Array = field(default_factory=lambda: np.zeros(()))
    """(ne, k) m at the elements' nodes, or one for all: how far along the director the mid-surface
    lies off the nodes."""
    growth: Array | None = None
    """(ne, 2) along the fibres and across: stress-free length over that laid, less one, of elements
    whose fibres have no stretch in situ."""
    lift: Array | float = 0.0
    """(n,) m or one for all: how much higher than its face a node touches a body."""
    left: Array | None = None
    """(ne,) part of each element's width that a cut left; None is all."""
    normals: Array | None = None
    """(n, 3) unit directors; None takes the mean normals of the elements at each node."""
    node_ids: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(n,) numbers by which the user knows the nodes; from 0 where none are given."""
    element_ids: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(ne,) numbers by which the user knows the elements; from 0 where none are given."""

    def __post_init__(self) -> None:
        fill(self, points=numbers("points (m)", self.points), quads=integers("quads", self.quads))
        fill(self, part=integers("part", self.part), fibre=numbers("fibre", self.fibre))
        fill(self, thickness=numbers("thickness (m)", self.thickness))
        n, ne = len(self.points), len(self.quads)
        if np.ndim(self.height) == 0:
            object.__setattr__(self, "height", np.full(self.quads.shape, float(self.height)))
        for name, count in (("node_ids", n), ("element_ids", ne)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.arange(count))

    def node(self, index: int) -> str:
        """Return a node's name, as its user knows it."""
        return f"node {self.node_ids[index]}"

    def element(self, index: int) -> str:
        """Return an element's name, as its user knows it, with its part."""
        return f"element {self.element_ids[index]} (part {self.parts[self.part[index]].name!r})"

    def edge(self, name: str) -> Ints:
        """Return the nodes (k,) with the least x ("x0"), the largest ("x1"), or so of y ("y0",
        "y1").  Raises InputError for another name."""
        if name not in EDGES:
            raise InputError(f"a sheet has the edges {', '.join(EDGES)}, not {name!r}")
        axis, sense = EDGES[name]
        reach = sense * self.points[:, axis]
        size = float(np.ptp(self.points, axis=0).max())
        return np.flatnonzero(reach >= reach.max() - ON_EDGE * size)

    @cached_property
    def directors(self) -> Array:
        """The nodes' unit directors, (n, 3)."""
        return node_directors(self.points, self.quads) if self.normals is None else self.normals

    @property
    def regions(self) -> tuple[str, ...]:
        """The name (ne,) of each element's part."""
        return tuple(self.parts[i].name for i in self.part)

    @property
    def stretch(self) -> Array:
        """The stretch (ne,) of the fibres in situ."""
        return np.array([part.in_situ_stretch for part in self.parts])[self.part]

    @property
    def _isochoric(self) -> Array:
        return np.array([part.isochoric for part in self.parts])[self.part]

    @property
    def stress_free_growth(self) -> Array:
        """How much the sheet grows along the fibres and across if it is let free, (ne, 2)."""
        in_situ = in_situ_growth(self.stretch, self._isochoric)
        if self.growth is None:
            return in_situ
        return np.where(self.stretch[:, None] != 1.0, in_situ, self.growth)

    @cached_property
    def section(self) -> Section:
        """The materials, with the thickness of the stress-free sheet."""
        stretch = np.where(self._isochoric, self.stretch, 1.0)
        element, laid = kind_of(self.quads), stress_free_thickness(self.thickness, stretch)
        if laid.ndim == 1:
            thickness = np.tile(laid[:, None], (1, len(element.gauss)))
        else:
            thickness = laid @ np.stack([element.shape(r, s)[0] for r, s in element.gauss]).T
        elements = [np.flatnonzero(self.part == i) for i in range(len(self.parts))]
        return join_sections(
            [
                Patch(
                    of_part,
                    part.law,
                    thickness[of_part],
                    bending=part.bending,
                    sliding=part.sliding,
                )
                for of_part, part in zip(elements, self.parts, strict=True)
                if len(of_part)
            ]
        )

    @cached_property
    def volumes(self) -> Array:
        """The volume (ne, k) m3 of each element, as laid, that goes to each of its nodes."""
        k = self.quads.shape[1]
        thickness = self.thickness if self.thickness.ndim == 2 else self.thickness[:, None]
        middle = self.points[self.quads] + self.height[:, :, None] * self.directors[self.quads]
        return node_volumes(middle, np.broadcast_to(thickness, (len(thickness), k)))

    def moved(self, over: Array) -> Array:
        """Return the nodes moved along their directors by the mean at each of `over` (ne, k) m,
        (n, 3) m."""
        mean = node_means(over, self.quads, len(self.points))
        return self.points + mean[:, None] * self.directors

    def model(self, **more: Any) -> ShellModel:
        """Return the solver's model of the sheet, with `more` of `ShellModel`'s fields: what holds,
        touches and pulls it.

        Raises InputError where the middles of nine-node quads do not lie between their corners."""
        check_middles(self.points, self.quads, self.element)
        X, D = self.points[self.quads], self.directors[self.quads]
        tables = shell_tables(X, D, self.fibre, self.stress_free_growth, self.height)
        if self.left is not None:
            tables = replace(tables, weight=tables.weight * self.left[:, None])
        return ShellModel(
            self.quads,
            self.points,
            self.directors,
            tables,
            self.section,
            regions=self.regions,
            node_ids=self.node_ids,
            **more,
        )


def quads_from_vtk(quads: Ints) -> Ints:
    """Return nine-node quads (ne, 9) whose nodes are in the order of VTK, FEBio, Abaqus and gmsh
    (corners, the middles of the edges in turn from the first edge on, the centre) in the order of a
    `Sheet`.  Raises InputError for quads of another number of nodes.

    >>> quads_from_vtk(np.arange(9)[None])
    array([[0, 1, 2, 3, 7, 5, 4, 6, 8]])
    """
    if np.ndim(quads) != 2 or np.shape(quads)[1] != 9:
        raise InputError(f"expected quads of nine nodes (ne, 9), got {np.shape(quads)}")
    return np.asarray(quads)[:, FROM_VTK]


def grid(nx: int, ny: int) -> tuple[Array, Ints]:
    """Return nodes (n, 2) of the unit square, x slowest, and its quads (nx ny, 4)."""
    x, y = np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1), indexing="ij")
    node = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    corners = [node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]]
    return np.column_stack([x.ravel(), y.ravel()]), np.stack([c.ravel() for c in corners], axis=1)


def even_sheet(
    points: Array,
    quads: Ints,
    law: Law | TensionField,
    thickness: float | Array,
    *,
    fibre: Sequence[float] = (1.0, 0.0, 0.0),
    **more: Any,
) -> Sheet:
    """Return a sheet of one law through points (n, 3) m, of one thickness (m) or that (n,) of its
    nodes, its fibres along one direction; `more` are other fields of `Sheet`."""
    points, quads = numbers("points (m)", points, None, 3), integers("quads", quads)
    ne, thick = len(quads), numbers("thickness (m)", thickness)
    return Sheet(
        points,
        quads,
        (ShellPart("sheet", law),),
        np.zeros(ne, dtype=np.intp),
        spread("thickness (m), of the nodes", thick, len(points))[quads],
        np.tile(np.asarray(fibre, dtype=float), (ne, 1)),
        **more,
    )


def plate(
    length: float, width: float, nx: int, ny: int, law: Law | TensionField, thickness: float
) -> Sheet:
    """Return a flat rectangle of nx by ny quads in the x-y plane, one corner at the origin, its
    `length` (m), and its fibres, along x; normals along z."""
    uv, quads = grid(nx, ny)
    points = np.column_stack([uv * [length, width], np.zeros(len(uv))])
    return even_sheet(points, quads, law, thickness)
