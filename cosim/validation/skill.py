"""Skill of a model over null models that know nothing of the finger, on compared rows.

skill = 1 - SSE(model) / SSE(null), with SSE = sum_i w_i e_i^2 and e_i the difference of row i:
from its reference, or where it has none from the nearer end of its band.  1 is a perfect answer, 0
one as far off as the null model, less than 0 one that is worse (Murphy 1988, Mon Weather Rev
116:2417).  w_i is one over the mean square of the references of all rows in the same unit, so that
neither units nor how many numbers are large decide.  Rows that chose a parameter, and requirements,
do not count.

A model's number costs at most 4 w_i s_i^2, with s_i the larger of its reference and the root mean
square of its unit: what the opposite answer costs.  A number that is not found costs this most, and
a null model by factors has none in its place, so that no number can be left out to raise a skill.

Where hands were measured one by one, two models are compared hand by hand too, by paired
differences of squared error: gain = sum_i w_i (n_i^2 - e_i^2) / rows, with n_i the null model's
difference.  It is linear in what was measured, so that the mean of some hands' gains is the gain
beside their mean; of all hands and over the answer 0 it is the skill beside the mean.  How many
hands the model is nearer to is counted, and judges nothing: three agree by chance one time in four.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import factorial, prod
from typing import Any, NamedTuple

import numpy as np

from cosim.port import Array, Ints
from cosim.results.compare import Comparison, Target, difference, number

FACTORS = {"no answer": 0.0, "halved": 0.5, "doubled": 2.0, "reversed": -1.0}
"""Null models by what the model's numbers are multiplied by."""
NOTHING = "no answer"
RESAMPLES, SEED, LEVEL = 2000, 1, 0.95
MOST_COST = 4.0
"""A number's cost over what the answer 0 costs, or over the mean square of its unit, at most."""
PERFECT_ENDS = (0.05, 0.95)
"""Between which quantiles the skill of a perfect model is told."""
Hands = Mapping[Target, Sequence[float]]
"""What was measured in each hand, of the targets of which it is known."""
ONE_TRIAL = "one trial, no interval"


@dataclass(frozen=True)
class Skill:
    """Skill over a null model, with the ends of its bootstrap interval (None with one trial), which
    is over the trials and, of rows that were measured hand by hand, over the hands."""

    null: str
    value: float
    low: float | None
    high: float | None
    rows: int
    trials: int
    hands: int = 0
    """Hands that were drawn, the most of a row."""

    @property
    def fault(self) -> str:
        """Why the model does not beat the null model; empty where it does."""
        if self.value <= 0:
            return "skill <= 0"
        if self.low is None:
            return ONE_TRIAL
        return "" if self.low > 0 else "interval reaches 0"

    def __str__(self) -> str:
        ends = f" [{number(self.low, 2)}, {number(self.high, 2)}]" if self.low is not None else ""
        return f"{number(self.value, 2)}{ends}"


def judging_rows(rows: Sequence[Comparison]) -> list[Comparison]:
    """The rows that judge: neither fitted nor required, and each distinct number once.

    Two rows are one number where the same model's number stands beside the same reference."""
    distinct: dict[Any, Comparison] = {}
    for i, row in enumerate(rows):
        t = row.target
        if t.fitted or t.kind == "requirement":
            continue
        same = (t.quantity, t.unit, t.reference, t.sd, t.low, t.high, t.source, row.model)
        distinct.setdefault(i if row.model is None else same, row)
    return list(distinct.values())


def scale_rows(rows: Sequence[Comparison], factor: float) -> list[Comparison]:
    """The rows with the model's numbers times `factor`."""
    return [replace(r, model=None if r.model is None else factor * r.model) for r in rows]


