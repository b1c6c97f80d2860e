"""Shell elements: total Lagrangian, finite rotations, position and unit director.

The shell is x(r, s) + z d(r, s), with z the distance from the mid-surface along the director.  Its
strains (`strain_forms`) are quadratic forms of y = (x1..xk, d1..dk), so that their gradient is
linear in y, their Hessian is constant and the tangent is exact and symmetric.  An element has k = 4
nodes (`mitc4`) and is integrated at g = 4 Gauss points, or 9 (`mitc9`) at 9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from fe_solver.elements import kernels
from fe_solver.elements import mitc9 as nine_nodes
from fe_solver.elements.kinds import KINDS, kind_of
from fe_solver.elements.mitc4 import (
    FOUR,
    TRIANGLE_MEMBRANE,
    distortion,
    mitc_shear,
    quad_membrane,
    triangle_shear,
)
from fe_solver.elements.strain_forms import Element, to_cartesian
from fe_solver.materials.section import Section

FOLD, STEEPEST = np.cos(np.deg2rad(12)), 0.25
"""Cosines of the angles between director and element's normal: beyond the first sheets meet at an
angle, within it one sheet is curved; to the second the lean is made up for."""


@dataclass(frozen=True)
class ShellTables:
    """Constant tables of a mesh of shell elements: what makes the strains at the Gauss points from
    the samples.

    Where sheets meet at an angle the node's director leans, and is the longer for it, so that the
    thickness across each sheet is its own."""

    membrane: Array
    """(ne, g, 3, 5 or 24), from the membrane's samples."""
    bending: Array
    """(ne, g, 3, 3), from the point's own three."""
    shear: Array
    """(ne, g, 2, 4 or 12), from the shear samples."""
    offset: Array
    """(ne, g, 8), taken off these strains."""
    weight: Array
    """(ne, g) m2, reference area of each Gauss point."""
    frame: Array
    """(ne, g, 3, 3) rows local axes 1 (fibre), 2 (transverse), 3 (normal) in the reference
    configuration."""
    height: Array
    """(ne, k) m, of the mid-surface over the nodes, along the elements' directors."""
    mitre: Array
    """(ne, k), elements' directors over those of the nodes."""
    growth: Array
    """(ne, 2): the stress-free lengths along axes 1 and 2 are 1 + growth times the mesh's."""

    @property
    def element(self) -> Element:
        """The kind of the elements."""
        return KINDS[self.height.shape[1]]

    def middle(self, y: Array) -> Array:
        """y (ne, 2k, 3) of the nodes as that of the mid-surface, seen from its first node: strains
        do not change with that, and their rounding errors are those of an element's lengths."""
        out = _over(y, self.height, self.mitre)
        out[:, : y.shape[1] // 2] -= out[:, :1]
        return out

    def strain(self, y: Array) -> Array:
        """The generalized strains (ne, g, 8) of the nodes' y (ne, 2k, 3): e11, e22, 2 e12 of the
        mid-surface, k11, k22, 2 k12 of bending, g13, g23 of transverse shear."""
        return _middle_and_strain(self, y)[1]

    def strain_change(self, y: Array, dy: Array) -> Array:
        """The derivative (ne, g, 8) of the strain at the nodes' y (ne, 2k, 3) along dy (ne, 2k, 3):
        without compiled kernels a central difference, exact for what is quadratic."""
        if not kernels.COMPILED:
            return (self.strain(y + dy) - self.strain(y - dy)) / 2
        y, dy = np.ascontiguousarray(y), np.ascontiguousarray(dy)
        return kernels.strain_changes(self.element.samples, y, dy, self.carried, self.parts)

    @property
    def parts(self) -> kernels.Tables:
        """The combinations of membrane, bending and shear."""
        return self.membrane, self.bending, self.shear

    @property
    def carried(self) -> kernels.Carried:
        """Height and mitre."""
        return self.height, self.mitre

    def spread(self) -> Array:
        """The combinations as one matrix (8 g, m) an element: (ne, 8 g, m)."""
        membrane, bending, shear = self.element.parts
        ne, points = self.weight.shape
        out = np.zeros((ne, points, 8, len(self.element.samples)))
        out[:, :, :3, membrane], out[:, :, 6:, shear] = self.membrane, self.shear
        for g in range(points):
            first = bending.start + 3 * g
            out[:, g, 3:6, first : first + 3] = self.bending[:, g]
        return out.reshape(ne, 8 * points, -1)


def _middle_and_strain(tables: ShellTables, y: Array) -> tuple[Array, Array]:
    """The mid-surface's y (ne, 2k, 3) and the strains (ne, g, 8) of the nodes' y (ne, 2k, 3)."""
    if not kernels.COMPILED:
        return _numpy_strain(tables, y)
    y = np.ascontiguousarray(y)
    samples, offset = tables.element.samples, tables.offset
    return kernels.strains(samples, y, tables.carried, tables.parts, offset)


def _numpy_strain(tables: ShellTables, y: Array) -> tuple[Array, Array]:
    """`_middle_and_strain` in numpy: what the compiled kernel is held to."""
    middle, element = tables.middle(y), tables.element
    membrane, bending, shear = element.parts
    samples = np.einsum("ncak,nak->nc", element.samples @ middle[:, None], middle) / 2
    parts = [
        tables.membrane @ samples[:, None, membrane, None],
        tables.bending @ samples[:, bending].reshape(*tables.weight.shape, 3, 1),
        tables.shear @ samples[:, None, shear, None],
    ]
    return middle, np.concatenate(parts, axis=2)[..., 0] - tables.offset


def _over(y: Array, height: Array, mitre: Array) -> Array:
    k = y.shape[1] // 2
    out = y.copy()
    out[:, k:] *= mitre[:, :, None]
    out[:, :k] += height[:, :, None] * out[:, k:]
    return out


def _mitre(X: Array, D: Array) -> Array:
    """The factors 1 / |D . n| (ne, k), with the elements' normals n at their nodes, where there is
    a fold; directors may point to either side."""
    element = kind_of(X)
    bases = [element.base_vectors(X, r, s) for r, s in element.nodes]
    normal = np.stack([np.cross(b[:, 0], b[:, 1]) for b in bases], axis=1)
    triangle = _is_triangle(X)
    normal[triangle] = normal[triangle, :1]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    lean = np.abs(np.einsum("nak,nak->na", normal, D))
    return np.where(lean < FOLD, 1 / np.maximum(lean, STEEPEST), 1.0)


def _is_triangle(X: Array) -> NDArray[np.bool_]:
    """Whether (ne,) the last two corners of an element are at one place; X (ne, k, 3)."""
    return np.asarray((X[:, 2] == X[:, 3]).all(axis=1))


def local_frames(X: Array, fibre: Array, r: float, s: float) -> tuple[Array, Array, Array]:
    """Local axes (ne, 3, 3) as rows, J (ne, 2, 2) and area factor (ne,) at one point of the
    reference elements X (ne, k, 3); axis 1 is `fibre` (ne, 3) brought into the tangent plane."""
    G = kind_of(X).base_vectors(X, r, s)
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
    bilinear: bool = False,
) -> ShellTables:
    """Tables for elements with nodes X (ne, k, 3), unit directors D (ne, k, 3), fibre directions
    (ne, 3) or (ne, g, 3) at the Gauss points, and growth (ne,) or (ne, 2): the stress-free length
    along the fibre, and that across it, is 1 + growth times that of the mesh (a multiplicative,
    plane eigenstrain; none across where only one is given).  `height`
    (ne, k), m, of the mid-surface over each node along its director: nodes on the lower face of a
    shell lie half its thickness below.  `bilinear`: the membrane strain of a four-node quad is that
    of its displacements, as FEBio has it, and locks when it is bent in its plane."""
    element, ne = kind_of(X), len(X)
    points = len(element.gauss)
    height = np.broadcast_to(height, X.shape[:2]).astype(float)
    fibre = np.broadcast_to(fibre[:, None] if fibre.ndim == 2 else fibre, (ne, points, 3))
    nodes, mitre = np.concatenate([X, D], axis=1), _mitre(X, D)
    X = _over(nodes, height, mitre)[:, : X.shape[1]]
    growth = growth if growth.ndim == 2 else np.stack([growth, np.zeros(ne)], axis=1)
    if element is FOUR:
        centre = None if bilinear else _stress_free_centre(X, fibre[:, 0], growth)
        membranes, shears = _four_nodes(X, centre)
    else:
        membranes, shears = _nine_nodes(X)
    one, two = (1 + growth).T
    tensor = np.stack([one**-2, two**-2, 1 / (one * two)], axis=1)[:, :, None]
    edges = np.stack([X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]], axis=2)
    triangle = _is_triangle(X)[:, None, None]
    parts: list[tuple[Array, ...]] = []
    for g, (r, s) in enumerate(element.gauss):
        frame, J, area = local_frames(X, fibre[:, g], r, s)
        base = np.where(triangle, frame[:, :2] @ edges, J)
        bending = to_cartesian(J, np.broadcast_to(np.eye(3), (ne, 3, 3)))
        shear = np.swapaxes(np.linalg.inv(base), 1, 2) @ shears[:, g]
        shear /= (1 + growth)[:, :, None]
        membrane = to_cartesian(base, membranes[:, g]) * tensor
        area = element.factors[g] * area * one * two
        parts.append((membrane, bending * tensor, shear, area, frame))
    membrane, bending, shear, weight, frames = (np.stack(p, 1) for p in zip(*parts, strict=True))
    none = np.zeros((ne, points, 8))
    bare = ShellTables(membrane, bending, shear, none, weight, frames, height, mitre, growth)
    offset = bare.strain(nodes)
    offset[:, :, :2] += (1 - tensor[:, None, :2, 0]) / 2
    return replace(bare, offset=offset)


