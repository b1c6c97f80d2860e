"""Springs between hood nodes and points of a rigid body, and between two nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator, PPoly

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.forces.friction import Friction
from fe_solver.forces.guides import Ropes
from fe_solver.forces.ramp import ramp

ROPE = -2
"""The group of the forces of ropes; contacts are of -1, springs of their sets' numbers."""


@dataclass(frozen=True)
class ForceCurve:
    """A table of p points that is the law of some springs.

    Between the points it is the cubic of Fritsch and Carlson (SIAM J Numer Anal 17:238, 1980, with
    Fritsch and Butland's slopes), C1 and monotone wherever the points are, so that Newton meets no
    kink and no spurious softening; beyond them it goes on straight.

    Raises InputError for fewer than two points, a stretch that does not grow and what is not
    finite."""

    springs: Ints
    """Indices, in their `Springs`, of those that follow it; their own stiffness plays no part."""
    stretch: Array
    """(p,) m."""
    force: Array
    """(p,) N."""

    def __post_init__(self) -> None:
        stretch, force = (np.asarray(v, dtype=float) for v in (self.stretch, self.force))
        object.__setattr__(self, "stretch", stretch)
        object.__setattr__(self, "force", force)
        if stretch.ndim != 1 or stretch.shape != force.shape or len(stretch) < 2:
            raise InputError(
                "a force curve needs two or more pairs of stretch (m) and force (N), got "
                f"{stretch.shape} stretches and {force.shape} forces"
            )
        if not (np.isfinite(stretch).all() and np.isfinite(force).all()):
            raise InputError("a force curve holds a value that is not finite")
        if (fault := np.flatnonzero(np.diff(stretch) <= 0)).size:
            a, b = stretch[fault[0] : fault[0] + 2]
            raise InputError(
                f"force curve: the stretch must grow from point to point, but {b:g} m follows "
                f"{a:g} m (points {fault[0]} and {fault[0] + 1})"
            )

    @cached_property
    def _pieces(self) -> tuple[PPoly, PPoly, PPoly]:
        force = PchipInterpolator(self.stretch, self.force)
        return force.antiderivative(), force, force.derivative()

    def _to_start(self, stretch: Array) -> tuple[Array, Array, Array]:
        """Work from the first point (J), force (N) and slope (N/m)."""
        inside = np.clip(stretch, self.stretch[0], self.stretch[-1])
        work, force, slope = (piece(inside) for piece in self._pieces)
        beyond = stretch - inside
        return work + (force + slope * beyond / 2) * beyond, force + slope * beyond, slope

    def __call__(self, stretch: Array) -> tuple[Array, Array, Array]:
        """Energy (J, zero at no stretch), force (N) and slope (N/m) at stretches (k,) m."""
        work, force, slope = self._to_start(stretch)
        return work - self._to_start(np.zeros(1))[0], force, slope


@dataclass(frozen=True)
class Springs:
    """k springs of energy k (l - l0)^2 / 2 from a node to a body, zero for l < l0 where
    `tension_only`."""

    node: Ints
    """(k,)."""
    body: Ints
    """(k,)."""
    anchor: Array
    """(k, 3) m, body frame."""
    stiffness: Array
    """(k,) N/m."""
    length: Array
    """(k,) m, the slack length l0."""
    tension_only: NDArray[np.bool_]
    """(k,)."""
    group: Ints
    """(k,) number of the set that a spring is of."""
    curves: Sequence[ForceCurve] = ()
    """In place of k (l - l0) for the springs that they name."""
    toe: Array | None = None
    """(k,) m: a tension-only spring's force sets in smoothly from l0 - toe to l0 + toe."""

    def __post_init__(self) -> None:
        _check_curves(self.curves, self.tension_only)

    @staticmethod
    def none() -> Springs:
        """No springs."""
        i, f = np.zeros(0, dtype=np.intp), np.zeros(0)
        return Springs(i, i, np.zeros((0, 3)), f, f, np.zeros(0, dtype=bool), i)


