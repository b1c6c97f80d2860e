"""Fitting stated parameters of a case to measured numbers, and what those could not tell.

The logarithms of the parameters are found by bounded least squares (scipy's trust-region reflective
method).  Gradients are central differences: where the bones are held of the hood's shape as its
tangent moves it (`cosim.nearby`), else of whole solves.

A target's miss is the distance from its band, zero inside; without a band the difference to its
reference; in units of its SD or, where nobody gave one, of 1 unit of the quantity (1 % of strain).
Rows inside their bands do not pull, and tell nothing of the parameters but an inequality.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from cosim.case import load_case
from cosim.compare import Comparison, Target, compared
from cosim.nearby import tangent_serves
from cosim.parameters import Free, Parameter
from cosim.port import Array, ConvergenceError, InputError
from cosim.trials import Settings, Solve, solver

STEP, SMALL_STEP = 0.01, 1e-4
"""Of the logarithms, of the differences: of solves, and of what the tangent foretells, which no
tolerance of a solve blurs."""
DIGITS = 4
"""Significant ones of the parameters found; their solve is the one that is reported."""
TOLERANCE = 1e-4
"""Relative, of cost and step, at which the search ends."""
NORMAL = 1.959964
"""Standard deviations of a 95 % interval of a normal distribution."""
NEAR_BOUND, SAME = 0.1, 0.01
"""A parameter so near to a bound, as a fraction of its range of logarithms, is put there where the
squared misses grow by less than a fraction: the targets do not tell the two apart."""
NOTHING = 1e-9
"""Of the largest singular value: a direction that the targets do not see."""


@dataclass(frozen=True)
class Confidence:
    """What rows say of the logarithms of n parameters, linearised."""

    singular_values: Array
    """(n,) of the misses by the logarithms, descending."""
    directions: Array
    """(n, n), a row for each singular value."""
    deviation: Array
    """(n,), infinite where nothing was seen."""
    correlation: Array
    """(n, n), NaN where a deviation is infinite."""
    inflation: float
    """Of the deviations, because the rows miss by more than their SDs: the square root of the
    misses' squares per degree of freedom, or 1."""


@dataclass(frozen=True)
class Fit:
    """What was found."""

    parameters: tuple[Parameter, ...]
    values: dict[str, float]
    settings: Settings
    start: tuple[Comparison, ...]
    rows: tuple[Comparison, ...]
    """The targets beside the model before and after."""
    misses: Array
    """(m,) after."""
    slopes: Array
    """(m, n) of every row's number by the logarithms, in units of its SD, band or no band."""
    solves: int
    failures: tuple[str, ...]
    """Of solves on the way, with their reason."""
    ended: str
    """Why the search ended."""
    by_tangent: bool
    """Whether the gradients are by the hood's tangent, not by differences of solves."""

    @property
    def within(self) -> tuple[Parameter, ...]:
        """Those that do not stand at a bound."""
        return tuple(p for p in self.parameters if self.values[p.name] not in (p.low, p.high))

    @property
    def confidence(self) -> Confidence:
        """Of the parameters `within`, by the rows that pull, the others held at their bounds."""
        told = np.array([pulls(row.target, row.model or 0.0) for row in self.rows])
        columns = [i for i, p in enumerate(self.parameters) if p in self.within]
        return confidence(self.slopes[told][:, columns], self.misses[told])


def miss(target: Target, model: float) -> float:
    """Zero where the target is met; see the module."""
    scale = target.sd or 1.0
    if target.low is None and target.high is None:
        return (model - (target.reference or 0.0)) / scale
    low = -np.inf if target.low is None else target.low
    high = np.inf if target.high is None else target.high
    return float(model - np.clip(model, low, high)) / scale


def pulls(target: Target, model: float) -> bool:
    """Whether the model's number matters: always, but inside of a band."""
    return (target.low is None and target.high is None) or miss(target, model) != 0


