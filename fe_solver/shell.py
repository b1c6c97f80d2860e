"""Four-node shell element: total Lagrangian, finite rotations, position and unit director.

The shell is x(r, s) + z d(r, s), with z the distance from the mid-surface along the director.  Its
strains (`assumed_strain`) are quadratic forms of y = (x1..x4, d1..d4), so that their gradient is
linear in y, their Hessian is constant and the tangent is exact and symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .assumed_strain import (
    BENDING,
    GAUSS,
    MEMBRANE,
    SAMPLES,
    SHEAR,
    TRIANGLE_MEMBRANE,
    base_vectors,
    distortion,
    quad_membrane,
    tied_shear,
    to_cartesian,
    triangle_shear,
)
from .section import Section

Array = NDArray[np.float64]

FOLD, STEEPEST = np.cos(np.deg2rad(12)), 0.25
"""Cosines of the angles between director and element's normal: beyond the first sheets meet at an
angle, within it one sheet is curved; to the second the lean is made up for."""


@dataclass(frozen=True)
class ShellTables:
    """Constant tables of a mesh of shell elements.

    Strains at the Gauss points from the samples: membrane (ne, 4, 3, 5), bending (ne, 4, 3, 3) from
    the point's own three, shear (ne, 4, 2, 4), each less `offset` (ne, 4, 8); weight (ne, 4)
    reference area of each Gauss point; frame (ne, 4, 3, 3) rows local axes 1 (fibre), 2
    (transverse), 3 (normal) in the reference configuration; height (ne, 4) of the mid-surface over
    the nodes, along the elements' directors, which are those of the nodes times `mitre` (ne, 4):
    where sheets meet at an angle the node's director leans, and is the longer for it, so that the
    thickness across each sheet is its own."""

    membrane: Array
    bending: Array
    shear: Array
    offset: Array
    weight: Array
    frame: Array
    height: Array
    mitre: Array

    def middle(self, y: Array) -> Array:
        """y (ne, 8, 3) of the nodes as that of the mid-surface."""
        return _over(y, self.height, self.mitre)

    def strain(self, y: Array) -> Array:
        """(ne, 4, 8) generalized strains of the nodes' y (ne, 8, 3): e11, e22, 2 e12 of the
        mid-surface, k11, k22, 2 k12 of bending, g13, g23 of transverse shear."""
        return self.combined(_sampled(self.middle(y)))

    def combined(self, samples: Array) -> Array:
        """(ne, 4, 8) strains from samples (ne, 21)."""
        parts = [
            self.membrane @ samples[:, None, MEMBRANE, None],
            self.bending @ samples[:, BENDING].reshape(-1, 4, 3, 1),
            self.shear @ samples[:, None, SHEAR, None],
        ]
        return np.concatenate(parts, axis=2)[..., 0] - self.offset

    def collected(self, force: Array) -> Array:
        """(ne, 21) stress of the samples from the forces (ne, 4, 8) of the Gauss points."""
        parts = [
            np.einsum("ngci,ngc->ni", self.membrane, force[..., :3]),
            np.einsum("ngci,ngc->ngi", self.bending, force[..., 3:6]).reshape(-1, 12),
            np.einsum("ngci,ngc->ni", self.shear, force[..., 6:]),
        ]
        return np.concatenate(parts, axis=1)

    def forces(self, y: Array, resultant: Array) -> Array:
        """(ne, 8, 3) by the nodes' y: gradient of resultant (ne, 4, 8) times strain, no area."""
        out = _stress_gradient(self.middle(y), self.collected(resultant))
        out[:, 4:] += self.height[:, :, None] * out[:, :4]
        out[:, 4:] *= self.mitre[:, :, None]
        return out

    def spread(self) -> Array:
        """(ne, 32, 21) the combinations as one matrix an element."""
        out = np.zeros((len(self.weight), 4, 8, 21))
        out[:, :, :3, MEMBRANE], out[:, :, 6:, SHEAR] = self.membrane, self.shear
        for g in range(4):
            out[:, g, 3:6, 5 + 3 * g : 8 + 3 * g] = self.bending[:, g]
        return out.reshape(-1, 32, 21)


def _sampled(y: Array) -> Array:
    """(ne, 21) samples of the mid-surface's y (ne, 8, 3)."""
    if kernels.COMPILED:
        return kernels.sampled(SAMPLES, y)
    return np.einsum("ncak,nak->nc", SAMPLES @ y[:, None], y) / 2


def _over(y: Array, height: Array, mitre: Array) -> Array:
    out = y.copy()
    out[:, 4:] *= mitre[:, :, None]
    out[:, :4] += height[:, :, None] * out[:, 4:]
    return out


