"""What it costs to hand out runs, and what a second worker gains."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from cosim.study.conduct import Count, conduct
from cosim.study.engine import local
from cosim.study.plan import read_plan
from cosim.study.store import Store

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
"""Of the shell."""


@dataclass(frozen=True)
class Timed:
    """A study by so many workers, from the end of each one's first run on: a process loads the
    program, and compiles, in its first."""

    seconds: float
    """On the clock."""
    solving: float
    """Of all runs, s, as each took it."""
    runs: int


def timed(workers: int, text: str) -> Timed:
    """A study on an empty store.  Raises InputError."""
    with TemporaryDirectory() as place:
        file = Path(place) / "bench.toml"
        file.write_text(text, encoding="utf-8")
        plan, store = read_plan(file), Store(Path(place) / "store").open()
        ends: list[float] = []

        def tell(count: Count) -> None:
            if count.done > len(ends):
                ends.append(time.perf_counter())

        with local(workers, lambda text: None) as solve:
            done = conduct(plan, store, solve, False, tell)
        taken = sorted(_ended(store), key=lambda end: end[1])
        seconds = {row.key: row.seconds for row in store.rows(done.keys.values())}
        counted = [seconds[key] for key, _ in taken[workers:]]
        return Timed(ends[-1] - ends[workers - 1], sum(counted), len(counted))


def _ended(store: Store) -> Iterator[tuple[str, float]]:
    """Key and time of every run in the book of executions."""
    for line in (store.root / "executions.log").read_text(encoding="utf-8").splitlines():
        word, key, *_, at = line.split()
        if word == "ended":
            yield key, float(at)


def figures(tell: Callable[[str], None]) -> Iterator[tuple[str, float]]:
    """Name and value of every figure."""
    text = STUDY.format(runs=RUNS)
    tell(f"{RUNS} runs of the shell by one worker")
    one = timed(1, text)
    yield "seconds of a run, one worker", one.solving / one.runs
    yield "cost of handing out, of the run's time", one.seconds / one.solving - 1
    tell(f"{RUNS} runs of the shell by two workers")
    two = timed(2, text)
    yield "seconds of a run, two workers", two.solving / two.runs
    yield "cost of handing out, two workers", 2 * two.seconds / two.solving - 1
    yield (
        "runs per second, two workers over one",
        (two.runs / two.seconds) / (one.runs / one.seconds),
    )