def confidence(slopes: Array, misses: Array) -> Confidence:
    """From slopes (k, n) and misses (k,) of the rows that pull."""
    n = slopes.shape[1]
    _, s, directions = np.linalg.svd(np.vstack([slopes, np.zeros((n, n))]))
    seen = s > NOTHING * s.max(initial=NOTHING)
    freedom = len(misses) - int(seen.sum())
    inflation = max(1.0, float(np.sqrt(misses @ misses / freedom))) if freedom > 0 else 1.0
    parts = directions[seen] / s[seen, None]
    covariance = inflation**2 * parts.T @ parts
    deviation = np.sqrt(np.diag(covariance))
    lost = (np.abs(directions[~seen]) > 1e-6).any(axis=0)
    deviation[lost] = np.inf
    correlation = np.full((n, n), np.nan)
    told = np.flatnonzero(~lost)
    outer = np.outer(deviation[told], deviation[told])
    correlation[np.ix_(told, told)] = covariance[np.ix_(told, told)] / outer
    return Confidence(s, directions, deviation, correlation, inflation)


def interval(fit: Fit, name: str) -> tuple[float, float]:
    """The 95 % interval of a parameter `within`, cut off at its bounds."""
    i = [p.name for p in fit.within].index(name)
    p, width = fit.within[i], NORMAL * fit.confidence.deviation[i]
    at = log(fit.values[name])
    low, high = max(at - width, log(p.low)), min(at + width, log(p.high))
    return exp(low), exp(high)


def standing(fit: Fit, name: str) -> str:
    """In words whether the targets tell the parameter."""
    p = next(p for p in fit.parameters if p.name == name)
    if p not in fit.within:
        return "at its bound"
    low, high = interval(fit, name)
    reached = [low <= p.low * (1 + 1e-9), high >= p.high * (1 - 1e-9)]
    return ("identified", "one side only", "not identified")[sum(reached)]


def fit(
    source: Path,
    settings: Settings,
    free: Free,
    targets: Sequence[Target],
    jobs: int = 1,
    most: int = 30,
    progress: Callable[[str], None] = lambda text: None,
) -> Fit:
    """The parameters with which the case at `source` misses the targets least, in at most so many
    steps.  Raises InputError where a target is not in the run, ConvergenceError where the case does
    not converge at the start or beside a point of the search."""
    chosen = tuple(t for t in targets if t.case in ("", source.stem))
    if not chosen:
        raise InputError(f"no target is for the case {source.stem}")
    with solver(source, jobs) as solve:
        tangent = tangent_serves(load_case(source, settings))
        search = _Search(source.stem, settings, free, chosen, solve, progress, tangent)
        return search.run(most)


