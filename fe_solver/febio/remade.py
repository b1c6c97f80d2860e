"""A solved job once more with FEBio's own assumptions: its `q4ans` shell (`q4ans`), its contact
(`facets`) and its automatic penalty, from the solution of our shell.

What then agrees with FEBio's figures differs from ours by the formulation, not by a mistake of
either.  Only the kind of job that figures are published of is covered; `not_covered` says why
another is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cosim.port import ConvergenceError, InputError

from ..fibre_materials import TransIsoMooneyRivlin
from ..job import ZERO, ContactPair, Job
from ..job_model import JobModel
from ..job_solve import JobResult
from ..linear_algebra import Analysis, Factor, NotPositiveDefiniteError, SuperLUAnalysis, analyse
from ..materials import Law
from ..mesh_geometry import is_triangle, node_directors
from ..springs import Springs, spring_forces, spring_state
from .facets import Facets, Pressed, cut, pressed
from .q4ans import SolidTables, solid_response, solid_tables
from .solid_laws import covered, normal_modulus

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

TOLERANCE = 1e-7
"""Residual over the largest spring force, or over the loads."""
MOST_ITERATIONS = 60
MAX_STEP = 1e-3
"""m, the longest of a Newton step."""
HALVINGS = 8
SOFTER = (0.006, 0.02, 0.06, 0.2, 1.0)
"""Of the bulk modulus, one after the other: our shell knows no thickness, and a nearly
incompressible solid far from its own has no descent."""


@dataclass(frozen=True)
class Remade:
    """Node positions on the file's face and on the other (n, 3) m, contact forces on the job's
    bodies (nb, 3) N, each spring set's forces (k,) N, deepest penetration (m), Newton iterations
    and the residual's norm (N)."""

    x: Array
    other: Array
    contact: Array
    spring_forces: tuple[Array, ...]
    penetration: float
    iterations: int
    residual: float


def not_covered(job: Job) -> str | None:
    """Why a job cannot be solved as FEBio does, in words; None where it can."""
    return next((words for found, words in _obstacles(job) if found), None)


def _obstacles(job: Job) -> Iterator[tuple[bool, str]]:
    yield len(job.parts) != 1, "has several materials"
    law = job.parts[0].law
    yield job.parts[0].in_situ_stretch != 1.0, "has fibres that are stretched in situ"
    yield not covered(law), f"has the law {type(law).__name__}, or terms of it, not remade"
    yield bool(is_triangle(job.quads).any()), "has triangles"
    thickness, height = job.thickness, job.height
    yield float(np.ptp(thickness)) > 1e-9 * thickness.max(), "has a varying thickness"
    on_face = np.isclose(height, height[0, 0], rtol=1e-9) & np.isclose(2 * abs(height), thickness)
    yield not on_face.all(), "has nodes that lie on no face of the sheet"
    yield bool(job.pressures), "has pressures"
    yield bool(job.held_directors), "has held directors"
    yield any(not t.clamped for t in job.tied), "has hinges"
    yield any(h.displacement != ZERO for h in job.held), "has prescribed displacements"
    yield any((s.body < 0).any() for s in job.springs), "has springs between nodes"
    for pair in job.contacts:
        plain = pair.automatic and pair.friction == 0 and pair.gap == 0
        yield not plain, "has friction, a gap or a penalty of its own in contact"
        yield bool((pair.side * height[0, 0] > 0).any()), "is touched on the face without nodes"


def remade(result: JobResult) -> Remade:
    """The last state of a job solved `as_febio`, solved anew by Newton from there.

    Raises InputError for a job that is not covered, and ConvergenceError where Newton fails."""
    reason = not_covered(result.job)
    if reason is not None:
        raise InputError(f"{result.job.name}: {reason}")
    last = result.states[-1]
    sheet = _sheet(result.model, last.time)
    c, iterations = last.configuration, 0
    z = np.concatenate([c.x, c.x + 2 * result.job.height[0, 0] * c.d])
    for law in _stages(sheet.law):
        z, residual, more = _settled(replace(sheet, law=law), z)
        iterations += more
    return _outcome(result.job, sheet, z, residual, iterations)


def _stages(law: Law) -> list[Law]:
    if isinstance(law, TransIsoMooneyRivlin):
        return [replace(law, k=share * law.k) for share in SOFTER]
    return [law]


@dataclass(frozen=True)
class _Pattern:
    """Where the entries of all blocks go among the matrix's data."""

    kept: NDArray[np.bool_]
    place: Ints
    slots: sp.csc_array

    @cached_property
    def analysis(self) -> Analysis:
        return analyse(self.slots)

    def factorised(self, values: Array) -> Factor:
        """Of the blocks' entries; the matrix may be indefinite."""
        count = self.slots.nnz
        data: Array = np.bincount(self.place, values[self.kept], count).astype(float)
        try:
            return self.analysis.factor(data)
        except NotPositiveDefiniteError:
            return SuperLUAnalysis(self.slots).factor(data)


def _pattern(groups: Sequence[Ints], free: NDArray[np.bool_]) -> _Pattern:
    """Of blocks that join the nodes of each row of the groups (k, m); free (2n, 3)."""
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
    return _Pattern(kept, place, sp.csc_array((data, at % size, begins), shape=(size, size)))


class _Balance(NamedTuple):
    """What the nodes feel, (2n, 3) N, and the blocks' entries of its derivative."""

    gradient: Array
    entries: Array


