"""What holds and touches a sheet, in a job as in a hood: bodies, ties, springs, contact.

Lengths in m, forces in N, angles in rad.  A body is known by its number among the bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array, Ints, rotation_matrix
from fe_solver.forces.guides import Ties
from fe_solver.forces.ramp import ramp
from fe_solver.forces.springs import ForceCurve, NodeSprings, Springs
from fe_solver.given import fill, indices, integers, numbers, spread
from fe_solver.job.curves import Drive, Extension, Interpolation, LoadCurve, drives_from
from fe_solver.surfaces.spline_distance import Surface

ZERO = Drive()
STILL = (ZERO, ZERO, ZERO)
WALL = -1
"""In place of a body's number in a tie of a job: what stands still."""
KINK = 0.01
"""Share of a table's interval, on either side of its points, within which the corners are
rounded."""
NO_NODES = np.zeros(0, dtype=np.intp)


class Given(Enum):
    """What gives a degree of freedom of a body where no drive does: equilibrium, or the place that
    it has at the begin of the step."""

    FREE = "free"
    STAYS = "stays"


@dataclass(frozen=True)
class Body:
    """A rigid body, moved in a job as its drives say; its frame is the world's at time 0, moved to
    the body's origin."""

    name: str
    origin: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) m, about which it turns."""
    vertices: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(nv, 3) m in its frame, of its surface, whether anything touches it or not."""
    triangles: Ints = field(default_factory=lambda: np.zeros((0, 3), dtype=np.intp))
    """(nt, 3) vertices of its surface's triangles."""
    displacement: tuple[Drive, Drive, Drive] = STILL
    """How far the origin moves along x, y, z, m."""
    rotation: tuple[Drive, Drive, Drive] = STILL
    """The rotation vector's components, rad."""
    surface: Surface | None = None
    """Its surface by signed distance in its frame, as a sphere's or a cone's; contact then needs
    no triangles."""
    free: tuple[bool, ...] = (False,) * 6
    """Which of its displacements along x, y, z and its turns about them equilibrium finds."""
    motions: tuple[tuple[Drive | Given, ...], ...] = ()
    """What gives each of the six in each step of the job; empty where that is the same in all."""

    def __post_init__(self) -> None:
        fill(
            self,
            origin=numbers("origin (m)", self.origin, 3),
            vertices=numbers("vertices (m)", self.vertices, None, 3),
            triangles=integers("triangles", self.triangles),
            displacement=drives_from("displacement (m)", self.displacement),
            rotation=drives_from("rotation (rad)", self.rotation),
        )

    def during(self, step: int) -> Body:
        """The body as it moves in a step of the job; what stays is at zero."""
        if not self.motions:
            return self
        own = self.motions[step]
        x, y, z, u, v, w = (m if isinstance(m, Drive) else ZERO for m in own)
        free = tuple(m is Given.FREE for m in own)
        return replace(self, displacement=(x, y, z), rotation=(u, v, w), free=free, motions=())

    def pose(self, time: float) -> tuple[Array, Array]:
        """Position (3,) m of the origin and rotation (3, 3) at a time."""
        moved = np.array([d.at(time) for d in self.displacement])
        return self.origin + moved, rotation_matrix(np.array([d.at(time) for d in self.rotation]))


@dataclass(frozen=True)
class Tied:
    """Nodes that move with a body."""

    nodes: Ints
    """(k,)."""
    body: int
    """Its number; WALL stands still."""
    clamped: bool = True
    """Whether the nodes' directors turn with it too."""
    name: str = field(default="", compare=False)
    """Under which its reaction is given."""
    steps: tuple[int, ...] | None = None
    """Numbers of the job's steps in which it is in force, from where the nodes are at its begin on;
    None in all."""

    def __post_init__(self) -> None:
        fill(self, nodes=indices("nodes", self.nodes))


