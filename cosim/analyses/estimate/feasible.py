"""The set of fingertip forces that tensions within their bounds can make.

With torques linear in the tensions, the torques that they make fill a zonotope, the image of a box;
a fingertip force is among the set where the torques that it asks for are in it:

    spread F = rows (tau(T) + beside),   least <= T <= most.

Where the tip also bears a moment there are as many equations as components and the set is a
zonotope too; where it is free to turn there is one more, and it is a section of one.  Exact where
the hood parts tensions in fixed shares, linearised at some tensions elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from cosim.analyses.estimate.demand import Demand
from cosim.analyses.estimate.held_finger import Torques
from cosim.analyses.estimate.tensions import Bounds
from cosim.errors import InputError
from cosim.port import Array

MOST_TENDONS = 14
"""Most tendons of a box of forces: all its corners, 2 to that power, are looked at."""
THIN = 1e-9
"""N: a set that is thinner has no inside."""


@dataclass(frozen=True)
class ForceSet:
    """A convex polytope in the d components `names`, N."""

    names: tuple[str, ...]
    vertices: Array
    """(v, d)."""
    halfspaces: Array
    """(h, d + 1): a F + b <= 0."""

    def holds(self, force: Array, by: float = 1e-9) -> bool:
        """Whether a force (d,) lies in it, or at most `by` N outside."""
        return bool((self.halfspaces[:, :-1] @ force + self.halfspaces[:, -1] <= by).all())

    def outline(self, first: int, second: int) -> Array:
        """What the set's shadow along the other component is bounded by (p, 2) N, in order."""
        return _around(self.vertices[:, [first, second]])

    def section(self, first: int, second: int) -> Array:
        """The forces with no other component (p, 2) N, in order; none: (0, 2)."""
        if len(self.names) == 2:
            return self.outline(first, second)
        cut = self.halfspaces[:, [first, second, -1]]
        inside = _inside(cut)
        if inside is None:
            return np.zeros((0, 2))
        return _around(HalfspaceIntersection(cut, inside).intersections)


def force_set(demand: Demand, tension: Array, at: Torques, bounds: Bounds) -> ForceSet:
    """The forces of a demand, of torques as they are linearised at tensions (nt,) N.

    Raises InputError where they fill no volume (or area, of a planar finger), or where there are
    too many tendons."""
    if len(tension) > MOST_TENDONS:
        raise InputError(f"feasible set: {len(tension)} tendons, of at most {MOST_TENDONS}")
    A = demand.rows @ at.by_tension
    offset = demand.rows @ (at.torque - at.by_tension @ tension + demand.beside)
    box = np.stack([bounds.least, bounds.most])
    pick = np.array(list(product((0, 1), repeat=len(tension))), dtype=int)
    corners = np.unique(box[pick, np.arange(len(tension))], axis=0)
    torques = corners @ A.T + offset
    scale = np.ptp(torques, axis=0).max(initial=0.0) or 1.0
    try:
        hull = ConvexHull(torques / scale)
        planes = np.column_stack(
            [hull.equations[:, :-1] @ demand.spread, scale * hull.equations[:, -1]]
        )
        size = np.linalg.norm(planes[:, :-1], axis=1)
        planes = planes[size > 0] / size[size > 0, None]
        inside = _inside(planes)
        if inside is None:
            raise _empty()
        vertices = HalfspaceIntersection(planes, inside).intersections
        whole = ConvexHull(vertices)
    except QhullError as error:
        raise _empty() from error
    return ForceSet(demand.names, vertices[whole.vertices], whole.equations)


def _inside(halfspaces: Array) -> Array | None:
    """The point farthest from the planes a x + b <= 0; None where there is no inside."""
    normals = halfspaces[:, :-1]
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    free = [(None, None)] * normals.shape[1]
    found = linprog(
        np.append(np.zeros(normals.shape[1]), -1.0),
        A_ub=np.hstack([normals, size]),
        b_ub=-halfspaces[:, -1],
        bounds=[*free, (0.0, 1e6)],
        method="highs",
    )
    if not found.success or found.x[-1] < THIN:
        return None
    return np.array(found.x[:-1])


def _around(points: Array) -> Array:
    hull = ConvexHull(points)
    corners: Array = points[hull.vertices]
    return corners


def _empty() -> InputError:
    return InputError(
        "feasible set: the tensions' bounds leave no set of fingertip forces with an inside in "
        "this posture. A hood in lumped form has no arms in abduction: leave that component open "
        '("-1 N free -2 N"), or clamp the fingertip'
    )