@dataclass(frozen=True)
class NodeSprings:
    """k springs between two nodes of the shell, as `Springs` otherwise."""

    nodes: Ints
    """(k, 2) indices."""
    stiffness: Array
    length: Array
    tension_only: NDArray[np.bool_]
    group: Ints
    curves: Sequence[ForceCurve] = ()

    def __post_init__(self) -> None:
        _check_curves(self.curves, self.tension_only)

    @staticmethod
    def none() -> NodeSprings:
        """No springs between nodes."""
        i, f = np.zeros(0, dtype=np.intp), np.zeros(0)
        return NodeSprings(np.zeros((0, 2), dtype=np.intp), f, f, np.zeros(0, dtype=bool), i)


def _check_curves(curves: Sequence[ForceCurve], tension_only: NDArray[np.bool_]) -> None:
    """A spring that pulls only when stretched must not pull at once, or its force would jump."""
    count = len(tension_only)
    for curve in curves:
        if ((curve.springs < 0) | (curve.springs >= count)).any():
            raise InputError(f"a force curve names spring {curve.springs.max()} of {count}")
        at_rest = float(curve(np.zeros(1))[1][0])
        if tension_only[curve.springs].any() and abs(at_rest) > 1e-9 * np.abs(curve.force).max():
            raise InputError(
                f"force curve of a tension-only spring: the force at no stretch is {at_rest:g} N, "
                "expected 0; shift the curve, or change the spring's slack length"
            )


class Axial(NamedTuple):
    """What springs do along themselves, each (k,)."""

    energy: Array
    """J."""
    force: Array
    """N, positive where it pulls."""
    slope: Array
    """N/m."""
    stretch: Array
    """Stretch (k,) in m: length less slack length."""
    taut: NDArray[np.bool_]
    """Whether the spring acts; one that also pushes always does."""


def axial(springs: Springs | NodeSprings, length: Array) -> Axial:
    """Law of the springs at lengths (k,) m."""
    stretch = length - springs.length
    taut = ~springs.tension_only | (stretch > 0)
    energy, force = springs.stiffness * stretch**2 / 2, springs.stiffness * stretch
    slope = springs.stiffness.astype(float)
    for curve in springs.curves:
        i = curve.springs
        energy[i], force[i], slope[i] = curve(stretch[i])
    if isinstance(springs, Springs) and springs.toe is not None:
        i = np.flatnonzero(springs.toe * springs.tension_only > 0)
        parts = ramp(stretch[i], springs.toe[i])
        energy[i], force[i], slope[i] = (springs.stiffness[i] * part for part in parts)
        taut[i] = stretch[i] > -springs.toe[i]
    return Axial(taut * energy, taut * force, taut * slope, stretch, taut)


def _lines(reach: Array) -> tuple[Array, Array]:
    """Length (k,) and unit direction (k, 3) of vectors (k, 3); no length has no direction."""
    length = np.linalg.norm(reach, axis=1)
    return length, reach / np.where(length > 0, length, 1.0)[:, None]


def _hessian(slope: Array, length: Array, direction: Array, curvature: bool, force: Array) -> Array:
    """The stiffness (k, 3, 3): the `slope` along the spring and force / length across it."""
    across = np.divide(force, length, out=slope.copy(), where=length > 0)
    if not curvature:
        across, slope = np.maximum(across, 0), np.maximum(slope, 0)
    along = direction[:, :, None] * direction[:, None, :]
    return slope[:, None, None] * along + across[:, None, None] * (np.eye(3) - along)


