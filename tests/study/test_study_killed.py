"""Studies that are killed, that fail and that go on for long: by the command, in processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from cosim.analyses.reduction.case_text import case_text
from cosim.analyses.reduction.reduce import reduce_case
from cosim.case.cache_key import address, case_table, code_version
from cosim.case.file import find_case, load_case
from cosim.pipeline import run_case
from cosim.study import open_study
from cosim.study.plan import read_plan
from cosim.study.store import Store
from cosim.study.task import Task, run_task

KILLS = 5
START = 5.0
"""Seconds in which a study on two workers has begun."""
SEED = 9
RUNS = 500
SETTLED = 100
"""Runs after which memory is looked at: caches are full."""
GROWTH = 10.0
"""kB for a run."""
REDUCED = ("isometric_edc", "hood.mesh.quads=250")
"""Which shell is reduced."""
GRID = {"MCP": (20.0, 40.0), "PIP": (35.0, 55.0), "DIP": (5.0, 25.0)}
"""deg, about what the study samples."""
SPREAD = 24
SHELL = """
case = "isometric_edc"
[sampling]
kind = "latin_hypercube"
n = 200
seed = 1
[parameters."tendons.EDC.tension"]
distribution = "uniform"
low = "3 N"
high = "4 N"
[parameters."hood.thickness"]
distribution = "uniform"
low = "0.6 mm"
high = "0.7 mm"
[outputs]
tip_force = "fingertip_magnitude_N"
"""
THIRD = """
case = "network_edc"
settings = ["finger.tip.kind=posture"]
[parameters."tendons.EDC.tension"]
from = "3 N"
to = "4 N"
count = 6
[parameters.PIP]
values = ["20 deg", "45 deg", "120 deg"]
settings = ["finger.posture.PIP={value}"]
[outputs]
torque = "joint_torque_Nmm.hood.PIP"
"""
"""The PIP goes to 110 deg."""


@dataclass(frozen=True)
class Broken:
    """What became of a study that was killed again and again."""

    is_same: bool
    """Its table, to the byte, as that of one that was not."""
    kills: int
    repeated: int
    """Runs that began again after they had ended."""
    lost: int
    """Runs that were cut off, and so begun more than once."""
    runs: int


def break_and_resume(study: str, folder: Path, *words: str, kills: int = KILLS) -> Broken:
    """The study (with more words of its command) unbroken, then killed with all its processes at
    random moments, on two workers."""
    whole, cut = folder / "whole", folder / "cut"
    begun = monotonic()
    _finish([study, *words], whole)
    span = max(monotonic() - begun - START, 1.0)
    moments = START + np.random.default_rng(SEED).uniform(0, 0.9 * span / (kills + 1), kills)
    hit = sum(_kill([study, *words], cut, float(moment)) for moment in moments)
    _finish([study, *words], cut)
    name = read_plan(study).name
    names = ("table.parquet", "table.csv")
    is_same = all((whole / name / n).read_bytes() == (cut / name / n).read_bytes() for n in names)
    repeated, lost = _executions(cut / "store")
    return Broken(is_same, hit, repeated, lost, len(open_study(cut / name).table))


def _command(study: list[str], out: Path) -> list[str]:
    words = ["study", *study, "--workers", "2", "--out", str(out)]
    return [sys.executable, "-P", "-c", "from cosim.cli import main; main()", *words]


def _finish(study: list[str], out: Path) -> None:
    done = subprocess.run(
        _command(study, out), capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    assert done.returncode == 0, done.stderr[-500:]


def _kill(study: list[str], out: Path, seconds: float) -> bool:
    """Whether it was still going on, and so was killed, with every process of its group."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        _command(study, out), stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        _kill_all(process.pid)
        process.wait()
        return True
    return False


def _kill_all(pid: int) -> None:
    """The process and all that it began; where there are groups of processes, all at once."""
    if sys.platform != "win32":
        os.killpg(pid, signal.SIGKILL)
        return
    import psutil

    first = psutil.Process(pid)
    for process in (first, *first.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            process.kill()


def _executions(store: Path) -> tuple[int, int]:
    """Of the book of executions: runs begun after they had ended; runs begun more often than they
    ended."""
    ended: set[str] = set()
    counts: Counter[str] = Counter()
    repeated = 0
    for line in (store / "executions.log").read_text(encoding="utf-8").splitlines():
        word, key = line.split()[:2]
        repeated += word == "begun" and key in ended
        counts[key] += 1 if word == "begun" else -1
        if word == "ended":
            ended.add(key)
    return repeated, sum(counts.values())


def check_nothing_is_lost(found: Broken) -> None:
    """Each kill costs the runs of two workers at most."""
    assert found.kills == KILLS
    assert found.is_same
    assert found.repeated == 0
    assert found.lost <= 2 * KILLS


@pytest.mark.slow
def test_a_study_of_a_reduced_network_is_killed_and_loses_nothing(tmp_path: Path) -> None:
    """640 runs of eight parameters, on a network that is reduced here from a coarse shell."""
    case = tmp_path / "reduced.toml"
    found = reduce_case(find_case(REDUCED[0]), REDUCED[1:], GRID, 2, spread=SPREAD)
    text = case_text(found, "a reduced hood", REDUCED[0], REDUCED[1:])
    case.write_text(text, encoding="utf-8")
    check_nothing_is_lost(break_and_resume("loads_saltelli", tmp_path, "--case", str(case)))


@pytest.mark.slow
def test_a_study_of_the_shell_is_killed_and_loses_nothing(tmp_path: Path) -> None:
    """200 runs."""
    file = tmp_path / "shell.toml"
    file.write_text(SHELL, encoding="utf-8")
    check_nothing_is_lost(break_and_resume(str(file), tmp_path))


@pytest.mark.slow
def test_a_study_whose_third_run_fails_counts_it_and_has_the_others(tmp_path: Path) -> None:
    file = tmp_path / "third.toml"
    file.write_text(THIRD, encoding="utf-8")
    done = subprocess.run(_command([str(file)], tmp_path), capture_output=True, check=False)
    assert done.returncode == 1
    found = open_study(tmp_path / "third")
    failed = found.table.status.ne("converged").to_numpy()
    assert (failed == (np.arange(len(failed)) % 3 == 2)).all()
    assert len({reason for _, reason in found.failures}) == 1
    plan = read_plan(file)
    for row in found.table[~failed].to_dict("records"):
        point = tuple(row[p.name] for p in plan.parameters)
        summary = run_case(load_case(plan.case, plan.settings_at(point))).summary
        assert summary["joint_torque_Nmm"]["hood"]["PIP"] == row["torque"]


@pytest.mark.slow
def test_a_process_that_solves_one_run_after_the_other_keeps_its_size(tmp_path: Path) -> None:
    """To a tenth of a GB in ten thousand runs."""
    import psutil

    plan, code = read_plan("network_saltelli"), code_version()
    process, sizes = psutil.Process(), []
    store = Store(tmp_path / "store").open()
    for point in plan.points[:RUNS]:
        case = load_case(plan.case, plan.settings_at(point))
        values = json.loads(json.dumps(case_table(case)))
        key = address(case, code)
        run_task(Task(key, values, plan.name, str(plan.case), str(store.root), code), store)
        sizes.append(process.memory_info().rss / 1024)
    slope = np.polyfit(np.arange(SETTLED, RUNS), sizes[SETTLED:], 1)[0]
    assert slope <= GROWTH