def skill(
    rows: Sequence[Comparison],
    null: str,
    answers: Mapping[Target, float | None] | None = None,
    hands: Hands | None = None,
) -> Skill | None:
    """Skill of the counted rows over a null model: one of FACTORS, or the `answers` of another
    model by target; minus infinity where the null model alone misses nothing.  None where neither
    misses, or no row counts.

    The interval (95 %) is a bootstrap over the trials and the `hands`, 2000 resamples of a fixed
    seed."""
    judged = judging_rows(rows)
    if answers is not None:
        judged = [row for row in judged if row.target in answers]
    if not judged:
        return None
    targets, models = [row.target for row in judged], [row.model for row in judged]
    others = (
        _null_answers(null, models) if answers is None else [answers[t] or 0.0 for t in targets]
    )
    most = MOST_COST * _scales(targets) ** 2
    most_of_other = np.full(len(targets), np.inf) if answers is None else most
    trials = sorted({t.case for t in targets})

    def errors(shifts: Array) -> Array:
        """Squared errors (2, draws, trials) beside references moved by `shifts` (draws, rows)."""
        mine = _squares(_gaps(targets, models), shifts, most, most)
        theirs = _squares(_gaps(targets, others), shifts, most_of_other, 0.0)
        place = np.array([[t.case == trial for trial in trials] for t in targets], dtype=float)
        return np.stack([mine, theirs]) * _weights(targets) @ place

    counts = len(judged), len(trials)
    total, worst = errors(np.zeros((1, len(judged)))).sum(axis=2)[:, 0]
    if worst <= 0:
        return Skill(null, -np.inf, None, None, *counts) if total > 0 else None
    random = np.random.default_rng(SEED)
    drawn = random.integers(0, len(trials), (RESAMPLES, len(trials)))
    each = [list((hands or {}).get(t, ())) for t in targets]
    low, high = _interval(errors(_hand_shifts(each, random)), drawn)
    value = float(1 - total / worst)
    return Skill(null, value, low, high, *counts, hands=max(map(len, each)))


def _null_answers(null: str, models: Sequence[float | None]) -> list[float | None]:
    """What one of FACTORS makes of the numbers; of one that is not found, nothing but no answer."""
    missing = 0.0 if null == NOTHING else None
    return [missing if m is None else FACTORS[null] * m for m in models]


def _gaps(targets: Sequence[Target], models: Sequence[float | None]) -> Array:
    """The differences (rows,), nan of numbers that are not found."""
    gaps = (difference(t, m) for t, m in zip(targets, models, strict=True))
    return np.array([np.nan if gap is None else gap for gap in gaps])


def _squares(gaps: Array, shifts: Array, most: Array, missing: Array | float) -> Array:
    """Squared differences (draws, rows), at most `most`, where the references are moved by `shifts`
    (draws, rows); `missing` of numbers that are not found."""
    squares = np.minimum((gaps - shifts) ** 2, most)
    return np.where(np.isnan(gaps), missing, squares)


def _scales(targets: Sequence[Target]) -> Array:
    """The larger (rows,) of what each row is compared with and the root mean square of its unit."""
    sizes = np.array([_size(t) for t in targets])
    return np.maximum(sizes, _weights(targets) ** -0.5)


def _hand_shifts(each: Sequence[Sequence[float]], random: np.random.Generator) -> Array:
    """How far the mean of as many hands, drawn with replacement, lies from that of all (RESAMPLES,
    rows); rows with the same number of hands have the same ones drawn, rows without stay."""
    shifts = np.zeros((RESAMPLES, len(each)))
    for n in sorted({len(hands) for hands in each} - {0, 1}):
        rows = [i for i, hands in enumerate(each) if len(hands) == n]
        measured = np.array([each[i] for i in rows]).T
        drawn = random.integers(0, n, (RESAMPLES, n))
        shifts[:, rows] = measured[drawn].mean(axis=1) - measured.mean(axis=0)
    return shifts


def _weights(targets: Sequence[Target]) -> Array:
    """Weights (n,), one over the mean square of what the rows of the same unit are compared
    with."""
    sizes: dict[str, list[float]] = {}
    for t in targets:
        sizes.setdefault(t.unit, []).append(_size(t) ** 2)
    mean = {unit: float(np.mean(squares)) or 1.0 for unit, squares in sizes.items()}
    return np.array([1 / mean[t.unit] for t in targets])


def _size(target: Target) -> float:
    if target.reference is not None:
        return abs(target.reference)
    return max(abs(end) for end in (target.low, target.high) if end is not None)


