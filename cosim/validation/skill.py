"""Skill of a model over null models that know nothing of the finger, on compared rows.

skill = 1 - SSE(model) / SSE(null), with SSE = sum_i w_i e_i^2 and e_i the difference of row i:
from its reference, or where it has none from the nearer end of its band.  1 is a perfect answer, 0
one as far off as the null model, less than 0 one that is worse (Murphy 1988, Mon Weather Rev
116:2417).  w_i is one over the mean square of the references of all rows in the same unit, so that
neither units nor how many numbers are large decide.  A row without a value counts as the answer 0.
Rows that chose a parameter, and requirements, do not count.

Where hands were measured one by one, two models are compared hand by hand too, by paired
differences of squared error: gain = sum_i w_i (n_i^2 - e_i^2) / rows, with n_i the null model's
difference.  It is linear in what was measured, so that the mean of some hands' gains is the gain
beside their mean; of all hands and over the answer 0 it is the skill beside the mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import factorial, prod
from typing import Any, NamedTuple

import numpy as np

from cosim.port import Array
from cosim.results.compare import Comparison, Target, difference, number

FACTORS = {"no answer": 0.0, "halved": 0.5, "doubled": 2.0, "reversed": -1.0}
"""Null models by what the model's numbers are multiplied by."""
RESAMPLES, SEED, LEVEL = 2000, 1, 0.95
ONE_TRIAL = "one trial, no interval"


@dataclass(frozen=True)
class Skill:
    """Skill over a null model, with the ends of its bootstrap interval (None with one trial)."""

    null: str
    value: float
    low: float | None
    high: float | None
    rows: int
    trials: int

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
    found: dict[Any, Comparison] = {}
    for i, row in enumerate(rows):
        t = row.target
        if t.fitted or t.kind == "requirement":
            continue
        same = (t.quantity, t.unit, t.reference, t.sd, t.low, t.high, t.source, row.model)
        found.setdefault(i if row.model is None else same, row)
    return list(found.values())


def scale_rows(rows: Sequence[Comparison], factor: float) -> list[Comparison]:
    """The rows with the model's numbers times `factor`."""
    return [replace(r, model=None if r.model is None else factor * r.model) for r in rows]


def skill(
    rows: Sequence[Comparison], null: str, answers: Mapping[Target, float | None] | None = None
) -> Skill | None:
    """Skill of the counted rows over a null model: one of FACTORS, or the `answers` of another
    model by target; minus infinity where the null model alone misses nothing.  None where neither
    misses, or no row counts.

    The interval (95 %) is a bootstrap over the trials, 2000 resamples of a fixed seed."""
    judged = judging_rows(rows)
    if answers is not None:
        judged = [row for row in judged if row.target in answers]
    if not judged:
        return None
    own = [row.model or 0.0 for row in judged]
    others = (
        [FACTORS[null] * m for m in own]
        if answers is None
        else [answers[row.target] or 0.0 for row in judged]
    )
    targets = [row.target for row in judged]
    weights = _weights(targets)
    trials = sorted({t.case for t in targets})
    place = [trials.index(t.case) for t in targets]
    errors = np.zeros((2, len(trials)))
    for side, models in enumerate((own, others)):
        gaps = np.array([difference(t, m) for t, m in zip(targets, models, strict=True)])
        np.add.at(errors[side], place, weights * gaps**2)
    total, worst = errors.sum(axis=1)
    if worst <= 0:
        lost = Skill(null, -np.inf, None, None, len(judged), len(trials))
        return lost if total > 0 else None
    low, high = _interval(errors)
    return Skill(null, float(1 - total / worst), low, high, len(judged), len(trials))


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


def _interval(errors: Array) -> tuple[float | None, float | None]:
    """Ends of the interval; errors: (2, trials), squared, of the model and of the null model."""
    n = errors.shape[1]
    if n < 2:
        return None, None
    drawn = np.random.default_rng(SEED).integers(0, n, (RESAMPLES, n))
    model, null = errors[:, drawn].sum(axis=2)
    found = 1 - model[null > 0] / null[null > 0]
    low, high = np.quantile(found, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def against_factors(rows: Sequence[Comparison]) -> list[Skill]:
    """Skill over each of FACTORS that misses something."""
    return [s for null in FACTORS if (s := skill(rows, null)) is not None]


class Resample(NamedTuple):
    """As many hands as there are, drawn with replacement; `ways`: orders in which they come."""

    hands: tuple[str, ...]
    ways: int
    gain: float


@dataclass(frozen=True)
class HandGains:
    """Gain over a null model beside each hand; `perfect`: the skill over that null model that the
    true mean would expect beside the mean of these hands."""

    null: str
    gains: Mapping[str, float]
    perfect: float

    @property
    def resamples(self) -> list[Resample]:
        """All distinct ones: ten of three hands, in 27 ways."""
        n = len(self.gains)
        found = []
        for hands in combinations_with_replacement(self.gains, n):
            ways = factorial(n) // prod(factorial(hands.count(hand)) for hand in self.gains)
            found.append(Resample(hands, ways, sum(self.gains[hand] for hand in hands) / n))
        return found

    @property
    def without(self) -> dict[str, float]:
        """The gain beside the mean of all hands but one, by that one."""
        total, n = sum(self.gains.values()), len(self.gains)
        return {hand: (total - gain) / (n - 1) for hand, gain in self.gains.items()}

    @property
    def verdict(self) -> str:
        """Whether the model is nearer than the null model; not decided where resamples disagree."""
        signs = {int(np.sign(r.gain)) for r in self.resamples}
        words = {1: "better", -1: "worse", 0: "equal"}
        return words[signs.pop()] if len(signs) == 1 else "not decided"

    def __str__(self) -> str:
        def listed(gains: Mapping[str, float]) -> str:
            return ", ".join(f"{hand} {number(gain, 2)}" for hand, gain in gains.items())

        each = sorted(self.resamples, key=lambda r: r.gain)
        drawn = ", ".join(f"{number(r.gain, 2)} ({r.ways})" for r in each)
        return (
            f"over {self.null}: {self.verdict}; gain {listed(self.gains)}; without "
            f"{listed(self.without)}; resamples (ways) {drawn}; a perfect model would expect a "
            f"skill of {number(self.perfect, 2)}"
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
        """As `skill` takes null models; None where it misses nothing beside the mean."""
        at = [i for i, r in enumerate(self.rows) if answers is None or r.target in answers]
        rows = [self.rows[i] for i in at]
        own = np.array([row.model or 0.0 for row in rows])
        other = (
            FACTORS[null] * own
            if answers is None
            else np.array([answers[row.target] or 0.0 for row in rows])
        )
        measured, weights = self.measured[:, at], self.weights[at]
        worst = weights @ (other - measured.mean(axis=0)) ** 2
        if worst <= 0:
            return None
        gains = ((other - measured) ** 2 - (own - measured) ** 2) @ weights / len(rows)
        error = weights @ measured.var(axis=0, ddof=1) / len(self.names)
        named = dict(zip(self.names, gains.tolist(), strict=True))
        return HandGains(null, named, float(1 - error / worst))


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


def hands_headline(found: Sequence[HandGains]) -> str:
    """Which null models the model is better and worse than hand by hand, in one line."""
    words: dict[str, list[str]] = {}
    for gains in found:
        words.setdefault(gains.verdict, []).append(gains.null)
    order = [word for word in ("worse", "not decided", "equal", "better") if word in words]
    return "; ".join(f"{word}: {', '.join(words[word])}" for word in order)


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