def _stress_free_centre(X: Array, fibre: Array, growth: Array) -> Array:
    """The base vectors r and s (ne, 2, 3) of the elements' centres, grown along the fibre (ne, 3)
    and across it by growth (ne, 2)."""
    base = kind_of(X).base_vectors(X, 0, 0)
    axes = local_frames(X, fibre, 0, 0)[0][:, :2]
    return base + np.einsum("nik,nak,na,nal->nil", base, axes, growth, axes)


def _four_nodes(X: Array, centre: Array | None) -> tuple[Array, Array]:
    """Membrane (ne, 4, 3, 5) and shear (ne, 4, 2, 4) at the Gauss points from the samples: of quads
    covariant, of triangles along their first and last edge; `centre` as in `quad_membrane`."""
    triangle = _is_triangle(X)
    warp = np.zeros((5, len(X)))
    warp[:, ~triangle] = distortion(X[~triangle])
    membrane = quad_membrane(X, warp, centre)
    membrane[triangle] = TRIANGLE_MEMBRANE
    shear = np.stack([mitc_shear(r, s) for r, s in FOUR.gauss])
    of_triangle = np.stack([triangle_shear(r, s) for r, s in FOUR.gauss])
    return membrane, np.where(triangle[:, None, None, None], of_triangle, shear)


