"""The shell with everything that holds it: energy, residual and tangent at given body poses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cosim.port import skew

from .assembly import DOFS, Pattern, add_at, make_pattern, scattered, tangents, turned
from .contact import Contact, contact_forces, joined
from .guides import Guides, Ties
from .loads import Inertia, pressure_forces, pressure_tangent
from .section import Section
from .shell import ShellTables, element_response
from .springs import (
    NodeSprings,
    PairForces,
    PointForces,
    Springs,
    node_springs,
    spring_forces,
)

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Configuration:
    """Node positions (n, 3), directors (n, 3) and body poses (nb, 3), (nb, 3, 3)."""

    x: Array
    d: Array
    position: Array
    rotation: Array


@dataclass(frozen=True)
class Evaluation:
    """Energy (J) less the dead loads' work but not the tendons', its raw gradients by x and d (n,
    3), the point forces, and the tangent's data where it was asked for."""

    energy: float
    gradient_x: Array
    gradient_d: Array
    points: PointForces
    bases: tuple[Array, Array]
    reduced: Array
    """(5n,) gradient in the nodes' bases, tendon pulls included."""
    follower: Array
    """(n, 3) N of the pressure on the nodes, in `gradient_x` but not in `energy`."""
    convex: bool
    """Whether the tangent is, or will be, the convex one (see `ShellModel.evaluate`)."""
    data: Array | None


