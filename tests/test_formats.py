"""The table of what is read of other programs' files names tests that are there."""

from __future__ import annotations

import re

from tests.helpers.folders import ROOT


def test_every_row_names_a_test_that_is_there() -> None:
    guide = (ROOT / "cosim" / "FORMATS.md").read_text(encoding="utf-8")
    rows = [line for line in guide.splitlines() if line.startswith("| ") and "| test |" not in line]
    named = {row.rstrip("| ").rpartition("| ")[2] for row in rows}
    written = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.M)
    }
    assert len(rows) > 40
    assert named <= written, sorted(named - written)
