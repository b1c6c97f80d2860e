"""A job as a solid of `q4ans` elements: what holds, loads and touches the sheet at a time.

The sheet's n nodes are pairs: positions z (2n, 3) m hold those on the file's face, where forces,
springs and ties act, then those on the other face.  Contact is FEBio's (`facets`), with its
automatic penalty or the file's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.forces.loads import pressure_forces, pressure_tangent
from fe_solver.forces.springs import NodeSprings, Springs, node_springs, spring_forces
from fe_solver.job.checks import check_job, within
from fe_solver.job.job import Job
from fe_solver.job.model import (
    body_loads,
    body_poses,
    check_supports,
    dead_loads,
    follower_pressure,
)
from fe_solver.materials.linear import Law
from fe_solver.q4ans.element import (
    SolidTables,
    Stressed,
    cross_matrix,
    solid_response,
    solid_tables,
)
from fe_solver.q4ans.facets import (
    Facets,
    Pressed,
    cut,
    find_triangles,
    looks_away,
    pressures,
)
from fe_solver.q4ans.laws import law_obstacle, normal_modulus
from fe_solver.sheet import Sheet, ShellPart
from fe_solver.solver.linear_algebra import Analysis, Factor, analyse
from fe_solver.supports import ContactPair, links_of, springs_of
from fe_solver.surfaces.closing import outwards

ON_FACE = 1e-9
"""Share of the thickness by which a node may lie off the sheet's face."""


def obstacles(job: Job) -> list[str]:
    """What a job has that `q4ans` elements do not cover, a reason each; none where they do."""
    return [*_obstacles(job)]


def _obstacles(job: Job) -> Iterator[str]:
    for body in job.bodies:
        if body.surface is not None:
            yield f"the body {body.name!r} has a surface that is not of triangles"
    for part in job.sheet.parts:
        reason = law_obstacle(part.law)
        if reason is not None:
            yield f"part {part.name!r}: the law {type(part.law).__name__} {reason}"
        if part.in_situ_stretch != 1.0 and not part.isochoric:
            yield f"part {part.name!r}: its stretch in situ changes the volume"
    if job.sheet.quads.shape[1] != 4:
        yield "its elements have nine nodes"
        return
    off = np.abs(2 * np.abs(job.sheet.height) - job.sheet.thickness) > ON_FACE * job.sheet.thickness
    off |= job.sheet.height * job.sheet.height[0, 0] <= 0
    if off.any():
        yield "its nodes do not all lie on one face of the sheet"
    else:
        yield from _crossed_faces(job.sheet)
    for pair in job.contacts:
        body = job.bodies[pair.body]
        if pair.friction > 0:
            yield f"contact {pair.name!r} has friction"
        if body.surface is None and not off.any() and _looks_away(job, pair):
            yield (
                f"contact {pair.name!r}: the sheet's face that is named looks away from the body "
                f"{body.name!r}, so that in FEBio they do not touch; turn its facets over, or name "
                "the other face"
            )
    for d in job.held_directors:
        given = [h.nodes for h in job.held if h.component == d.component]
        loose = np.setdiff1d(d.nodes, np.concatenate([*given, *(t.nodes for t in job.ties)]))
        if len(loose):
            yield f"the director of {job.sheet.node(loose[0])} is held, and it is free to move"


def _looks_away(job: Job, pair: ContactPair) -> bool:
    facets = _facets(job, pair, np.zeros(len(pair.quads)))
    pose = job.bodies[pair.body].pose(0.0)
    return looks_away(facets, _rest_nodes(job.sheet), *pose, float(job.sheet.thickness.mean()))


def _rest_nodes(sheet: Sheet) -> Array:
    """The nodes (2n, 3) m as laid out: those on the file's face, those on the other."""
    return np.concatenate([sheet.points, sheet.moved(2 * sheet.height)])


def _crossed_faces(sheet: Sheet) -> Iterator[str]:
    rest = _rest(sheet, np.arange(len(sheet.quads)))
    crossed = np.flatnonzero(cross_matrix(rest, sheet.height[0, 0]))
    if len(crossed):
        yield (
            f"{sheet.element(crossed[0])}: the sheet is thicker than its radius there, so that its "
            f"faces cross ({len(crossed)} such elements)"
        )


def _rest(sheet: Sheet, elements: Ints) -> Array:
    """The corners (k, 8, 3) m of elements (k,) as laid out: on the file's face, on the other."""
    quads = sheet.quads[elements]
    low = sheet.points[quads]
    high = low + 2 * sheet.height[elements, :, None] * sheet.directors[quads]
    return np.concatenate([low, high], axis=1)


