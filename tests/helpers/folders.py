"""Where the tests find files."""

from __future__ import annotations

import json
from pathlib import Path

from cosim.results.write import DIGEST, LEDGER_DIGEST, SUMMARY_DIGEST

ROOT = Path(__file__).resolve().parents[2]
TEST_DATA = ROOT / "tests" / "data"
CASE_DATA = ROOT / "cases" / "data"


def forget_digest(folder: Path) -> None:
    """Take from a run's summary the digests of its files, so that others may stand in their
    place."""
    summary = folder / "summary.json"
    stated = json.loads(summary.read_text(encoding="utf-8"))
    for key in (DIGEST, LEDGER_DIGEST, SUMMARY_DIGEST):
        stated.pop(key, None)
    summary.write_text(json.dumps(stated), encoding="utf-8")