@dataclass(frozen=True)
class _Sheet:
    """The job at one time.  n nodes, each a pair: positions z (2n, 3) m hold the file's face, then
    the other, and so does free (2n, 3)."""

    quads: Ints
    tables: SolidTables
    law: Law
    springs: Springs
    facets: tuple[Facets, ...]
    load: Array
    position: Array
    rotation: Array
    free: NDArray[np.bool_]

    @cached_property
    def pairs(self) -> Ints:
        """(ne, 8) the elements' nodes."""
        return np.concatenate([self.quads, self.quads + len(self.load)], axis=1)

    @cached_property
    def pattern(self) -> _Pattern:
        groups = [self.pairs, *(f.quads for f in self.facets), self.springs.node[:, None]]
        return _pattern(groups, self.free)

    def contacts(self, z: Array) -> list[Pressed]:
        poses = [(self.position[f.body], self.rotation[f.body]) for f in self.facets]
        return [pressed(f, z, *pose) for f, pose in zip(self.facets, poses, strict=True)]

    def balance(self, z: Array) -> _Balance:
        force, blocks = solid_response(self.tables, self.law, z[self.pairs])
        out, entries = np.zeros_like(z), [blocks.ravel()]
        np.add.at(out, self.pairs, force.reshape(-1, 8, 3))
        out[: len(self.load)] -= self.load
        for f, p in zip(self.facets, self.contacts(z), strict=True):
            np.add.at(out, f.quads, p.gradient.reshape(-1, 4, 3))
            entries.append(p.blocks.ravel())
        s = spring_forces(self.springs, z, self.position, self.rotation, curvature=True)
        np.add.at(out, s.node, s.gradient)
        return _Balance(out, np.concatenate([*entries, s.hessian.ravel()]))

    def missed(self, found: _Balance) -> float:
        """N, the norm of what does not balance; infinite where a law has no answer."""
        size = float(np.linalg.norm(found.gradient[self.free]))
        return size if np.isfinite(size) else np.inf

    def pull(self, z: Array) -> Array:
        """(k,) N of the springs."""
        return spring_state(self.springs, z, self.position, self.rotation).force


def _sheet(model: JobModel, time: float) -> _Sheet:
    job, (position, rotation) = model.job, model.poses(time)
    n, quads = len(job.points), job.quads
    high = 2 * job.height[0, 0] * node_directors(job.points, quads)
    corners = np.concatenate([job.points[quads], (job.points + high)[quads]], axis=1)
    tables, law = solid_tables(corners, job.fibre), job.parts[0].law
    free = np.ones((2, n, 3), dtype=bool)
    for t in job.tied:
        free[:, t.nodes] = False
    for h in job.held:
        free[0, h.nodes, h.component] = False
    return _Sheet(
        quads,
        tables,
        law,
        model.base.springs,
        tuple(_facets(job, pair, tables, law) for pair in job.contacts),
        model.dead(time),
        position,
        rotation,
        free.reshape(2 * n, 3),
    )


def _facets(job: Job, pair: ContactPair, tables: SolidTables, law: Law) -> Facets:
    """With FEBio's automatic penalty E A / V times the file's factor: the modulus along the normal,
    the facet's area, the element's volume (theory manual 3.4, section 7.1.7)."""
    X = job.points[job.quads[pair.quads]]
    area = np.linalg.norm(np.cross(X[:, 2] - X[:, 0], X[:, 3] - X[:, 1]), axis=1) / 2
    penalty = pair.penalty * normal_modulus(law) * area / tables.volume[pair.quads].sum(axis=1)
    triangles = job.bodies[pair.body].vertices[pair.triangles]
    near = cut(triangles, float(np.sqrt(np.median(area))))
    return Facets(job.quads[pair.quads], pair.side, penalty, pair.body, near)


def _settled(sheet: _Sheet, z: Array) -> tuple[Array, float, int]:
    """Equilibrium near z by Newton, the residual (N) and the iterations.

    Raises ConvergenceError."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        here = sheet.balance(z)
        scale = max(float(np.linalg.norm(sheet.load)), float(sheet.pull(z).max(initial=0.0)))
        for iteration in range(MOST_ITERATIONS):
            if sheet.missed(here) <= TOLERANCE * scale:
                return z, sheet.missed(here), iteration
            step = np.zeros_like(z)
            factor = sheet.pattern.factorised(here.entries)
            step[sheet.free] = -factor.solve(here.gradient[sheet.free])
            z, here = _advanced(sheet, z, here, step)
    raise ConvergenceError(
        f"FEBio's formulation, made anew, did not reach equilibrium in {MOST_ITERATIONS} "
        f"iterations: {sheet.missed(here):.1e} N do not balance"
    )


def _advanced(sheet: _Sheet, z: Array, here: _Balance, step: Array) -> tuple[Array, _Balance]:
    """The first of ever shorter steps that lowers the residual, or the best of them."""
    share = min(1.0, MAX_STEP / max(float(np.abs(step).max()), np.finfo(float).tiny))
    tried: list[tuple[float, Array, _Balance]] = []
    for _ in range(HALVINGS):
        there = sheet.balance(z + share * step)
        tried.append((sheet.missed(there), z + share * step, there))
        if tried[-1][0] < sheet.missed(here) * (1 - 1e-3 * share):
            break
        share /= 2
    return min(tried, key=lambda t: t[0])[1:]


def _outcome(job: Job, sheet: _Sheet, z: Array, residual: float, iterations: int) -> Remade:
    n, contact, deepest = len(sheet.load), np.zeros((len(job.bodies), 3)), 0.0
    for f, p in zip(sheet.facets, sheet.contacts(z), strict=True):
        contact[f.body] += p.force
        deepest = max(deepest, float(p.depth.max()))
    force = sheet.pull(z)
    by_set = tuple(force[sheet.springs.group == i] for i in range(len(job.springs)))
    return Remade(z[:n], z[n:], contact, by_set, deepest, iterations, residual)