@dataclass(frozen=True)
class PointForces:
    """Forces between points of the hood and bodies that act along one line at one point.

    Each force is that of a one-sided spring; those that are open are listed too, with no force."""

    nodes: Ints
    """(k, m) whose mean is the point: one node alone, or those of an element."""
    weights: Array
    """(k, m) of the nodes."""
    cell: Ints
    """(k,) the element; -1 for a node alone."""
    body: Ints
    """(k,)."""
    energy: float
    """J."""
    gradient: Array
    """(k, 3) N, by the point's position (the hood feels its opposite and the body feels it)."""
    force: Array
    """(k,) N along `direction`."""
    bend: Callable[[Array], Array]
    """Makes the Hessian (k, 3, 3) from such forces."""
    arm: Array
    """(k, 3) m, the point of action from the body's origin, world."""
    turns: NDArray[np.bool_]
    """(k,) whether the force turns with the body (contact) or follows the point (spring)."""
    group: Ints
    """(k,) number of a spring's set; -1 of a contact, ROPE of a rope."""
    depth: Array
    """(k,) m along `direction`, penetration or stretch; inf of a two-sided spring."""
    direction: Array
    """(k, 3), unit."""
    stiffness: Array
    """(k,) N/m."""
    ramp: Array
    """(k,) m of depth about zero over which the force is smoothed."""
    length: Array
    """(k,) m of the spring, inf of a contact."""
    friction: Friction | None = None
    """World frame; None where no point has any."""

    @property
    def node(self) -> Ints:
        """The node (k,) that bears most of each force."""
        return np.asarray(self.nodes[np.arange(len(self.nodes)), self.weights.argmax(axis=1)])

    def widened(self, width: int) -> PointForces:
        """With `width` nodes for each point, those more than it has without weight."""
        count, has = self.nodes.shape
        nodes = np.repeat(self.nodes, [*[1] * (has - 1), width - has + 1], axis=1)
        weights = np.concatenate([self.weights, np.zeros((count, width - has))], axis=1)
        return replace(self, nodes=nodes, weights=weights)

    def at_points(self, values: Array) -> Array:
        """The values (k, 3) at the points of values (n, 3) at the nodes."""
        return np.asarray(self._by_node(len(values)) @ values)

    def on_nodes(self, forces: Array, count: int) -> Array:
        """The forces (n, 3) N at `count` nodes of forces (k, 3) at the points."""
        return np.asarray(self._by_node(count).T @ forces)

    def _by_node(self, count: int) -> sp.csr_array:
        """The weights as a matrix (k, n) of `count` nodes."""
        k, m = self.nodes.shape
        ends = np.arange(0, k * m + 1, m)
        return sp.csr_array((self.weights.ravel(), self.nodes.ravel(), ends), (k, count))

    def acting(self) -> PointForces:
        """Those alone that have a force or a stiffness."""
        on = np.flatnonzero(self.hessian.any(axis=(1, 2)) | self.gradient.any(axis=1))

        def bend(force: Array) -> Array:
            every = np.zeros(len(self.force))
            every[on] = force
            return self.bend(every)[on]

        columns = {name: getattr(self, name)[on] for name in COLUMNS}
        friction = self.friction and self.friction.take(on)
        return replace(self, bend=bend, friction=friction, **columns)

    @cached_property
    def hessian(self) -> Array:
        """The stiffness (k, 3, 3); made when first asked for, which a trial step never does."""
        return self.bend(self.force)


COLUMNS = [f.name for f in fields(PointForces) if f.name not in ("energy", "bend", "friction")]
"""What `PointForces` say of each point."""


