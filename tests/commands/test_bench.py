"""`cosim bench`: its names, and the files of its ratios."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.commands import bench, bench_files
from cosim.commands.bench import BENCHES, OF_ALL, Bench
from cosim.study.bench import StudyTiming, planned_rate
from cosim.version import __version__


def cosim(*words: str):
    return CliRunner().invoke(app, list(words))


def fake(monkeypatch, name: str, **ratios: float) -> None:
    monkeypatch.setitem(BENCHES, name, Bench("", lambda options: ratios))


def test_the_help_names_every_bench():
    shown = " ".join(cosim("bench", "--help").stdout.split())
    assert all(f"{name}: {bench.line}" in shown for name, bench in BENCHES.items())


@pytest.mark.parametrize(("name", "hint"), [("stuides", "studies"), ("grwth", "growth")])
def test_a_bench_that_there_is_not_is_told_the_nearest(name, hint):
    done = cosim("bench", name)
    assert done.exit_code == 2
    assert done.stderr.rstrip().endswith(f"or the bench {hint}?")
    assert len(done.stderr.splitlines()) == 1


def test_ratios_are_written_with_where_they_were_measured(monkeypatch, tmp_path):
    fake(monkeypatch, "pulls", solves=0.5)
    file = tmp_path / "now.json"
    assert cosim("bench", "pulls", "--json", str(file)).exit_code == 0
    record = json.loads(file.read_text())
    assert record["ratios"] == {"pulls": {"solves": 0.5}}
    assert {"processor", "cores", "libraries", "linear solver"} <= set(record["machine"])
    assert record["source"]
    assert record["date"].endswith("+00:00")


def test_all_benches_leave_their_ratios_in_one_file(monkeypatch, tmp_path):
    for i, name in enumerate(OF_ALL):
        monkeypatch.setitem(OF_ALL, name, lambda i=i: {"ratio": float(i)})
    file = tmp_path / "all.json"
    assert cosim("bench", "all", "--json", str(file)).exit_code == 0
    ratios = json.loads(file.read_text())["ratios"]
    assert ratios == {name: {"ratio": i} for i, name in enumerate(OF_ALL)}


def test_files_of_several_commits_stand_side_by_side(monkeypatch, tmp_path):
    files = [tmp_path / "a.json", tmp_path / "b.json"]
    for file, solves in zip(files, (4.0, 3.0), strict=True):
        fake(monkeypatch, "pulls", solves=solves)
        cosim("bench", "pulls", "--json", str(file))
    both = [word for file in files for word in ("--against", str(file))]
    assert "pulls: solves 4 3 0.75" in " ".join(cosim("bench", "files", *both).stdout.split())
    fake(monkeypatch, "pulls", solves=2.0, failed=0.0)
    shown = " ".join(cosim("bench", "pulls", *both).stdout.split())
    assert "pulls: solves 4 3 2 0.50" in shown
    assert "pulls: failed - - 0 -" in shown


@pytest.mark.parametrize(
    "content", ["no JSON", "[1]", "{}", '{"source": "", "date": "", "machine": {}, "ratios": 1}']
)
def test_a_file_that_the_command_did_not_write_is_refused(tmp_path, content):
    file = tmp_path / "other.json"
    file.write_text(content)
    done = cosim("bench", "files", "--against", str(file))
    assert done.exit_code == 2
    assert "is no file that cosim bench --json wrote" in done.stderr


def test_files_to_compare_must_be_named_and_be_there(tmp_path):
    done = cosim("bench", "files")
    assert (done.exit_code, "--against" in done.stderr) == (2, True)
    done = cosim("bench", "files", "--against", str(tmp_path / "none.json"))
    assert (done.exit_code, "cannot be read" in done.stderr) == (2, True)


def test_a_file_that_cannot_be_written_is_told_before_anything_is_measured(monkeypatch, tmp_path):
    monkeypatch.setattr(bench, "_measure", lambda *_: pytest.fail("it has measured"))
    done = cosim("bench", "pulls", "--json", str(tmp_path))
    assert done.exit_code == 2


def test_without_git_the_version_is_the_source(monkeypatch, tmp_path):
    monkeypatch.setattr(bench_files.cosim, "__file__", str(tmp_path / "cosim" / "__init__.py"))
    assert bench_files.source_version() == __version__
    (tmp_path / ".git").touch()  # no repository
    assert bench_files.source_version() == __version__


def test_many_workers_are_planned_by_what_is_serial():
    one = StudyTiming(seconds=11.0, solving=10.0, runs=10)
    assert planned_rate(one, 1) == pytest.approx(one.rate)
    assert planned_rate(one, 10**9) == pytest.approx(10)