class Loads(NamedTuple):
    """The loads of one time, and the state of contact."""

    position: Array
    """(nb, 3) m, of the bodies."""
    rotation: Array
    """(nb, 3, 3), of the bodies."""
    dead: Array
    """(2n, 3) N."""
    pressure: Array | None
    """(ne,) Pa, which follows the quads."""
    multipliers: tuple[Array | float, ...]
    """(k, 4) Pa of each contact pair."""
    met: tuple[Ints | None, ...]
    """(k, 4) triangles of each contact pair; None where they are to be looked for."""


class Source(Enum):
    """What resists."""

    ELEMENT = "element"
    CONTACT = "contact"
    SPRING = "spring"
    LINK = "spring between nodes"
    PRESSURE = "pressure"


class Term(NamedTuple):
    """A part of the balance."""

    source: Source
    nodes: Ints
    """(k, m)."""
    force: Array
    """(k, m, 3) N, with which the nodes resist."""
    stiffness: Array
    """(k, 3m, 3m) N/m, its derivative."""
    body: Ints | None = None
    """(k,) on which the nodes act; None where there is none."""
    stressed: Stressed | None = None
    """What elements bear."""

    def product(self, moved: Array) -> Array:
        """The change (k, m, 3) N of the forces by displacements (k, m, 3) m of the nodes."""
        flat = moved.reshape(len(moved), 3 * moved.shape[1], 1)
        return np.asarray((self.stiffness @ flat).reshape(moved.shape))


@dataclass(frozen=True)
class SolidPart:
    """k elements of one law."""

    elements: Ints
    """(k,)."""
    rest: Array
    """(k, 8, 3) m, their nodes as laid out."""
    tables: SolidTables
    law: Law
    normal_modulus: float
    """Pa, through the thickness."""


