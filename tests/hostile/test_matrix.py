"""Some of the combinations of hood, finger, tip, scheme and edge that `python -m
tests.hostile.matrix` solves."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hostile.matrix import Combination, combinations, end_of

LUMPED = ("pulleys", "split", "network", "two bands", "planar", "robot's pulleys")
LIGHT = [c for c in combinations(400) if c.hood in LUMPED][:12]


@pytest.mark.parametrize("combination", LIGHT, ids=" / ".join)
def test_a_light_combination_closes_or_says_why_not(
    combination: Combination, tmp_path: Path
) -> None:
    ended = end_of(combination, tmp_path)
    assert ended.how != "failed", ended.why


@pytest.mark.slow
@pytest.mark.parametrize("combination", combinations(60), ids=" / ".join)
def test_a_combination_closes_or_says_why_not(combination: Combination, tmp_path: Path) -> None:
    ended = end_of(combination, tmp_path)
    assert ended.how != "failed", ended.why
