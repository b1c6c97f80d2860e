"""A job as a solid of `q4ans` elements: what holds, loads and touches the sheet at a time.

The sheet's n nodes are pairs: positions z (2n, 3) m hold those on the file's face, where forces,
springs and ties act, then those on the other face.  Contact is FEBio's (`facets`), with its
automatic penalty or the file's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.forces.loads import pressure_forces, pressure_tangent
from fe_solver.forces.springs import NodeSprings, Springs, node_springs, spring_forces
from fe_solver.job.checks import check_job, within
from fe_solver.job.free_bodies import load_wrenches
from fe_solver.job.job import Job
from fe_solver.job.model import (
    body_loads,
    body_poses,
    check_supports,
    dead_loads,
    follower_pressure,
)
from fe_solver.job.phases import Phase, phases
from fe_solver.materials.linear import Law
from fe_solver.q4ans.balance import Coming, Loads, Source, Term, Unbalanced, turns
from fe_solver.q4ans.bodies import BodyFactor, BodySystem, Pull
from fe_solver.q4ans.element import (
    SolidTables,
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
from fe_solver.supports import ContactPair, Tied, links_of, springs_of
from fe_solver.surfaces.closing import outwards

COORDINATE_ROUNDING = 0.2
"""What is lost of the last bit of a coordinate in its differences."""
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
    for phase in phases(job):
        yield from _loose_directors(phase.job)


def _loose_directors(job: Job) -> Iterator[str]:
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
    attached: Array
    """(2n, 3) m, the places of tied nodes in their bodies' frames; zero elsewhere."""
    coming: Coming | None = None
    """What a phase that others go before sets and releases at its begin."""

    @cached_property
    def pairs(self) -> Ints:
        """The elements' nodes (ne, 8)."""
        return np.concatenate(
            [self.job.sheet.quads, self.job.sheet.quads + len(self.job.sheet.points)], axis=1
        )

    @cached_property
    def bodies(self) -> BodySystem | None:
        """The system of the nodes with the bodies that equilibrium moves; None without such."""
        motions = np.array([b.free for b in self.job.bodies], dtype=bool).reshape(-1, 6)
        if not motions.any():
            return None
        tied = np.full(len(self.rest), -1)
        for t in self.job.ties:
            tied[_tied_nodes(t, len(self.job.sheet.points))] = t.body
        volume = sum(float(p.tables.volume.sum()) for p in self.parts)
        length = np.sqrt(volume / self.thickness / len(self.job.sheet.quads))
        return BodySystem(self.free, motions, tied, float(length))

    def at(
        self,
        time: float,
        multipliers: tuple[Array | float, ...] | None = None,
        last: Loads | None = None,
    ) -> Loads:
        """The loads of a time; contact without multipliers where None.  What equilibrium moves of
        the bodies is where it is in the `last` ones, or else where their drives have it."""
        position, rotation = body_poses(self.job.bodies, time)
        if last is not None and self.bodies is not None:
            motions = self.bodies.motions
            position = np.where(motions[:, :3], last.position, position)
            turned = np.asarray(motions[:, 3:].any(axis=1))[:, None, None]
            rotation = np.where(turned, last.rotation, rotation)
        n, pressure = len(self.job.sheet.points), follower_pressure(self.job, time)
        dead = np.zeros_like(self.rest)
        dead[:n] = dead_loads(self.job, time)
        weight = body_loads(self.job, time)
        if weight is not None:
            # half on each face: the mass lies evenly between them
            np.add.at(dead, self.job.sheet.quads, weight / 2)
            np.add.at(dead, self.job.sheet.quads + n, weight / 2)
        if self.coming is not None:
            dead += self.coming.fade.at(time) * self.coming.force
        if multipliers is None:
            multipliers = (0.0,) * len(self.facets)
        met = (None,) * len(self.facets)
        return Loads(time, position, rotation, dead, pressure, multipliers, met)

    def poses(self, share: float, before: Loads, after: Loads) -> tuple[Array, Array]:
        """Positions (nb, 3) m and rotations (nb, 3, 3) of the bodies at a share of the time between
        loads; what equilibrium moves of them goes evenly."""
        time = before.time + share * (after.time - before.time)
        position, rotation = body_poses(self.job.bodies, time)
        if self.bodies is None:
            return position, rotation
        twists = np.hstack(
            [after.position - before.position, turns(before.rotation, after.rotation)]
        )
        evenly = before.carry(share * twists)
        motions = self.bodies.motions
        turned = np.asarray(motions[:, 3:].any(axis=1))[:, None, None]
        return (
            np.where(motions[:, :3], evenly.position, position),
            np.where(turned, evenly.rotation, rotation),
        )

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

    def place(self, z: Array, loads: Loads) -> Array:
        """z (2n, 3) with what is given at the loads' time: ties to bodies and held
        displacements."""
        job, n, out, time = self.job, len(self.job.sheet.points), z.copy(), loads.time
        for h in job.held:
            out[h.nodes, h.component] = self.rest[h.nodes, h.component] + h.displacement.at(time)
        for d in job.held_directors:
            moved = out[d.nodes, d.component] - self.rest[d.nodes, d.component]
            out[n + d.nodes, d.component] = self.rest[n + d.nodes, d.component] + moved
        for t in job.ties:
            nodes = _tied_nodes(t, n)
            out[nodes] = loads.position[t.body] + self.attached[nodes] @ loads.rotation[t.body].T
        if self.coming is not None:
            out += self.coming.fade.at(time) * self.coming.off
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

    def unbalanced(self, z: Array, loads: Loads, terms: Sequence[Term]) -> Unbalanced:
        """What does not balance at z (2n, 3) m."""
        nodes, bodies = self.imbalance(terms, loads), self.bodies
        if bodies is None:
            return Unbalanced(nodes, nodes[self.free])
        spread = bodies.spread(z, loads.position)
        pulls, wrench = _pulls(terms), self.wrench(loads)[0]
        full = bodies.unbalanced(z, loads.position, pulls, nodes, wrench)
        return Unbalanced(nodes, spread.T @ full)

    def wrench(self, loads: Loads) -> tuple[Array, Array]:
        """The loads (nb, 6) N and N m on the bodies at their origins, and the forces (nb, 3) N of
        these that turn with their bodies."""
        out, follower = load_wrenches(self.job.rigid_loads, loads.time, loads.rotation)
        if self.coming is not None:
            out += self.coming.fade.at(loads.time) * self.coming.wrench
        return out, follower

    def body_factor(
        self, bodies: BodySystem, z: Array, loads: Loads, terms: Sequence[Term]
    ) -> BodyFactor:
        """The tangent of nodes and bodies.  Raises SingularError."""
        nodes, (_, follower) = self.imbalance(terms, loads), self.wrench(loads)
        full = bodies.tangent(z, loads.position, _pulls(terms), nodes, follower)
        return BodyFactor.of(bodies, full, bodies.spread(z, loads.position))

    def scale(self, unbalanced: Array, terms: Sequence[Term]) -> float:
        """The largest (N) of the reactions' norm and the forces on nodes by all but elements."""
        outer = [np.abs(t.force).max(initial=0.0) for t in terms if t.source != Source.ELEMENT]
        return float(max(self.least_force, np.linalg.norm(unbalanced[~self.free]), *outer))

    def rounding(self, z: Array, terms: Sequence[Term]) -> float:
        """What of the unknowns' balance is rounding error (N): the last bit of the coordinates
        times the stiffest entry, of all of them."""
        stiffest = max(float(np.abs(t.stiffness).max(initial=0.0)) for t in terms)
        error = COORDINATE_ROUNDING * np.finfo(float).eps * stiffest * float(np.abs(z).max())
        return error * float(np.sqrt(np.count_nonzero(self.free)))

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