def _mitre(X: Array, D: Array) -> Array:
    """(ne, 4) 1 / |D . n|, with the elements' normals n at their corners, where there is a fold;
    directors may point to either side."""
    into, out_of = X - np.roll(X, 1, axis=1), np.roll(X, -1, axis=1) - X
    normal = np.cross(into, out_of)
    triangle = (X[:, 2] == X[:, 3]).all(axis=1)
    normal[triangle] = normal[triangle, :1]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    lean = np.abs(np.einsum("nak,nak->na", normal, D))
    return np.where(lean < FOLD, 1 / np.maximum(lean, STEEPEST), 1.0)


def local_frames(X: Array, fibre: Array, r: float, s: float) -> tuple[Array, Array, Array]:
    """Local axes (ne, 3, 3) as rows, J (ne, 2, 2) and area factor (ne,) at one point of the
    reference elements X (ne, 4, 3); axis 1 is `fibre` (ne, 3) brought into the tangent plane."""
    G = base_vectors(X, r, s)
    normal = np.cross(G[:, 0], G[:, 1])
    area = np.linalg.norm(normal, axis=1)
    normal = normal / area[:, None]
    e1 = fibre - np.einsum("nk,nk->n", fibre, normal)[:, None] * normal
    e1 = e1 / np.linalg.norm(e1, axis=1, keepdims=True)
    frame = np.stack([e1, np.cross(normal, e1), normal], axis=1)
    return frame, np.einsum("nik,ngk->nig", frame[:, :2], G), area


def shell_tables(
    X: Array,
    D: Array,
    fibre: Array,
    growth: Array,
    height: Array | float = 0.0,
    *,
    even: bool = True,
) -> ShellTables:
    """Tables for elements with nodes X (ne, 4, 3), unit directors D (ne, 4, 3), fibre directions
    (ne, 3) or (ne, 4, 3) at the Gauss points, and fibre growth (ne,): the stress-free length along
    the fibre is 1 + growth times that of the mesh (a multiplicative, plane eigenstrain).  `height`
    (ne, 4), m, of the mid-surface over each node along its director: nodes on the lower face of a
    shell lie half its thickness below.  `even`: the in-plane shear is evened over each quad, as in
    `assumed_strain`; else bilinear, as FEBio has it."""
    ne = len(X)
    height = np.broadcast_to(height, (ne, 4)).astype(float)
    fibre = np.broadcast_to(fibre[:, None] if fibre.ndim == 2 else fibre, (ne, 4, 3))
    nodes, mitre = np.concatenate([X, D], axis=1), _mitre(X, D)
    Y = _over(nodes, height, mitre)
    X = Y[:, :4]
    triangle = (X[:, 2] == X[:, 3]).all(axis=1)
    warp = np.zeros((5, ne))
    warp[:, ~triangle] = distortion(X[~triangle])
    tensor = np.stack([(1 + growth) ** -2, np.ones(ne), 1 / (1 + growth)], axis=1)[:, :, None]
    edges = np.stack([X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]], axis=2)
    membranes = np.moveaxis(quad_membrane(X, warp, even), 1, 0)
    parts: list[tuple[Array, ...]] = []
    for (r, s), along, quad in zip(GAUSS, np.moveaxis(fibre, 1, 0), membranes, strict=True):
        frame, J, area = local_frames(X, along, r, s)
        own = np.where(triangle[:, None, None], frame[:, :2] @ edges, J)
        tri = triangle[:, None, None]
        membrane = np.where(tri, TRIANGLE_MEMBRANE, quad)
        shear = np.where(tri, triangle_shear(r, s), tied_shear(r, s))
        bending = to_cartesian(J, np.broadcast_to(np.eye(3), (ne, 3, 3)))
        shear = np.swapaxes(np.linalg.inv(own), 1, 2) @ shear
        shear[:, 0] /= (1 + growth)[:, None]
        membrane = to_cartesian(own, membrane) * tensor
        parts.append((membrane, bending * tensor, shear, area * (1 + growth), frame))
    membrane, bending, shear, weight, frames = (np.stack(p, 1) for p in zip(*parts, strict=True))
    none = np.zeros((ne, 4, 8))
    bare = ShellTables(membrane, bending, shear, none, weight, frames, height, mitre)
    offset = bare.strain(nodes)
    offset[:, :, 0] += (1 - tensor[:, 0]) / 2
    return replace(bare, offset=offset)