def _nine_nodes(X: Array) -> tuple[Array, Array]:
    """Membrane (ne, 9, 3, 24) and shear (ne, 9, 2, 12), covariant, as `_four_nodes`."""
    shear = nine_nodes.mitc_shear()
    return nine_nodes.mitc_membrane(X), np.broadcast_to(shear, (len(X), *shear.shape))


@dataclass(frozen=True)
class ElementResponse:
    """The elements' energy, its gradient, and what the tangent is made of."""

    energy: float
    """J, of all elements."""
    gradient: Array
    """(ne, 2k, 3), by the nodes' y."""
    middle: Array
    """(ne, 2k, 3), the mid-surface's y."""
    force: Array
    """(ne, g, 8), of the Gauss points, times their areas."""
    stiffness: Array
    """(ne, g, 8, 8), of the Gauss points."""


def element_response(tables: ShellTables, section: Section, y: Array) -> ElementResponse:
    """Energy and gradient of all elements at the nodes' y (ne, 2k, 3)."""
    middle, strain = _middle_and_strain(tables, y)
    answer = section.response(strain)
    energy = float(np.vdot(answer.energy, tables.weight))
    force = answer.force * tables.weight[:, :, None]
    gradient = (_kernel_forces if kernels.COMPILED else _numpy_forces)(tables, middle, force)
    return ElementResponse(energy, gradient, middle, force, answer.stiffness)


