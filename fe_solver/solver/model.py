"""Shell and cables with all that holds them: energy, residual and tangent at body poses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from cosim.port import Array, Ints
from fe_solver.elements import kernels
from fe_solver.elements.shell import ElementResponse, ShellTables, element_blocks, element_response
from fe_solver.forces.cables import Cables, cable_forces
from fe_solver.forces.contact import Contact, contact_forces, join_point_forces
from fe_solver.forces.guides import Guides, Ropes, Ties
from fe_solver.forces.loads import Inertia, pressure_forces, pressure_tangent
from fe_solver.forces.springs import (
    NodeSprings,
    PairForces,
    PointForces,
    Springs,
    node_springs,
    rope_forces,
    spring_forces,
)
from fe_solver.materials.section import Section
from fe_solver.solver.assembly import DOFS, Pattern, make_pattern
from fe_solver.vectors import cross, sum_at_nodes, tangents, turn_directors


@dataclass(frozen=True)
class Configuration:
    """Where the nodes and the bodies are."""

    x: Array
    """(n, 3) m, positions of the nodes."""
    d: Array
    """(n, 3), unit directors of the nodes."""
    position: Array
    """(nb, 3) m, origins of the bodies."""
    rotation: Array
    """(nb, 3, 3), of the bodies' frames."""


@dataclass(frozen=True)
class Evaluation:
    """The balance of a model in one configuration."""

    energy: float
    """J, less the dead loads' work but not the tendons'."""
    gradient_x: Array
    """(n, 3) N, of the energy by the nodes' positions."""
    gradient_d: Array
    """(n, 3) N m, by their directors."""
    points: PointForces
    """Forces of springs, contacts and ropes."""
    bases: tuple[Array, Array]
    """The nodes' bases: A (n, 3, 3) for displacements, T (n, 3, 2) for turns."""
    reduced: Array
    """(5n,) gradient in the nodes' bases, tendon pulls included."""
    follower: Array
    """(n, 3) N of the pressure on the nodes, in `gradient_x` but not in `energy`."""
    convex: bool
    """Whether the tangent is, or will be, the convex one (see `ShellModel.evaluate`)."""
    elements: ElementResponse
    """What the elements' tangent is made of."""
    links: PairForces
    """Forces between pairs of nodes."""
    data: Array | None = None
    """The tangent's entries, where they were asked for."""


class Forces(NamedTuple):
    """What makes the tangent's geometric part: resultants (ne, g, 8) of the elements times the
    areas of their Gauss points, and forces (k,) N of the points."""

    elements: Array
    points: Array


