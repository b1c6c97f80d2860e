"""A study through the command: tables, resuming, failures, limits; on a case that takes
milliseconds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from contextlib import nullcontext
from functools import partial
from math import radians
from pathlib import Path

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim.case.cache_key import address, case_table, code_version
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.processes import WorkerProcess, do_with_memory
from cosim.results.compare import numbers_of
from cosim.results.conventions import by_axis
from cosim.solve.session import Session
from cosim.study import open_study, process
from cosim.study import page as page_module
from cosim.study.engine import in_this_process
from cosim.study.execute import Count, check_outputs, in_turn
from cosim.study.store import Store
from cosim.study.task import Task, Verdict, _numbers, run_task, stored_outcome
from tests.helpers.fixed_posture import HELD
from tests.helpers.folders import ROOT

STUDY = """
case = "held.toml"
[parameters.PIP]
values = ["20 deg", "30 deg", "40 deg", "50 deg"]
settings = ["finger.posture.PIP={value}"]
[outputs]
torque = "joint_torque_Nmm.passive.PIP"
"""
FREE = 'settings = ["finger.tip.kind=point", "solve.max_iterations=1"]'
"""Which one round does not solve."""


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    (tmp_path / "held.toml").write_text(HELD, encoding="utf-8")
    (tmp_path / "pip.toml").write_text(STUDY, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """The pages of studies, which other tests here read, without their pictures."""
    monkeypatch.setattr(page_module, "picture_address", lambda *_: "")


def cosim(*words: str):
    return CliRunner().invoke(app, ["study", *words, "--workers", "0"])


def begin_counts(place: Path) -> Counter[str]:
    """Times that each run was begun."""
    lines = (place / "studies" / "store" / "executions.log").read_text().splitlines()
    return Counter(line.split()[1] for line in lines if line.startswith("begun"))


def a_task(place: Path, *settings: str, **more) -> Task:
    case = load_case(place / "held.toml", settings)
    code = code_version()
    values = json.loads(json.dumps(case_table(case)))
    store = Store(place / "s").open()
    return Task(address(case, code), values, "held", "held.toml", str(store.root), code, **more)


def test_a_study_is_the_closed_form_and_is_not_done_twice(place):
    done = cosim("pip.toml")
    assert done.exit_code == 0, done.output
    found = open_study(place / "studies" / "pip")
    angles = np.radians([20, 30, 40, 50])
    assert found.values("torque") == pytest.approx(-40 * angles, rel=1e-9)
    assert found.dataset().torque.sel(PIP=30).item() == pytest.approx(-40 * radians(30))
    assert found.dataset().torque.attrs["units"] == "N mm"
    before = (place / "studies" / "pip" / "table.parquet").read_bytes()
    again = cosim("pip.toml")
    assert "0 runs solved" in again.output
    assert set(begin_counts(place).values()) == {1}
    assert (place / "studies" / "pip" / "table.parquet").read_bytes() == before
    page = (place / "studies" / "pip" / "index.html").read_text(encoding="utf-8")
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_page_lays_the_runs_beside_what_was_measured(place):
    header = "name,quantity,unit,reference,sd,low,high,source,kind,case"
    rows = (
        "near,joint_torque_Nmm.passive.PIP,N mm,-24,5,,,us,experiment,",
        "far,joint_torque_Nmm.passive.PIP,N mm,,,1,,us,inferred,held",
        "not ours,joint_torque_Nmm.passive.PIP,N mm,0,,,,us,experiment,another",
    )
    (place / "told.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    (place / "pip.toml").write_text('data = "told.csv"\n' + STUDY, encoding="utf-8")
    assert cosim("pip.toml").exit_code == 0
    page = (place / "studies" / "pip" / "index.html").read_text(encoding="utf-8")
    assert ">near</td><td>-24 ± 5</td><td>median inside" in page
    assert ">far</td><td>[at least 1]</td><td>apart" in page
    assert ">Torque: " in page.partition("<main>")[0]
    assert " N mm in the median, " in page.partition("<main>")[0]
    assert "not ours" not in page.split('<section id="file">')[0]


@pytest.mark.usefixtures("undrawn")
def test_a_study_is_done_on_another_case_too(place):
    """Whose joint is twice as stiff; its runs are others, in the same store."""
    other = '[finger.passive.PIP]\nstiffness = "0.08 N*m/rad"\nrest = "0 deg"\n'
    (place / "stiff.toml").write_text(f'extends = "held.toml"\n{other}', encoding="utf-8")
    own = cosim("pip.toml")
    assert own.exit_code == 0, own.output
    done = cosim("pip.toml", "--case", "stiff.toml")
    assert "4 runs solved" in done.output, done.output
    angles = np.radians([20, 30, 40, 50])
    assert open_study(place / "studies" / "pip").values("torque") == pytest.approx(-80 * angles)
    assert cosim("pip.toml", "--case", "nothing.toml").exit_code == 2


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_tendons_of_a_fixed_split_add_up(place):
    text = (ROOT / "cases" / "studies" / "superposition.toml").read_text(encoding="utf-8")
    for line in ('    "hood.mesh.quads=200",\n', '[limits]\ntime = "300 s"\n'):
        assert line in text
        text = text.replace(line, "")
    few = text.replace("n = 500", "n = 50").replace("fingertip_fibres_edc", "split_edc")
    (place / "sum.toml").write_text(few, encoding="utf-8")
    done = cosim("sum.toml")
    assert done.exit_code == 0, done.output
    assert "Does it add up?" in done.output
    found = open_study(place / "studies" / "sum")
    answers = json.loads((place / "studies" / "sum" / "answers.json").read_text())["outputs"]
    for name in ("distal", "dorsal", "radial"):
        assert found.slopes(name).r2 == pytest.approx(1, abs=1e-9)
        assert found.slopes(name).rms < 1e-6
        assert len(answers[name]["surface"]["pairs"]) == 10
        assert list(found.pairs(name).values()) == pytest.approx([0] * 10, abs=1e-5)


@pytest.mark.usefixtures("undrawn")
def test_another_study_of_the_store_takes_what_is_there(place):
    cosim("pip.toml")
    other = STUDY.replace('"50 deg"', '"60 deg"')
    (place / "other.toml").write_text(other, encoding="utf-8")
    assert "1 runs solved" in cosim("other.toml").output


@pytest.mark.usefixtures("undrawn")
def test_a_study_goes_on_where_it_was(place, monkeypatch):
    calls = []

    def cut_off(task: Task, store: Store, session: Session):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(task.key)
        return run_task(task, store, session)

    with monkeypatch.context() as patch:
        patch.setattr("cosim.study.engine.run_task", cut_off)
        stopped = cosim("pip.toml")
    assert stopped.exit_code == 130
    assert "the same command goes on" in stopped.output
    status = CliRunner().invoke(app, ["study", "--status", "studies/store"])
    assert "stopped" in status.output
    assert "2 runs solved" in cosim("pip.toml").output
    assert set(begin_counts(place).values()) == {1}
    assert "4/4" in CliRunner().invoke(app, ["study", "--status", "studies/store"]).output


def test_failures_are_rows_and_retry_does_them_again(place, monkeypatch):
    from cosim import pipeline as run

    real, broken = run.run_case, [True]

    def fails(case, session):
        if broken[0] and radians(35) < case.finger.posture.PIP:
            raise ConvergenceError("no equilibrium\nhere")
        return real(case, session)

    monkeypatch.setattr(run, "run_case", fails)
    done = cosim("pip.toml")
    assert done.exit_code == 1
    assert "2 without an answer: no equilibrium here" in done.output
    found = open_study(place / "studies" / "pip")
    assert found.failures == {("failed", "no equilibrium here"): [2, 3]}
    assert np.isnan(found.values("torque")[2:]).all()
    page = (place / "studies" / "pip" / "index.html").read_text(encoding="utf-8")
    assert "no equilibrium here" in page
    assert "2 converged, 2 did not" in page
    broken[0] = False
    assert cosim("pip.toml").exit_code == 1
    assert "2 runs solved" in (again := cosim("pip.toml", "--retry")).output
    assert again.exit_code == 0


@pytest.mark.usefixtures("undrawn")
def test_what_the_case_refuses_is_a_row(place):
    text = STUDY.replace('"50 deg"', '"150 deg"')
    (place / "pip.toml").write_text(text, encoding="utf-8")
    assert cosim("pip.toml").exit_code == 1
    table = open_study(place / "studies" / "pip").table
    assert table.status.tolist() == 3 * ["converged"] + ["refused"]
    assert "must be 110 deg or less" in table.reason[3]
    assert str(place) not in table.to_csv()


@pytest.mark.usefixtures("undrawn")
def test_failures_stop_the_study_where_it_says(place):
    text = STUDY.replace("[param", "limits = { failures = 2 }\n" + FREE + "\n[param", 1)
    (place / "pip.toml").write_text(text, encoding="utf-8")
    done = cosim("pip.toml")
    assert done.exit_code == 1
    assert "2 runs were not done" in done.output
    table = open_study(place / "studies" / "pip").table
    assert table.status.tolist() == ["failed", "failed", "waiting", "waiting"]


def test_an_output_that_is_not_there_is_told_with_its_neighbours(place):
    text = STUDY.replace("joint_torque_Nmm.passive.PIP", "joint_torque_Nmm.pasive.PIP")
    (place / "pip.toml").write_text(text, encoding="utf-8")
    done = cosim("pip.toml")
    assert done.exit_code == 2
    assert "nearest: joint_torque_Nmm.passive.PIP" in done.output
    summary = {"a": {"b": 1.0, "c": by_axis((1.0, 2.0, 3.0))}, "zero": 0.0}
    assert list(numbers_of(summary)) == ["a.b", "a.c.distal", "a.c.radial", "a.c.dorsal", "zero"]
    check_outputs({"x": "a.b/zero"}, summary)
    with pytest.raises(InputError, match=r"at a\.d"):
        check_outputs({"x": "a.b/a.d"}, summary)


def test_bad_input_ends_with_2(place):
    assert cosim("nothing.toml").exit_code == 2
    assert cosim("pip.toml", "--store", ".").exit_code == 2
    limited = STUDY.replace("[param", 'limits = { time = "1 s" }\n[param', 1)
    (place / "pip.toml").write_text(limited, encoding="utf-8")
    assert "--workers 1" in (done := cosim("pip.toml")).output
    assert done.exit_code == 2
    assert CliRunner().invoke(app, ["study", "--status", "nowhere"]).exit_code == 2


def test_the_address_is_of_what_is_solved(place):
    (place / "copy.toml").write_text(HELD + "[output]\npicture = false\n", encoding="utf-8")
    base, code = load_case(place / "held.toml"), code_version()
    same = load_case(place / "copy.toml", ["title=Another"])
    other = load_case(place / "held.toml", ["finger.posture.PIP=45.000000001 deg"])
    assert address(base, code) == address(same, code)
    assert address(base, code) != address(other, code)
    assert address(base, code) != address(base, code + "x")


def test_the_address_is_of_a_files_content_not_of_its_name(place):
    surfaces = [place / name for name in ("a.stl", "b.stl", "c.stl")]
    for path, content in zip(surfaces, ("one", "one", "two"), strict=True):
        path.write_text(content)
    found = [
        address(
            load_case(
                "network_edc",
                [f'finger.bones.proximal={{surface="{path.as_posix()}", unit="mm", frame="ours"}}'],
            ),
            "code",
        )
        for path in surfaces
    ]
    assert found[0] == found[1] != found[2]


def test_runs_that_share_their_models_are_those_that_do_not(place):
    """What a process has solved before leaves no bit in a run of other tensions."""
    here = Store(place / "t").open()
    tasks = [a_task(place, f"tendons.EDC.tension={pull} N") for pull in (1.0, 2.0)]
    assert [verdict.status for verdict in in_this_process(iter(tasks))] == ["converged"] * 2
    for task in tasks:
        run_task(Task(**{**vars(task), "store": str(here.root)}), here)
        shared, alone = (store.find(task.key) for store in (Store(Path(task.store)), here))
        assert shared is not None
        assert alone is not None
        assert shared.summary == alone.summary


def test_a_run_in_its_own_process_is_that_of_this_one(place):
    """Also one that follows it there, one over its time, and one whose process crashes."""
    try:
        task = a_task(place, "finger.posture.PIP=33 deg")
        verdict = process.solve(task)
        assert (verdict.status, verdict.solved) == ("converged", True)
        store = Store(Path(task.store))
        row = store.find(task.key)
        here = Store(place / "t").open()
        run_task(Task(**{**vars(task), "store": str(here.root)}), here)
        same = here.find(task.key)
        assert row is not None
        assert same is not None
        assert row.summary == same.summary
        assert not process.solve(task).solved
        late = a_task(place, "finger.posture.PIP=34 deg", limit=1e-4)
        assert process.solve(late).status == "timeout"
        assert stored_outcome(late, store) is not None
        assert stored_outcome(Task(**{**vars(late), "limit": 60.0}), store) is None
        other = Task(**{**vars(task), "code": "another"})
        with pytest.raises(InputError, match="install the same"):
            process.solve(other)
    finally:
        process.close()


VARIABLES = """
from pathlib import Path
from cosim.study import process
process._process().call(process.run.__globals__["os"].getpid)
print(process._process().call(Path.read_text, Path("/proc/self/environ")))
process.close()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_the_process_of_a_run_has_one_thread_and_keeps_its_memory():
    """Whatever a Dask worker was given: two that hand every block back get in each other's way."""
    variables = {"MALLOC_TRIM_THRESHOLD_": "65536", "OPENBLAS_NUM_THREADS": "8"}
    done = subprocess.run(
        [sys.executable, "-c", VARIABLES],
        env={**os.environ, **variables, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    given = dict(line.split("=", 1) for line in done.stdout.split("\0") if "=" in line)
    assert {given[name] for name in process.THREADS} == {"1"}
    assert int(given["MALLOC_TRIM_THRESHOLD_"]) > 2**26
    assert given["MALLOC_MMAP_MAX_"] == "0"  # older glibc takes no threshold beyond 32 MB


def end_process(task: Task) -> Verdict:
    os._exit(7)


def test_a_run_whose_process_ends_again_and_again_is_a_row(place, monkeypatch):
    """So is one that ends in a fault of the program."""
    monkeypatch.setattr(process, "DEATHS", 2)
    task, child = a_task(place), WorkerProcess()
    try:
        assert process.call(child, end_process, task).status == "died"
        row = Store(Path(task.store)).find(task.key)
        assert row is not None
        assert row.reason == "its process ended 2 times (exit code 7)"
        bad = Task(
            **{
                **vars(a_task(place, "finger.posture.PIP=31 deg")),
                "case": {"title": "no case at all"},
            }
        )
        verdict = process.call(child, partial(do_with_memory, process.run), bad)
        assert (verdict.status, verdict.reason[:17]) == ("died", "ValidationError: ")
    finally:
        child.end()


@pytest.mark.usefixtures("undrawn")
def test_arrays_are_kept_where_asked_for(place):
    cosim("pip.toml")
    text = STUDY.replace("[param", 'arrays = ["angle"]\n[param', 1)
    (place / "pip.toml").write_text(text, encoding="utf-8")
    assert "4 runs solved" in cosim("pip.toml").output
    found = open_study(place / "studies" / "pip")
    data = found.arrays(1)
    assert list(data.data_vars) == ["angle"]
    assert float(data.angle.sel(joint="PIP")[-1]) == pytest.approx(radians(30))
    assert "0 runs solved" in cosim("pip.toml").output


@pytest.mark.usefixtures("undrawn")
def test_a_parameter_may_be_now_a_word_and_now_a_number(place):
    mixed = '[parameters.word]\nvalues = ["off", 3]\nsettings = ["title={value}"]\n[outputs]'
    (place / "pip.toml").write_text(STUDY.replace("[outputs]", mixed), encoding="utf-8")
    done = cosim("pip.toml")
    assert done.exit_code in (0, 1), done.output
    table = open_study(place / "studies" / "pip").table
    assert table.word.tolist() == 4 * ["off", "3.0"]


def listening(process: psutil.Process) -> list:
    """Its open ports."""
    found = process.net_connections(kind="inet")
    return [connection for connection in found if connection.status == psutil.CONN_LISTEN]


def test_by_processes_the_table_is_the_same_to_the_byte_and_no_port_opens(place, monkeypatch):
    cosim("pip.toml")
    counts = []

    def look(count: Count) -> None:
        own = psutil.Process()
        counts.append(sum(len(listening(p)) for p in (own, *own.children(recursive=True))))

    before = len(listening(psutil.Process()))
    monkeypatch.setattr("cosim.commands.study.progress", lambda name, store: nullcontext(look))
    done = CliRunner().invoke(
        app, ["study", "pip.toml", "--workers", "2", "--out", "two"], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    assert counts == 5 * [before]  # as it begins, and at the end of each run
    for name in ("table.parquet", "table.csv", "answers.json"):
        one, two = (place / folder / "pip" / name for folder in ("studies", "two"))
        assert one.read_bytes() == two.read_bytes()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_workers_of_a_scheduler_solve_in_processes_of_their_own(place):
    """Those of the user's own cluster, here of one worker under a nanny, on the loopback."""
    distributed = pytest.importorskip("distributed")
    limited = STUDY.replace("[param", 'limits = { time = "60 s" }\n[param', 1)
    (place / "pip.toml").write_text(limited, encoding="utf-8")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address_of = ["--scheduler", cluster.scheduler_address]
        done = CliRunner().invoke(app, ["study", "pip.toml", *address_of], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    found = open_study(place / "studies" / "pip")
    assert found.values("torque") == pytest.approx(-40 * np.radians([20, 30, 40, 50]), rel=1e-9)


def test_a_number_that_is_none_does_not_end_a_study() -> None:
    """JSON has no NaN: a worker died of it, twice, and the run was booked as dead."""
    found = _numbers({"slip_ratio": float("nan"), "wall_s": np.float64(1.0)})
    assert found == {"slip_ratio": None}


@given(st.lists(st.tuples(st.floats(-9, 9), st.sampled_from(["a", "b", None])), min_size=1))
def test_runs_in_turn_are_the_runs(points):
    turn = in_turn(points)
    assert turn[0] == points[0]
    assert sorted(map(repr, turn)) == sorted(map(repr, points))
