"""Studies that are killed, that fail and that go on for long."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from cosim.analyses.reduction.case_text import case_text
from cosim.analyses.reduction.reduce import reduce_case
from cosim.case.file import find_case, load_case
from cosim.checks import Row, Study
from cosim.port import ConvergenceError
from cosim.study import open_study
from cosim.study.cache_key import address, code_version, stated
from cosim.study.plan import Plan, read_plan
from cosim.study.store import Store
from cosim.study.task import Task, settle

if TYPE_CHECKING:
    import pandas as pd

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
EXACT = "an unbroken run of the same study"
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


def broken(study: str, folder: Path, *words: str, kills: int = KILLS) -> Broken:
    """The study (with more words of its command) unbroken, then killed with all its processes at
    random moments, on two workers.

    Raises ConvergenceError where it does not end well."""
    whole, cut = folder / "whole", folder / "cut"
    begun = monotonic()
    _finish([study, *words], whole)
    span = max(monotonic() - begun - START, 1.0)
    moments = START + np.random.default_rng(SEED).uniform(0, 0.9 * span / (kills + 1), kills)
    hit = sum(_killed([study, *words], cut, float(moment)) for moment in moments)
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
    if done.returncode:
        raise ConvergenceError(f"cosim study {' '.join(study)}: {done.stderr.strip()[-500:]}")


def _killed(study: list[str], out: Path, seconds: float) -> bool:
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


def _broken_rows(name: str, found: Broken) -> Iterator[Row]:
    yield Row(
        name, "times killed", KILLS, found.kills, 0.0, "SIGKILL to all its processes", "absolute"
    )
    yield Row(name, "tables that differ", 0.0, 1.0 - found.is_same, 0.0, EXACT, "absolute")
    yield Row(
        name,
        f"finished runs repeated, of {found.runs}",
        0.0,
        found.repeated,
        0.0,
        EXACT,
        "absolute",
    )
    most = "each kill costs the runs of two workers at most"
    yield Row(name, "runs cut off", 2.0 * KILLS, found.lost, 0.0, most, "bound")


def reduced_rows() -> Iterator[Row]:
    """640 runs of eight parameters, on a network that is reduced here from a coarse shell."""
    with TemporaryDirectory() as folder:
        case = Path(folder) / "reduced.toml"
        found = reduce_case(find_case(REDUCED[0]), REDUCED[1:], GRID, 2, spread=SPREAD)
        text = case_text(found, "a reduced hood", REDUCED[0], REDUCED[1:])
        case.write_text(text, encoding="utf-8")
        yield from _broken_rows(
            "killed, Saltelli of a reduced network",
            broken("loads_saltelli", Path(folder), "--case", str(case)),
        )


def shell_rows() -> Iterator[Row]:
    """200 runs of the shell."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "shell.toml"
        file.write_text(SHELL, encoding="utf-8")
        yield from _broken_rows("killed, the shell", broken(str(file), Path(folder)))


def failing_rows() -> Iterator[Row]:
    """Every third run has a posture that the finger does not reach."""
    name = "every third run fails"
    with TemporaryDirectory() as folder:
        place = Path(folder)
        file = place / "third.toml"
        file.write_text(THIRD, encoding="utf-8")
        done = subprocess.run(_command([str(file)], place), capture_output=True, check=False)
        yield Row(name, "exit code", 1.0, done.returncode, 0.0, "a run has no answer", "absolute")
        found = open_study(place / "third")
        failed = found.table.status.ne("converged").to_numpy()
        expected = np.arange(len(failed)) % 3 == 2
        wrong = int((failed != expected).sum())
        yield Row(
            name, "runs with another end", 0.0, wrong, 0.0, "postures beyond 110 deg", "absolute"
        )
        reasons = len({reason for _, reason in found.failures})
        yield Row(name, "reasons told", 1.0, reasons, 0.0, "one reason for all", "absolute")
        yield from _right_rows(name, found.table[~failed], read_plan(file))


def _right_rows(name: str, rows: pd.DataFrame, plan: Plan) -> Iterator[Row]:
    """The others, against runs of the case itself."""
    from cosim.pipeline import run_case

    off = 0.0
    for row in rows.to_dict("records"):
        point = tuple(row[p.name] for p in plan.parameters)
        summary = run_case(load_case(plan.case, plan.settings_at(point))).summary
        off = max(off, abs(summary["joint_torque_Nmm"]["hood"]["PIP"] - row["torque"]))
    yield Row(name, "the rest, largest difference, N mm", 0.0, off, 0.0, "cosim run", "absolute")


def memory_rows() -> Iterator[Row]:
    """One process that solves one run after the other, as a worker's does."""
    import psutil

    plan, code = read_plan("network_saltelli"), code_version()
    process, sizes = psutil.Process(), []
    with TemporaryDirectory() as folder:
        store = Store(Path(folder) / "store").open()
        for point in plan.points[:RUNS]:
            case = load_case(plan.case, plan.settings_at(point))
            values = json.loads(json.dumps(stated(case)))
            key = address(case, code)
            settle(Task(key, values, plan.name, str(plan.case), str(store.root), code), store)
            sizes.append(process.memory_info().rss / 1024)
    slope = np.polyfit(np.arange(SETTLED, RUNS), sizes[SETTLED:], 1)[0]
    what = f"memory over runs {SETTLED} to {RUNS}, kB a run"
    yield Row(
        "memory of a worker",
        what,
        GROWTH,
        float(slope),
        0.0,
        "flat: a tenth of a GB in ten thousand runs",
        "bound",
    )


STUDIES = (
    Study("study whose third run fails", failing_rows),
    Study("study killed five times, reduced network", reduced_rows),
    Study("memory of a worker", memory_rows),
    Study("study killed five times, shell", shell_rows, slow=True),
)
