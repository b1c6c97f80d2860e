"""The notebooks run from beginning to end, each in a new process and an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.helpers.folders import ROOT

NOTEBOOKS = sorted((ROOT / "cases" / "notebooks").glob("[!_]*.py"))
LONG = ("first_run", "own_material", "own_measurements")
"""They solve a shell."""
MARKS = {
    **{name: [pytest.mark.slow] for name in LONG},
    "fmu": [
        pytest.mark.fmu,
        pytest.mark.skipif(find_spec("pythonfmu3") is None, reason="the extra fmu is missing"),
    ],
}


@pytest.mark.parametrize(
    "path", [pytest.param(p, id=p.stem, marks=MARKS.get(p.stem, [])) for p in NOTEBOOKS]
)
def test_a_notebook_runs(path: Path, tmp_path: Path):
    env = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, str(path)], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_each_is_named_in_the_catalogue():
    guide = (ROOT / "cases" / "README.md").read_text(encoding="utf-8")
    for path in NOTEBOOKS:
        assert f"(notebooks/{path.name})" in guide
        assert re.match(r"# ---\n# jupyter:\n", path.read_text(encoding="utf-8"))
