"""Fit parameters of cases to measured numbers, and say what these do not determine.

The parameters' coordinates (`FitParameter`: logarithms, or fractions of a range) are found by
bounded least squares (scipy's trust-region reflective method) over the rows of all cases.
Gradients are central differences, case by case: with held bones of the hood's shape as its tangent
moves it (`cosim.analyses.trials.by_tangent`), else of whole solves.

A target's miss is the distance from its band, zero inside; without a band the difference to its
reference; in units of its SD or, where nobody gave one, of 1 unit of the quantity (1 % of strain).
Rows inside their bands do not pull: they only bound the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from cosim.analyses.identify.cases import FitCase, StatedCase, assign_rows
from cosim.analyses.identify.information import Information, check_identifiable, information
from cosim.analyses.identify.parameters import FitParameter, Free, raise_faults
from cosim.analyses.identify.profile import Profile, profile
from cosim.analyses.trials.by_tangent import tangent_serves
from cosim.analyses.trials.workers import CaseWorkers, Summary, Trial
from cosim.case.file import Settings, load_case
from cosim.errors import ConvergenceError, InputError, Progress, quiet
from cosim.port import Array
from cosim.processes import process_pool
from cosim.results.compare import Comparison, Target, compare_with_targets
from cosim.results.quantities import check_quantities

STEP, SMALL_STEP = 0.01, 1e-4
"""Steps of the differences, in coordinates: of differences of solves, and of what the tangent
predicts, which no tolerance of a solve blurs."""
SEARCH_TOLERANCE = 1e-4
"""Relative, of cost and step, at which the search ends."""
NORMAL = 1.959964
"""Standard deviations of a 95 % interval of a normal distribution."""
NEAR_BOUND, SAME = 0.1, 0.01
"""A parameter so near to a bound, as a fraction of its range of coordinates, is put there where the
squared misses grow by less than a fraction: the targets do not tell the two apart."""
OTHER_STATE = 0.1
"""SDs that a row of the search may differ by from that of a solve from scratch."""
SHOWN = 3
"""Largest misses in a line of progress."""
NOTHING = 1e-9
"""The part of the largest singular value below which the targets do not see a direction."""


@dataclass(frozen=True)
class Confidence:
    """What rows say of the coordinates of n parameters, linearised."""

    singular_values: Array
    """(n,) of the misses by the coordinates, descending."""
    directions: Array
    """(n, n), a row for each singular value."""
    deviation: Array
    """(n,), infinite where nothing was seen."""
    correlation: Array
    """(n, n), NaN where a deviation is infinite."""
    inflation: float
    """The factor on the deviations where the rows miss by more than their SDs: the square root of
    the misses' squares per degree of freedom, or 1."""


@dataclass(frozen=True)
class FitPart:
    """How well rows are met: root mean squares of their misses, SDs."""

    name: str
    count: int
    start: float
    """With the parameters as they were at the start."""
    end: float
    """With those found."""
    zero: float
    """The same of the null model, which says 0 of every number."""


@dataclass(frozen=True)
class Fit:
    """What was found.  Rows are those of all cases, each with its case's name."""

    parameters: tuple[FitParameter, ...]
    values: dict[str, float]
    settings: Settings
    """What the values set in the first case."""
    start: tuple[Comparison, ...]
    rows: tuple[Comparison, ...]
    """The targets beside the model before and after."""
    held_out_start: tuple[Comparison, ...]
    held_out: tuple[Comparison, ...]
    """Rows that did not pull, before and after."""
    misses: Array
    """(m,) of the targets, after."""
    slopes: Array
    """(m, n) of every target's number by the coordinates, in units of its SD, band or no band."""
    evaluations: int
    """Points of the search at which every case was solved."""
    solves: int
    failures: tuple[str, ...]
    """The solves that failed on the way, with their reason."""
    notes: tuple[str, ...]
    """What to know of the solves from scratch that the rows are of."""
    stop_reason: str
    """Why the search ended."""
    by_tangent: tuple[str, ...]
    """Cases whose gradients are by the hood's tangent, not by differences of solves."""
    before: Information
    """What the rows can say of the parameters, at the start."""
    profiles: tuple[Profile, ...] = ()
    """The profile likelihood of each parameter, where it was asked for."""

    @property
    def parts(self) -> tuple[FitPart, ...]:
        """How well the rows fitted to and those held out are met."""
        pairs = {
            "fitted to": (self.start, self.rows),
            "held out": (self.held_out_start, self.held_out),
        }
        return tuple(
            FitPart(name, len(after), rms(before), rms(after), rms(after, model=0.0))
            for name, (before, after) in pairs.items()
            if after
        )

    @property
    def within(self) -> tuple[FitParameter, ...]:
        """The parameters that do not end at a bound."""
        return tuple(p for p in self.parameters if self.values[p.name] not in (p.low, p.high))

    @property
    def confidence(self) -> Confidence:
        """The confidence in the parameters `within`, by the rows that pull, the others held at
        their bounds."""
        pulling = np.array([pulls(row.target, row.model or 0.0) for row in self.rows])
        columns = [i for i, p in enumerate(self.parameters) if p in self.within]
        return confidence(self.slopes[pulling][:, columns], self.misses[pulling])


