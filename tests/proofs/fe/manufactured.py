"""Manufactured solutions of the continuous shell: a chosen smooth motion, the load that makes it an
equilibrium, and how far a mesh's equilibrium under that load is from it.

A surface X(u, v) with directors D moves to x(u, v) with directors d.  Its strains follow from the
exact derivatives by u and v, without any element; the stress resultants N are the derivatives of
the section's energy by the strains, taken by differences of the energy alone; and the load on a
test function is the internal virtual work of the exact motion,

    L(dx, dd) = integral of  N . de(x, d; dx, dd) dA,

by many Gauss points of the unit square.  That is the strong form integrated by parts, with the
tractions of the free edges in it.  The elements' assumed strains, tables, resultants and tangents
are all on the other side of the comparison.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.kinds import kind_of
from fe_solver.elements.strain_forms import to_cartesian
from fe_solver.materials.linear import Law
from fe_solver.materials.section import Section, one_law
from fe_solver.materials.tension_field import TensionField
from fe_solver.sheet import even_sheet
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.vectors import sum_at_nodes
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp

Field = Callable[[Any, Any], Any]
"""Vectors (..., 3) at u and v (...); analytic, so that a complex step differentiates it."""
STEP = 1e-30
"""Of the complex step."""
STRAIN = 2e-4
"""Of the differences of the energy, of sixth order."""
SIXTH = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
POINTS = 6
"""Gauss points along each side of an element for the load and the errors."""
THICKNESS = 0.1
FIBRE = np.array([1.0, 0.4, 0.1])
SOLVE = NewtonOptions(tolerance=1e-9, max_step=0.2)


def unit(v: Array) -> Array:
    """Vectors (..., 3) at unit length; analytic."""
    return np.asarray(v / np.sqrt((v * v).sum(axis=-1, keepdims=True)))


def vectors(*components: Array | float) -> Array:
    """Vectors (..., 3) of their components."""
    return np.stack(np.broadcast_arrays(*components), axis=-1)


@dataclass(frozen=True)
class Surface:
    """A surface over the unit square, in m, with its unit directors."""

    place: Field
    director: Field

    def at(self, uv: Array) -> Shape:
        """Return the surface and its derivatives at uv (..., 2)."""
        u, v = uv[..., 0], uv[..., 1]

        def slopes(field: Field) -> Array:
            by_u = field(u + 1j * STEP, v).imag / STEP
            return np.stack([by_u, field(u, v + 1j * STEP).imag / STEP], axis=-2)

        x, d = self.place(u, v), self.director(u, v)
        return Shape(x, d, slopes(self.place), slopes(self.director))


@dataclass(frozen=True)
class Shape:
    """A surface at points (...), with derivatives by u and v as rows."""

    x: Array
    d: Array
    dx: Array
    """(..., 2, 3)."""
    dd: Array
    """(..., 2, 3)."""

    def forms(self) -> tuple[Array, Array, Array]:
        """Return the covariant metric / 2, curvature and shear (..., 3), (..., 3), (..., 2)."""
        (a, b), (p, q) = np.moveaxis(self.dx, -2, 0), np.moveaxis(self.dd, -2, 0)

        def dot(v: Array, w: Array) -> Array:
            return np.asarray((v * w).sum(axis=-1))

        metric = [dot(a, a) / 2, dot(b, b) / 2, dot(a, b) / 2]
        curvature = [dot(a, p), dot(b, q), (dot(a, q) + dot(b, p)) / 2]
        return (
            np.stack(metric, -1),
            np.stack(curvature, -1),
            np.stack([dot(a, self.d), dot(b, self.d)], -1),
        )


@dataclass(frozen=True)
class Motion:
    """A manufactured motion."""

    rest: Surface
    moved: Surface
    growth: tuple[float, float] = (0.0, 0.0)
    """Of the stress-free sheet along the fibres and across, over the surface at rest, less one."""

    def strains(self, uv: Array) -> tuple[Array, Array, Array]:
        """Return the exact strains (m, 8) at uv (m, 2), the matrices (m, 2, 2) of the stress-free
        derivatives by u and v along the local axes, as columns, and the stress-free areas (m,)."""
        rest, moved = self.rest.at(uv), self.moved.at(uv)
        normal = np.cross(rest.dx[:, 0], rest.dx[:, 1])
        area = np.linalg.norm(normal, axis=1)
        normal /= area[:, None]
        along = unit(FIBRE - (normal @ FIBRE)[:, None] * normal)
        axes = np.stack([along, np.cross(normal, along)], axis=1)
        grown = 1 + np.array(self.growth)
        J = grown[:, None] * np.einsum("mik,mgk->mig", axes, rest.dx)
        metric, curvature, shear = moved.forms()
        _, bent, lean = rest.forms()
        stress_free = np.swapaxes(J, 1, 2) @ J / 2
        e = metric - stress_free[:, [0, 1, 0], [0, 1, 1]]
        plane = [to_cartesian(J, t[..., None])[..., 0] for t in (e, curvature - bent)]
        shear = np.einsum("mgi,mg->mi", np.linalg.inv(J), shear - lean)
        return np.concatenate([*plane, shear], axis=1), J, area * grown.prod()


def resultants(section: Section, strain: Array) -> Array:
    """The stress resultants (m, 8) at strains (m, 8) by differences of the section's energy, in
    numpy; a section of one element with m points."""
    scale = STRAIN * np.array([1.0] * 3 + [2 / THICKNESS] * 3 + [1.0] * 2)
    out = np.zeros_like(strain)
    for i, h in enumerate(scale):
        for k, weight in SIXTH:
            for sign in (1, -1):
                at = strain.copy()
                at[:, i] += sign * k * h
                energy = section.respond_in_numpy(at[None]).energy[0]
                out[:, i] += sign * weight * energy / h
    return out


@dataclass(frozen=True)
class Mesh:
    """Nodes of the unit square and elements over them."""

    uv: Array
    """(n, 2)."""
    quads: Ints
    """(ne, k)."""

    @cached_property
    def quadrature(self) -> tuple[Array, Array, Array, Array]:
        """Shape functions (p, k), their derivatives by u and v (p, ne, 2, k), the places (p, ne, 2)
        and the weights (p, ne) of points for load and errors."""
        knots, factors = np.polynomial.legendre.leggauss(POINTS)
        element, at = kind_of(self.quads), self.uv[self.quads]
        values, slopes, places, weights = [], [], [], []
        for i, r in enumerate(knots):
            for j, s in enumerate(knots):
                n, nr, ns = element.shape(r, s)
                base = np.einsum("ca,nai->nci", np.stack([nr, ns]), at)
                values.append(n)
                slopes.append(np.linalg.solve(base, np.stack([nr, ns])[None]))
                places.append(np.einsum("a,nai->ni", n, at))
                weights.append(factors[i] * factors[j] * np.abs(np.linalg.det(base)))
        return np.array(values), np.array(slopes), np.array(places), np.array(weights)


def virtual_work(
    motion: Motion, mesh: Mesh, law: Law | TensionField, thickness: float
) -> tuple[Array, Array]:
    """The load (n, 3) N on the mid-surface's nodes and (n, 3) N m on their directors that makes the
    motion an equilibrium."""
    shape, slope, places, weight = mesh.quadrature
    points = places.reshape(-1, 2)
    strain, J, area = motion.strains(points)
    section = one_law(law, np.full((1, len(points)), thickness))
    N = resultants(section, strain)
    moved = motion.moved.at(points)
    # contravariant components: N . strain = n . metric / 2 + m . curvature + q . shear
    n, m = (_contravariant(J, N[:, i : i + 3]) for i in (0, 3))
    q = np.einsum("mgi,mi->mg", np.linalg.inv(J), N[:, 6:])
    by_slope = np.einsum("mgh,mhk->mgk", n, moved.dx) + np.einsum("mgh,mhk->mgk", m, moved.dd)
    by_slope += q[:, :, None] * moved.d[:, None]
    by_director_slope = np.einsum("mgh,mhk->mgk", m, moved.dx)
    by_director = np.einsum("mg,mgk->mk", q, moved.dx)
    size = (weight.ravel() * area)[:, None, None]
    grid = weight.shape
    tensors = [(size * t).reshape(*grid, 2, 3) for t in (by_slope, by_director_slope)]
    own = (size[:, 0] * by_director).reshape(*grid, 3)
    force = np.einsum("pnga,pngk->nak", slope, tensors[0])
    couple = np.einsum("pnga,pngk->nak", slope, tensors[1]) + np.einsum("pa,pnk->nak", shape, own)
    count = len(mesh.uv)
    return sum_at_nodes(mesh.quads, force, count), sum_at_nodes(mesh.quads, couple, count)


def _contravariant(J: Array, tensor: Array) -> Array:
    """Symmetric tensors (m, 2, 2) along the derivatives by u and v from Cartesian ones (m, 3)."""
    a, b, c = tensor.T
    inverse = np.linalg.inv(J)
    local = np.moveaxis(np.array([[a, c], [c, b]]), 2, 0)
    return np.asarray(inverse @ local @ np.swapaxes(inverse, 1, 2))


@dataclass(frozen=True)
class Errors:
    """How far an equilibrium is from the manufactured motion, each relative."""

    place: float
    """L2 norm of the error of places (m) and directors over that of their changes."""
    strain: float
    """Norm of the strains' error over that of the strains, both as energy with E = 1, nu = 0."""


