"""A stand-alone shell model in SI units, whatever file it came from.

Lengths in m, forces in N, stresses in Pa, angles in rad; one right-handed world frame.  A body's
frame is the world's at time 0, moved to the body's origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints, rotation_matrix
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.materials.linear import Law

ZERO = Drive()
STILL = (ZERO, ZERO, ZERO)


@dataclass(frozen=True)
class ShellPart:
    """Shell elements of one material."""

    name: str
    law: Law
    in_situ_stretch: float = 1.0


@dataclass(frozen=True)
class Body:
    """A rigid body: its origin (3,) m, about which it turns; how far the origin moves along x, y,
    z (m); the rotation vector's components (rad); and its surface, vertices (nv, 3) m in its frame
    with triangles (nt, 3), whether anything touches it or not."""

    name: str
    origin: Array
    vertices: Array
    triangles: Ints
    displacement: tuple[Drive, Drive, Drive] = STILL
    rotation: tuple[Drive, Drive, Drive] = STILL

    def pose(self, time: float) -> tuple[Array, Array]:
        """Position (3,) m of the origin and rotation (3, 3) at a time."""
        moved = np.array([d.at(time) for d in self.displacement])
        return self.origin + moved, rotation_matrix(np.array([d.at(time) for d in self.rotation]))


@dataclass(frozen=True)
class Tied:
    """Nodes (k,) that move with a body (its number); `clamped`: their directors turn with it
    too."""

    nodes: Ints
    body: int
    clamped: bool = True


@dataclass(frozen=True)
class PrescribedDisplacement:
    """Nodes (k,) of which one displacement component (0, 1, 2: x, y, z) is given, m."""

    nodes: Ints
    component: int
    displacement: Drive = ZERO


@dataclass(frozen=True)
class HeldDirector:
    """Nodes (k,) of which one component of the director keeps its initial value."""

    nodes: Ints
    component: int


@dataclass(frozen=True)
class SpringLaw:
    """Axial force by elongation: `stiffness` (N/m) times it, or a table (m -> N); a tension-only
    spring has no force when it is shorter than at rest."""

    stiffness: float
    tension_only: bool = False
    table: LoadCurve | None = None

    def force(self, elongation: float) -> float:
        """N, positive in tension."""
        if self.tension_only and elongation < 0:
            return 0.0
        return self.stiffness * elongation if self.table is None else self.table.at(elongation)


@dataclass(frozen=True)
class SpringSet:
    """Springs of one law.  Spring i joins node `nodes[i]` to the point `anchor[i]` (m, body frame)
    of body `body[i]`, or, where `body[i]` is -1, to node `other[i]`; `length` (k,) m at rest."""

    name: str
    law: SpringLaw
    nodes: Ints
    body: Ints
    anchor: Array
    other: Ints
    length: Array


@dataclass(frozen=True)
class NodalForce:
    """A force (3,) N on each of the nodes (k,), times the curve, in the world frame."""

    nodes: Ints
    force: Array
    curve: LoadCurve | None = None


@dataclass(frozen=True)
class Pressure:
    """A pressure (Pa) on quads (k,): positive against the quad's normal (right-handed about its
    corners) where `sign` (k,) is 1, along it where it is -1; `dead` keeps the direction and area of
    the start."""

    quads: Ints
    sign: Ints
    pressure: Drive
    dead: bool = False


@dataclass(frozen=True)
class ContactPair:
    """Quads (k,) of the shell that slide on triangles (nt, 3) of a body's surface.

    `side` (k,): the quad's face that is meant, 1 that of its normal, -1 the other; `gap` m is kept
    between the faces.  The penalty is a factor of the solver's own choice where `automatic`, else
    N/m3.  Friction is Coulomb's coefficient."""

    name: str
    quads: Ints
    side: Ints
    body: int
    triangles: Ints
    penalty: float = 1.0
    automatic: bool = True
    friction: float = 0.0
    gap: float = 0.0


@dataclass(frozen=True)
class Step:
    """A stretch of time up to `end`, in that many increments to begin with."""

    name: str
    end: float
    increments: int


@dataclass(frozen=True)
class Job:
    """Everything that a stand-alone solve needs.

    n nodes: `points` (n, 3) m and their numbers in the file `node_ids` (n,).  ne elements: `quads`
    (ne, 4), a triangle as (a, b, c, c); their numbers `element_ids` (ne,); the index of their part
    `part` (ne,); at their corners the `thickness` (ne, 4) m and the `height` (ne, 4) m by which the
    mid-surface lies off the nodes along the director (normal right-handed about the corners);
    `fibre` (ne, 3) unit directions.  `notes` list what the file holds and this model leaves
    out."""

    name: str
    points: Array
    node_ids: Ints
    quads: Ints
    element_ids: Ints
    part: Ints
    parts: tuple[ShellPart, ...]
    thickness: Array
    height: Array
    fibre: Array
    bodies: tuple[Body, ...] = ()
    tied: tuple[Tied, ...] = ()
    held: tuple[PrescribedDisplacement, ...] = ()
    held_directors: tuple[HeldDirector, ...] = ()
    springs: tuple[SpringSet, ...] = ()
    forces: tuple[NodalForce, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    contacts: tuple[ContactPair, ...] = ()
    steps: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()

    def node(self, index: int) -> str:
        """A node as its user knows it."""
        return f"node {self.node_ids[index]}"

    def element(self, index: int) -> str:
        """An element as its user knows it, with its part."""
        return f"element {self.element_ids[index]} (part {self.parts[self.part[index]].name!r})"
