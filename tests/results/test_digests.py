"""Summary and ledger tell of a change by a hand or a disk, as the arrays do."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cosim
from cosim.errors import InputError
from cosim.results.sto import write_tables
from tests.helpers.folders import forget_digest


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    case = cosim.load("split_edc").replace({"output.picture": False})
    return cosim.run(case).save(tmp_path)


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


CHANGES: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "a number": lambda s: {**s, "fingertip_magnitude_N": 1.001 * s["fingertip_magnitude_N"]},
    "a number more": lambda s: {**s, "x": 1.0},
    "a number less": lambda s: {k: v for k, v in s.items() if k != "tension_N"},
    "what deep lists hold": lambda s: {**s, "x": json.loads("[" * 500 + "]" * 500)},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_changed_summary_is_refused(folder: Path, change: Callable[[Any], Any]) -> None:
    edit(folder / "summary.json", change)
    for read in (cosim.open_run, lambda run: write_tables(run, run / "run.sto")):
        with pytest.raises(InputError, match=r"summary\.json: cannot be read as a part of a run"):
            read(folder)


def test_a_summary_in_another_order_of_lines_or_of_other_seconds_is_the_same(folder: Path) -> None:
    edit(folder / "summary.json", lambda s: {**s, "wall_s": 99.0})
    assert cosim.open_run(folder).summary["wall_s"] == 99.0


def test_a_changed_ledger_is_refused(folder: Path) -> None:
    path = folder / "ledger.csv"
    text = path.read_bytes()
    digits = [i for i, byte in enumerate(text) if chr(byte).isdigit()]
    for i in digits[:: max(len(digits) // 7, 1)]:
        path.write_bytes(text[:i] + (b"1" if text[i : i + 1] != b"1" else b"2") + text[i + 1 :])
        with pytest.raises(InputError, match=r"ledger\.csv: cannot be read.*by the digest"):
            cosim.open_run(folder)
    path.write_bytes(text)
    cosim.open_run(folder)


def test_a_run_of_an_older_version_has_no_digests_and_is_read(folder: Path) -> None:
    before = cosim.open_run(folder).summary
    forget_digest(folder)
    assert cosim.open_run(folder).summary == before
