"""A kind of hood or finger is said in one place."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from cosim.fingers.kinds import FINGERS, AnyFinger
from cosim.hoods.kinds import KINDS, AnyHood
from tests.helpers.folders import ROOT

ADDED = {
    "from cosim.hoods.shell import variation as shell\n": (
        "from cosim.hoods.shell import variation as shell\nfrom cosim.hoods import string\n"
    ),
    "        fmu.KIND,\n": "        fmu.KIND,\n        string.KIND,\n",
    "    | fmu.FmuHoodConfig\n": "    | fmu.FmuHoodConfig\n    | string.StringHood\n",
}
CASE = """extends = "pulley_edc"
title = "EDC pulls a string"
[hood]
kind = "string"
"""
WORK = """
import json
from cosim.case.file import json_schema
from cosim.cli import app
from cosim.analyses import ladder
from cosim.models.fit import check_fit
from cosim.case.file import load_case
from cosim.errors import InputError

refused = {}
for name in ("two_band_edc", "middle_minorflex_edc"):
    try:
        check_fit(load_case(name, ['hood={kind="string"}']))
    except InputError as error:
        refused[name] = str(error)
case = load_case("string.toml")
rungs = ladder.rungs_of(case)
ladder.rungs_of = lambda _: rungs[:1]
(rung,) = ladder.solve_rungs(case, 1)
print(json.dumps([refused, rungs, rung.status, dict(rung.slips), json_schema()]))

app(["run", "string.toml", "--quiet"], standalone_mode=False)
app(["show", "runs/string", "-o", "page.html"], standalone_mode=False)
"""
"""The programs' work in one process of the copy."""


def test_the_tables_of_kinds_and_the_unions_hold_the_same():
    assert {kind.table for kind in KINDS.values()} == set(get_args(AnyHood))
    assert {kind.table for kind in FINGERS.values()} == set(get_args(AnyFinger))


def test_every_hood_fits_fingers_that_there_are():
    for kind in KINDS.values():
        assert set(kind.table.fits) <= set(FINGERS)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of cosim with one kind of hood more: a file, its import, and a line in the table and
    in the union."""
    root = tmp_path_factory.mktemp("house")
    shutil.copytree(ROOT / "cosim", root / "cosim")  # with what Python compiled
    toy = ROOT / "tests" / "helpers" / "elastic_string.py"
    shutil.copyfile(toy, root / "cosim" / "hoods" / "string.py")
    kinds = root / "cosim" / "hoods" / "kinds.py"
    text = kinds.read_text(encoding="utf-8")
    for old, new in ADDED.items():
        assert old in text
        text = text.replace(old, new)
    kinds.write_text(text, encoding="utf-8")
    (root / "string.toml").write_text(CASE, encoding="utf-8")
    return root


def python(house: Path, *words: str) -> str:
    """What a program of the copy prints."""
    places = [house, ROOT]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, places))}
    done = subprocess.run(
        [sys.executable, *words], cwd=house, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def said(house: Path) -> str:
    return python(house, "-c", WORK)


def test_a_new_hood_runs_from_a_case_and_is_in_its_report(house: Path, said: str):
    folder = house / "runs" / "string"
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    tension = summary["tension_N"]["EDC"]
    assert tension == pytest.approx(3.469)
    assert summary["string_tension_N"]["EDC"] == tension
    assert summary["slip_force_N"]["central"] == tension
    assert summary["hood_cells"] == 3
    assert not summary["audit_missed"]
    assert (folder / "hood.vtu").exists()
    assert (folder / "picture.png").exists()
    page = (house / "page.html").read_text(encoding="utf-8")
    assert "one elastic string over the PIP" in page
    assert "string_tension_N.EDC" in page


def test_a_new_hood_is_in_the_schema(said: str):
    schema = json.loads(said.splitlines()[0])[-1]
    assert schema["$defs"]["StringHood"]["description"] == "One elastic string over the PIP."


def test_a_new_hood_is_refused_where_it_does_not_fit_and_stands_on_the_ladder(said: str):
    refused, rungs, status, slips, _ = json.loads(said.splitlines()[0])
    assert set(refused) == {"two_band_edc", "middle_minorflex_edc"}
    assert all('hood.kind = "string" does not go with' in text for text in refused.values())
    assert rungs[0] == "string"
    assert status == "converged"
    assert slips["central"] == pytest.approx(3.469)


def test_a_new_hood_keeps_the_promises(house: Path):
    suite = str(ROOT / "tests" / "port" / "test_conformance.py")
    alone = ("-p", "no:cacheprovider", "-n", "0", "-c", os.devnull, "--import-mode=importlib")
    said = python(house, "-m", "pytest", "-q", "-k", "string", *alone, suite)
    assert "7 passed" in said