def solve_motion(
    motion: Motion,
    mesh: Mesh,
    law: Law | TensionField,
    thickness: float = THICKNESS,
    height: float = 0.0,
) -> Errors:
    """The errors of a mesh, its nodes `height` under the mid-surface along the director, held at
    u = 0 and u = 1 where the motion takes them.  Raises ConvergenceError."""
    u = mesh.uv[:, 0]
    rest, exact = motion.rest.at(mesh.uv), motion.moved.at(mesh.uv)
    growth = np.tile(motion.growth, (len(mesh.quads), 1))
    laid = even_sheet(
        *(rest.x - height * rest.d, mesh.quads, law, thickness),
        normals=rest.d, fibre=tuple(FIBRE), height=height, growth=growth,
    )  # fmt: skip
    model = laid.model(bodies=("ground",))
    force, couple = virtual_work(motion, mesh, law, thickness)
    held = np.flatnonzero((u < 1e-9) | (u > 1 - 1e-9))
    model = replace(clamp(model, held), dead=force, couples=couple + height * force)
    x = exact.x - height * exact.d
    model = replace(model, ties=replace(model.ties, position=x[held], director=exact.d[held]))
    start = replace(at_rest(model), x=x, d=exact.d)
    found = solve(model, start, NO_TENSION, SOLVE, near=True).configuration
    return errors(motion, mesh, model, found, height)


