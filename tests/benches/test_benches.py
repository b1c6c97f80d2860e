"""The benches: their names, and the files of its ratios."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from cosim.errors import CosimError
from cosim.solve import session
from cosim.version import __version__
from fe_solver.solver.linear_algebra import available
from tests.benches import __main__ as bench
from tests.benches import files as bench_files
from tests.benches import history as bench_history
from tests.benches import pairs as bench_pairs
from tests.benches import study as study_bench
from tests.benches.__main__ import BENCHES, OF_ALL, Bench
from tests.benches.files import BenchRecord
from tests.benches.shell_speed import bench_solvers
from tests.benches.study import StudyTiming, load_figures, planned_rate
from tests.helpers.folders import ROOT


def run(*words: str):
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(bench.bench)
    return CliRunner().invoke(app, list(words))


def fake(monkeypatch, name: str, **ratios: float) -> None:
    monkeypatch.setitem(BENCHES, name, Bench("", lambda options: ratios))


def test_the_help_names_every_bench():
    shown = " ".join(run("--help").stdout.split())
    assert all(f"{name}: {bench.line}" in shown for name, bench in BENCHES.items())


@pytest.mark.parametrize(("name", "hint"), [("stuides", "studies"), ("grwth", "growth")])
def test_a_bench_that_there_is_not_is_told_the_nearest(name, hint):
    done = run(name)
    assert done.exit_code == 2
    assert done.stderr.rstrip().endswith(f"or the bench {hint}?")
    assert len(done.stderr.splitlines()) == 1


def test_ratios_are_written_with_where_they_were_measured(monkeypatch, tmp_path):
    fake(monkeypatch, "pulls", solves=0.5)
    file = tmp_path / "now.json"
    assert run("pulls", "--json", str(file)).exit_code == 0
    record = json.loads(file.read_text())
    assert record["ratios"] == {"pulls": {"solves": 0.5}}
    assert {"processor", "cores", "libraries", "linear solver"} <= set(record["machine"])
    assert record["source"]
    assert record["date"].endswith("+00:00")


def test_all_benches_leave_their_ratios_in_one_file(monkeypatch, tmp_path):
    for i, name in enumerate(OF_ALL):
        monkeypatch.setitem(OF_ALL, name, lambda i=i: {"ratio": float(i)})
    file = tmp_path / "all.json"
    assert run("all", "--json", str(file)).exit_code == 0
    ratios = json.loads(file.read_text())["ratios"]
    assert ratios == {name: {"ratio": i} for i, name in enumerate(OF_ALL)}


def test_files_of_several_commits_stand_side_by_side(monkeypatch, tmp_path):
    files = [tmp_path / "a.json", tmp_path / "b.json"]
    for file, solves in zip(files, (4.0, 3.0), strict=True):
        fake(monkeypatch, "pulls", solves=solves)
        run("pulls", "--json", str(file))
    both = [word for file in files for word in ("--against", str(file))]
    assert "pulls: solves 4 3 0.75" in " ".join(run("files", *both).stdout.split())
    fake(monkeypatch, "pulls", solves=2.0, failed=0.0)
    shown = " ".join(run("pulls", *both).stdout.split())
    assert "pulls: solves 4 3 2 0.50" in shown
    assert "pulls: failed - - 0 -" in shown


@pytest.mark.parametrize(
    "content", ["no JSON", "[1]", "{}", '{"source": "", "date": "", "machine": {}, "ratios": 1}']
)
def test_a_file_that_the_command_did_not_write_is_refused(tmp_path, content):
    file = tmp_path / "other.json"
    file.write_text(content)
    done = run("files", "--against", str(file))
    assert done.exit_code == 2
    assert "is no file that --json of the benches wrote" in done.stderr


def test_files_to_compare_must_be_named_and_be_there(tmp_path):
    done = run("files")
    assert (done.exit_code, "--against" in done.stderr) == (2, True)
    done = run("files", "--against", str(tmp_path / "none.json"))
    assert (done.exit_code, "cannot be read" in done.stderr) == (2, True)


def record(source: str, day: int, **ratios: float) -> BenchRecord:
    machine = {"processor": "an old one, slow", "cores": "2", "linear solver": "feral"}
    return BenchRecord(source, f"2026-01-{day:02}T12:00:00+00:00", machine, {"pulls": ratios})


def test_two_versions_are_measured_in_turn(monkeypatch, tmp_path):
    measured = []
    of = {
        tmp_path: [(4.0, 9.0), (6.0, 3.0), (5.0, 4.0)],
        bench_pairs.ROOT: [(2.0, 7.0), (1.0, 2.0), (9.0, 1.5)],
    }

    def measure(words, root, name):
        assert words == ["pulls", "--most", "250"]
        measured.append(root)
        ratio, cpu = of[root][measured.count(root) - 1]
        return record("x", 1, solves=ratio), cpu

    monkeypatch.setattr(bench_pairs, "_measure", measure)
    words = ["pulls", "--most", "250"]
    theirs, ours = bench_pairs.measure_pair(words, tmp_path, "old", 3, lambda text: None)
    assert measured == [tmp_path, bench_pairs.ROOT] * 3
    assert theirs.source == "old"
    assert theirs.ratios == {"pulls": {"solves": 5.0}, "pair": {bench_pairs.CPU: 1.0}}
    assert ours.ratios == {"pulls": {"solves": 2.0}, "pair": {bench_pairs.CPU: 0.5}}


def test_another_version_is_a_folder_or_a_commit(tmp_path):
    with bench_pairs.source_folder(str(ROOT)) as folder:
        assert folder == ROOT
    done = run("fingers", "--against", str(tmp_path / "nothing"))
    assert done.exit_code == 2
    assert "no folder of sources, and no commit" in done.stderr
    done = run("fingers", "--against", "a", "--against", "b")
    assert (done.exit_code, "one folder or commit at a time" in done.stderr) == (2, True)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs git and a checkout")
def test_the_files_of_a_commit_are_there_until_the_end():
    with bench_pairs.source_folder("HEAD") as folder:
        assert (folder / "cosim" / "cli.py").is_file()
        assert folder != ROOT
    assert not folder.exists()


def test_a_version_that_fails_is_an_error_with_its_last_words(tmp_path):
    for name in (
        "cosim/__init__.py",
        "cosim/cli.py",
        "tests/__init__.py",
        "tests/benches/__init__.py",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "tests" / "benches" / "__main__.py").write_text(
        "raise SystemExit('no such bench here')"
    )
    done = run("fingers", "--against", str(tmp_path))
    assert done.exit_code == 2
    assert done.stderr.endswith(
        "python -m tests.benches fingers --spacing 0.25 mm --most 2400: no such bench here\n"
    )


@pytest.mark.slow
def test_a_version_beside_itself_does_the_same(tmp_path):
    file = tmp_path / "now.json"
    done = run("pulls", "--against", str(ROOT), "--repeats", "1", "--json", str(file))
    assert done.exit_code == 0
    assert "pulls: linear solves each" in done.stdout
    assert json.loads(file.read_text())["ratios"]["pair"]


def test_figures_are_kept_over_commits_and_regressions_shown(monkeypatch, tmp_path):
    history = tmp_path / "bench.csv"
    monkeypatch.setattr(bench, "HISTORY", history)
    assert "--keep adds them" in run("page").stderr
    new = {"solves": 4.5, "runs per second, two over one": 1.9, "failed": 1.0, "only now": 1.0}
    for made in (
        record("aaa", 1, **{"solves": 4.0, "runs per second, two over one": 1.5, "failed": 0.0}),
        record("bbb", 2, **new),
    ):
        bench_history.append_record(history, made)
    (found,) = bench_history.read_history(history)
    assert found.bench == "pulls"
    assert found.machine == "an old one, slow, feral"
    assert found.sources == ("aaa, 2026-01-01", "bbb, 2026-01-02")
    assert found.regressions == ("solves", "failed")
    done = run("page", "--out", str(tmp_path / "a.html"))
    assert "worse: pulls: solves: 4 to 4.5 (an old one, slow, feral)" in done.stdout
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page.count('class="worse"') == 2
    assert '<td>4</td><td class="worse">4.5</td>' in page


def test_figures_are_kept_in_a_checkout_alone(monkeypatch, tmp_path):
    fake(monkeypatch, "pulls", solves=4.0)
    monkeypatch.setattr(bench, "HISTORY", tmp_path / "bench.csv")
    monkeypatch.setattr(bench, "ROOT", tmp_path)
    done = run("pulls", "--keep")
    assert (done.exit_code, "needs a checkout" in done.stderr) == (2, True)
    (tmp_path / ".git").touch()
    for _ in range(2):
        assert run("pulls", "--keep").exit_code == 0
    head, *rows = (tmp_path / "bench.csv").read_text().splitlines()
    assert head == ",".join(bench_history.COLUMNS)
    assert [row.rpartition("pulls,")[2] for row in rows] == ["solves,4", "solves,4"]


@pytest.mark.parametrize(
    ("name", "values", "worse"),
    [
        ("ratio", (1.0, 1.09, 1.3), (False, False, True)),
        ("ratio", (1.0, None, 1.2), (False, False, True)),
        ("ratio", (1.0, 0.5, None), (False, False, False)),
        ("runs per second, two over one", (2.0, 3.0, 2.5), (False, False, True)),
    ],
)
def test_a_figure_is_worse_than_the_one_before(name, values, worse):
    assert bench_history.FigureLine(name, values).worse == worse


def test_combined_loads_leave_the_same_table_by_one_and_two_workers(tmp_path, monkeypatch):
    file = tmp_path / "loads.toml"
    file.write_text(
        'case = "split_edc"\n[parameters."tendons.EDC.tension"]\nfrom = "1 N"\nto = "4 N"\n'
        'count = 6\n[outputs]\ntip = "fingertip_magnitude_N"\n'
    )
    found = dict(load_figures(lambda text: None, file))
    assert all(value > 0 for value in found.values())
    contents = iter((b"a", b"b"))
    monkeypatch.setattr(Path, "read_bytes", lambda path: next(contents))
    monkeypatch.setattr(study_bench, "_time_study", lambda *_: StudyTiming(1.0, 1.0, 1))
    with pytest.raises(CosimError, match="leave different tables"):
        list(load_figures(lambda text: None, file))


def test_a_file_that_cannot_be_written_is_told_before_anything_is_measured(monkeypatch, tmp_path):
    monkeypatch.setattr(bench, "_measure", lambda *_: pytest.fail("it has measured"))
    done = run("pulls", "--json", str(tmp_path))
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


def test_bench_prints_its_figures(monkeypatch):
    monkeypatch.setattr(
        "tests.benches.__main__.bench_case",
        lambda case, _: {"warm_run_s": 1.5, "ratio": case.hood.mesh.quads / 100},
    )
    assert run("isometric_edc", "--set", "hood.mesh.quads=250").stdout.split() == [
        *("warm_run_s", "1.5", "ratio", "2.5")
    ]


def test_linear_solvers_are_timed_on_one_tangent(capsys):
    ratios = bench_solvers("isometric_edc")
    assert all(ratio > 0 for ratio in ratios.values())
    shown = capsys.readouterr().out
    assert all(name in shown for name in available())


def test_bench_needs_a_shell():
    done = run("pulley_edc")
    assert done.exit_code == 2
    assert "bench needs a hood of finite elements" in done.stderr


@pytest.mark.slow
def test_bench_times_a_real_run(monkeypatch):
    built, build = [], session.build_any
    monkeypatch.setattr(session, "build_any", lambda case: built.append(case) or build(case))
    monkeypatch.setattr("tests.benches.case.REPEATS", 2)
    done = run("isometric_edc", "--set", "hood.mesh.quads=120")
    assert len(built) == 1 + 2, "warm runs share their models, the two cold ones do not"
    figures = dict(line.split() for line in done.stdout.splitlines())
    seconds = {name: float(value) for name, value in figures.items()}
    assert all(value > 0 for value in seconds.values())
    linear = seconds["assembly_s"] + seconds["factorisation_s"]
    assert seconds["ratio"] == pytest.approx(seconds["warm_run_s"] / linear, rel=0.01)


@pytest.mark.slow
def test_bench_times_the_steps_of_a_motion():
    short = ("hood.mesh.quads=120", "forward.duration='3 ms'")
    done = run("motion_edc_fdp", *(word for s in short for word in ("--set", s)))
    figures = dict(line.split() for line in done.stdout.splitlines())
    values = {name: float(value) for name, value in figures.items()}
    assert values["steps"] == 3
    linear = values["assembly_s"] + values["factorisation_s"]
    assert values["ratio"] == pytest.approx(values["step_s"] / linear, rel=0.01)
    assert values["ratio"] > 1


def test_bench_of_a_motion_needs_a_shell():
    done = run("forward_edc")
    assert done.exit_code == 2
    assert "bench needs a hood of finite elements" in done.stderr
