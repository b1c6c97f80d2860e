"""`cosim verify`: what is judged, and what is only shown."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from tests.helpers.rows import Row
from tests.proofs.coupling.fmu_rows import time_row
from tests.proofs.hoods import hood_rows
from tests.proofs.hoods import reduction_rows as reduction
from tests.proofs.studies.lesion_rows import LEAST, sign_row

LONG = 1e9  # s


def timed_rows(monkeypatch: pytest.MonkeyPatch) -> list[Row]:
    """The rows of the studies that read a clock, on a machine that is ever so slow."""
    monkeypatch.setattr(hood_rows, "_seconds", lambda network: LONG)
    slow = SimpleNamespace(rate=SimpleNamespace(one=LONG, batched=LONG), seconds=1.0)
    monkeypatch.setattr(reduction, "find_case", lambda name: None)
    monkeypatch.setattr(reduction, "reduce_case", lambda *_: slow)
    monkeypatch.setattr(reduction, "errors", lambda found: ())
    network = [row for row in hood_rows.network_rows() if row.computed == LONG]
    return [*network, *reduction.shell_rows(), time_row("units", "hood", 1e-4, LONG)]


def test_what_a_clock_took_is_shown_and_not_judged(monkeypatch):
    rows = timed_rows(monkeypatch)
    assert len(rows) == 4
    assert {row.verdict for row in rows} == {"shown"}
    assert all(row.passed for row in rows)


@pytest.mark.parametrize(
    ("gained", "is_known_miss", "verdict"),
    [
        (-3.0, False, "pass"),
        (2.7, False, "FAIL"),
        (-LEAST / 2, False, "FAIL"),
        (2.7, True, "outside"),
        (-3.0, True, "within"),
    ],
)
def test_a_known_miss_is_shown_and_any_other_fails(gained, is_known_miss, verdict):
    assert sign_row("mallet", "PIP", gained, is_known_miss).verdict == verdict
