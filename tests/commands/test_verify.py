"""`cosim verify`: the door to the proofs, and the rows that they leave."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.commands import verify
from tests.helpers.rows import Row, record

pytest_plugins = ["pytester"]

PROOF = """
from tests.helpers.rows import Row
from tests.helpers.rows import judge_of
import pytest

@pytest.fixture
def judge(request):
    return judge_of(request)

def rows(off):
    yield Row("beam", "deflection", 2.0, 2.001, 0.01, "closed form", order=2.0)
    yield Row("beam", "turn", 2.0, off, 0.01, "closed form")
    if off > 3:
        raise ValueError("largest at node 7")

def test_sound(judge):
    assert len(judge(rows(2.0))) == 2

def test_poor(judge):
    judge(rows(2.1))

def test_stuck(judge):
    judge(rows(4.0))

def test_without_rows(judge):
    judge(())
"""
PLUGIN = """
from tests.helpers.rows import add_options as pytest_addoption, show

def pytest_terminal_summary(terminalreporter, config):
    show([r for k in ("passed", "failed") for r in terminalreporter.stats.get(k, ())], config)
"""


def test_rows_are_judged_and_left_also_by_what_fails(pytester):
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(PROOF)
    file = pytester.path / "rows.json"
    done = pytester.runpytest("-p", "no:cacheprovider", "--rows", str(file), "--table")
    done.assert_outcomes(passed=1, failed=3)
    rows = json.loads(file.read_text())
    assert [row["verdict"] for row in rows] == ["pass", "pass", "pass", "FAIL", "pass", "FAIL"]
    assert rows[0]["order"] == 2.0
    assert rows[0]["error"] == pytest.approx(5e-4)
    done.stdout.fnmatch_lines(["*[[]1[]] closed form", "6 rows, 2 failed"])


def test_what_is_not_a_number_is_null():
    made = record(Row("beam", "turn", 2.0, float("nan"), 0.01, "closed form"))
    assert (made["computed"], made["verdict"]) == (None, "FAIL")


def test_an_installation_is_told_to_clone(monkeypatch, tmp_path):
    monkeypatch.setattr(verify, "ROOT", tmp_path)
    done = CliRunner().invoke(app, ["verify", "fe"])
    assert done.exit_code == 2
    assert "clone the repository" in done.stderr


def test_a_name_that_no_proof_has_is_told():
    done = CliRunner().invoke(app, ["verify", "robot", "--only", "bridge"])
    assert done.exit_code == 2
    assert "no proof of robot has this name" in done.stderr


@pytest.mark.slow
def test_the_door_runs_a_proof_and_writes_its_rows(tmp_path):
    file = tmp_path / "rows.json"
    done = CliRunner().invoke(app, ["verify", "robot", "--only", "fan", "--json", str(file)])
    assert done.exit_code == 0
    assert {row["verdict"] for row in json.loads(file.read_text())} == {"pass"}
