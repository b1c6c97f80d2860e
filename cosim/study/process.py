"""A run in a process of its own, which can be ended: a solve may hang or crash in compiled code."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import partial
from multiprocessing import current_process
from pathlib import Path

from cosim.case.cache_key import code_version
from cosim.errors import CosimError, InputError
from cosim.outcome import Status
from cosim.processes import (
    BLAS_THREADS,
    MALLOC_SETTINGS,
    Memory,
    ProcessEndedError,
    TimeLimitError,
    WorkerProcess,
    do_with_memory,
)
from cosim.study.store import Store
from cosim.study.task import Task, Verdict, row_of, run_task

DEATHS = 3
"""Times that the process of a run may end on its own before the run counts as failed."""
THREADS = (*BLAS_THREADS, "NUMBA_NUM_THREADS", "FE_SOLVER_THREADS")
"""One of each: the workers are as many as there are cores for them."""
ENVIRONMENT = {**dict.fromkeys(THREADS, "1"), **MALLOC_SETTINGS}
"""The environment of the processes that solve, whatever a worker of Dask was given."""
_here = threading.local()


def run(memory: Memory, task: Task) -> Verdict:
    """What the process does: its stores and its session stay with it.  Raises InputError where the
    store cannot be written."""
    from cosim.solve.session import Session

    session = memory.setdefault("session", Session())
    return run_task(task, memory.setdefault(task.store, Store(Path(task.store))), session)


def call(process: WorkerProcess, function: Callable[[Task], Verdict], task: Task) -> Verdict:
    """The run's verdict; its row is in the store then.  A run that is over its time, that ends in a
    fault of the program or whose process ended `DEATHS` times has one as well.

    Raises InputError where the store cannot be written."""
    why = ""
    for _ in range(DEATHS):
        try:
            return process.call(function, task, limit=task.limit)
        except TimeLimitError as error:
            return _put(task, "timeout", str(error), task.limit or 0.0)
        except ProcessEndedError as error:
            why = error.why
        except CosimError:
            raise
        except Exception as error:  # a fault of the program: the study's other runs go on
            return _put(task, "died", f"{type(error).__name__}: {error}"[:300], 0.0)
    return _put(task, "died", f"its process ended {DEATHS} times ({why})", 0.0)


def solve(task: Task) -> Verdict:
    """The verdict of a run that a thread of a Dask worker does, which has a process for it.

    Raises InputError where the worker has other sources, and where the store cannot be written."""
    if task.code != code_version():
        raise InputError(
            f"a worker has cosim {code_version()}, this study is for {task.code}: install the same "
            "on both"
        )
    return call(_process(), partial(do_with_memory, run), task)


def _process() -> WorkerProcess:
    """That of this thread."""
    process: WorkerProcess | None = getattr(_here, "process", None)
    if process is None:
        current_process().daemon = False  # under a nanny it is, and could start no process
        process = _here.process = WorkerProcess({**os.environ, **ENVIRONMENT})
    return process


def close() -> None:
    """End the process of this thread, if there is one."""
    if getattr(_here, "process", None) is not None:
        _here.process.end()
        del _here.process


def _put(task: Task, status: Status, reason: str, seconds: float) -> Verdict:
    row = row_of(task, status, reason, seconds, {})
    Store(Path(task.store)).put(row)
    return Verdict(row.key, row.status, reason, seconds)