def miss(target: Target, model: float) -> float:
    """Zero where the target is met; see the module."""
    scale = target.sd or 1.0
    if target.low is None and target.high is None:
        return (model - (target.reference or 0.0)) / scale
    low = -np.inf if target.low is None else target.low
    high = np.inf if target.high is None else target.high
    return float(model - np.clip(model, low, high)) / scale


def rms(rows: Sequence[Comparison], model: float | None = None) -> float:
    """The root mean square of rows' misses, or of those that one number has in place of all the
    model's."""
    numbers = [row.model or 0.0 if model is None else model for row in rows]
    misses = [miss(row.target, x) for row, x in zip(rows, numbers, strict=True)]
    return float(np.sqrt(np.mean(np.square(misses))))


def pulls(target: Target, model: float) -> bool:
    """Whether the model's number matters: always, but inside of a band."""
    return (target.low is None and target.high is None) or miss(target, model) != 0


def confidence(slopes: Array, misses: Array) -> Confidence:
    """The confidence that slopes (k, n) and misses (k,) of the rows that pull give."""
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
    determined = np.flatnonzero(~lost)
    outer = np.outer(deviation[determined], deviation[determined])
    correlation[np.ix_(determined, determined)] = covariance[np.ix_(determined, determined)] / outer
    return Confidence(s, directions, deviation, correlation, inflation)


def interval(fit: Fit, name: str) -> tuple[float, float]:
    """The 95 % interval of a parameter `within`, cut off at its bounds."""
    p, ends = _interval(fit, name)
    low, high = (p.value(end) for end in ends)
    return low, high


def _interval(fit: Fit, name: str) -> tuple[FitParameter, tuple[float, float]]:
    """The parameter, and its interval in coordinates."""
    i = [p.name for p in fit.within].index(name)
    p, width = fit.within[i], NORMAL * fit.confidence.deviation[i]
    at, low, high = (p.coordinate(v) for v in (fit.values[name], p.low, p.high))
    return p, (max(at - width, low), min(at + width, high))


def identifiability(fit: Fit, name: str) -> str:
    """Whether the targets determine the parameter, in words."""
    if name not in [p.name for p in fit.within]:
        return "at its bound"
    p, (low, high) = _interval(fit, name)
    reached = [low <= p.coordinate(p.low) + 1e-9, high >= p.coordinate(p.high) - 1e-9]
    return ("identified", "one side only", "not identified")[sum(reached)]


def fit(
    source: Path,
    settings: Settings,
    free: Free,
    targets: Sequence[Target],
    workers: int = 1,
    most: int = 30,
    progress: Progress = quiet,
    **more: bool,
) -> Fit:
    """`fit_all` of one case, the one at `source` with settings; targets for others are left out."""
    stated = (StatedCase(source.stem, source, settings),)
    return fit_all(assign_rows(stated, (free,), targets), workers, most, progress, **more)


def fit_all(
    cases: Sequence[FitCase],
    workers: int = 1,
    most: int = 30,
    progress: Progress = quiet,
    *,
    allow_unidentified: bool = False,
    profiles: bool = False,
) -> Fit:
    """The parameters, the same in all cases, with which they miss their targets least, in at most
    so many evaluations of all cases; gradients, the `profiles` of the likelihood and the last
    solves, from scratch, come on top.

    Raises InputError where a target is not in its run and, unless that is allowed, where the rows
    cannot tell a parameter at the start (`information`), ConvergenceError where a case does not
    converge at the start or nowhere beside a point of the search."""
    serves = [tangent_serves(load_case(c.stated.source, c.stated.settings)) for c in cases]
    pool_cases = [(c.name, c.stated.source, on) for c, on in zip(cases, serves, strict=True)]
    rows = [row for case in cases for row in (*case.rows, *case.held_out)]
    arms = any("moment_arm" in row.quantity for row in rows)
    with process_pool(workers) as pool:
        search = _Search(cases, serves, CaseWorkers(pool_cases, pool, arms), most, progress)
        found = search.run(allow_unidentified)
        return replace(found, profiles=search.profiles(found)) if profiles else found


