"""Manufactured solutions of the solid between two faces, for the `q4ans` element.

The solid is linear through its thickness, y(u, v, t) = x + t h d / 2 for t in [-1, 1], with d of
any length; its law is taken at two Gauss points through the thickness, as the element takes it.
All six strains follow from the exact derivatives by u, v and t; the load on the nodes of both faces
is the internal virtual work of the exact motion, as in `manufactured`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from fe_solver.elements.mitc4 import shape
from fe_solver.job.job import Job
from fe_solver.materials.linear import Law
from fe_solver.q4ans.element import POINTS, solid_strain
from fe_solver.q4ans.laws import FIRST, SECOND, SHEAR, solid_stress
from fe_solver.q4ans.model import SolidModel, solid_model
from fe_solver.sheet import even_sheet
from fe_solver.supports import WALL, Tied
from tests.proofs.fe.manufactured import (
    FIBRE,
    THICKNESS,
    Errors,
    Mesh,
    Motion,
    Surface,
    relative_norm,
    unit,
)

LEVELS = (-(3**-0.5), 3**-0.5)
MOST = 30
BALANCED = 1e-9


@dataclass(frozen=True)
class Solid:
    """The solid at points (m,) in one state."""

    y: Array
    """(m, 3) m."""
    bases: Array
    """(m, 3, 3), the derivatives by u, v and t as rows."""


def solid_at(surface: Surface, uv: Array, t: float) -> Solid:
    """The solid between the faces of a surface at uv (m, 2) and t."""
    s, half = surface.at(uv), THICKNESS / 2
    plane = s.dx + t * half * s.dd
    return Solid(s.x + t * half * s.d, np.concatenate([plane, half * s.d[:, None]], axis=1))


def strains(motion: Motion, uv: Array, t: float) -> tuple[Array, Array, Array]:
    """The local strains (m, 6), the matrices (m, 3, 3) of the local axes along the dual base, and
    the volumes (m,)."""
    rest, moved = (solid_at(s, uv, t).bases for s in (motion.rest, motion.moved))
    normal = unit(np.cross(rest[:, 0], rest[:, 1]))
    along = unit(FIBRE - (normal @ FIBRE)[:, None] * normal)
    P = np.stack([along, np.cross(normal, along), normal], axis=1) @ np.linalg.inv(rest)
    natural = (moved @ np.swapaxes(moved, 1, 2) - rest @ np.swapaxes(rest, 1, 2)) / 2
    local = P @ natural @ np.swapaxes(P, 1, 2)
    return local[:, FIRST, SECOND] * np.where(SHEAR, 2, 1), P, np.linalg.det(rest)


def virtual_work(motion: Motion, mesh: Mesh, law: Law) -> Array:
    """The load (2n, 3) N on the nodes of the lower and of the upper face."""
    values, slopes, places, weight = mesh.quadrature
    low, high = np.zeros((2, *mesh.quads.shape, 3))
    for t in LEVELS:
        uv = places.reshape(-1, 2)
        strain, P, volume = strains(motion, uv, t)
        S = np.zeros((len(uv), 3, 3))
        stress = solid_stress(law, strain)[0]
        S[:, FIRST, SECOND] = S[:, SECOND, FIRST] = stress
        pull = np.swapaxes(P, 1, 2) @ S @ P @ solid_at(motion.moved, uv, t).bases
        pull = (pull * (volume * weight.ravel())[:, None, None]).reshape(*weight.shape, 3, 3)
        plane = np.einsum("pnga,pngk->nak", slopes, pull[:, :, :2])
        across = np.einsum("pa,pnk->nak", values, pull[:, :, 2]) / 2
        low += (1 - t) / 2 * plane - across
        high += (1 + t) / 2 * plane + across
    out, n = np.zeros((2 * len(mesh.uv), 3)), len(mesh.uv)
    np.add.at(out, mesh.quads, low)
    np.add.at(out, mesh.quads + n, high)
    return out


def solve_motion(motion: Motion, mesh: Mesh, law: Law) -> Errors:
    """The errors of a mesh of `q4ans` elements, held at u = 0 and u = 1.  Raises
    ConvergenceError."""
    rest, exact = motion.rest.at(mesh.uv), motion.moved.at(mesh.uv)
    half, u = THICKNESS / 2, mesh.uv[:, 0]
    low = rest.x - half * rest.d
    laid = even_sheet(
        *(low, mesh.quads, law, THICKNESS), normals=rest.d, fibre=tuple(FIBRE), height=half
    )
    held = np.flatnonzero((u < 1e-9) | (u > 1 - 1e-9))
    model = solid_model(Job(laid, ties=[Tied(held, WALL)]))
    z = _equilibrium(
        model,
        np.concatenate([exact.x - half * exact.d, exact.x + half * exact.d]),
        virtual_work(motion, mesh, law),
    )
    return _errors(motion, mesh, model, z)


def _equilibrium(model: SolidModel, z: Array, dead: Array) -> Array:
    """The places (2n, 3) in equilibrium under a load by Newton's method from z."""
    loads = model.at(0.0)._replace(dead=dead)
    terms = tuple(model.terms(z, loads))
    left = model.imbalance(terms, loads)
    for _ in range(MOST):
        if model.unbalanced(z, loads, terms).size < BALANCED * np.linalg.norm(dead):
            return z
        step = np.zeros_like(z)
        step[model.free] = -model.pattern(terms).factorise(terms).solve(left[model.free])
        for part in 0.5 ** np.arange(10):  # a whole step may turn an element inside out
            with np.errstate(all="ignore"):
                tried = tuple(model.terms(z + part * step, loads))
            after = model.imbalance(tried, loads)
            if np.linalg.norm(after[model.free]) < np.linalg.norm(left[model.free]):
                break
        z, terms, left = z + part * step, tried, after
    raise ConvergenceError("no equilibrium of q4ans elements under the manufactured load")


def _errors(motion: Motion, mesh: Mesh, model: SolidModel, z: Array) -> Errors:
    values, _, places, weight = mesh.quadrature
    uv, n = places.reshape(-1, 2), len(mesh.uv)
    missed, change = [], []
    for t, face in ((-1.0, z[:n]), (1.0, z[n:])):
        exact = solid_at(motion.moved, uv, t).y.reshape(*weight.shape, 3)
        missed.append(np.einsum("pa,nak->pnk", values, face[mesh.quads]) - exact)
        change.append(exact - solid_at(motion.rest, uv, t).y.reshape(*weight.shape, 3))
    place = relative_norm(np.stack(missed), np.stack(change), np.stack([weight, weight]))
    (part,) = model.parts
    strain = solid_strain(part.tables, part.rest + (z - model.rest)[model.pairs])
    true = np.empty_like(strain)
    for g, (r, s, t) in enumerate(POINTS):
        at = np.einsum("a,nai->ni", shape(r, s)[0], mesh.uv[mesh.quads])
        true[:, g] = strains(motion, at, t)[0]
    metric = np.where(SHEAR, 0.5, 1.0) ** 0.5
    size = part.tables.volume
    return Errors(place, relative_norm((strain - true) * metric, true * metric, size))
