"""Runs done side by side: by processes of this machine, by the workers of a Dask scheduler that the
user has started, or here one after the other.

Runs are handed out as others end, so that a hundred thousand of them are never in a scheduler at
once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.errors import CosimError, InputError, Progress
from cosim.processes import process_pool
from cosim.study import process as apart
from cosim.study.store import Store
from cosim.study.task import Task, Verdict, row_of, run_task

if TYPE_CHECKING:
    from distributed import Client, Future

Solve = Callable[[Iterator[Task]], Iterator[Verdict]]
"""Verdicts as runs end, in any order; it takes a task only where there is room for it."""
AHEAD = 2
"""Runs handed out for each worker: one that it does, one that waits."""
LOOK = 2.0
"""Seconds after which the number of workers is asked for again."""
SCHEDULER_LIMIT = "20s"
"""For a scheduler to answer."""


def in_this_process(tasks: Iterator[Task]) -> Iterator[Verdict]:
    """One after the other in this process: no time limit, and a crash is one of this process."""
    from cosim.solve.session import Session

    session = Session()
    for task in tasks:
        yield run_task(task, Store(Path(task.store)), session)


@contextmanager
def local(workers: int) -> Iterator[Solve]:
    """So many processes on this machine, of a pool that opens no port."""
    with process_pool(workers, apart=True, environment=apart.ENVIRONMENT) as pool:
        run = pool.with_memory(apart.run)
        yield lambda tasks: pool.as_completed(run, ([t] for t in tasks), AHEAD, apart.call)


@contextmanager
def remote(scheduler: str, tell: Progress) -> Iterator[Solve]:
    """The workers of a Dask scheduler, as they come and go.  Raises InputError."""
    from distributed import Client

    try:
        client = Client(scheduler, timeout=SCHEDULER_LIMIT)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: does not answer ({error})") from error
    with client:
        if find_spec("bokeh"):
            tell(f"live page of Dask: {client.dashboard_link}")
        if not client.nthreads():
            tell("the scheduler has no workers yet; waiting for the first")
        yield lambda tasks: _through(client, tasks)


def _through(client: Client, tasks: Iterator[Task]) -> Iterator[Verdict]:
    from distributed import as_completed

    running: dict[str, Task] = {}
    width, looked = _width(client), time.monotonic()
    first = list(islice(tasks, width))
    ended: Any = as_completed([_hand_out(client, task, running) for task in first])
    try:
        for future in ended:
            yield _verdict(future, running.pop(future.key))
            if time.monotonic() - looked > LOOK:
                width, looked = _width(client), time.monotonic()
            for task in islice(tasks, max(0, width - len(running))):
                ended.add(_hand_out(client, task, running))
    finally:
        client.cancel(list(running), force=True)


def _width(client: Client) -> int:
    return AHEAD * max(1, sum(client.nthreads().values()))


def _hand_out(client: Client, task: Task, running: dict[str, Task]) -> Future:
    name = f"cosim-{task.key[:40]}-{time.monotonic_ns():x}"
    running[name] = task
    return client.submit(apart.solve, task, key=name, pure=False)


def _verdict(future: Future, task: Task) -> Verdict:
    """How the run of a task ended.  Raises InputError where the store cannot be written, CosimError
    where the scheduler ended."""
    from distributed import KilledWorker

    if future.status == "finished":
        verdict: Verdict = future.result()
        return verdict
    error = future.exception() if future.status == "error" else None
    if isinstance(error, KilledWorker):
        reason = "workers were ended while they had it, more often than Dask allows"
        row = row_of(task, "died", reason, 0.0, {})
        Store(Path(task.store)).put(row)
        return Verdict(row.key, row.status, row.reason, row.seconds)
    if isinstance(error, CosimError):
        raise error
    raise CosimError(
        f"Dask gave up a run ({error or future.status}); what had finished is kept: give the same "
        "command again"
    )