@dataclass(frozen=True)
class _Point:
    """All cases solved at a point of the search; `failures` where one has no result."""

    x: Array
    rows: tuple[Comparison, ...] = ()
    held_out: tuple[Comparison, ...] = ()
    failures: tuple[str, ...] = ()
    misses: Array = field(init=False)
    """(m,)"""

    def __post_init__(self) -> None:
        misses = np.array([miss(row.target, row.model or 0.0) for row in self.rows])
        object.__setattr__(self, "misses", misses)

    @property
    def squares(self) -> float:
        return float(self.misses @ self.misses)


class _Search:
    """The solves of one fit; keeps the last point, which residuals and slopes share."""

    def __init__(
        self,
        cases: Sequence[FitCase],
        serves: Sequence[bool],
        workers: CaseWorkers,
        most: int,
        progress: Progress,
    ) -> None:
        self.cases, self.serves, self.workers = cases, serves, workers
        self.most, self.progress = most, progress
        self.parameters = cases[0].free.parameters
        bounds = [[p.coordinate(p.low), p.coordinate(p.high)] for p in self.parameters]
        self.low, self.high = np.array(bounds).T
        self.sizes = np.array([self.steps_of(i) for i in range(len(cases))])
        self.evaluations = self.solves = 0
        self.failures: list[str] = []
        self.last = _Point(np.full(len(bounds), np.nan))
        self.best: _Point | None = None
        self.last_slopes: tuple[Array, Array] | None = None

    def run(self, allow_unidentified: bool) -> Fit:
        x = np.array([p.coordinate(p.start) for p in self.parameters])
        counts = len(self.cases), len(self.parameters), sum(len(c.rows) for c in self.cases)
        self.progress("{} cases, {} parameters, {} rows: the start, from scratch".format(*counts))
        start = self.at(x)
        if start.failures:
            raise ConvergenceError("at the start: " + "; ".join(start.failures))
        inside = 1e-6 * (self.high - self.low)
        begin = np.clip(x, self.low + inside, self.high - inside)
        before = self.information(begin)
        if not allow_unidentified:
            check_identifiable(before)
        solution = least_squares(
            self.residuals,
            begin,
            self.slopes_that_pull,
            bounds=(self.low, self.high),
            ftol=SEARCH_TOLERANCE,
            xtol=SEARCH_TOLERANCE,
            max_nfev=max(1, self.most - int((begin != x).any())),
        )
        each = zip(self.parameters, solution.x, strict=True)
        x = self.snap_to_bounds(np.array([p.round_coordinate(z) for p, z in each]))
        end, notes = self.afresh(x)
        values = self.values(x)
        names = tuple(c.name for c, serves in zip(self.cases, self.serves, strict=True) if serves)
        return Fit(
            self.parameters,
            values,
            self.cases[0].free.settings(values),
            start.rows,
            end.rows,
            start.held_out,
            end.held_out,
            end.misses,
            self.slopes(end),
            self.evaluations,
            self.solves,
            tuple(self.failures),
            notes,
            self.ending(solution.status, str(solution.message)),
            names,
            before,
        )

    def information(self, x: Array) -> Information:
        """What the rows can say of the parameters near x; nothing is lost where no case has an
        answer, which the search says."""
        names = [p.name for p in self.parameters]
        failed = bool(self.at(x).failures)
        slopes = np.eye(len(names)) if failed else self.slopes_at(x)
        return information(names, slopes, self.high - self.low)

    def profiles(self, fit: Fit) -> tuple[Profile, ...]:
        """The profile of every parameter around what was found."""
        best = np.array([p.coordinate(fit.values[p.name]) for p in self.parameters])
        widths = dict.fromkeys(fit.values, np.inf)
        inflation = fit.confidence.inflation
        for p, deviation in zip(fit.within, fit.confidence.deviation, strict=True):
            widths[p.name] = NORMAL * deviation
        out = []
        for i, p in enumerate(self.parameters):
            self.progress(f"the profile of {p.name}")
            search = (self.residuals, self.slopes_that_pull, best, (self.low, self.high))
            out.append(profile(p.name, i, *search, widths[p.name], inflation))
        return tuple(out)

    def ending(self, status: int, message: str) -> str:
        if status == 0:
            return f"stopped at {self.most} evaluations, the most that were allowed"
        return message.replace("`", "").rstrip(".")

    def snap_to_bounds(self, x: Array) -> Array:
        """x at the bounds that fit the targets as well, as far as evaluations are left."""
        for i, reach in enumerate(NEAR_BOUND * (self.high - self.low)):
            for bound in (self.low[i], self.high[i]):
                if 0 < abs(x[i] - bound) <= reach and self.evaluations < self.most:
                    at_bound = np.where(np.arange(len(x)) == i, bound, x)
                    most = (1 + SAME) * np.sum(self.residuals(x) ** 2)
                    x = at_bound if np.sum(self.residuals(at_bound) ** 2) <= most else x
        return x

    def values(self, x: Array) -> dict[str, float]:
        """Values by name, with the digits that are written."""
        return {p.name: p.value(z) for p, z in zip(self.parameters, x, strict=True)}

    def trial(self, case: FitCase, x: Array) -> Settings:
        return case.stated.settings + case.free.settings(self.values(x))

    def at(self, x: Array) -> _Point:
        """All cases solved at x."""
        if not np.array_equal(self.last.x, x):
            self.evaluations += 1
            self.solves += len(self.cases)
            trials = {i: self.trial(case, x) for i, case in enumerate(self.cases)}
            self.last = self.point(x, self.workers.solve(trials))
            self.failures += self.last.failures
            better = self.best is None or self.last.squares < self.best.squares
            if better and not self.last.failures:
                self.best = self.last
            self.progress(self.line(self.last))
        return self.last

    def point(self, x: Array, outcomes: Mapping[int, Trial]) -> _Point:
        """The point of the search that outcomes make.  Raises InputError for what a case does not
        take, and for numbers that no run has."""
        failures, faults = [], []
        fitted: list[Comparison] = []
        held_out: list[Comparison] = []
        for i, case in enumerate(self.cases):
            outcome = outcomes[i]
            if outcome.status == "refused":
                faults.append(outcome.reason)
            elif outcome.status == "failed":
                failures.append(f"{case.name}: {_values_text(self.values(x))}: {outcome.reason}")
            else:
                summary = outcome.result()
                pair = [
                    compare_with_targets(t, summary, case.name) for t in (case.rows, case.held_out)
                ]
                faults += [
                    _absent(row, summary) for rows in pair for row in rows if row.model is None
                ]
                fitted += pair[0]
                held_out += pair[1]
        raise_faults(faults)
        if failures:
            return _Point(x, failures=tuple(failures))
        return _Point(x, tuple(fitted), tuple(held_out))

    def line(self, point: _Point) -> str:
        count = f"{self.evaluations} of at most {self.most}"
        if point.failures:
            return f"{count}: did not converge: {'; '.join(point.failures)}"
        order = np.argsort(-np.abs(point.misses), kind="stable")[:SHOWN]
        largest = ", ".join(f"{self.label(point.rows[i])} {point.misses[i]:+.3g}" for i in order)
        return (
            f"{count}: sum of squared misses {point.squares:.4g}; "
            f"{_values_text(self.values(point.x))}; "
            f"largest, SDs: {largest}"
        )

    def label(self, row: Comparison) -> str:
        return row.target.name + (f" [{row.target.case}]" if len(self.cases) > 1 else "")

    def afresh(self, x: Array) -> tuple[_Point, tuple[str, ...]]:
        """All cases solved from scratch, as a run of each does it, and what to know of that.  A
        hood may have an equilibrium that the search followed and a run does not come to."""
        trials = {i: self.trial(case, x) for i, case in enumerate(self.cases)}
        self.solves += len(trials)
        outcomes = self.workers.solve(trials, afresh=True)
        failed = [i for i, o in outcomes.items() if o.status == "failed"]
        notes = [
            f"{self.cases[i].name} does not converge from scratch with what was found; its rows "
            f"are those that the search came to: {outcomes[i].reason}"
            for i in failed
            if self.serves[i]
        ]
        if failed:
            outcomes |= self.workers.solve({i: trials[i] for i in failed})
        end = self.point(x, outcomes)
        if end.failures:
            raise ConvergenceError("at the end: " + "; ".join(end.failures))
        return end, (*notes, *self.other_states(end))

    def other_states(self, end: _Point) -> list[str]:
        """Rows that the search, where it came to the same parameters, has other numbers of."""
        if self.best is None or np.abs(end.x - self.best.x).max() > STEP / 10:
            return []
        return [
            f"{self.label(row)}: {row.model:.4g} from scratch, {searched.model:.4g} in the search: "
            "the case has more than one equilibrium there"
            for row, searched in zip(end.rows, self.best.rows, strict=True)
            if abs(_scale([row])[0] - _scale([searched])[0]) > OTHER_STATE
        ]

    def residuals(self, x: Array) -> Array:
        """The misses (m,); infinite where a solve did not converge, which makes the search step
        shorter."""
        point = self.at(x)
        if point.failures:
            return np.full(sum(len(case.rows) for case in self.cases), np.inf)
        return point.misses

    def slopes_that_pull(self, x: Array) -> Array:
        point = self.at(x)
        pulling = np.array([pulls(row.target, row.model or 0.0) for row in point.rows])
        return self.slopes_at(x) * pulling[:, None]

    def slopes_at(self, x: Array) -> Array:
        """The slopes (m, n) at a point of the search, kept for the next who asks."""
        if self.last_slopes is None or not np.array_equal(self.last_slopes[0], x):
            self.last_slopes = (np.array(x), self.slopes(self.at(x)))
        return self.last_slopes[1]

    def slopes(self, point: _Point) -> Array:
        """The slopes (m, n) of the numbers by the coordinates, in units of their SDs."""
        x, sides = point.x, (-1, 1)
        ends = [
            [
                np.clip(x + sign * size * unit, self.low, self.high)
                for size, unit in zip(sizes, np.eye(len(x)), strict=True)
                for sign in sides
            ]
            for sizes in self.sizes
        ]
        each = list(zip(self.cases, ends, strict=True))
        self.solves += sum(
            len(stencil) for stencil, serves in zip(ends, self.serves, strict=True) if not serves
        )
        outcomes = self.workers.solve_nearby(
            [self.trial(case, x) for case in self.cases],
            [[self.trial(case, end) for end in stencil] for case, stencil in each],
        )
        blocks, first = [], 0
        for (case, stencil), case_outcomes in zip(each, outcomes, strict=True):
            rows = point.rows[first : first + len(case.rows)]
            first += len(rows)
            blocks.append(self.slopes_of(case, (x, rows), stencil, case_outcomes))
        slopes = np.concatenate(blocks)
        lost = np.flatnonzero(np.isnan(slopes).all(axis=0))
        if len(lost):
            name = self.parameters[lost[0]].name
            raise ConvergenceError(f"no gradient with respect to {name}: {self.failures[-1]}")
        return np.nan_to_num(slopes)

    def slopes_of(
        self,
        case: FitCase,
        at: tuple[Array, Sequence[Comparison]],
        ends: Sequence[Array],
        outcomes: Sequence[Trial],
    ) -> Array:
        """The slopes (m, n) of one case; NaN by a parameter to neither side of which it
        converged."""
        compared: list[tuple[Array, Sequence[Comparison]]] = []
        for end, outcome in zip(ends, outcomes, strict=True):
            if outcome.status == "refused":
                raise InputError(outcome.reason)
            if outcome.status == "failed":
                self.failures.append(
                    f"{case.name}: {_values_text(self.values(end))}: {outcome.reason}"
                )
                compared.append((end, ()))
            else:
                compared.append((end, compare_with_targets(case.rows, outcome.result(), case.name)))
        columns = []
        for i in range(len(self.parameters)):
            pair = [side for side in compared[2 * i : 2 * i + 2] if side[1]]
            (x0, before), (x1, after) = (*pair, at, at)[:2]
            if x0[i] == x1[i]:
                columns.append(np.full(len(case.rows), np.nan))
                continue
            columns.append((_scale(after) - _scale(before)) / (x1[i] - x0[i]))
        return np.stack(columns, axis=1)

    def steps_of(self, i: int) -> list[float]:
        """The steps of the differences by each parameter in case i, in coordinates."""
        if not self.serves[i]:
            return [STEP] * len(self.parameters)
        return [STEP if self.lays_mesh(self.cases[i], p) else SMALL_STEP for p in self.parameters]

    def lays_mesh(self, case: FitCase, p: FitParameter) -> bool:
        """Whether the mesh is laid elsewhere with another value of the parameter."""
        start = {p.name: p.start for p in self.parameters}
        changed = {**start, p.name: p.low if p.start != p.low else p.high}
        keys = {
            load_case(
                case.stated.source, case.stated.settings + case.free.settings(values)
            ).mesh_key()
            for values in (start, changed)
        }
        return len(keys) > 1


def _absent(row: Comparison, summary: Summary) -> str:
    """Why a run has no number there: with the nearest name where that is misspelt."""
    target = row.target
    try:
        check_quantities([target], [(target.case, summary)])
    except InputError as error:
        return str(error)
    return f"{target.name}: the run of {target.case} has no number at {target.quantity}"


def _scale(rows: Sequence[Comparison]) -> Array:
    return np.array([(row.model or 0.0) / (row.target.sd or 1.0) for row in rows])


def _values_text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