def _reach(springs: Springs, x: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Arms (k, 3) of the anchors from their bodies' origins and vectors (k, 3) from the anchors to
    the nodes, world frame."""
    arm = np.einsum("kij,kj->ki", rotation[springs.body], springs.anchor)
    return arm, x[springs.node] - position[springs.body] - arm


def spring_state(springs: Springs, x: Array, position: Array, rotation: Array) -> Axial:
    """Force, stretch and whether it is taut, by spring, at node positions x (n, 3) and body poses
    (nb, 3), (nb, 3, 3)."""
    return axial(springs, _lines(_reach(springs, x, position, rotation)[1])[0])


def spring_directions(springs: Springs, x: Array, position: Array, rotation: Array) -> Array:
    """Unit directions (k, 3) from the anchors to the nodes, world frame; places as there."""
    return _lines(_reach(springs, x, position, rotation)[1])[1]


def node_spring_directions(springs: NodeSprings, x: Array) -> Array:
    """Unit directions (k, 3) from the first nodes to the second."""
    return _lines(x[springs.nodes[:, 1]] - x[springs.nodes[:, 0]])[1]


def node_spring_state(springs: NodeSprings, x: Array) -> Axial:
    """Force, stretch and whether it is taut, by spring, at node positions x (n, 3)."""
    return axial(springs, _lines(x[springs.nodes[:, 1]] - x[springs.nodes[:, 0]])[0])


def spring_forces(
    springs: Springs, x: Array, position: Array, rotation: Array, curvature: bool
) -> PointForces:
    """Spring energies at node positions x (n, 3) and body poses (nb, 3), (nb, 3, 3); without
    `curvature` the negative terms of the Hessian are left out: compression across a spring, and a
    falling force curve."""
    arm, reach = _reach(springs, x, position, rotation)
    length, direction = _lines(reach)
    pull = axial(springs, length)
    stiffness = springs.stiffness.astype(float)
    for curve in springs.curves:
        stiffness[curve.springs] = curve(np.maximum(pull.stretch[curve.springs], 0))[2]
    return PointForces(
        springs.node[:, None],
        np.ones((len(length), 1)),
        np.full(len(length), -1, dtype=np.intp),
        springs.body,
        float(pull.energy.sum()),
        pull.force[:, None] * direction,
        pull.force,
        partial(_hessian, pull.slope, length, direction, curvature),
        arm,
        np.zeros(len(length), dtype=bool),
        springs.group,
        np.where(springs.tension_only, pull.stretch, np.inf),
        direction,
        stiffness,
        np.zeros(len(length)) if springs.toe is None else springs.toe,
        length,
    )


def rope_forces(
    ropes: Ropes, tension: Array, x: Array, position: Array, rotation: Array
) -> PointForces:
    """Forces of ropes that bear `tension` (k,) N, as those of springs whose force does not change;
    the tendons' work is counted elsewhere, so that they have no energy."""
    length, direction = ropes.lines(x, position, rotation)
    none, endless = np.zeros(len(length)), np.full(len(length), np.inf)
    return PointForces(
        ropes.node[:, None],
        np.ones((len(length), 1)),
        np.full(len(length), -1, dtype=np.intp),
        ropes.body,
        0.0,
        tension[:, None] * direction,
        tension,
        partial(_hessian, none, length, direction, True),
        ropes.arm(rotation),
        np.zeros(len(length), dtype=bool),
        np.full(len(length), ROPE),
        endless,
        direction,
        none,
        none,
        endless,
    )


class PairForces(NamedTuple):
    """Forces between pairs of nodes."""

    energy: float
    """J."""
    gradient: Array
    """(k, 2, 3) N, of the energy by the position of either node."""
    hessian: Array
    """(k, 6, 6) N/m, by the positions of the first node and of the second."""

    @staticmethod
    def none() -> PairForces:
        """No forces between nodes."""
        return PairForces(0.0, np.zeros((0, 2, 3)), np.zeros((0, 6, 6)))


def node_springs(springs: NodeSprings, x: Array, curvature: bool) -> PairForces:
    """Energy, gradients and Hessian of springs between nodes at positions x (n, 3); `curvature` as
    in `spring_forces`."""
    length, direction = _lines(x[springs.nodes[:, 1]] - x[springs.nodes[:, 0]])
    pull = axial(springs, length)
    force = pull.force[:, None] * direction
    block = _hessian(pull.slope, length, direction, curvature, pull.force)
    return PairForces(
        float(pull.energy.sum()),
        np.stack([-force, force], axis=1),
        np.block([[block, -block], [-block, block]]),
    )