def element_blocks(
    tables: ShellTables, response: ElementResponse, bases: tuple[Array, Array], convex: bool = False
) -> Array:
    """The tangent (ne, 5k, 5k) in the nodes' bases A (ne, k, 3, 3) and T (ne, k, 3, 2), without the
    curvature of the directors' sphere.

    `convex` keeps of the geometric stiffness what tension makes, so that the tangent is positive
    semidefinite: not consistent, but a descent direction from any state."""
    resultant = tensile(response.force) if convex else response.force
    blocks = _kernel_blocks if kernels.COMPILED else _numpy_blocks
    return blocks(tables, response.middle, resultant, response.stiffness, bases)


def tensile(resultant: Array) -> Array:
    """The part of the stress resultants (ne, g, 8) whose geometric stiffness is not negative: the
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


def _kernel_forces(tables: ShellTables, middle: Array, resultant: Array) -> Array:
    samples = tables.element.samples
    return kernels.forces(samples, middle, tables.carried, tables.parts, resultant)


def _numpy_forces(tables: ShellTables, middle: Array, resultant: Array) -> Array:
    """The gradient (ne, 2k, 3) by the nodes' y of resultant (ne, g, 8) times strain, in numpy: what
    the compiled kernel is held to."""
    k = middle.shape[1] // 2
    out = _geometric(tables.element, _sample_stress(tables, resultant)) @ middle
    out[:, k:] += tables.height[:, :, None] * out[:, :k]
    out[:, k:] *= tables.mitre[:, :, None]
    return out


def _sample_stress(tables: ShellTables, resultant: Array) -> Array:
    """The stress (ne, m) of the samples from the resultants (ne, g, 8) of the Gauss points."""
    bent = np.einsum("ngci,ngc->ngi", tables.bending, resultant[..., 3:6])
    parts = [
        np.einsum("ngci,ngc->ni", tables.membrane, resultant[..., :3]),
        bent.reshape(len(bent), 3 * bent.shape[1]),
        np.einsum("ngci,ngc->ni", tables.shear, resultant[..., 6:]),
    ]
    return np.concatenate(parts, axis=1)


def _geometric(element: Element, stress: Array) -> Array:
    """The Hessian (ne, 2k, 2k) of the samples, weighted by stress (ne, m)."""
    m, size = element.samples.shape[:2]
    return (stress @ element.samples.reshape(m, size * size)).reshape(-1, size, size)


def _kernel_blocks(
    tables: ShellTables,
    middle: Array,
    resultant: Array,
    stiffness: Array,
    bases: tuple[Array, Array],
) -> Array:
    shape = tables.element.samples, middle, tables.carried, tables.parts
    return kernels.element_blocks(*shape, resultant, (stiffness, tables.weight), bases)


def _numpy_blocks(
    tables: ShellTables, y: Array, resultant: Array, stiffness: Array, bases: tuple[Array, Array]
) -> Array:
    """The element tangents in numpy: what the compiled kernel is held to."""
    stress = _sample_stress(tables, resultant)
    stiffness = stiffness * tables.weight[:, :, None, None]
    bases = bases[0], bases[1] * tables.mitre[:, :, None, None]
    ne, size = y.shape[:2]
    samples, spread = tables.element.samples, tables.spread()
    m, points = len(samples), stiffness.shape[1]
    flat = (samples @ y[:, None]).reshape(ne, m, 3 * size)
    inner = (stiffness @ spread.reshape(ne, points, 8, m)).reshape(ne, 8 * points, m)
    hessian = np.swapaxes(flat, 1, 2) @ (np.swapaxes(spread, 1, 2) @ inner) @ flat
    geometric = _geometric(tables.element, stress)
    blocks = hessian.reshape(ne, size, 3, size, 3)
    for k in range(3):
        blocks[:, :, k, :, k] += geometric
    W = _projection(tables.height, *bases)
    out = np.swapaxes(W, 1, 2) @ hessian @ W
    return (out + np.swapaxes(out, 1, 2)) / 2


def _projection(height: Array, A: Array, T: Array) -> Array:
    """The mid-surface's y by the nodes' degrees of freedom (ne, 6k, 5k)."""
    ne, count = height.shape
    W = np.zeros((ne, 6 * count, 5 * count))
    for a in range(count):
        x, at = slice(3 * a, 3 * a + 3), 5 * a
        d = slice(3 * (count + a), 3 * (count + a) + 3)
        W[:, x, at : at + 3], W[:, d, at + 3 : at + 5] = A[:, a], T[:, a]
        W[:, x, at + 3 : at + 5] = height[:, a, None, None] * T[:, a]
    return W