def errors(
    motion: Motion, mesh: Mesh, model: ShellModel, c: Configuration, height: float
) -> Errors:
    """The errors of a configuration of the model of a mesh."""
    shape, _, places, weight = mesh.quadrature
    exact, rest = motion.moved.at(places), motion.rest.at(places)
    nodal = np.concatenate([c.x + height * c.d, c.d], axis=1)
    target = np.concatenate([exact.x, exact.d], axis=2)
    change = target - np.concatenate([rest.x, rest.d], axis=2)
    missed = np.einsum("pa,nak->pnk", shape, nodal[mesh.quads]) - target
    place = relative_norm(missed, change, weight)
    strain = model.tables.strain(np.concatenate([c.x[mesh.quads], c.d[mesh.quads]], axis=1))
    element = kind_of(mesh.quads)
    own = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
    at = np.einsum("ga,nai->ngi", own, mesh.uv[mesh.quads])
    true = motion.strains(at.reshape(-1, 2))[0].reshape(strain.shape)
    h2 = model.section.thickness.mean() ** 2
    metric = np.array([1, 1, 0.5, h2 / 12, h2 / 12, h2 / 24, 5 / 12, 5 / 12]) ** 0.5
    return Errors(
        place, relative_norm((strain - true) * metric, true * metric, model.tables.weight)
    )


def relative_norm(missed: Array, whole: Array, weight: Array) -> float:
    """The norm of what is missed (..., k) over that of the whole, both with a weight (...)."""
    return float(
        np.sqrt(np.vdot(weight, (missed**2).sum(-1)) / np.vdot(weight, (whole**2).sum(-1)))
    )
