"""A number on several meshes: the observed order, the limit, and how far it is off by its mesh.

Of three meshes with edges h1 > h2 > h3 and a number f on each, the observed order p solves

    (f1 - f2) / (f2 - f3) = (h1^p - h2^p) / (h2^p - h3^p)

(Celik et al. 2008, J Fluids Eng 130:078001, for edges of any ratio).  The limit is f3 - (f2 - f3) /
((h2 / h3)^q - 1) with q = min(p, FORMAL) (Richardson).  The number on the case's own mesh lies off
the limit by an error that times a factor of safety is the grid convergence index: 1.25 where the
order is observed, else three times the range of all meshes stands in its place (Roache 1998; Eca
and Hoekstra 2014, J Comput Phys 262:104).  Either is about a 95 % interval, half of it the standard
uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict

from cosim.case.schema import Case
from cosim.port import AXES
from cosim.results.conventions import OPPOSITE

FORMAL = 2.0
"""The order at which forces and strains of the elements converge where the answer is smooth."""
SLOWEST, STEEPEST = 0.5, 20.0
"""Orders between which one is looked for; a steeper one is infinite."""
SAFETY, SAFETY_UNSEEN = 1.25, 3.0
NO_CHANGE = 1e-4
"""Changes of less than this part of a number say nothing of an order."""
SHARE = 0.01
"""The part of a number by which it may change over the meshes; a force's components by that of the
force, an angle by that of a radian."""
POINTS = 0.2
"""How far a strain may change over the meshes, %."""
Verdict = Literal["beyond", "no value", "converges", "within"]
"""Over the meshes a number stays within its bound, or else converges with an observed order, or
does neither."""
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


class Convergence(NamedTuple):
    """What three meshes say of a number: the observed order and the limit, or why there is none."""

    order: float | None
    limit: float | None
    why: str


class MeshSeries(BaseModel):
    """A number on several meshes, the coarsest first, in its unit."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    factors: tuple[float, ...]
    """Quads over those of the case."""
    values: tuple[float | None, ...]
    bound: float
    """How far apart the numbers may lie."""

    @property
    def own(self) -> float | None:
        """The number on the case's own mesh."""
        return self.values[self.factors.index(1.0)]

    @property
    def convergence(self) -> Convergence:
        """By the three finest meshes."""
        if None in self.values:
            lacking = [f for f, v in zip(self.factors, self.values, strict=True) if v is None]
            words = " and ".join(f"{factor:.2g} times the quads" for factor in lacking)
            return Convergence(None, None, f"no result with {words}")
        if len(self.values) < 3:
            return Convergence(None, None, "an order takes three meshes")
        edges = [factor**-0.5 for factor in self.factors[-3:]]
        return observe_order([v for v in self.values[-3:] if v is not None], edges)

    @property
    def range(self) -> float | None:
        """How far apart the numbers lie; None with less than two."""
        known = [v for v in self.values if v is not None]
        return max(known) - min(known) if len(known) > 1 else None

    @property
    def error(self) -> float | None:
        """About how far the number is off by its mesh: from the limit, else the range of all
        meshes; None with less than two numbers."""
        own, limit = self.own, self.convergence.limit
        if own is not None and limit is not None:
            return abs(own - limit)
        return None if own is None else self.range

    @property
    def index(self) -> float | None:
        """The grid convergence index, in the number's unit."""
        if self.error is None:
            return None
        return (SAFETY if self.convergence.limit is not None else SAFETY_UNSEEN) * self.error

    @property
    def uncertainty(self) -> float | None:
        """The standard uncertainty u_num."""
        return None if self.index is None else self.index / 2

    @property
    def order_text(self) -> str:
        """The observed order, or why there is none."""
        order, _, why = self.convergence
        return why if order is None else f"{order:.2g}"

    @property
    def verdict(self) -> Verdict:
        """Whether the number stays within its bound, or converges."""
        if self.range is None or None in self.values:
            return "no value"
        if self.range <= self.bound:
            return "within"
        return "beyond" if self.convergence.order is None else "converges"


def observe_order(values: Sequence[float], edges: Sequence[float]) -> Convergence:
    """The order of three numbers, the coarsest mesh's first, on meshes with such edges.

    >>> edges = [1, 1 / 2, 1 / 3]
    >>> f"{observe_order([7 + h**2 for h in edges], edges).order:.3f}"
    '2.000'
    """
    from scipy.optimize import brentq

    coarse, middle, fine = values
    first, second = coarse - middle, middle - fine
    if max(abs(first), abs(second)) <= NO_CHANGE * max(map(abs, values)):
        return Convergence(None, None, "hardly changes")
    if first * second < 0:
        return Convergence(None, None, "goes up and down")
    h2, h3 = edges[1] / edges[0], edges[2] / edges[0]

    def excess(p: float) -> float:  # falls from positive to negative where p is the order
        return (h2**p - h3**p) - second / first * (1 - h2**p)

    if excess(SLOWEST) < 0:
        faster = "changes the more, the finer"
        slower = f"too slowly: below {SLOWEST:g}"
        return Convergence(None, None, faster if abs(second) >= abs(first) else slower)
    order = np.inf if excess(STEEPEST) > 0 or second == 0 else brentq(excess, SLOWEST, STEEPEST)
    limit = fine - second / ((h2 / h3) ** min(order, FORMAL) - 1)
    return Convergence(float(order), float(limit), "")


def vector_sizes(values: Mapping[str, float]) -> dict[str, float]:
    """The sizes of the vectors of which components are among numbers, by the path above them.

    >>> vector_sizes({"force_N.distal": 3.0, "force_N.radial": 4.0, "ratio": 1.0})
    {'force_N': 5.0}
    """
    sizes: dict[str, float] = {}
    for path, value in values.items():
        vector, _, part = path.rpartition(".")
        if part in (*AXES, *OPPOSITE):
            sizes[vector] = float(np.hypot(sizes.get(vector, 0.0), value))
    return sizes


def bound(path: str, value: float, unit: str, sizes: Mapping[str, float]) -> float:
    """How far a number may change over the meshes, with the sizes of the vectors about it."""
    if unit == "%":
        return POINTS
    if unit == "deg":
        return float(np.degrees(SHARE))
    return SHARE * sizes.get(path.rpartition(".")[0], abs(value))


def mesh_family(count: int, own: int) -> tuple[int, ...]:
    """So many meshes by their fineness: the case's own and a finer one, then a coarser one before
    them where there is one, then still finer ones.

    >>> mesh_family(3, 2), mesh_family(3, 1), mesh_family(2, 2)
    ((1, 2, 3), (1, 2, 3), (2, 3))
    """
    first = own if count < 3 else max(own - 1, 1)
    return tuple(range(first, first + count))


def mesh_factors(count: int, own: int) -> tuple[float, ...]:
    """Quads over the case's own on the meshes of its family."""
    return tuple((fineness / own) ** 2 for fineness in mesh_family(count, own))


def on_mesh(case: Case, fineness: int) -> Case:
    """The case on the mesh of its family that is so fine; on its own as it stands."""
    if fineness == case.hood.mesh_fineness:
        return case
    return case.replace(case.hood.mesh_values(fineness))