@dataclass(frozen=True)
class SolidModel:
    """n pairs of nodes, the two faces of a sheet, with their supports."""

    job: Job
    rest: Array
    """(2n, 3) m."""
    free: NDArray[np.bool_]
    """(2n, 3) which components are free."""
    parts: tuple[SolidPart, ...]
    facets: tuple[Facets, ...]
    springs: Springs
    links: NodeSprings

    @cached_property
    def pairs(self) -> Ints:
        """The elements' nodes (ne, 8)."""
        return np.concatenate(
            [self.job.sheet.quads, self.job.sheet.quads + len(self.job.sheet.points)], axis=1
        )

    def at(self, time: float, multipliers: tuple[Array | float, ...] | None = None) -> Loads:
        """The loads of a time; contact without multipliers where None."""
        n, pressure = len(self.job.sheet.points), follower_pressure(self.job, time)
        dead = np.zeros_like(self.rest)
        dead[:n] = dead_loads(self.job, time)
        weight = body_loads(self.job, time)
        if weight is not None:
            # half on each face: the mass lies evenly between them
            np.add.at(dead, self.job.sheet.quads, weight / 2)
            np.add.at(dead, self.job.sheet.quads + n, weight / 2)
        if multipliers is None:
            multipliers = (0.0,) * len(self.facets)
        met = (None,) * len(self.facets)
        return Loads(*body_poses(self.job.bodies, time), dead, pressure, multipliers, met)

    def search_contacts(self, z: Array, loads: Loads) -> Loads:
        """The loads with contact kept to the triangles that it meets at z."""
        met = (
            find_triangles(f, z, loads.position[f.body], loads.rotation[f.body])
            for f in self.facets
        )
        return loads._replace(met=tuple(met))

    def with_penalty(self, share: float) -> SolidModel:
        """The model with so much of contact's penalties."""
        facets = tuple(replace(f, penalty=share * f.penalty) for f in self.facets)
        return replace(self, facets=facets)

    def place(self, z: Array, time: float) -> Array:
        """z (2n, 3) with what is given at a time: ties to bodies and held displacements."""
        job, n, out = self.job, len(self.job.sheet.points), z.copy()
        for h in job.held:
            out[h.nodes, h.component] = self.rest[h.nodes, h.component] + h.displacement.at(time)
        for d in job.held_directors:
            moved = out[d.nodes, d.component] - self.rest[d.nodes, d.component]
            out[n + d.nodes, d.component] = self.rest[n + d.nodes, d.component] + moved
        for t in job.ties:
            body = job.bodies[t.body]
            position, rotation = body.pose(time)
            nodes = np.concatenate([t.nodes, n + t.nodes]) if t.clamped else t.nodes
            out[nodes] = position + (self.rest[nodes] - body.origin) @ rotation.T
        return out

    def contacts(self, z: Array, loads: Loads) -> list[Pressed]:
        """What each pair does."""
        return [
            pressures(f, z, loads.position[f.body], loads.rotation[f.body], multiplier, met)
            for f, multiplier, met in zip(self.facets, loads.multipliers, loads.met, strict=True)
        ]

    def terms(
        self, z: Array, loads: Loads, before: tuple[Sequence[Term], Array] | None = None
    ) -> Iterator[Term]:
        """All parts of the balance but the dead loads, always in this order: elements by part,
        contact by pair, springs to bodies, springs between nodes, pressure.

        With the terms `before` a step (2n, 3) m that led to z, the elements' tangents have the
        stress that these predicted in place of that which the step's error strains (see
        `fe_solver.solver.mixed_steps`)."""
        last = [t.stressed for t in before[0] if t.stressed is not None] if before else []
        for i, part in enumerate(self.parts):
            nodes = self.pairs[part.elements]
            y = part.rest + (z - self.rest)[nodes]
            predicted = last[i].after(before[1][nodes]) if before else None
            force, stiffness, stressed = solid_response(part.tables, part.law, y, predicted)
            force = force.reshape(-1, 8, 3)
            yield Term(Source.ELEMENT, nodes, force, stiffness, stressed=stressed)
        for f, p in zip(self.facets, self.contacts(z, loads), strict=True):
            body = np.full(len(f.quads), f.body)
            yield Term(Source.CONTACT, f.quads, p.gradient.reshape(-1, 4, 3), p.blocks, body)
        s = spring_forces(self.springs, z, loads.position, loads.rotation, curvature=True)
        yield Term(Source.SPRING, s.nodes, s.gradient[:, None], s.hessian, s.body)
        links = node_springs(self.links, z, curvature=True)
        yield Term(Source.LINK, self.links.nodes, links.gradient, links.hessian)
        if loads.pressure is not None:
            x = z[self.job.sheet.quads]
            stiffness = -pressure_tangent(x, loads.pressure).reshape(-1, 12, 12)
            stiffness = (stiffness + np.swapaxes(stiffness, 1, 2)) / 2
            force = -pressure_forces(x, loads.pressure)
            yield Term(Source.PRESSURE, self.job.sheet.quads, force, stiffness)

    def imbalance(self, terms: Sequence[Term], loads: Loads) -> Array:
        """The forces (2n, 3) N with which the nodes resist more than the dead loads ask for: zero
        at free components in equilibrium, reactions at given ones."""
        out = -loads.dead
        for term in terms:
            np.add.at(out, term.nodes, term.force)
        return out

    def miss(self, unbalanced: Array) -> float:
        """The norm (N) of what does not balance; infinite where a law has no answer."""
        size = float(np.linalg.norm(unbalanced[self.free]))
        return size if np.isfinite(size) else np.inf

    def scale(self, unbalanced: Array, terms: Sequence[Term]) -> float:
        """The largest (N) of the reactions' norm and the forces on nodes by all but elements."""
        outer = [np.abs(t.force).max(initial=0.0) for t in terms if t.source != Source.ELEMENT]
        return float(max(self.least_force, np.linalg.norm(unbalanced[~self.free]), *outer))

    @cached_property
    def thickness(self) -> float:
        """The mean thickness (m) of the sheet."""
        return float(self.job.sheet.thickness.mean())

    @cached_property
    def least_force(self) -> float:
        """The least force (N) that is a load: a millionth of modulus times squared thickness."""
        modulus = max(p.normal_modulus for p in self.parts)
        return 1e-6 * modulus * self.thickness**2

    def deepest(self, z: Array, loads: Loads) -> float:
        """The depth (m) by which contact penetrates."""
        contacts = self.contacts(z, loads)
        return max((float(p.depth.max(initial=0.0)) for p in contacts), default=0.0)

    def pattern(self, terms: Sequence[Term]) -> SolidPattern:
        """The pattern of the tangent's free part, which is the same for all terms of a model."""
        return _pattern([t.nodes for t in terms], self.free)


def solid_model(job: Job) -> SolidModel:
    """The model of a job.  Raises InputError for what `check_job` and `check_supports` find, for
    surfaces that are not wound alike, and naming what is not covered."""
    check_job(job)
    check_supports(job)
    reasons = obstacles(job)
    if reasons:
        raise InputError(f"{job.name}: --element q4ans does not cover it: {'; '.join(reasons)}")
    sheet, quads = job.sheet, job.sheet.quads
    rest = _rest_nodes(sheet)
    parts = [_part(job, np.flatnonzero(sheet.part == i), p) for i, p in enumerate(sheet.parts)]
    parts = [p for p in parts if len(p.elements)]
    volume, modulus = np.zeros(len(quads)), np.zeros(len(quads))
    for p in parts:
        volume[p.elements] = p.tables.volume.sum(axis=1)
        modulus[p.elements] = p.normal_modulus
    facets = tuple(
        _facets(job, pair, _penalty(job, pair, volume, modulus)) for pair in job.contacts
    )
    springs, links = springs_of(job.springs), links_of(job.springs)
    return SolidModel(job, rest, _free(job), tuple(parts), facets, springs, links)


