"""Orders of convergence to manufactured solutions: each element in membrane, bending, shear and
large rotation, and each material law.

Theory (Strang and Fix 1973, An Analysis of the Finite Element Method): an element with all
polynomials of degree p meets a smooth solution with the order p + 1 in its displacements, in L2,
and p in its strains, in the norm of the energy; p is 1 for four nodes and 2 for nine.  The meshes
are mapped smoothly, so that their elements become parallelograms as they are refined.  On meshes
that stay distorted the nine-node element loses an order of each, by its tied strains, which hold
but the linear ones of a parallelogram; four nodes keep theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cosim.port import Array, rotation_matrix
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.linear import Law
from fe_solver.materials.tension_field import TensionField
from tests.helpers.rows import Row
from tests.proofs.fe import fibre_rows, manufactured_solid
from tests.proofs.fe.element_rows import halve
from tests.proofs.fe.manufactured import (
    THICKNESS,
    Errors,
    Mesh,
    Motion,
    Surface,
    solve_motion,
    unit,
    vectors,
)
from tests.proofs.fe.material_rows import ISOTROPIC, LAWS, MPA, SOFT_TENDON
from tests.proofs.fe.sheets import elements

SHORT = 0.25
"""How far the order of the last two meshes may stay behind theory."""
SOURCE = "Strang, Fix 1973: order {} for smooth solutions; load by the exact motion's virtual work"
SHIFT = 0.2
TURN = rotation_matrix(np.array([0.9, 0.7, 0.3]))
ROLL = np.radians(150)
PI = np.pi
sin, cos = np.sin, np.cos


def upright(u: Array, v: Array) -> Array:
    """Directors along z."""
    return vectors(0 * u, 0 * v, 1 + 0 * u)


FLAT = Surface(lambda u, v: vectors(u, v, 0 * u), upright)


def hill(u: Array, v: Array) -> Array:
    """A surface curved both ways over the unit square."""
    return vectors(u, v, 0.12 * sin(PI * u) + 0.1 * v * v - 0.1 * u * v)


def hill_normal(u: Array, v: Array) -> Array:
    """The unit normals of the hill."""
    return unit(vectors(-0.12 * PI * cos(PI * u) + 0.1 * v, -0.2 * v + 0.1 * u, 1 + 0 * u))


HILL = Surface(hill, hill_normal)


def move_hill(share: float, along: float, across: float, thicker: float = 0.0) -> Motion:
    """The hill turned by 67 degrees, stretched along x and y, with a `share` of a wavy motion in
    which its directors lean too; the directors are longer by up to `thicker`."""

    def place(u: Array, v: Array) -> Array:
        waves = vectors(
            0.06 * sin(PI * u + 0.3) * cos(2 * v),
            0.05 * cos(2 * u) * sin(2 * v),
            0.05 * sin(PI * u) * cos(2 * v),
        )
        moved = hill(u, v) + share * waves + vectors(along * u, across * v, 0 * u)
        return np.asarray(moved @ TURN.T)

    def director(u: Array, v: Array) -> Array:
        lean = vectors(
            0.05 * u - 0.2 * cos(PI * u) * cos(2 * v), 0.1 * sin(PI * u) * sin(2 * v), 0 * u
        )
        length = 1 + thicker * sin(PI * u) * cos(2 * v)
        return np.asarray(length[..., None] * unit(hill_normal(u, v) + share * lean) @ TURN.T)

    return Motion(HILL, Surface(place, director))


def stretched(u: Array, v: Array) -> Array:
    """A flat sheet stretched and sheared in its plane."""
    x = 1.1 * u + 0.04 * sin(PI * u + 0.3) * cos(PI * v)
    return vectors(x, 1.1 * v + 0.06 * cos(2 * u) * sin(2 * v + 0.2), 0 * u)


def bent(u: Array, v: Array) -> Array:
    """A flat sheet bent both ways."""
    return vectors(u, v, 0.1 * sin(PI * u) * cos(2 * v))


def bent_normal(u: Array, v: Array) -> Array:
    """The unit normals of the bent sheet."""
    by_u = -0.1 * PI * cos(PI * u) * cos(2 * v)
    return unit(vectors(by_u, 0.2 * sin(PI * u) * sin(2 * v), 1 + 0 * u))


def leaning(u: Array, v: Array) -> Array:
    """Directors that lean by up to 14 degrees over a sheet at rest."""
    return unit(vectors(0.2 * sin(PI * u) * cos(2 * v), 0.15 * cos(2 * u) * sin(2 * v), 1 + 0 * u))


def rolled(u: Array, v: Array) -> Array:
    """A flat sheet rolled up by ROLL, 5 % longer."""
    radius, angle = 1.05 / ROLL, ROLL * u
    return vectors(
        radius * sin(angle), v + 0.05 * sin(2 * v) * u, radius * (1 - cos(angle)) + 0 * v
    )


def rolled_director(u: Array, v: Array) -> Array:
    """Unit directors of the rolled sheet that lean by up to 6 degrees."""
    angle = ROLL * u + 0.1 * sin(PI * v)
    return unit(vectors(-sin(angle), 0.05 * sin(PI * u) * cos(2 * v), cos(angle)))


CURVED = move_hill(1.0, 0.05, 0.05)
MOTIONS = {
    "membrane": Motion(FLAT, Surface(stretched, upright)),
    "bending": Motion(FLAT, Surface(bent, bent_normal)),
    "shear": Motion(FLAT, Surface(FLAT.place, leaning)),
    "rolled up by 150 degrees": Motion(FLAT, Surface(rolled, rolled_director)),
    "curved sheet, nodes on a face": CURVED,
    "curved sheet that grew": replace(move_hill(0.4, 0.08, 0.08), growth=(0.03, -0.02)),
}
TAUT = move_hill(0.4, 0.08, 0.08)
"""Fibres and matrix in tension everywhere."""
WRINKLED = move_hill(0.4, 0.08, -0.08)
"""Shortened across, so that a tension field wrinkles."""
MATERIALS: dict[str, Law | TensionField] = {
    **LAWS,
    "crossed linear fibres": CrossedLinear(fibre_rows.STRAIGHT, fibre_rows.LINEAR, 1.2),
    "crossed exponential fibres": CrossedFibres(fibre_rows.TENDON, fibre_rows.FIBRE, 1.2),
}
SOLIDS: dict[str, Law] = {
    **{name: LAWS[name] for name in ("isotropic", "orthotropic", "neo-Hookean")},
    "trans iso Mooney-Rivlin, k = 20 MPa": replace(SOFT_TENDON, k=20 * MPA),
}
"""What a solid may thicken with; nearly incompressible, it would resist by a pressure without
bound."""


def mapped(uv: Array) -> Array:
    """The unit square mapped smoothly to itself, with no angle of 90 degrees left."""
    u, v = uv.T
    bulge = 0.08 * sin(PI * u) * sin(PI * v)
    x = u + bulge + 0.05 * sin(2 * PI * u) * v
    return np.column_stack([x, v - bulge * (1 + u) / 2 + 0.04 * sin(PI * v) * (u - 0.5)])


@dataclass(frozen=True)
class Kind:
    """A kind of element on ever finer meshes."""

    name: str
    nodes: int
    sizes: tuple[int, ...]
    """Elements along a side."""
    orders: tuple[float, float]
    """In theory: of places and directors, and of strains."""
    triangles: bool = False
    random: bool = False
    """Whether the corners are moved at random, so that elements stay distorted, or mapped."""

    def mesh(self, size: int) -> Mesh:
        """Return the mesh of a size."""
        shift = SHIFT if self.random else 0.0
        uv, quads = elements(size, size, self.nodes, shift, seed=size)
        uv = uv if self.random else mapped(uv)
        return Mesh(uv, halve(quads) if self.triangles else quads)


FOUR = Kind("four-node quads", 4, (4, 8, 16), (2, 1))
NINE = Kind("nine-node quads", 9, (2, 4, 8), (3, 2))
KINDS = (
    FOUR,
    NINE,
    Kind("triangles", 4, (8, 16, 32), (2, 1), triangles=True),
    Kind("distorted four-node quads", 4, (8, 16, 32), (2, 1), random=True),
    Kind("distorted nine-node quads", 9, (4, 8, 16), (2, 1), random=True),
)
Solve = Callable[[Mesh], Errors]


def convergence(name: str, kind: Kind, solve: Solve) -> Iterator[Row]:
    """Yield how far the observed orders of places and of strains stay behind theory."""
    errors = [solve(kind.mesh(size)) for size in kind.sizes]
    last = f"{kind.sizes[-2]} to {kind.sizes[-1]} elements a side"
    of = {
        "places and directors, L2": [e.place for e in errors],
        "strains, energy norm": [e.strain for e in errors],
    }
    for (what, values), theory in zip(of.items(), kind.orders, strict=True):
        order = float(np.log2(values[-2] / values[-1]))
        yield Row(
            f"manufactured, {kind.name}",
            f"{name}: order of {what}, behind theory, {last}",
            *(SHORT, theory - order, 0.0, SOURCE.format(theory), "bound", order),
        )


def element_rows() -> Iterator[Row]:
    """Yield the orders of every element in every motion, of an isotropic sheet."""
    for kind in KINDS:
        for name, motion in MOTIONS.items():
            height = THICKNESS / 2 if motion is CURVED else 0.0
            solve = partial(solve_motion, motion, law=ISOTROPIC, height=height)
            yield from convergence(name, kind, solve)
    for name in SOLIDS:
        yield from solid_rows(name)


def solid_rows(name: str) -> Iterator[Row]:
    """Yield the orders of the `q4ans` element with a law."""
    motion, law = move_hill(0.4, 0.08, 0.08, thicker=0.05), SOLIDS[name]
    kind = replace(FOUR, name="q4ans solid shell")
    what = f"curved sheet that thickens, {name}"
    yield from convergence(what, kind, partial(manufactured_solid.solve_motion, motion, law=law))


def material_rows() -> Iterator[Row]:
    """Yield the orders of four and nine nodes with every material law, and of nine where a tension
    field wrinkles."""
    for name, law in MATERIALS.items():
        for kind in (FOUR, NINE):
            yield from convergence(name, kind, partial(solve_motion, TAUT, law=law))
        if name.startswith("tension field"):
            yield from convergence(
                f"{name}, wrinkled", NINE, partial(solve_motion, WRINKLED, law=law)
            )