@dataclass(frozen=True)
class SpringLaw:
    """Axial force by elongation, the length less that at rest."""

    stiffness: float | Array
    """N/m, of all springs or (k,) of each."""
    tension_only: bool = False
    """Whether there is no force when the spring is shorter than at rest."""
    table: LoadCurve | None = None
    """Force (N) by elongation (m), in place of the stiffness."""
    toe: float = 0.0
    """m: a tension-only spring's force sets in smoothly from so much before its rest length to as
    much after."""

    def __post_init__(self) -> None:
        stiffness = numbers("stiffness (N/m)", self.stiffness)
        fill(self, stiffness=stiffness if stiffness.ndim else float(stiffness))

    def force(self, elongation: float) -> float | Array:
        """The force (N) at an elongation, positive in tension."""
        if self.tension_only and self.toe:
            return self.stiffness * ramp(np.array(elongation), self.toe)[1]
        if self.tension_only and elongation < 0:
            return 0.0
        return self.stiffness * elongation if self.table is None else self.table.at(elongation)


@dataclass(frozen=True)
class SpringSet:
    """Springs of one law and name, from nodes to points of bodies or to other nodes."""

    name: str
    law: SpringLaw
    nodes: Ints
    """(k,)."""
    body: Ints
    """(k,) number of the body that a spring ends at, -1 where it ends at a node."""
    anchor: Array
    """(k, 3) m, the point of that body, in its frame."""
    other: Ints
    """(k,) the node that a spring ends at, -1 where it ends at a body."""
    length: Array
    """(k,) m at rest."""

    def __post_init__(self) -> None:
        k = len(indices("nodes", self.nodes))
        fill(
            self,
            nodes=indices("nodes", self.nodes),
            body=spread("body", integers("body", self.body), k),
            anchor=numbers("anchor (m)", self.anchor, k, 3),
            other=spread("other", integers("other", self.other), k),
            length=spread("length (m)", numbers("length (m)", self.length), k),
        )

    @staticmethod
    def to_body(
        name: str, law: SpringLaw, nodes: Ints, body: int, anchor: Array, length: Array | float
    ) -> SpringSet:
        """Return springs that all end at one body, of the rest length (k,) m or one for all."""
        nodes = indices("nodes", nodes)
        k = len(nodes)
        rest = np.array(np.broadcast_to(length, k), dtype=float)
        return SpringSet(name, law, nodes, np.full(k, body), anchor, np.full(k, -1), rest)


@dataclass(frozen=True)
class ContactPair:
    """Elements of a sheet that slide on a body."""

    name: str
    quads: Ints
    """(k,) the elements."""
    side: Ints
    """(k,) the face that is meant: 1 that of the element's normal, -1 the other."""
    body: int
    """Its number."""
    triangles: Ints = field(default_factory=lambda: np.zeros((0, 3), dtype=np.intp))
    """(nt, 3) of the body's surface, where that is of triangles."""
    penalty: float = 1.0
    """A factor of the solver's own choice where `automatic`, else N/m3."""
    automatic: bool = True
    friction: float = 0.0
    """Coulomb's coefficient."""
    gap: float = 0.0
    """m that is kept between the faces."""
    steps: tuple[int, ...] | None = None
    """Numbers of the job's steps in which it is in force; None in all."""
    augmented: bool = False
    """Whether the penalty is a way to keep the faces apart, by multipliers, and not what gives."""

    def __post_init__(self) -> None:
        quads = indices("quads", self.quads)
        side = spread("side", integers("side", self.side), len(quads))
        fill(self, quads=quads, side=side, triangles=integers("triangles", self.triangles))


