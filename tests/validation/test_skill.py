"""Skill over null models: what it is for known answers, and what it does not depend on."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from cosim.results.compare import Comparison, Target, verdict
from cosim.validation.skill import (
    FACTORS,
    against_factors,
    hand_data,
    hands_headline,
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


def beside(models: np.ndarray, *off: float, unit: str = "N") -> dict[str, list[Comparison]]:
    """The rows beside hands that were measured to be so far off."""
    return {
        f"H{i}": [
            replace(r, target=replace(r.target, reference=r.target.reference + x))
            for r in rows(models, unit)
        ]
        for i, x in enumerate(off, 1)
    }


def test_a_perfect_model_gains_beside_each_hand_what_the_null_model_lacks():
    found = hand_data(beside(MEASURED, 0.0, 0.0, 0.0)).gains("no answer")
    assert list(found.gains.values()) == pytest.approx([1, 1, 1])
    assert (found.count, found.perfect) == ("3 of 3", pytest.approx(1))
    assert list(found.skills.values()) == pytest.approx([1, 1, 1])
    data = hand_data(beside(MEASURED, -0.3, 0.0, 0.3))
    assert data.noise["N"] == pytest.approx((np.sqrt(2 / 3) * 0.45, 0.3 / np.sqrt(3)))
    found = data.gains("no answer")
    size = np.mean(MEASURED**2)
    expected = [1 + 2 * x * MEASURED.mean() / size for x in (-0.3, 0.0, 0.3)]
    assert list(found.gains.values()) == pytest.approx(expected)
    assert found.perfect == pytest.approx(1 - 0.03 / size)
    assert found.spread[0] < found.perfect < found.spread[1] < 1


def test_a_model_that_is_the_null_model_gains_nothing():
    models = 0.7 * MEASURED
    hands = beside(models, -0.3, 0.1, 0.2)
    first = {row.target: row.model for row in hands["H1"]}
    found = hand_data(hands).gains("fixed split", first)
    assert set(found.gains.values()) == {0.0}
    assert found.count == "0 of 3"


def test_hands_are_counted_and_judge_nothing_and_ten_resamples_are_listed():
    data = hand_data(beside(1.0 + 0 * MEASURED, 2.0, 3.0, -4.0))
    found = data.gains("no answer")
    a, b, c = found.gains.values()
    assert min(a, b) > 0 > c
    assert found.count == "2 of 3"
    assert "nearer in 2 of 3 hands" in str(found)
    assert hands_headline([found]) == "no answer 2 of 3"
    assert len(found.resamples) == 10
    assert sum(r.ways for r in found.resamples) == 27
    every = {r.hands: (r.ways, r.gain) for r in found.resamples}
    assert every["H1", "H1", "H1"] == (1, pytest.approx(a))
    assert every["H1", "H1", "H3"] == (3, pytest.approx((2 * a + c) / 3))
    assert every["H1", "H2", "H3"] == (6, pytest.approx((a + b + c) / 3))
    assert list(found.without.values()) == pytest.approx([(b + c) / 2, (a + c) / 2, (a + b) / 2])


def test_a_gain_is_the_skill_beside_the_mean_of_hands_and_knows_no_units():
    models = MEASURED + RNG.normal(0, 1, 24)
    newtons, millimetres = (beside(models, -0.5, 0.2, 0.9, unit=unit) for unit in ("N", "mm"))
    both = {h: [*newtons[h], *[in_unit(r, 25.0, "mm") for r in millimetres[h]]] for h in newtons}
    mean = beside(models, 0.2)["H1"]
    for hands in (newtons, both):
        found = hand_data(hands).gains("no answer")
        assert np.mean(list(found.gains.values())) == pytest.approx(skill(mean, "no answer").value)
    noise = hand_data(both).noise
    assert noise["mm"] == pytest.approx(25 * np.array(noise["N"]))


def test_only_what_every_hand_has_is_compared_and_means_alone_have_no_hands():
    hands = beside(MEASURED, -0.3, 0.3)
    hands["H2"] = hands["H2"][3:]
    assert len(hand_data(hands).rows) == 21
    assert hand_data({}) is None
    assert hand_data({"mean": rows(MEASURED)}) is None
    answers = {row.target: 0.0 for row in hands["H1"][:6]}
    split = hand_data(hands).gains("fixed split", answers)
    few = {hand: each[-21:][:3] for hand, each in hands.items()}
    assert split.count == hand_data(few).gains("no answer").count == "2 of 2"
    assert hand_data(hands).gains("fixed split", {}) is None


def without(models: np.ndarray, *lost: int) -> np.ndarray:
    return np.where(np.isin(np.arange(len(models)), lost), np.nan, models)


@pytest.mark.parametrize("null", [*FACTORS, "fixed split"])
@pytest.mark.parametrize("scale", [0.0, 0.5, 1.0, 2.0, -1.0, 20.0])
def test_no_number_can_be_left_out_to_raise_a_skill(null, scale):
    """Whatever the model, and whichever number or trial is missing; one by one to the last."""
    models = scale * MEASURED + np.random.default_rng(7).normal(0, 3, 24)
    split = {r.target: 0.3 for r in rows(models)} if null == "fixed split" else None

    def value(*lost: int) -> float:
        found = skill(rows(without(models, *lost)), null, split)
        return 1.0 if found is None else found.value

    whole = value()
    for i in range(24):
        assert value(i) <= whole + 1e-12, i
    for i in range(0, 24, 3):
        assert value(i, i + 1, i + 2) <= whole + 1e-12
    falling = [value(*range(n)) for n in range(25)]
    assert all(b <= a + 1e-12 for a, b in itertools.pairwise(falling))


def test_a_number_that_is_not_found_costs_what_the_opposite_answer_costs():
    found = skill(rows(without(MEASURED, 4)), "no answer").value
    scale = max(MEASURED[4] ** 2, np.mean(MEASURED**2))
    assert found == pytest.approx(1 - 4 * scale / np.sum(MEASURED**2))
    opposite = skill(rows(np.where(np.arange(24) == 4, -MEASURED, MEASURED)), "no answer").value
    assert found <= opposite + 1e-12
    hands = beside(without(MEASURED, 4), -0.3, 0.0, 0.3)
    complete = hand_data(beside(MEASURED, -0.3, 0.0, 0.3)).gains("no answer")
    lacking = hand_data(hands).gains("no answer")
    assert all(lacking.gains[hand] < complete.gains[hand] for hand in complete.gains)


def test_an_interval_is_wider_over_hands_that_differ_and_the_same_over_hands_that_agree():
    models = MEASURED + RNG.normal(0, 1, 24)
    mine = rows(models)
    alone = skill(mine, "no answer")
    for spread, same in ((0.0, True), (1.5, False)):
        hands = {r.target: [r.target.reference + spread * x for x in (-1, 0, 1)] for r in mine}
        found = skill(mine, "no answer", hands=hands)
        assert found.value == alone.value
        assert (found.high - found.low == pytest.approx(alone.high - alone.low)) == same
        assert found.high - found.low >= alone.high - alone.low - 1e-12
        assert (found.hands, alone.hands) == (3, 0)


def test_a_perfect_model_s_skill_lies_between_its_ends_nine_times_of_ten():
    """Hands drawn by a known law round a truth: how often the truth's skill lies between them."""
    random, inside = np.random.default_rng(5), 0
    for _ in range(200):
        off = random.normal(0, 1, 3)
        measured = hand_data(beside(MEASURED, *off))
        mean = measured.measured.mean(axis=0)
        of_truth = 1 - np.sum((MEASURED - mean) ** 2) / np.sum(mean**2)
        low, _ = measured.gains("no answer").spread
        inside += of_truth >= low
    assert inside / 200 > 0.75  # 95 % with many hands; three know their own spread badly