def _interval(errors: Array, drawn: Ints) -> tuple[float | None, float | None]:
    """Ends of the interval; errors: (2, draws, trials), squared, of the model and of the null
    model; drawn: trials (draws, trials)."""
    if drawn.shape[1] < 2:
        return None, None
    model, null = np.take_along_axis(errors, drawn[None], axis=2).sum(axis=2)
    skills = 1 - model[null > 0] / null[null > 0]
    low, high = np.quantile(skills, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def against_factors(rows: Sequence[Comparison], hands: Hands | None = None) -> list[Skill]:
    """Skill over each of FACTORS that misses something."""
    return [s for null in FACTORS if (s := skill(rows, null, hands=hands)) is not None]


class Resample(NamedTuple):
    """As many hands as there are, drawn with replacement; `ways`: orders in which they come."""

    hands: tuple[str, ...]
    ways: int
    gain: float


@dataclass(frozen=True)
class HandGains:
    """Gain over a null model beside each hand, and the skill beside it."""

    null: str
    gains: Mapping[str, float]
    skills: Mapping[str, float]
    """One less the ratio of squared errors beside that hand."""
    perfect: float
    """The skill that the true mean would expect beside the mean of these hands."""
    spread: tuple[float, float]
    """Between which ends nine of ten such skills lie, with hands that differ as these do."""

    @property
    def resamples(self) -> list[Resample]:
        """All distinct ones: ten of three hands, in 27 ways."""
        n = len(self.gains)
        resamples = []
        for hands in combinations_with_replacement(self.gains, n):
            ways = factorial(n) // prod(factorial(hands.count(hand)) for hand in self.gains)
            resamples.append(Resample(hands, ways, sum(self.gains[hand] for hand in hands) / n))
        return resamples

    @property
    def without(self) -> dict[str, float]:
        """The gain beside the mean of all hands but one, by that one."""
        total, n = sum(self.gains.values()), len(self.gains)
        return {hand: (total - gain) / (n - 1) for hand, gain in self.gains.items()}

    @property
    def nearer(self) -> int:
        """How many hands the model is nearer to than the null model."""
        return sum(gain > 0 for gain in self.gains.values())

    @property
    def count(self) -> str:
        """The same in words, of all hands."""
        return f"{self.nearer} of {len(self.gains)}"

    def __str__(self) -> str:
        def listed(gains: Mapping[str, float]) -> str:
            return ", ".join(f"{hand} {number(gain, 2)}" for hand, gain in gains.items())

        each = sorted(self.resamples, key=lambda r: r.gain)
        drawn = ", ".join(f"{number(r.gain, 2)} ({r.ways})" for r in each)
        low, high = (number(end, 2) for end in self.spread)
        return (
            f"over {self.null}: nearer in {self.count} hands; skill {listed(self.skills)}; gain "
            f"{listed(self.gains)}; without {listed(self.without)}; resamples (ways) {drawn}; a "
            f"perfect model would expect a skill of {number(self.perfect, 2)} ({low} to {high})"
        )


class Noise(NamedTuple):
    """RMS over the rows of one unit, in it: of a hand less the mean of the others, and of the
    standard error of the mean of all."""

    single: float
    mean: float


@dataclass(frozen=True)
class HandData:
    """The rows that were measured in every hand.

    `rows`: those of the first hand; `measured`: (hands, rows), in their units; `weights`: (rows,),
    as in the skill beside the hands' mean."""

    names: tuple[str, ...]
    rows: tuple[Comparison, ...]
    measured: Array
    weights: Array

    @property
    def noise(self) -> dict[str, Noise]:
        """By unit."""
        n = len(self.names)
        off = n / (n - 1) * (self.measured - self.measured.mean(axis=0))
        errors = self.measured.var(axis=0, ddof=1) / n
        units = np.array([row.target.unit for row in self.rows])
        return {
            unit: Noise(
                float(np.sqrt(np.mean(off[:, units == unit] ** 2))),
                float(np.sqrt(np.mean(errors[units == unit]))),
            )
            for unit in dict.fromkeys(units.tolist())
        }

    def gains(
        self, null: str, answers: Mapping[Target, float | None] | None = None
    ) -> HandGains | None:
        """As `skill` takes null models and numbers that are not found; None where the null model
        misses nothing beside the mean."""
        at = [i for i, r in enumerate(self.rows) if answers is None or r.target in answers]
        models = [self.rows[i].model for i in at]
        targets = [self.rows[i].target for i in at]
        others = (
            _null_answers(null, models) if answers is None else [answers[t] or 0.0 for t in targets]
        )
        measured, weights = self.measured[:, at], self.weights[at]
        mean = measured.mean(axis=0)
        most, no_most = MOST_COST * np.maximum(mean**2, 1 / weights), np.full(len(at), np.inf)

        def errors(values: Sequence[float | None], beside: Array, missing: Array | float) -> Array:
            gaps = np.array([np.nan if v is None else v for v in values]) - mean
            return _squares(gaps, beside - mean, no_most, missing) @ weights

        worst = float(errors(others, mean[None], 0.0)[0])
        if worst <= 0:
            return None
        mine, theirs = errors(models, measured, most), errors(others, measured, 0.0)
        drawn = mean + _noise_of_mean(measured)
        perfect = 1 - ((drawn - mean) ** 2 @ weights) / errors(others, drawn, 0.0)
        variance = weights @ measured.var(axis=0, ddof=1) / len(self.names)
        low, high = np.quantile(perfect, PERFECT_ENDS)
        return HandGains(
            null,
            dict(zip(self.names, ((theirs - mine) / len(at)).tolist(), strict=True)),
            dict(zip(self.names, (1 - mine / theirs).tolist(), strict=True)),
            float(1 - variance / worst),
            (float(low), float(high)),
        )


def _noise_of_mean(measured: Array) -> Array:
    """How far (RESAMPLES, rows) the mean of so many hands lies from the true one by a normal law
    with the covariance of the hands (n, rows)."""
    n = len(measured)
    random = np.random.default_rng(SEED).normal(size=(RESAMPLES, n))
    random -= random.mean(axis=1, keepdims=True)
    return np.asarray(random @ (measured - measured.mean(axis=0)) / np.sqrt(n * (n - 1)))


def hand_data(hands: Mapping[str, Sequence[Comparison]]) -> HandData | None:
    """The judging rows with a reference that all hands have, by trial and quantity; None of fewer
    than two hands or without such a row."""
    tables = [
        {(r.target.case, r.target.quantity): r for r in judging_rows(rows)}
        for rows in hands.values()
    ]
    if len(tables) < 2:
        return None
    shared = [key for key in tables[0] if all(_is_measured(t.get(key)) for t in tables)]
    if not shared:
        return None
    measured = np.array([[t[key].target.reference for key in shared] for t in tables])
    rows = tuple(tables[0][key] for key in shared)
    means = [
        replace(row.target, reference=float(mean))
        for row, mean in zip(rows, measured.mean(axis=0), strict=True)
    ]
    return HandData(tuple(hands), rows, measured, _weights(means))


def _is_measured(row: Comparison | None) -> bool:
    return row is not None and row.target.reference is not None


def hands_headline(every: Sequence[HandGains]) -> str:
    """How many hands the model is nearer to than each null model, in one line."""
    return ", ".join(f"{gains.null} {gains.count}" for gains in every)


def headline(skills: Sequence[Skill], judged: int) -> str:
    """Whether a group beats its null models, in one line."""
    if not judged:
        return "Not counted: every row chose a parameter, or there is none."
    if not skills:
        return "Says nothing: no null model misses a row."
    lost = [f"{s.null} (skill {s}: {s.fault})" for s in skills if s.fault not in ("", ONE_TRIAL)]
    if lost:
        return "DOES NOT BEAT " + "; ".join(lost)
    undecided = any(s.fault for s in skills)
    word = f"Undecided ({ONE_TRIAL}): " if undecided else "Beats its null models: "
    return word + "; ".join(f"{s.null} {s}" for s in skills)