def ties_of(
    ties: Sequence[Tied], points: Array, directors: Array, position: Array, rotation: Array
) -> Ties:
    """Return what is clamped, of nodes at points (n, 3) with directors (n, 3) while the bodies are
    at `position` (nb, 3) and `rotation` (nb, 3, 3)."""
    clamps, none = [t for t in ties if t.clamped], np.zeros((0, 3))
    places = [(points[t.nodes] - position[t.body]) @ rotation[t.body] for t in clamps]
    return Ties(
        np.concatenate([NO_NODES, *[t.nodes for t in clamps]]),
        np.concatenate([NO_NODES, *[np.full(len(t.nodes), t.body) for t in clamps]]),
        np.vstack([none, *places]),
        np.vstack([none, *[directors[t.nodes] @ rotation[t.body] for t in clamps]]),
    )


def springs_of(sets: Sequence[SpringSet]) -> Springs:
    """The springs that end at bodies; a spring's group is the number of its set."""
    ends = [(i, s, np.flatnonzero(s.body >= 0)) for i, s in enumerate(sets)]
    return Springs(
        np.concatenate([NO_NODES, *[s.nodes[on] for _, s, on in ends]]),
        np.concatenate([NO_NODES, *[s.body[on] for _, s, on in ends]]),
        np.concatenate([np.zeros((0, 3)), *[s.anchor[on] for _, s, on in ends]]),
        *_columns(ends),
        _curves(ends),
        np.concatenate([np.zeros(0), *[np.full(len(on), s.law.toe) for _, s, on in ends]]),
    )


def links_of(sets: Sequence[SpringSet]) -> NodeSprings:
    """The springs between nodes; a spring's group is the number of its set."""
    ends = [(i, s, np.flatnonzero(s.body < 0)) for i, s in enumerate(sets)]
    pairs = [np.stack([s.nodes[on], s.other[on]], axis=1) for _, s, on in ends]
    nodes = np.concatenate([np.zeros((0, 2), dtype=np.intp), *pairs])
    return NodeSprings(nodes, *_columns(ends), _curves(ends))


def _columns(
    sets: Sequence[tuple[int, SpringSet, Ints]],
) -> tuple[Array, Array, NDArray[np.bool_], Ints]:
    """Stiffness, rest length, tension-only and group of the springs, each (k,)."""
    count, none = [len(on) for _, _, on in sets], np.zeros(0)
    each = [np.broadcast_to(s.law.stiffness, len(s.nodes))[on] for _, s, on in sets]
    length = np.concatenate([none, *[s.length[on] for _, s, on in sets]])
    only = np.repeat([s.law.tension_only for _, s, _ in sets], count).astype(bool)
    group = np.repeat([i for i, _, _ in sets], count).astype(np.intp)
    return np.concatenate([none, *each]), length, only, group


def _curves(sets: Sequence[tuple[int, SpringSet, Ints]]) -> tuple[ForceCurve, ...]:
    first, out = 0, []
    for _, s, nodes in sets:
        if s.law.table is not None and len(nodes):
            out.append(_force_curve(s.name, s.law.table, np.arange(first, first + len(nodes))))
        first += len(nodes)
    return tuple(out)


def _force_curve(name: str, table: LoadCurve, springs: Ints) -> ForceCurve:
    """The table with points beside its corners, so that the smooth curve through them is straight
    where the table is."""
    if table.interpolation == Interpolation.STEP or table.extension in (
        Extension.REPEAT,
        Extension.REPEAT_OFFSET,
    ):
        raise InputError(
            f"springs {name!r}: a force that steps or repeats with the elongation is not solved; "
            "give a table of straight or smooth pieces"
        )
    times = np.array(table.times)
    share = np.array([0, KINK, 1 - KINK])
    if table.interpolation != Interpolation.LINEAR:
        share = np.linspace(0, 1, 21)[:-1]
    inside = (times[:-1, None] + np.diff(times)[:, None] * share).ravel()
    span = times[-1] - times[0]
    low, high = times[0] - span * np.array([1, KINK]), times[-1] + span * np.array([0, KINK, 1])
    at = np.concatenate([low, inside, high])
    return ForceCurve(springs, at, np.array([table.at(float(t)) for t in at]))
