"""Skill over null models: what it is for known answers, and what it does not depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.results.compare import Comparison, Target, verdict
from cosim.validation.skill import (
    FACTORS,
    against_factors,
    headline,
    judging_rows,
    scale_rows,
    skill,
)

RNG = np.random.default_rng(3)
MEASURED = RNG.normal(0, 2, 24)


def rows(models: np.ndarray, unit: str = "N") -> list[Comparison]:
    """Three components of eight trials."""
    out = []
    for i, (model, reference) in enumerate(zip(models, MEASURED, strict=True)):
        place = (f"row {i}", f"f_{unit}.{i % 3}", unit, float(reference))
        target = Target(*place, None, None, None, "a paper", "experiment", f"trial {i // 3}")
        found = None if np.isnan(model) else float(model)
        out.append(Comparison(target, found))
    return out


def in_unit(row: Comparison, factor: float, unit: str) -> Comparison:
    """The row with its numbers in another unit."""
    t = row.target
    target = replace(t, unit=unit, reference=None if t.reference is None else factor * t.reference)
    return Comparison(target, None if row.model is None else factor * row.model)


def test_a_perfect_answer_has_skill_one_and_no_answer_none_over_no_answer():
    for null in FACTORS:
        found = skill(rows(MEASURED), null)
        assert (found.value, found.low, found.high, found.fault) == (1.0, 1.0, 1.0, "")
    nothing = skill(rows(0 * MEASURED), "no answer")
    assert (nothing.value, nothing.low, nothing.high) == (0.0, 0.0, 0.0)
    assert nothing.fault == "skill <= 0"
    missing = skill(rows(np.nan * MEASURED), "no answer")
    assert missing.value == 0.0
    assert against_factors(rows(-MEASURED))[0].value == pytest.approx(-3)


def test_skill_is_one_less_the_ratio_of_squared_errors():
    models = MEASURED + RNG.normal(0, 1, 24)
    for null, factor in FACTORS.items():
        expected = 1 - np.sum((models - MEASURED) ** 2) / np.sum((factor * models - MEASURED) ** 2)
        assert skill(rows(models), null).value == pytest.approx(expected)
    split = {row.target: 0.3 for row in rows(models)}
    expected = 1 - np.sum((models - MEASURED) ** 2) / np.sum((0.3 - MEASURED) ** 2)
    assert skill(rows(models), "fixed split", split).value == pytest.approx(expected)


def test_skill_knows_neither_units_nor_order_and_its_interval_is_the_same_each_time():
    models = MEASURED + RNG.normal(0, 1, 24)
    mixed = [*rows(models), *rows(1.3 * models + 1, "deg")]
    known = skill(mixed, "no answer")
    assert skill(mixed, "no answer") == known
    assert known.low < known.value < known.high
    other = [in_unit(r, 1e3, "mN") if r.target.unit == "N" else r for r in mixed]
    for same in (other, mixed[::-1], [mixed[i] for i in RNG.permutation(len(mixed))]):
        found = skill(same, "no answer")
        numbers = (found.value, found.low, found.high)
        assert numbers == pytest.approx((known.value, known.low, known.high), rel=1e-12)


def test_a_row_with_a_band_alone_errs_by_what_lies_beyond_it():
    own = ("a", "x_percent", "%", None, None, None, -15.0, "a paper", "experiment")
    deep = Comparison(Target(*own, "one"), -12.0)
    assert skill([deep], "no answer").value == pytest.approx(1 - (3 / 15) ** 2)
    assert skill([deep], "no answer").fault == "one trial, no interval"
    assert skill([Comparison(deep.target, -20.0)], "doubled") is None  # neither misses
    assert skill([deep], "doubled").value == -np.inf
    assert verdict(deep.target, 0.0) == "outside"


def test_a_fitted_or_required_row_is_not_counted_and_a_number_once():
    first, second, *_ = rows(MEASURED)
    fitted = Comparison(replace(first.target, fitted=True), first.model)
    required = Comparison(replace(first.target, kind="requirement"), first.model)
    again = Comparison(
        replace(first.target, name="through another hood", case="other"), first.model
    )
    differs = Comparison(again.target, first.model + 1e-3)
    assert judging_rows([fitted, required]) == []
    assert skill([fitted, required], "no answer") is None
    assert judging_rows([first, second, again]) == [first, second]
    assert judging_rows([first, differs]) == [first, differs]
    none = [Comparison(r.target, None) for r in (first, again)]
    assert judging_rows(none) == none


def test_the_first_line_says_which_null_model_wins_and_why():
    models = 2.0 * MEASURED
    found = against_factors(rows(models))
    said = headline(found, 24)
    assert said.startswith(
        "DOES NOT BEAT no answer (skill 0 [0, 0]: skill <= 0); halved (skill -inf"
    )
    assert "doubled" not in said
    assert headline(against_factors(rows(MEASURED)), 24).startswith(
        "Beats its null models: no answer"
    )
    (one,) = (s for s in against_factors(rows(MEASURED)[:3]) if s.null == "no answer")
    assert headline([one], 3) == "Undecided (one trial, no interval): no answer 1"
    assert headline([], 0).startswith("Not counted")


def test_no_value_stays_none_when_scaled():
    models = MEASURED.copy()
    models[0] = np.nan
    halved = scale_rows(rows(models), 0.5)
    assert halved[0].model is None
    assert halved[1].model == 0.5 * models[1]