class _Search:
    """The solves of one fit; keeps the last point's, which residuals and slopes share."""

    def __init__(
        self,
        case: str,
        settings: Settings,
        free: Free,
        targets: tuple[Target, ...],
        solve: Solve,
        progress: Callable[[str], None],
        tangent: bool,
    ) -> None:
        self.case, self.settings, self.free, self.targets = case, settings, free, targets
        self.solve, self.progress, self.tangent = solve, progress, tangent
        self.low, self.high = np.log([[p.low, p.high] for p in free.parameters]).T
        self.solves = 0
        self.failures: list[str] = []
        self.last: tuple[bytes, tuple[Comparison, ...]] = (b"", ())

    def run(self, most: int) -> Fit:
        x = np.log([p.start for p in self.free.parameters])
        start = self.rows([x])[0]
        if not start:
            raise ConvergenceError(f"at the start: {self.failures[-1]}")
        inside = 1e-6 * (self.high - self.low)
        found = least_squares(
            self.residuals,
            np.clip(x, self.low + inside, self.high - inside),
            self.slopes_that_pull,
            bounds=(self.low, self.high),
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            max_nfev=most,
        )
        x = self.snapped(np.log([float(f"{value:.{DIGITS}g}") for value in np.exp(found.x)]))
        values = self.values(x)
        rows = self.at(x)
        if not rows:
            raise ConvergenceError(f"at the end: {self.failures[-1]}")
        return Fit(
            self.free.parameters,
            values,
            self.free.settings(values),
            start,
            rows,
            np.array([miss(row.target, row.model or 0.0) for row in rows]),
            self.slopes(x),
            self.solves,
            tuple(self.failures),
            str(found.message).replace("`", "").rstrip("."),
            self.tangent,
        )

    def snapped(self, x: Array) -> Array:
        """At the bounds that the targets do not tell x from."""
        for i, reach in enumerate(NEAR_BOUND * (self.high - self.low)):
            for bound in (self.low[i], self.high[i]):
                if 0 < abs(x[i] - bound) <= reach:
                    there = np.where(np.arange(len(x)) == i, bound, x)
                    most = (1 + SAME) * np.sum(self.residuals(x) ** 2)
                    x = there if np.sum(self.residuals(there) ** 2) <= most else x
        return x

    def values(self, x: Array) -> dict[str, float]:
        """By name, in digits as they are written."""
        names = [p.name for p in self.free.parameters]
        return {n: float(f"{v:.12g}") for n, v in zip(names, np.exp(x), strict=True)}

    def trial(self, x: Array) -> Settings:
        return self.settings + self.free.settings(self.values(x))

    def rows(
        self, points: Sequence[Array], around: Array | None = None
    ) -> list[tuple[Comparison, ...]]:
        """The targets beside the model at each point, `around` one by its tangent; nothing where it
        did not converge."""
        near = self.trial(around) if around is not None and self.tangent else None
        self.solves += len(points) if near is None else 1
        outcomes = self.solve([self.trial(x) for x in points], near)
        found: list[tuple[Comparison, ...]] = []
        for x, outcome in zip(points, outcomes, strict=True):
            if outcome.status == "refused":
                raise InputError(outcome.reason)
            if outcome.status == "failed":
                self.failures.append(f"{_told(self.values(x))}: {outcome.reason}")
                found.append(())
                continue
            found.append(_compared(self.targets, outcome.summary, self.case))
        return found

    def at(self, x: Array) -> tuple[Comparison, ...]:
        if self.last[0] != x.tobytes():
            rows = self.rows([x])[0]
            self.last = (x.tobytes(), rows)
            squares = sum(miss(row.target, row.model or 0.0) ** 2 for row in rows)
            told = f"sum of squared misses {squares:.4g}" if rows else "did not converge"
            self.progress(f"{_told(self.values(x))}: {told}")
        return self.last[1]

    def residuals(self, x: Array) -> Array:
        """(m,); infinite where the solve did not converge, which makes the search step shorter."""
        rows = self.at(x)
        if not rows:
            return np.full(len(self.targets), np.inf)
        return np.array([miss(row.target, row.model or 0.0) for row in rows])

    def slopes_that_pull(self, x: Array) -> Array:
        told = np.array([pulls(row.target, row.model or 0.0) for row in self.at(x)])
        return self.slopes(x) * told[:, None]

    def slopes(self, x: Array) -> Array:
        """(m, n) of the numbers by the logarithms, in units of their SDs."""
        n = len(x)
        size = SMALL_STEP if self.tangent else STEP
        steps = size * np.stack([s * np.eye(n)[i] for i in range(n) for s in (-1, 1)])
        ends = [np.clip(x + step, self.low, self.high) for step in steps]
        rows = self.rows(ends, x)
        columns = []
        for i in range(n):
            pair = [(ends[k], rows[k]) for k in (2 * i, 2 * i + 1) if rows[k]]
            if len(pair) < 2:
                pair.append((x, self.at(x)))
            (x0, before), (x1, after) = pair[:2]
            if not before or not after or x0[i] == x1[i]:
                name = self.free.parameters[i].name
                raise ConvergenceError(f"no gradient by {name}: {self.failures[-1]}")
            columns.append((_scaled(after) - _scaled(before)) / (x1[i] - x0[i]))
        return np.stack(columns, axis=1)


def _scaled(rows: Sequence[Comparison]) -> Array:
    return np.array([(row.model or 0.0) / (row.target.sd or 1.0) for row in rows])


def _compared(
    targets: Sequence[Target], summary: Mapping[str, Any], case: str
) -> tuple[Comparison, ...]:
    rows = compared(targets, summary, case)
    absent = [row.target.quantity for row in rows if row.model is None]
    if absent:
        raise InputError(f"the run of {case} has no number at {', '.join(absent)}")
    return rows


def _told(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
