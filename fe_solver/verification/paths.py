"""Equilibria along a growing load."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import ConvergenceError

from ..model import Configuration, ShellModel
from ..newton import factorised, residual_norm, solve
from ..shell import Array
from .sheets import BENCHMARK, NO_TENSION, at_rest

CLOSE = 1e-6
"""Residual over the largest force at which the damped Newton takes over from the undamped one."""
SEEN = 2e-4
"""Relative change by a halved mesh below which no order is measured: other errors are as large."""
MOST = 60
LONGEST = np.array([2.0, 2.0, 2.0, 1.5, 1.5])
"""m and rad, of a node's undamped step."""


@dataclass(frozen=True)
class Loading:
    """A model, its full load (n, 3) N, and the direction (n, 3) of each of the k displacements that
    are looked at, as weights (k, n, 3)."""

    model: ShellModel
    load: Array
    watched: Array

    def seen(self, c: Configuration) -> Array:
        """(k,) m."""
        return np.einsum("kni,ni->k", self.watched, c.x - self.model.reference)


def followed(loading: Loading, parts: Iterable[float]) -> Array:
    """(len(parts), k) watched displacements under growing parts of the load.

    A thin sheet that turns far is nearly inextensible, and the energy's descent follows that curved
    valley in small steps; so each equilibrium is sought without damping first, and what was found
    is finished, and judged, by the one Newton, which begins anew where it was none.  Raises
    ConvergenceError."""
    c, out = at_rest(loading.model), []
    options = replace(BENCHMARK, max_iterations=400)
    for part in parts:
        model = replace(loading.model, dead=part * loading.load)
        start = undamped(model, c) or c
        c = solve(model, start, NO_TENSION, options, near=True).configuration
        out.append(loading.seen(c))
    return np.array(out)


def undamped(model: ShellModel, c: Configuration) -> Configuration | None:
    """The configuration near equilibrium that whole Newton steps from c lead to, if they do."""
    for _ in range(MOST):
        e = model.evaluate(c, NO_TENSION, tangent=True)
        assert e.data is not None
        residual, force = residual_norm(model, e)
        if residual <= CLOSE * force:
            return c
        if not np.isfinite(residual):
            return None
        step = np.zeros(model.pattern.size)
        try:
            step[model.free] = -factorised(model, e.data).solve(e.reduced[model.free])
        except ConvergenceError:
            return None
        longest = (np.abs(step.reshape(-1, 5)) / LONGEST).max()
        c = model.stepped(c, e.bases, step / max(1.0, longest))
    return None


def watching(node: int, direction: Array, n: int) -> Array:
    """(n, 3) weights of one node's displacement along `direction`."""
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
