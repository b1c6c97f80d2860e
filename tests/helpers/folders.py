"""Where the tests find files."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEST_DATA = ROOT / "tests" / "data"
CASE_DATA = ROOT / "cases" / "data"
