"""The guide's table of FEBio's features names the test of each."""

from __future__ import annotations

import re

import pytest

from tests.helpers.folders import ROOT

GUIDE = (ROOT / "fe_solver" / "febio" / "README.md").read_text(encoding="utf-8")
ROWS = [line for line in GUIDE.splitlines() if line.startswith("| ")][1:]
TESTS = "".join(
    p.read_text(encoding="utf-8") for p in (ROOT / "tests/fe_solver").rglob("test_*.py")
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[2:40].strip())
def test_each_feature_has_a_verdict_and_a_test(row: str) -> None:
    section, _, verdict, _, tests = (cell.strip() for cell in row.strip("|").split("|"))
    assert section
    assert re.match("taken|told|refused", verdict)
    names = re.findall(r"`(test_\w+)`", tests)
    assert names
    assert all(f"def {name}(" in TESTS for name in names)