@dataclass(frozen=True)
class ShellModel:
    """A shell of n nodes and ne elements with its supports, its loads and nt tendons, which pull on
    it by guides or ropes."""

    quads: Ints
    """(ne, 4) or (ne, 9), nodes of the elements."""
    reference: Array
    """(n, 3) m, positions of the nodes free of load."""
    directors: Array
    """(n, 3), unit, there."""
    tables: ShellTables
    section: Section
    springs: Springs = field(default_factory=Springs.none)
    ties: Ties = field(default_factory=Ties.none)
    guides: Guides = field(default_factory=Guides.none)
    share: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(nt, k) of each tendon's tension along the first axis of k guided nodes; with those of its
    ropes they add up to one."""
    contacts: tuple[Contact, ...] = ()
    bodies: tuple[str, ...] = ()
    """(nb,) names."""
    dead: Array | None = None
    """(n, 3) N on the nodes, which stay as they are in the world frame."""
    couples: Array | None = None
    """(n, 3) N m on the directors: of dead loads off the nodes, their arms along the directors."""
    pressure: Array | None = None
    """(ne,) Pa, which follows the quads and pushes against their normals."""
    links: NodeSprings = field(default_factory=NodeSprings.none)
    """Springs between nodes of the shell."""
    cables: Cables = field(default_factory=Cables.none)
    """Line cells; a node of no quad has no director to turn."""
    ropes: Ropes = field(default_factory=Ropes.none)
    """What tendons pull on by eyelets."""
    inertia: Inertia | None = None
    groups: tuple[str, ...] = ()
    """Names of the springs' groups."""
    regions: tuple[str, ...] = ()
    """Name of each quad's region, for messages."""
    node_ids: Ints | None = None
    """Numbers (n,) by which the user knows the nodes, for messages; None counts them from 0."""

    def node_name(self, node: int) -> str:
        """A node as its user knows it."""
        return f"node {node if self.node_ids is None else self.node_ids[node]}"

    def with_changes(self, **changes: Any) -> ShellModel:
        """A copy with other loads, contacts, inertia or materials, which shares the sparsity: its
        quads, supports and links are these."""
        other = replace(self, **changes)
        vars(other)["pattern"] = self.pattern
        return other

    @cached_property
    def pattern(self) -> Pattern:
        """The tangent's sparsity."""
        return make_pattern(self.quads, len(self.reference), self.free, self.pairs)

    @cached_property
    def pairs(self) -> Ints:
        """The pairs of nodes (k, 2) that springs join, then those that cables do."""
        return np.concatenate([self.links.nodes, self.cables.nodes])

    def pair_forces(self, x: Array, curvature: bool) -> PairForces:
        """Forces of the springs between nodes, then of the cables; `curvature` as in
        `node_springs`."""
        if not len(self.pairs):
            return PairForces.none()
        springs, cables = node_springs(self.links, x, curvature), cable_forces(self.cables, x)
        return PairForces(
            springs.energy + cables.energy,
            np.concatenate([springs.gradient, cables.gradient]),
            np.concatenate([springs.hessian, cables.hessian]),
        )

    @cached_property
    def free(self) -> Ints:
        """Ascending indices of the free degrees of freedom."""
        mask = np.ones((len(self.reference), DOFS), dtype=bool)
        mask[self.ties.node] = False
        mask[self.guides.node] = ~np.hstack([self.guides.held, self.guides.still])
        mask[np.setdiff1d(np.arange(len(mask)), self.quads), 3:] = False
        return np.flatnonzero(mask)

    @cached_property
    def side(self) -> Array:
        """The signs (ne, k) of the reference's `cosines`."""
        return np.sign(self.cosines(self.reference, self.directors))

    def cosines(self, x: Array, d: Array) -> Array:
        """The cosines (ne, k) between the quads' normals and their nodes' directors."""
        X = x[self.quads]
        normal = cross(X[:, 2] - X[:, 0], X[:, 3] - X[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
        return np.asarray(np.einsum("ek,eak->ea", normal, d[self.quads]))

    def bases(self, c: Configuration) -> tuple[Array, Array]:
        """Displacement bases (n, 3, 3) and director tangents (n, 3, 2)."""
        g = self.guides
        A, T = np.tile(np.eye(3), (len(c.x), 1, 1)), tangents(c.d)
        A[g.node] = c.rotation[g.body] @ g.axes
        if g.steady.any():
            T[g.node[g.steady]] = self._level_tangents(c)
        return A, T

    def _level_tangents(self, c: Configuration) -> Array:
        """The tangents (k, 3, 2) of the steady directors, the first along `level`."""
        g, on = self.guides, self.guides.steady
        d = c.d[g.node[on]]
        level = np.einsum("kij,kj->ki", c.rotation[g.body[on]], g.level[on])
        first = level - np.einsum("ki,ki->k", level, d)[:, None] * d
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, cross(d, first)], axis=2)

    def move_bodies(self, c: Configuration, position: Array, rotation: Array) -> Configuration:
        """The same hood with its bodies at new poses: tied nodes follow, guided nodes are put back
        on their lines and planes."""
        x, d = c.x.copy(), c.d.copy()
        t, g = self.ties, self.guides
        x[t.node] = position[t.body] + np.einsum("kij,kj->ki", rotation[t.body], t.position)
        d[t.node] = np.einsum("kij,kj->ki", rotation[t.body], t.director)
        moved = np.where(g.held, 0.0, self._guide_travel(c))
        local = g.origin + np.einsum("kij,kj->ki", g.axes, moved)
        x[g.node] = position[g.body] + np.einsum("kij,kj->ki", rotation[g.body], local)
        on = g.node[g.steady], g.body[g.steady]
        seen = np.einsum("kji,kj->ki", c.rotation[on[1]], c.d[on[0]])
        d[on[0]] = np.einsum("kij,kj->ki", rotation[on[1]], seen)
        return Configuration(x, d, position, rotation)

    def _guide_travel(self, c: Configuration) -> Array:
        """The travel (k, 3) m of each guided node along its axes."""
        g = self.guides
        local = np.einsum("kji,kj->ki", c.rotation[g.body], c.x[g.node] - c.position[g.body])
        return np.einsum("kji,kj->ki", g.axes, local - g.origin)

    def slide(self, c: Configuration) -> Array:
        """The travel (k,) m of each guided node along its first axis."""
        return self._guide_travel(c)[:, 0]

    def excursion(self, c: Configuration) -> Array:
        """The excursion (nt,) m of each tendon."""
        drawn = self.share @ self.slide(c)
        if len(self.ropes.node):
            length, _ = self.ropes.lines(c.x, c.position, c.rotation)
            drawn = drawn + self.ropes.share @ (self.ropes.length - length)
        return drawn

    def pulls(self, c: Configuration, tension: Array) -> Array:
        """The force (k, 3) N of the tendons on each guided node."""
        g = self.guides
        along = np.einsum("kij,kj->ki", c.rotation[g.body], g.direction)
        return (tension @ self.share)[:, None] * along

    def take_step(self, c: Configuration, bases: tuple[Array, Array], step: Array) -> Configuration:
        """The configuration after a step (5n,) in the nodes' bases."""
        u = step.reshape(-1, DOFS)
        x = c.x + np.einsum("nij,nj->ni", bases[0], u[:, :3])
        return Configuration(x, turn_directors(c.d, bases[1], u[:, 3:]), c.position, c.rotation)

    def point_forces(self, c: Configuration, tension: Array, curvature: bool = True) -> PointForces:
        """Forces of springs to bodies, of contacts, and of ropes under `tension` (nt,) N;
        `curvature` as in `contact_forces`."""
        parts = [spring_forces(self.springs, c.x, c.position, c.rotation, curvature)]
        parts += [contact_forces(k, c.x, c.position, c.rotation, curvature) for k in self.contacts]
        if len(self.ropes.node):
            borne = tension @ self.ropes.share
            parts.append(rope_forces(self.ropes, borne, c.x, c.position, c.rotation))
        return join_point_forces(parts)

    def potential(self, c: Configuration, energy: float, tension: Array) -> float:
        """Total potential energy, J: an evaluation's energy less the tendons' work."""
        return energy - float(tension @ self.excursion(c))

    def evaluate(
        self, c: Configuration, tension: Array, tangent: bool, convex: bool = False
    ) -> Evaluation:
        """Energy, residual and (on request) tangent at a configuration; with `convex` the tangent
        is the positive semidefinite part that is cheap to have, not the consistent one."""
        y = np.concatenate([c.x[self.quads], c.d[self.quads]], axis=1)
        bases = A, T = self.bases(c)
        elements = element_response(self.tables, self.section, y)
        points = self.point_forces(c, tension, not convex)
        n = len(c.x)
        gx, gd = self.nodal(elements.gradient)
        links = self.pair_forces(c.x, not convex)
        gx += points.on_nodes(points.gradient, n)
        gx += sum_at_nodes(self.pairs, links.gradient, n)
        energy = elements.energy + points.energy + links.energy
        if self.dead is not None:
            gx -= self.dead
            energy -= float(np.vdot(self.dead, c.x - self.reference))
        if self.couples is not None:
            gd -= self.couples
            energy -= float(np.vdot(self.couples, c.d - self.directors))
        follower = self._follower(c.x)
        gx -= follower
        if self.inertia is not None:
            more, ix, id_ = self.inertia.pull(c.x, c.d)
            energy, gx, gd = energy + more, gx + ix, gd + id_
        pulled = gx.copy()
        pulled[self.guides.node] -= self.pulls(c, tension)
        reduced = np.concatenate(
            [np.einsum("nij,ni->nj", A, pulled), np.einsum("nij,ni->nj", T, gd)], axis=1
        ).ravel()
        e = Evaluation(energy, gx, gd, points, bases, reduced, follower, convex, elements, links)
        return self.with_tangent(c, e) if tangent else e

    def with_tangent(self, c: Configuration, e: Evaluation) -> Evaluation:
        """An evaluation at `c` with its tangent; one that has it already is itself."""
        return e if e.data is not None else replace(e, data=self.tangent(c, e))

    def nodal(self, elements: Array) -> tuple[Array, Array]:
        """Sums at the nodes, by position and by director (n, 3), of element vectors (ne, 2k, 3)."""
        n, k = len(self.reference), self.quads.shape[1]
        by_position = sum_at_nodes(self.quads, elements[:, :k], n)
        return by_position, sum_at_nodes(self.quads, elements[:, k:], n)

    def _follower(self, x: Array) -> Array:
        """The force (n, 3) N of the pressure on the nodes."""
        if self.pressure is None:
            return np.zeros_like(x)
        return sum_at_nodes(self.quads, pressure_forces(x[self.quads], self.pressure), len(x))

    def tangent(self, c: Configuration, e: Evaluation, forces: Forces | None = None) -> Array:
        """The tangent's data at `c`; with `forces` its geometric part is of these in place of what
        the configuration strains."""
        (A, T), points, hessian, elements = e.bases, e.points, e.points.hessian, e.elements
        if forces is not None:
            hessian = points.bend(forces.points)
            elements = replace(elements, force=forces.elements)
        corners = A[self.quads], T[self.quads]
        blocks = element_blocks(self.tables, elements, corners, e.convex)
        bend = -np.einsum("ni,ni->n", e.gradient_d, c.d)
        bend = np.maximum(bend, 0) if e.convex else bend
        if self.pressure is not None:
            at = (5 * np.arange(self.quads.shape[1])[:, None] + np.arange(3)).ravel()
            W = A[self.quads]
            slope = pressure_tangent(c.x[self.quads], self.pressure)
            turned = np.einsum("naki,nakbl,nblj->naibj", W, slope, W)
            blocks[:, at[:, None], at] -= turned.reshape(-1, len(at), len(at))
        nodal = np.zeros((len(bend), DOFS, DOFS))
        self.add_points(blocks, nodal, points, hessian, A)
        B = A[self.pairs]
        pairs = np.einsum("kaji,kajbl,kblm->kaibm", B, e.links.hessian.reshape(-1, 2, 3, 2, 3), B)
        np.add.at(nodal[:, :3, :3], self.pairs[:, 0], pairs[:, 0, :, 0])
        np.add.at(nodal[:, :3, :3], self.pairs[:, 1], pairs[:, 1, :, 1])
        if self.inertia is not None:
            nodal[:, range(3), range(3)] += self.inertia.stiffness[:, None]
            bend = bend + self.inertia.turning
        # the sphere's curvature: the second variation of a unit director is -|angle|^2 d
        bend[self.ties.node] = 0.0
        nodal[:, 3, 3] = nodal[:, 4, 4] = bend
        return self.pattern.assemble(blocks, nodal, pairs[:, 0, :, 1])

    def add_points(
        self, blocks: Array, nodal: Array, points: PointForces, hessian: Array, A: Array
    ) -> None:
        """Add Hessians (k, 3, 3) of point forces to the blocks of elements (ne, 5m, 5m) and of
        nodes (n, 5, 5), in the nodes' bases A (n, 3, 3), in place."""
        acts, alone = hessian.any(axis=(1, 2)), points.cell < 0
        node, stiffness = points.nodes[acts & alone, 0], hessian[acts & alone]
        np.add.at(nodal[:, :3, :3], node, np.swapaxes(A[node], 1, 2) @ stiffness @ A[node])
        on = np.flatnonzero(acts & ~alone)
        if not on.size:
            return
        cells, which = np.unique(points.cell[on], return_inverse=True)
        spread = kernels.spread(which, points.weights[on], hessian[on], len(cells))
        quads = self.quads[cells]
        turned = np.flatnonzero(np.isin(quads, self.guides.node).any(axis=1))
        B = A[quads[turned]]
        spread[turned] = np.einsum("eaki,eakbl,eblj->eaibj", B, spread[turned], B, optimize=True)
        m = quads.shape[1]
        at = (DOFS * np.arange(m)[:, None] + np.arange(3)).ravel()
        blocks[cells[:, None, None], at[:, None], at] += spread.reshape(-1, 3 * m, 3 * m)

    @cached_property
    def slaves(self) -> tuple[Ints, sp.csr_array]:
        """The degrees of freedom of tied and guided nodes, and the tangent's columns there, their
        entries the positions in its data."""
        nodes = np.union1d(self.ties.node, self.guides.node)
        dofs = (nodes[:, None] * DOFS + np.arange(DOFS)).ravel()
        slots = self.pattern.full(np.arange(1.0, len(self.pattern.indices) + 1))[:, dofs]
        places = slots.data.astype(np.intp) - 1
        return dofs, sp.csr_array((places, slots.indices, slots.indptr), slots.shape)