@dataclass(frozen=True)
class ShellModel:
    """A shell, its supports and loads; tendons pull guided nodes along their first axis with shares
    `share` (nt, k) of k guided nodes, each row adding up to one.  `dead` (n, 3) N are forces on the
    nodes that stay as they are in the world frame, `pressure` (ne,) Pa follows the quads and pushes
    against their normals."""

    quads: Ints
    reference: Array
    directors: Array
    tables: ShellTables
    section: Section
    springs: Springs
    ties: Ties
    guides: Guides
    share: Array
    contacts: tuple[Contact, ...]
    bodies: tuple[str, ...]
    dead: Array | None = None
    pressure: Array | None = None
    links: NodeSprings = field(default_factory=NodeSprings.none)
    """Springs between nodes of the shell."""
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

    def alike(self, **changes: Any) -> ShellModel:
        """A copy with other loads, contacts, inertia or materials, which shares the sparsity: its
        quads, supports and links are these."""
        other = replace(self, **changes)
        vars(other)["pattern"] = self.pattern
        return other

    @cached_property
    def pattern(self) -> Pattern:
        return make_pattern(self.quads, len(self.reference), self.free, self.links.nodes)

    @cached_property
    def free(self) -> Ints:
        """Ascending indices of the free degrees of freedom."""
        mask = np.ones((len(self.reference), DOFS), dtype=bool)
        mask[self.ties.node] = False
        mask[self.guides.node] = ~np.hstack([self.guides.held, self.guides.still])
        return np.flatnonzero(mask)

    def bases(self, c: Configuration) -> tuple[Array, Array]:
        """Displacement bases (n, 3, 3) and director tangents (n, 3, 2)."""
        g = self.guides
        A, T = np.tile(np.eye(3), (len(c.x), 1, 1)), tangents(c.d)
        A[g.node] = c.rotation[g.body] @ g.axes
        if g.steady.any():
            T[g.node[g.steady]] = self._level_tangents(c)
        return A, T

    def _level_tangents(self, c: Configuration) -> Array:
        """(k, 3, 2) tangents of the steady directors, the first along `level`."""
        g, on = self.guides, self.guides.steady
        d = c.d[g.node[on]]
        level = np.einsum("kij,kj->ki", c.rotation[g.body[on]], g.level[on])
        first = level - np.einsum("ki,ki->k", level, d)[:, None] * d
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(d, first)], axis=2)

    def posed(self, c: Configuration, position: Array, rotation: Array) -> Configuration:
        """The same hood with its bodies at new poses: tied nodes follow, guided nodes are put back
        on their lines and planes."""
        x, d = c.x.copy(), c.d.copy()
        t, g = self.ties, self.guides
        x[t.node] = position[t.body] + np.einsum("kij,kj->ki", rotation[t.body], t.position)
        d[t.node] = np.einsum("kij,kj->ki", rotation[t.body], t.director)
        moved = np.where(g.held, 0.0, self._moved(c))
        local = g.origin + np.einsum("kij,kj->ki", g.axes, moved)
        x[g.node] = position[g.body] + np.einsum("kij,kj->ki", rotation[g.body], local)
        on = g.node[g.steady], g.body[g.steady]
        seen = np.einsum("kji,kj->ki", c.rotation[on[1]], c.d[on[0]])
        d[on[0]] = np.einsum("kij,kj->ki", rotation[on[1]], seen)
        return Configuration(x, d, position, rotation)

    def _moved(self, c: Configuration) -> Array:
        """(k, 3) m, how far each guided node has moved along its axes."""
        g = self.guides
        local = np.einsum("kji,kj->ki", c.rotation[g.body], c.x[g.node] - c.position[g.body])
        return np.einsum("kji,kj->ki", g.axes, local - g.origin)

    def slide(self, c: Configuration) -> Array:
        """(k,) m, how far each guided node has moved along its first axis."""
        return self._moved(c)[:, 0]

    def excursion(self, c: Configuration) -> Array:
        """(nt,) m."""
        return self.share @ self.slide(c)

    def pulls(self, c: Configuration, tension: Array) -> Array:
        """(k, 3) N force of the tendons on each guided node."""
        g = self.guides
        along = np.einsum("kij,kj->ki", c.rotation[g.body], g.direction)
        return (tension @ self.share)[:, None] * along

    def stepped(self, c: Configuration, bases: tuple[Array, Array], step: Array) -> Configuration:
        """The configuration after a step (5n,) in the nodes' bases."""
        u = step.reshape(-1, DOFS)
        x = c.x + np.einsum("nij,nj->ni", bases[0], u[:, :3])
        return Configuration(x, turned(c.d, bases[1], u[:, 3:]), c.position, c.rotation)

    def point_forces(self, c: Configuration, curvature: bool = True) -> PointForces:
        parts = [spring_forces(self.springs, c.x, c.position, c.rotation, curvature)]
        parts += [contact_forces(k, c.x, c.position, c.rotation, curvature) for k in self.contacts]
        return joined(parts)

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
        own = (A[self.quads], T[self.quads]) if tangent else None
        elements = element_response(self.tables, self.section, y, own, convex)
        points = self.point_forces(c, not convex)
        n = len(c.x)
        gx, gd = self.nodal(elements.gradient)
        links = node_springs(self.links, c.x, not convex)
        gx += scattered(points.node, points.gradient, n)
        gx += scattered(self.links.nodes, links.gradient, n)
        energy = elements.energy + points.energy + links.energy
        if self.dead is not None:
            gx -= self.dead
            energy -= float(np.vdot(self.dead, c.x - self.reference))
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
        e = Evaluation(energy, gx, gd, points, bases, reduced, follower, convex, None)
        if elements.blocks is None:
            return e
        return replace(e, data=self._assemble(elements.blocks, c, e, links))

    def with_tangent(self, c: Configuration, e: Evaluation) -> Evaluation:
        """An evaluation at `c` with its tangent; one that has it already is itself."""
        if e.data is not None:
            return e
        y = np.concatenate([c.x[self.quads], c.d[self.quads]], axis=1)
        own = e.bases[0][self.quads], e.bases[1][self.quads]
        blocks = element_response(self.tables, self.section, y, own, e.convex).blocks
        assert blocks is not None
        links = node_springs(self.links, c.x, not e.convex)
        return replace(e, data=self._assemble(blocks, c, e, links))

    def nodal(self, elements: Array) -> tuple[Array, Array]:
        """Sums at the nodes, by position and by director (n, 3), of element vectors (ne, 8, 3)."""
        n = len(self.reference)
        by_position = scattered(self.quads, elements[:, :4], n)
        return by_position, scattered(self.quads, elements[:, 4:], n)

    def _follower(self, x: Array) -> Array:
        """(n, 3) N force of the pressure on the nodes."""
        if self.pressure is None:
            return np.zeros_like(x)
        return scattered(self.quads, pressure_forces(x[self.quads], self.pressure), len(x))

    def _assemble(self, blocks: Array, c: Configuration, e: Evaluation, links: PairForces) -> Array:
        A, points = e.bases[0], e.points
        bend = -np.einsum("ni,ni->n", e.gradient_d, c.d)
        bend = np.maximum(bend, 0) if e.convex else bend
        if self.pressure is not None:
            at = (5 * np.arange(4)[:, None] + np.arange(3)).ravel()
            W = A[self.quads]
            slope = pressure_tangent(c.x[self.quads], self.pressure)
            turned = np.einsum("naki,nakbl,nblj->naibj", W, slope, W)
            blocks[:, at[:, None], at] -= turned.reshape(-1, 12, 12)
        nodal = np.zeros((len(bend), DOFS, DOFS))
        own = np.swapaxes(A[points.node], 1, 2) @ points.hessian @ A[points.node]
        np.add.at(nodal[:, :3, :3], points.node, own)
        B = A[self.links.nodes]
        pairs = np.einsum("kaji,kajbl,kblm->kaibm", B, links.hessian.reshape(-1, 2, 3, 2, 3), B)
        np.add.at(nodal[:, :3, :3], self.links.nodes[:, 0], pairs[:, 0, :, 0])
        np.add.at(nodal[:, :3, :3], self.links.nodes[:, 1], pairs[:, 1, :, 1])
        if self.inertia is not None:
            nodal[:, range(3), range(3)] += self.inertia.stiffness[:, None]
            bend = bend + self.inertia.turning
        # the sphere's curvature: the second variation of a unit director is -|angle|^2 d
        bend[self.ties.node] = 0.0
        nodal[:, 3, 3] = nodal[:, 4, 4] = bend
        return self.pattern.assemble(blocks, nodal, pairs[:, 0, :, 1])

    def wrenches(self, c: Configuration, e: Evaluation, tension: Array) -> dict[str, Array]:
        """(nb, 6) forces (N) and moments (N m) about each body's origin of the hood on the bodies,
        world frame, by source: springs per group, contact, tie, guide."""
        nb = len(self.bodies)
        p = e.points
        out = {"contact": _wrench(p.body, p.gradient, p.arm, nb, p.group == -1)}
        for i in range(int(self.springs.group.max(initial=-1)) + 1):
            out[f"spring {i}"] = _wrench(p.body, p.gradient, p.arm, nb, p.group == i)
        t, g = self.ties, self.guides
        arm = c.x[t.node] - c.position[t.body]
        couple = np.cross(c.d[t.node], e.gradient_d[t.node])
        out["tie"] = _wrench(t.body, -e.gradient_x[t.node], arm, nb)
        np.add.at(out["tie"][:, 3:], t.body, -couple)
        reaction = e.gradient_x[g.node] - self.pulls(c, tension)
        arm = c.x[g.node] - c.position[g.body]
        out["guide"] = _wrench(g.body, -reaction, arm, nb)
        on = g.node[g.steady]
        couple = np.cross(c.d[on], e.gradient_d[on])
        np.add.at(out["guide"][:, 3:], g.body[g.steady], -couple)
        return out

    @cached_property
    def _slaves(self) -> tuple[Ints, sp.csr_array]:
        """The degrees of freedom of tied and guided nodes, and the tangent's columns there, their
        entries the positions in its data."""
        nodes = np.union1d(self.ties.node, self.guides.node)
        dofs = (nodes[:, None] * DOFS + np.arange(DOFS)).ravel()
        slots = self.pattern.full(np.arange(1.0, len(self.pattern.indices) + 1))[:, dofs]
        places = slots.data.astype(np.intp) - 1
        return dofs, sp.csr_array((places, slots.indices, slots.indptr), slots.shape)

    def slaved(self, c: Configuration, bases: tuple[Array, Array]) -> Array:
        """(5n, 6nb) how tied and guided nodes follow twists of the bodies."""
        A, T = bases
        out = np.zeros((len(c.x), DOFS, len(self.bodies), 6))
        for held in (self.ties, self.guides):
            arm = c.x[held.node] - c.position[held.body]
            G = np.concatenate([np.tile(np.eye(3), (len(arm), 1, 1)), -skew(arm)], axis=2)
            out[held.node, :3, held.body] = np.swapaxes(A[held.node], 1, 2) @ G
        on = self.guides.steady
        for node, body in (
            (self.ties.node, self.ties.body),
            (self.guides.node[on], self.guides.body[on]),
        ):
            out[node, 3:, body, 3:] = -np.swapaxes(T[node], 1, 2) @ skew(c.d[node])
        return out.reshape(-1, 6 * len(self.bodies))

    def coupling(
        self, c: Configuration, e: Evaluation, tension: Array
    ) -> tuple[Array, Array, Array, Array]:
        """At an evaluation with its tangent: the residual by the bodies' twists (5n, 6nb) and the
        wrenches by twists at fixed free dofs (6nb, 6nb); then the residual by the tensions (5n, nt)
        and the wrenches by the tensions (6nb, nt)."""
        assert e.data is not None
        nb, n = len(self.bodies), len(c.x)
        A, _ = e.bases
        S, (dofs, slots) = self.slaved(c, e.bases), self._slaves
        K = sp.csr_array((e.data[slots.data], slots.indices, slots.indptr), slots.shape)
        KS = K @ S[dofs]
        residual = KS.reshape(n, DOFS, nb, 6)
        wrench = -(S[dofs].T @ KS[dofs]).reshape(nb, 6, nb, 6)
        p = e.points
        G = np.concatenate([np.tile(np.eye(3), (len(p.arm), 1, 1)), -skew(p.arm)], axis=2)
        force = -p.hessian @ G
        force[p.turns, :, 3:] -= skew(p.gradient[p.turns])
        local = np.swapaxes(A[p.node], 1, 2) @ force
        add_at(residual, (p.node, slice(0, 3), p.body), local)
        own = np.swapaxes(G, 1, 2) @ force
        arm_cross = skew(p.gradient)
        own[p.turns, 3:, :3] += arm_cross[p.turns]
        follow = ~p.turns
        own[follow, 3:, 3:] += arm_cross[follow] @ skew(p.arm[follow])
        add_at(wrench, (p.body, slice(None), p.body), own)
        self._held_points(
            p, G, force, np.einsum("nij,njbk->nibk", A, S.reshape(n, 5, nb, 6)[:, :3]), wrench
        )
        self._held_terms(c, e, tension, residual, wrench)
        by_tension, wrench_tension = self._tension_terms(c, A)
        size = 6 * nb
        return residual.reshape(-1, size), wrench.reshape(size, size), by_tension, wrench_tension

    def _held_points(
        self, p: PointForces, G: Array, force: Array, follow: Array, wrench: Array
    ) -> None:
        """Points that act on one body and whose node another body moves (in place); follow (n, 3,
        nb, 6) the nodes' motion by the bodies' twists, force (k, 3, 6) the points' force by their
        own body's."""
        on = follow[p.node].any(axis=(1, 2, 3))
        moved = follow[p.node[on]]
        by_node = np.swapaxes(G[on], 1, 2) @ p.hessian[on]
        by_node[:, 3:] -= np.where(p.turns[on, None, None], skew(p.gradient[on]), 0.0)
        add_at(wrench, p.body[on], np.einsum("kij,kjbl->kibl", by_node, moved))
        back = np.einsum("kjbl,kji->kbli", moved, force[on])
        for body in np.unique(p.body[on]):
            wrench[:, :, body] -= back[p.body[on] == body].sum(axis=0)

    def _held_terms(
        self, c: Configuration, e: Evaluation, tension: Array, residual: Array, wrench: Array
    ) -> None:
        """The turning of lines, arms and pulls with their bodies (in place)."""
        t, g = self.ties, self.guides
        arm = c.x[t.node] - c.position[t.body]
        turn = skew(e.gradient_x[t.node]) @ skew(arm)
        turn += skew(e.gradient_d[t.node]) @ skew(c.d[t.node])
        add_at(wrench[:, 3:, :, 3:], (t.body, slice(None), t.body), -turn)
        pull = self.pulls(c, tension)
        total = e.gradient_x[g.node] - pull
        A, T = e.bases
        gx = e.gradient_x[g.node]
        residual[g.node, :3, g.body, 3:] += np.cross(np.swapaxes(A[g.node], 1, 2), gx[:, None])
        arm = c.x[g.node] - c.position[g.body]
        moment = -skew(total) @ skew(arm) - skew(arm) @ skew(pull)
        add_at(wrench[:, 3:, :, 3:], (g.body, slice(None), g.body), moment)
        add_at(wrench[:, :3, :, 3:], (g.body, slice(None), g.body), -skew(pull))
        on = g.steady
        node, body, d = g.node[on], g.body[on], c.d[g.node[on]]
        gd = e.gradient_d[node]
        bend = np.einsum("ki,ki->k", gd, d)[:, None]
        spin = np.cross(np.swapaxes(T[node], 1, 2), (gd - bend * d)[:, None])
        residual[node, 3:, body, 3:] += spin
        turn = skew(gd) @ skew(d) - bend[:, None] * skew(d) @ skew(d)
        add_at(wrench[:, 3:, :, 3:], (body, slice(None), body), -turn)

    def _tension_terms(self, c: Configuration, A: Array) -> tuple[Array, Array]:
        g, nb, nt = self.guides, len(self.bodies), len(self.share)
        residual = np.zeros((len(c.x), DOFS, nt))
        residual[g.node, 0] = -self.share.T
        wrench = np.zeros((nb, 6, nt))
        along = A[g.node, :, 0]
        arm = c.x[g.node] - c.position[g.body]
        unit = np.concatenate([along, np.cross(arm, along)], axis=1)
        add_at(wrench, g.body, unit[:, :, None] * self.share.T[:, None, :])
        return residual.reshape(len(c.x) * DOFS, nt), wrench.reshape(6 * nb, nt)


def _wrench(
    body: Ints, force: Array, arm: Array, nb: int, keep: NDArray[np.bool_] | None = None
) -> Array:
    if keep is not None:
        body, force, arm = body[keep], force[keep], arm[keep]
    out = np.zeros((nb, 6))
    np.add.at(out, body, np.concatenate([force, np.cross(arm, force)], axis=1))
    return out