def _part(job: Job, elements: Ints, part: ShellPart) -> SolidPart:
    rest = _rest(job.sheet, elements)
    tables = solid_tables(rest, job.sheet.fibre[elements], part.in_situ_stretch)
    modulus = normal_modulus(part.law, part.in_situ_stretch)
    return SolidPart(elements, rest, tables, part.law, modulus)


def _free(job: Job) -> NDArray[np.bool_]:
    n = len(job.sheet.points)
    free = np.ones((2 * n, 3), dtype=bool)
    for t in job.ties:
        free[t.nodes] = False
        if t.clamped:
            free[n + t.nodes] = False
    for h in job.held:
        free[h.nodes, h.component] = False
    for d in job.held_directors:
        free[n + d.nodes, d.component] = False
    return free


def _areas(job: Job, pair: ContactPair) -> Array:
    """The areas (k,) m2 of a pair's facets."""
    X = job.sheet.points[job.sheet.quads[pair.quads]]
    return np.linalg.norm(np.cross(X[:, 2] - X[:, 0], X[:, 3] - X[:, 1]), axis=1) / 2


def _penalty(job: Job, pair: ContactPair, volume: Array, modulus: Array) -> Array:
    """FEBio's automatic penalty E A / V times the file's factor, (k,) N/m3: the modulus along the
    normal, the facet's area, the element's volume (theory manual 3.4, section 7.1.7); or the
    file's."""
    if not pair.automatic:
        return np.full(len(pair.quads), pair.penalty)
    q = pair.quads
    return np.asarray(pair.penalty * modulus[q] * _areas(job, pair) / volume[q])


def _facets(job: Job, pair: ContactPair, penalty: Array) -> Facets:
    """The facets of a pair, on a surface wound as our own shell takes it: a closed one outwards, an
    open one as it is."""
    other = pair.side * job.sheet.height[pair.quads, 0] > 0
    quads = job.sheet.quads[pair.quads] + len(job.sheet.points) * other[:, None]
    body = job.bodies[pair.body]
    with within(f"{job.name}: contact {pair.name!r} with the body {body.name!r}"):
        corners = body.vertices[outwards(body.vertices, pair.triangles)]
    near = cut(corners, float(np.sqrt(np.median(_areas(job, pair)))))
    return Facets(quads, pair.side, penalty, pair.body, near, pair.gap)


@dataclass(frozen=True)
class SolidPattern:
    """Where the entries of all terms go among the matrix's data."""

    kept: NDArray[np.bool_]
    """Which of all terms' entries belong to free components."""
    place: Ints
    """Of each of these among the matrix's data."""
    slots: sp.csc_array
    """The matrix, whose data number its entries from 1."""

    @cached_property
    def analysis(self) -> Analysis:
        """The symbolic factorisation for this pattern, made once."""
        return analyse(self.slots)

    def data(self, terms: Sequence[Term]) -> Array:
        """The matrix's entries."""
        values = np.concatenate([t.stiffness.ravel() for t in terms])[self.kept]
        return np.bincount(self.place, values, self.slots.nnz).astype(float)

    def factorise(self, terms: Sequence[Term]) -> Factor:
        """The tangent, which may be indefinite.  Raises ConvergenceError where it is singular."""
        return self.analysis.factor(self.data(terms))


def _pattern(groups: Sequence[Ints], free: NDArray[np.bool_]) -> SolidPattern:
    """The pattern of blocks that join the nodes of each row of the groups (k, m)."""
    number = np.where(free.ravel(), np.cumsum(free) - 1, -1)
    dofs = [
        number[3 * g[:, :, None] + np.arange(3)].reshape(len(g), 3 * g.shape[1]) for g in groups
    ]
    rows = np.concatenate([np.repeat(d, d.shape[1], axis=1).ravel() for d in dofs])
    columns = np.concatenate([np.tile(d, (1, d.shape[1])).ravel() for d in dofs])
    kept, size = (rows >= 0) & (columns >= 0), int(free.sum())
    at, place = np.unique(columns[kept] * size + rows[kept], return_inverse=True)
    begins = np.searchsorted(at, np.arange(size + 1) * size)
    data = 1.0 + np.arange(len(at))
    return SolidPattern(kept, place, sp.csc_array((data, at % size, begins), shape=(size, size)))