@dataclass(frozen=True)
class ElementResponse:
    """Energy (J) of all elements and its gradient (ne, 8, 3) by the nodes' y, with what the tangent
    is made of: the mid-surface's y (ne, 8, 3), and the Gauss points' forces (ne, 4, 8) and
    stiffness (ne, 4, 8, 8), the first times the points' areas."""

    energy: float
    gradient: Array
    middle: Array
    force: Array
    stiffness: Array


def element_response(tables: ShellTables, section: Section, y: Array) -> ElementResponse:
    """Energy and gradient of all elements at the nodes' y (ne, 8, 3)."""
    middle = tables.middle(y)
    answer = section.response(tables.combined(_sampled(middle)))
    energy = float(np.vdot(answer.energy, tables.weight))
    force = answer.force * tables.weight[:, :, None]
    return ElementResponse(energy, tables.forces(y, force), middle, force, answer.stiffness)


def element_blocks(
    tables: ShellTables, response: ElementResponse, bases: tuple[Array, Array], convex: bool = False
) -> Array:
    """(ne, 20, 20) tangent in the nodes' bases A (ne, 4, 3, 3) and T (ne, 4, 3, 2), without the
    curvature of the directors' sphere.

    `convex` keeps of the geometric stiffness what tension makes, so that the tangent is positive
    semidefinite: not consistent, but a descent direction from any state."""
    stress = tables.collected(tensile(response.force) if convex else response.force)
    stiffness = response.stiffness * tables.weight[:, :, None, None]
    bases = bases[0], bases[1] * tables.mitre[:, :, None, None]
    blocks = _compiled_blocks if kernels.COMPILED else _plain_blocks
    return blocks(tables, response.middle, stress, stiffness, bases)


def tensile(resultant: Array) -> Array:
    """The part of the stress resultants (ne, 4, 8) whose geometric stiffness is not negative: the
    membrane's tensile principal forces."""
    n1, n2, n12 = resultant[..., 0], resultant[..., 1], resultant[..., 2]
    mean, half = (n1 + n2) / 2, (n1 - n2) / 2
    radius = np.hypot(half, n12)
    high, low = np.maximum(mean + radius, 0), np.maximum(mean - radius, 0)
    ratio = np.divide(high - low, 2 * radius, out=np.zeros_like(radius), where=radius > 0)
    out = np.zeros_like(resultant)
    out[..., 0] = (high + low) / 2 + ratio * half
    out[..., 1] = (high + low) / 2 - ratio * half
    out[..., 2] = ratio * n12
    return out


def _stress_gradient(y: Array, stress: Array) -> Array:
    """(ne, 8, 3) gradient of the samples, weighted by stress (ne, 21)."""
    if kernels.COMPILED:
        return kernels.stress_gradient(SAMPLES, y, stress)
    return (stress @ SAMPLES.reshape(21, 64)).reshape(-1, 8, 8) @ y


def _compiled_blocks(
    tables: ShellTables, y: Array, stress: Array, stiffness: Array, bases: tuple[Array, Array]
) -> Array:
    parts = tables.membrane, tables.bending, tables.shear
    return kernels.element_blocks(SAMPLES, y, tables.height, parts, stress, stiffness, bases)


def _plain_blocks(
    tables: ShellTables, y: Array, stress: Array, stiffness: Array, bases: tuple[Array, Array]
) -> Array:
    """The element tangents in numpy: what the compiled kernel is held to."""
    ne = len(y)
    spread = tables.spread()
    flat = (SAMPLES @ y[:, None]).reshape(ne, 21, 24)
    inner = (stiffness @ spread.reshape(ne, 4, 8, 21)).reshape(ne, 32, 21)
    hessian = np.swapaxes(flat, 1, 2) @ (np.swapaxes(spread, 1, 2) @ inner) @ flat
    geometric = (stress @ SAMPLES.reshape(21, 64)).reshape(ne, 8, 8)
    blocks = hessian.reshape(ne, 8, 3, 8, 3)
    for k in range(3):
        blocks[:, :, k, :, k] += geometric
    W = _projection(tables.height, *bases)
    out = np.swapaxes(W, 1, 2) @ hessian @ W
    return (out + np.swapaxes(out, 1, 2)) / 2


def _projection(height: Array, A: Array, T: Array) -> Array:
    """(ne, 24, 20) the mid-surface's y by the nodes' degrees of freedom."""
    W = np.zeros((len(A), 24, 20))
    for a in range(4):
        x, d, at = slice(3 * a, 3 * a + 3), slice(12 + 3 * a, 15 + 3 * a), 5 * a
        W[:, x, at : at + 3], W[:, d, at + 3 : at + 5] = A[:, a], T[:, a]
        W[:, x, at + 3 : at + 5] = height[:, a, None, None] * T[:, a]
    return W
