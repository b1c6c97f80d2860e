"""Skill of a model over null models that know nothing of the finger, on compared rows.

skill = 1 - SSE(model) / SSE(null), with SSE = sum_i w_i e_i^2 and e_i the difference of row i:
from its reference, or where it has none from the nearer end of its band.  1 is a perfect answer, 0
one as far off as the null model, less than 0 one that is worse (Murphy 1988, Mon Weather Rev
116:2417).  w_i is one over the mean square of the references of all rows in the same unit, so that
neither units nor how many numbers are large decide.  A row without a value counts as the answer 0.
Rows that chose a parameter, and requirements, do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
    """(n,), one over the mean square of what the rows of the same unit are compared with."""
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
