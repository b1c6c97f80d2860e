"""Equilibria along a growing load."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import solve
from tests.proofs.fe.sheets import BENCHMARK, NO_TENSION, at_rest

SEEN = 2e-4
"""Relative change by a halved mesh below which no order is measured: other errors are as large."""
WHOLE = replace(BENCHMARK, max_iterations=400, max_step=2.0, max_turn=1.5)

MOST_HALVINGS = 3


@dataclass(frozen=True)
class Loading:
    """A model and its load."""

    model: ShellModel
    load: Array
    """(n, 3) N, the full one."""
    watched: Array
    """(k, n, 3), weights of k displacements that are looked at."""

    def watched_displacements(self, c: Configuration) -> Array:
        """The weighted means (k,) m of the nodes' displacements in a configuration."""
        return np.einsum("kni,ni->k", self.watched, c.x - self.model.reference)


def follow(loading: Loading, parts: Iterable[float]) -> Array:
    """The watched displacements (len(parts), k) under growing parts of the load.  Raises
    ConvergenceError."""
    c, out, reached = at_rest(loading.model), [], 0.0
    for part in parts:
        c = _reach(loading, c, reached, part, MOST_HALVINGS)
        out.append(loading.watched_displacements(c))
        reached = part
    return np.array(out)


def _reach(
    loading: Loading, c: Configuration, reached: float, part: float, halvings: int
) -> Configuration:
    """Equilibrium under a part of the load, from that under the part `reached`; by halves where the
    whole step fails."""
    model = replace(loading.model, dead=part * loading.load)
    try:
        return solve(model, c, NO_TENSION, WHOLE).configuration
    except ConvergenceError:
        if halvings == 0:
            raise
    half = (reached + part) / 2
    c = _reach(loading, c, reached, half, halvings - 1)
    return _reach(loading, c, half, part, halvings - 1)


def watching(node: int, direction: Array, n: int) -> Array:
    """The weights (n, 3) of one node's displacement along `direction`."""
    out = np.zeros((n, 3))
    out[node] = direction
    return out


def halving_order(coarse: float, medium: float, fine: float) -> float | None:
    """Order of convergence from results on three meshes, each half as coarse as the one before:
    log2 of the ratio of the two changes; None where the last is too small to tell."""
    first, last = abs(medium - coarse), abs(fine - medium)
    return float(np.log2(first / last)) if last > SEEN * abs(fine) else None


def error_order(coarse: float, fine: float) -> float:
    """Order from the errors on two meshes, one half as coarse as the other."""
    return float(np.log2(abs(coarse / fine)))


def limit(coarse: float, fine: float) -> float:
    """What results on two meshes, one half as coarse as the other, tend to by order two
    (Richardson)."""
    return float(fine + (fine - coarse) / 3)


def drive_node(
    model: ShellModel, node: int, way: Array, values: Iterable[float]
) -> tuple[Array, Configuration]:
    """The force (len(values),) N along `way` (3,), a unit vector, that moves a held node along it
    by growing values (m), and the last configuration: a path beyond a limit load.  Raises
    ConvergenceError."""
    g, c = model.guides, at_rest(model)
    on = (g.node == node)[:, None]
    forces = []
    for value in values:
        moved = model.with_changes(guides=replace(g, origin=g.origin + on * value * way))
        c = moved.move_bodies(c, c.position, c.rotation)
        solution = solve(moved, c, NO_TENSION, WHOLE)
        c = solution.configuration
        forces.append(solution.evaluation.gradient_x[node] @ way)
    return np.array(forces), c


def largest(values: Array) -> float:
    """The largest of values at even steps, on the parabola through it and its neighbours.  Raises
    ConvergenceError where it is the first or the last."""
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        raise ConvergenceError("the load has no maximum within the path that was followed")
    previous, top, following = values[k - 1 : k + 2]
    return float(top + (following - previous) ** 2 / (8 * (2 * top - previous - following)))