def _pulls(terms: Sequence[Term]) -> list[Pull]:
    return [Pull(t.nodes, t.force, t.stiffness, t.body) for t in terms]


def solid_model(job: Job) -> SolidModel:
    """The model of a job.  Raises InputError for what `check_job` and `check_supports` find, for
    surfaces that are not wound alike, and naming what is not covered."""
    check_job(job)
    check_supports(job)
    reasons = obstacles(job)
    if reasons:
        raise InputError(f"{job.name}: --element q4ans does not cover it: {'; '.join(reasons)}")
    rest = _rest_nodes(job.sheet)
    origins = np.array([b.origin for b in job.bodies]).reshape(-1, 3)
    upright = np.tile(np.eye(3), (len(origins), 1, 1))
    return _model_from(job, rest, origins, upright)


def next_model(
    phase: Phase, z: Array, loads: Loads, multipliers: tuple[Array | float, ...]
) -> SolidModel:
    """The model of a phase that goes on from the nodes (2n, 3) m and loads at the end of another,
    of which they are an equilibrium, with the multipliers of its own contact pairs."""
    job, time = phase.job, phase.begin
    job = replace(job, bodies=phase.bodies(loads.position, loads.rotation))
    model = _model_from(job, z, *body_poses(job.bodies, time))
    now, still = model.at(time, multipliers, loads), np.zeros((len(job.bodies), 6))
    off = np.where(model.free, 0.0, z - model.place(z, now))
    terms = tuple(model.terms(z, now))
    left = model.imbalance(terms, now)
    force, wrench = np.where(model.free, left, 0.0), still
    if model.bodies is not None:
        full = model.bodies.unbalanced(z, now.position, _pulls(terms), left, model.wrench(now)[0])
        wrench = np.where(model.bodies.motions, model.bodies.borne(z, now.position, full), 0.0)
    return replace(model, coming=Coming(phase.fade, off, force, wrench))


def _model_from(job: Job, z: Array, position: Array, rotation: Array) -> SolidModel:
    """The model of a job whose nodes z (2n, 3) m are tied to its bodies where these are."""
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
    attached = np.zeros_like(rest)
    for t in job.ties:
        nodes = _tied_nodes(t, len(sheet.points))
        attached[nodes] = (z[nodes] - position[t.body]) @ rotation[t.body]
    return SolidModel(job, rest, _free(job), tuple(parts), facets, springs, links, attached)


def _tied_nodes(tie: Tied, n: int) -> Ints:
    """Those of the n pairs of nodes that move with the body of a tie."""
    return np.concatenate([tie.nodes, n + tie.nodes]) if tie.clamped else tie.nodes


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
    """The place of each of these among the matrix's data."""
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
