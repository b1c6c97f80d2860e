"""Quasi-linear viscoelasticity: what an elastic law bears as it relaxes, step by step.

With S_e(t) what a law bears at once, its increments since the start relax by G (Fung 1993,
Biomechanics, 2nd ed., section 7.6); what is borne at the start, at rest, stays:

    S(t) = S_e(0) + int_0^t G(t - s) dS_e(s),    G(t) = g + sum_i w_i exp(-t / tau_i),  G(0) = 1

and g = 1 - sum w_i is left in the end.  Over a step in which S_e changes evenly the sum is exact
(Taylor, Pister and Goudreau 1970, Int J Numer Methods Eng 2:45):

    S = a S_e + S_h,    a = g + sum_i w_i phi(dt / tau_i),    phi(x) = (1 - exp(-x)) / x

with S_h of the steps before, so that the law of a step is the elastic one times a, and a stress
that is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.port import Array

TERMS = 16
"""How many a spectrum has: Gauss-Legendre over the logarithm of times, 1e-5 over four decades."""


class Memory(NamedTuple):
    """What n numbers of a law bear and have borne."""

    rest: Array
    """(n,) at the start, at rest; it does not relax."""
    elastic: Array
    """(n,) what the law bears at once at what it is deformed to."""
    branches: Array
    """(k, n) of that, since the start, what each term still bears."""

    def swing_to(self, top: Memory, period: float) -> Swing:
        """Cycles of `period` s between what is borne here, at the foot, and at the top of one."""
        return Swing(top.elastic - self.elastic, period)


class Swing(NamedTuple):
    """Many cycles about what slowly changes: evenly up by `size` and evenly down again."""

    size: Array
    """(n,) of what is borne at once."""
    period: float
    """s."""


@dataclass(frozen=True)
class Prony:
    """A reduced relaxation function of k exponentials.  Raises InputError for weights that are
    negative or more than one together, and times that are not positive.

    >>> import numpy as np
    >>> from fe_solver.materials.prony import Prony
    >>> tissue = Prony(np.array([0.3]), np.array([10.0]))
    >>> float(tissue.modulus(10.0).round(4)), tissue.left
    (0.8104, 0.7)
    """

    weights: Array
    """(k,) of what is borne at once."""
    times: Array
    """(k,) s."""

    def __post_init__(self) -> None:
        w, times = self.weights, self.times
        if np.shape(w) != np.shape(times) or np.ndim(w) != 1:
            raise InputError(f"relaxation: {np.size(w)} weights and {np.size(times)} times")
        if not ((w >= 0).all() and w.sum() <= 1 and (times > 0).all()):
            raise InputError(
                "relaxation: expected weights of 0 and more, together at most 1, and times above "
                f"0 s, got {w.tolist()} and {times.tolist()}"
            )

    @staticmethod
    def fung(spectrum: float, shortest: float, longest: float) -> Prony:
        """Fung's spectrum, `spectrum` over tau between two times (s):

        G(t) = (1 + C (E1(t / longest) - E1(t / shortest))) / (1 + C ln(longest / shortest))
        """
        span = np.log(longest / shortest)
        at, share = np.polynomial.legendre.leggauss(TERMS)
        times = shortest * np.exp(span * (at + 1) / 2)
        return Prony(spectrum * span / 2 * share / (1 + spectrum * span), times)

    @property
    def left(self) -> float:
        """What is left in the end of what is borne at once."""
        return float(1 - self.weights.sum())

    def modulus(self, time: Array | float) -> Array:
        """G, what is left after `time` s (0 and more) of what is borne at once."""
        time = np.asarray(time, dtype=float)
        return np.asarray(self.left + np.exp(-time[..., None] / self.times) @ self.weights)

    def start(self, borne: Array) -> Memory:
        """The memory at rest of what bears (n,)."""
        return Memory(borne, borne, np.zeros((len(self.times), len(borne))))

    def law(self, memory: Memory, dt: float, swing: Swing | None = None) -> tuple[float, Array]:
        """What makes the law of the `dt` s after `memory` of the elastic one: its factor, and what
        is held (n,) besides.  Infinitely long after, the law of what is left in the end.  With a
        `swing` that of the ends of whole cycles, `dt` s after."""
        decay, even = self._decay(dt)
        factor = self.left + float(self.weights @ even)
        held = (1 - self.left) * memory.rest + decay @ memory.branches
        held = held - float(self.weights @ even) * memory.elastic
        return factor, held + self._swung(dt, swing).sum(axis=0)

    def after(self, memory: Memory, borne: Array, dt: float, swing: Swing | None = None) -> Memory:
        """The memory `dt` s after one, where the law then bears (n,)."""
        (factor, held), (decay, even) = self.law(memory, dt, swing), self._decay(dt)
        elastic = (borne - held) / factor
        more = (self.weights * even)[:, None] * (elastic - memory.elastic)
        more += self._swung(dt, swing)
        return Memory(memory.rest, elastic, decay[:, None] * memory.branches + more)

    def _swung(self, dt: float, swing: Swing | None) -> Array:
        """What cycles over `dt` s leave in the terms (k, n): a geometric series."""
        if swing is None:
            return np.zeros((len(self.times), 1))
        decay, even = self._decay(swing.period / 2)
        series = (1 - np.exp(-dt / self.times)) / (1 + decay)
        return -(self.weights * even * series)[:, None] * swing.size

    def _decay(self, dt: float) -> tuple[Array, Array]:
        """What is left (k,) of a step's beginning, and of an even change over it."""
        x = dt / self.times
        even = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
        return np.exp(-x), even
