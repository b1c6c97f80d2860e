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
LONG = (
    *("first_run", "mujoco_hood", "own_material", "own_measurements", "own_mesh"),
    *("predictive_control", "sweep", "motion", "captured_motion", "force_loop"),
)
"""They solve a shell, or many motions."""
NEEDS_FMU = [
    pytest.mark.fmu,
    pytest.mark.skipif(find_spec("pythonfmu3") is None, reason="the extra fmu is missing"),
]
MARKS = {
    **{name: [pytest.mark.slow] for name in LONG},
    "fmu": NEEDS_FMU,
    "controller": [pytest.mark.slow, *NEEDS_FMU],
    "own_bones": [
        pytest.mark.slow,
        pytest.mark.skipif(find_spec("pyvista") is None, reason="the extra view is missing"),
    ],
    "environment": [
        pytest.mark.skipif(find_spec("gymnasium") is None, reason="the extra gym is missing")
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


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_ends_in_a_figure(path: Path):
    last = path.read_text(encoding="utf-8").rsplit("\n# %%", 1)[1].rstrip().splitlines()
    assert last[0] == ""  # a cell of code
    assert last[-1] == "plt.show()" or re.fullmatch(r"\w+\.plot\(.*\)", last[-1])


@pytest.mark.slow
@pytest.mark.skipif(find_spec("nbconvert") is None, reason="the extra notebooks is missing")
def test_a_page_shows_its_figure_calls_nothing_and_leaves_nothing(tmp_path: Path):
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", "cases.notebooks", "pages", "motion", "sweep"]
    done = subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["pages"]
    pages = sorted((tmp_path / "pages").iterdir())
    assert [p.name for p in pages] == ["motion.html", "sweep.html"]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "data:image/png;base64" in text.rsplit('class="jp-OutputArea', 1)[1]
        assert not re.search(r"""(src|href)=["'](http|//)""", text)


def test_each_is_named_in_the_catalogue():
    guide = (ROOT / "cases" / "README.md").read_text(encoding="utf-8")
    for path in NOTEBOOKS:
        assert f"(notebooks/{path.name})" in guide
        assert re.match(r"# ---\n# jupyter:\n", path.read_text(encoding="utf-8"))
