"""What it costs to hand out runs, what a second worker gains, and what the machine lets it gain."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import typer

from cosim.errors import CosimError, Progress
from cosim.processes import WorkerProcess, do_with_memory
from cosim.study import process as apart
from cosim.study.engine import Solve, local
from cosim.study.execute import check_libraries, execute_study
from cosim.study.files import table_of, write_table
from cosim.study.plan import read_plan
from cosim.study.store import Store
from cosim.study.task import Task, Verdict

RUNS = 64
STUDY = """
case = "isometric_edc"
[parameters."tendons.EDC.tension"]
from = "3 N"
to = "4 N"
count = {runs}
[outputs]
tip_force = "fingertip_magnitude_N"
"""
"""A study of the shell hood."""
LOADS = "superposition"
"""The packaged study of 500 combined loads."""
HOUR, MANY = 3600, 128
"""s; workers for whom a rate is planned and not measured."""
SECONDS, PER_HOUR = "seconds", "runs per hour"
"""How the names of figures begin that are times, or rates."""
PLAN = (
    "planned by Amdahl's law, 1 / (h + s / n) runs per second: n workers, s the seconds of a run, "
    "h what it costs one worker beside them, all of it taken to be serial; slower memory of a full "
    "machine is not in it"
)
Engine = Callable[[int], AbstractContextManager[Solve]]
"""What solves runs, by so many workers."""


@dataclass(frozen=True)
class StudyTiming:
    """A study by so many workers, from the end of each one's first run on: a process loads the
    program, and compiles, in its first."""

    seconds: float
    """s, by the clock."""
    solving: float
    """s, the sum over all runs of what each took."""
    runs: int

    @property
    def rate(self) -> float:
        """Runs per second."""
        return self.runs / self.seconds


def time_study(engine: Engine, workers: int, text: str) -> StudyTiming:
    """A study on an empty store.  Raises InputError."""
    with TemporaryDirectory() as place:
        file = Path(place) / "bench.toml"
        file.write_text(text, encoding="utf-8")
        return _time_study(engine, workers, file, Path(place))


def _time_study(engine: Engine, workers: int, study: str | Path, folder: Path) -> StudyTiming:
    """Solve a study whose store and table go to a folder.  Raises InputError."""
    plan, store = read_plan(study), Store(folder / "store").open()
    with engine(workers) as solve:
        done = execute_study(plan, store, solve, False, lambda count: None)
    write_table(table_of(plan, done, store), folder)
    taken = sorted(_run_ends(store), key=lambda end: end[1])
    seconds = {row.key: row.seconds for row in store.rows(done.keys.values())}
    counted = [seconds[key] for key, _ in taken[workers:]]
    return StudyTiming(taken[-1][1] - taken[workers - 1][1], sum(counted), len(counted))


def _run_ends(store: Store) -> Iterator[tuple[str, float]]:
    """Key and time of every run in the book of executions."""
    for line in (store.root / "executions.log").read_text(encoding="utf-8").splitlines():
        word, key, *_, at = line.split()
        if word == "ended":
            yield key, float(at)


def plain(workers: int) -> AbstractContextManager[Solve]:
    """The same processes with the runs dealt out beforehand: what the machine gives."""

    def solve(tasks: Iterator[Task]) -> Iterator[Verdict]:
        dealt = list(tasks)
        shares = [dealt[i::workers] for i in range(workers)]
        with ThreadPoolExecutor(workers) as pool:
            return chain.from_iterable(pool.map(_share, shares))

    return nullcontext(solve)


def _share(tasks: list[Task]) -> list[Verdict]:
    process = WorkerProcess({**os.environ, **apart.ENVIRONMENT})
    try:
        return [apart.call(process, partial(do_with_memory, apart.run), task) for task in tasks]
    finally:
        process.end()


def planned_rate(one: StudyTiming, workers: int) -> float:
    """Runs per second of so many workers by Amdahl's law, from the timing of one: what a run costs
    beside its solving is taken to be serial."""
    serial = max(one.seconds - one.solving, 0.0) / one.runs
    return 1 / (serial + one.solving / one.runs / workers)


def figures(tell: Progress, runs: int = RUNS) -> Iterator[tuple[str, float]]:
    """Name and value of every figure; studies of so many runs.  Raises InputError."""
    check_libraries()
    text = STUDY.format(runs=runs)
    tell(f"{runs} runs of the shell by one worker")
    one = time_study(local, 1, text)
    yield f"{SECONDS} of a run, one worker", one.solving / one.runs
    yield "cost of handing out, of the run's time", one.seconds / one.solving - 1
    tell(f"{runs} runs of the shell by two workers")
    two = time_study(local, 2, text)
    yield f"{SECONDS} of a run, two workers", two.solving / two.runs
    yield "cost of handing out, two workers", 2 * two.seconds / two.solving - 1
    yield "runs per second, two workers over one", two.rate / one.rate
    tell(f"{2 * runs} runs of the shell by one process and two without an engine")
    ceiling = time_study(plain, 2, text).rate / time_study(plain, 1, text).rate
    yield "runs per second, two plain processes over one", ceiling
    yield f"{PER_HOUR}, one worker", HOUR * one.rate
    yield f"{PER_HOUR}, two workers", HOUR * two.rate
    planned = planned_rate(one, MANY)
    yield f"{PER_HOUR}, {MANY} workers (planned)", HOUR * planned
    yield f"runs per second, {MANY} workers over one (planned)", planned / one.rate


def load_figures(tell: Progress, study: str | Path = LOADS) -> Iterator[tuple[str, float]]:
    """Name and value of every figure of a study by one and by two workers.  Raises CosimError where
    their tables are not the same to the byte, and InputError."""
    check_libraries()
    tables, timings = [], []
    for workers in (1, 2):
        tell(f"{study} by {workers} of 2 workers")
        with TemporaryDirectory() as place:
            folder = Path(place)
            timings.append(_time_study(local, workers, study, folder))
            tables.append((folder / "table.csv").read_bytes())
    if tables[0] != tables[1]:
        raise CosimError(f"{study}: one worker and two leave different tables")
    one, two = timings
    yield f"{SECONDS} of a run, one worker", one.solving / one.runs
    yield "runs per second, two workers over one", two.rate / one.rate
    yield "time of a run by two workers over one", two.solving / two.runs * one.runs / one.solving


def bench_studies(runs: int | None = None) -> dict[str, float]:
    """Print what it costs to hand out runs, what a second worker gains and how many runs an hour
    more would solve; the ratios by name."""
    measured = dict(figures(lambda text: typer.echo(text, err=True), runs or RUNS))
    for name, value in measured.items():
        typer.echo(f"{name:<58} {value:.4g}")
    typer.echo(PLAN)
    times = (SECONDS, PER_HOUR)
    return {name: value for name, value in measured.items() if not name.startswith(times)}


def bench_loads() -> dict[str, float]:
    """Print what the packaged study of combined loads costs by one and by two workers; the ratios
    by name.  Raises CosimError where the two tables differ."""
    measured = dict(load_figures(lambda text: typer.echo(text, err=True)))
    for name, value in measured.items():
        typer.echo(f"{name:<58} {value:.4g}")
    return {name: value for name, value in measured.items() if not name.startswith(SECONDS)}
