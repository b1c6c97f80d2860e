"""How far the compared numbers change with the mesh: the same trials on coarser and finer ones.

Of three meshes whose edges go by RATIO, with a number f on each, the coarsest first, the observed
order is p = ln((f1 - f2) / (f2 - f3)) / ln RATIO and the limit f3 - (f2 - f3) / (RATIO^q - 1) with
q = min(p, FORMAL) (Richardson).  The number on the case's own mesh lies off the limit by an error
that times a factor of safety is the grid convergence index: 1.25 where the order is observed, else
three times the range of all meshes stands in its place (Roache 1998; Eca and Hoekstra 2014, J
Comput Phys 262:104).  Either is about a 95 % interval, half of it the standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.port import AXES
from cosim.results.compare import Comparison
from cosim.results.conventions import OPPOSITE
from cosim.validation.records import Record, six_digits
from cosim.validation.run import Board
from cosim.validation.trial import Trial
from cosim.validation.versions import Key, Version, key_of, values_of_boards

RATIO = 1.5
"""Of the quads' edges from one mesh to the next."""
FORMAL = 2.0
"""The order at which forces and strains of the elements converge where the answer is smooth."""
SLOWEST = 0.5
SAFETY, SAFETY_UNSEEN = 1.25, 3.0
SAME = 1e-4
"""Changes of less than this part of a number say nothing of an order."""
SHARE = 0.02
"""The part of a number by which it may be off; a force's components by that of the force, an angle
by that of a radian."""
POINTS = 0.1
"""How far a strain may be off, %."""
Verdict = Literal["beyond", "no value", "within"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


class Convergence(NamedTuple):
    """What three meshes say of a number: the observed order and the limit, or why there is none."""

    order: float | None
    limit: float | None
    why: str


class MeshSeries(Record):
    """A number on several meshes, the coarsest first, in its unit."""

    factors: tuple[float, ...]
    """Quads over those of the case."""
    values: tuple[float | None, ...]
    bound: float
    """How far the number on the case's own mesh may be off."""

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
        return observe_order([v for v in self.values[-3:] if v is not None], RATIO)

    @property
    def error(self) -> float | None:
        """About how far the number is off by its mesh: from the limit, else the range of all
        meshes; None with less than two numbers."""
        own, limit = self.own, self.convergence.limit
        if own is not None and limit is not None:
            return abs(own - limit)
        known = [v for v in self.values if v is not None]
        return max(known) - min(known) if len(known) > 1 and own is not None else None

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
    def verdict(self) -> Verdict:
        """Whether the number is off by more than it may."""
        if self.error is None or None in self.values:
            return "no value"
        return "within" if self.error <= self.bound else "beyond"


def observe_order(values: Sequence[float], ratio: float) -> Convergence:
    """The order of three numbers, the coarsest mesh's first, whose edges go by `ratio`.

    >>> f"{observe_order([1 + 0.09, 1 + 0.04, 1 + 0.0177778], 1.5).order:.3f}"
    '2.000'
    """
    coarse, middle, fine = values
    first, second = coarse - middle, middle - fine
    if max(abs(first), abs(second)) <= SAME * max(map(abs, values)):
        return Convergence(None, None, "hardly changes with the mesh")
    if first * second < 0:
        return Convergence(None, None, "goes up and down as the mesh gets finer")
    if abs(second) >= abs(first):
        return Convergence(None, None, "changes the more, the finer the mesh")
    order = np.inf if second == 0 else float(np.log(first / second) / np.log(ratio))
    if order < SLOWEST:
        return Convergence(None, None, f"changes too slowly: order {order:.2g}")
    limit = fine - second / (ratio ** min(order, FORMAL) - 1)
    return Convergence(order, float(limit), "")


def mesh_factors(count: int) -> tuple[float, ...]:
    """Quads over the case's own on so many meshes: its own and a finer one, then a coarser one
    before them, then still finer ones."""
    first = 0 if count < 3 else -1
    return tuple(RATIO ** (2.0 * i) for i in range(first, first + count))


def mesh_versions(factors: Sequence[float], settings: Sequence[str] = ()) -> dict[str, Version]:
    """The trials with `settings` on each mesh but their own, by its factor; a hood that is not
    generated keeps its mesh."""

    def on_mesh(factor: float) -> Version:
        def version(trial: Trial) -> Case:
            case = load_case(trial.case, (*trial.settings, *settings))
            quads = case.hood.generated_quads
            if quads is None:
                return case
            finer = f"hood.mesh.quads={round(factor * quads)}"
            return load_case(trial.case, (*trial.settings, *settings, finer))

        return version

    return {f"{factor:g}": on_mesh(factor) for factor in factors if factor != 1.0}


def mesh_series(
    boards: Sequence[Board], versions: Mapping[str, Sequence[Board]]
) -> dict[Key, MeshSeries]:
    """The series of every number; of one that the mesh does not touch it is a constant."""
    by_factor = {float(name): values_of_boards(b) for name, b in versions.items()}
    factors = tuple(sorted({1.0, *by_factor}))
    series: dict[Key, MeshSeries] = {}
    for board in boards:
        forces = _forces(board.rows)
        for row in board.rows:
            key = key_of(board.group, row)
            elsewhere = {f: values[key] for f, values in by_factor.items() if key in values}
            if row.model is None or len(elsewhere) < len(by_factor):
                continue
            values = {1.0: row.model, **elsewhere}
            on_each = tuple(values[f] for f in factors)
            series[key] = MeshSeries(factors=factors, values=on_each, bound=_bound(row, forces))
    return series


def _bound(row: Comparison, forces: Mapping[tuple[str, str], float]) -> float:
    t = row.target
    if t.unit == "%":
        return POINTS
    if t.unit == "deg":
        return float(np.degrees(SHARE))
    own = abs(row.model or 0.0)
    return SHARE * forces.get((t.case, t.quantity.rpartition(".")[0]), own)


def _forces(rows: Sequence[Comparison]) -> dict[tuple[str, str], float]:
    """Magnitudes by case and quantity, of forces whose components are compared."""
    parts: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        name, _, item = row.target.quantity.rpartition(".")
        if item in (*AXES, *OPPOSITE) and row.model is not None:
            parts.setdefault((row.target.case, name), {})[item] = row.model
    return {key: float(np.linalg.norm(list(vector.values()))) for key, vector in parts.items()}


def distinct(series: Mapping[Key, MeshSeries]) -> Iterator[tuple[Key, MeshSeries]]:
    """Each number that the mesh touches once, whatever the references beside it; those that are
    off by more than they may first."""
    once: dict[tuple[str, str, str, float | None], tuple[Key, MeshSeries]] = {}
    for key, s in series.items():
        if len(set(map(six_digits, s.values))) > 1:
            once.setdefault((key[0], key[1], key[3], s.own), (key, s))
    yield from sorted(once.values(), key=lambda item: VERDICTS.index(item[1].verdict))


def tally(series: Mapping[Key, MeshSeries]) -> dict[str, int]:
    """How many numbers of each verdict."""
    verdicts = [s.verdict for _, s in distinct(series)]
    return {v: verdicts.count(v) for v in VERDICTS}
