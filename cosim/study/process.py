"""A run in a process of its own, which can be ended: what a Dask worker does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO

from cosim.errors import InputError
from cosim.processes import BLAS_THREADS, MALLOC_SETTINGS
from cosim.study.store import Status, Store
from cosim.study.task import Task, Verdict, row_of

DEATHS = 3
"""Times that the process of a run may end on its own before the run counts as failed."""
PATIENCE = 5.0
"""Seconds for a process to end by itself once its input has."""
THREADS = (*BLAS_THREADS, "NUMBA_NUM_THREADS", "FE_SOLVER_THREADS")
"""One of each: the workers are as many as there are cores for them."""
_here = threading.local()


class Child:
    """A process that solves one run after the other."""

    def __init__(self) -> None:
        self.told: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        root = str(Path(__file__).parents[2])
        paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "cosim.study.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.told,
            env=os.environ | {"PYTHONPATH": paths} | dict.fromkeys(THREADS, "1") | MALLOC_SETTINGS,
            text=True,
            encoding="utf-8",
        )
        self.is_ready = False

    def ask(self, task: Task) -> tuple[str, bool]:
        """The child's answer, "" where it ended; and whether it was ended for its time."""
        late = threading.Event()

        def end() -> None:
            late.set()
            self.process.kill()

        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.is_ready = self.is_ready or bool(self.process.stdout.readline())
        timer = threading.Timer(task.limit or threading.TIMEOUT_MAX, end)
        timer.daemon = True
        timer.start()
        try:
            print(json.dumps(asdict(task)), file=self.process.stdin, flush=True)
            answer = self.process.stdout.readline()
        except OSError:  # the process has ended; on Windows not a BrokenPipeError
            answer = ""
        finally:
            timer.cancel()
        return ("" if late.is_set() else answer), late.is_set()

    def end(self) -> str:
        """End it; what is known of why it ended."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with suppress(OSError):
            self.process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(PATIENCE)
        self.process.kill()
        code = self.process.wait()
        self.process.stdout.close()
        self.told.seek(0)
        lines = self.told.read().decode(errors="replace").split("\n")
        self.told.close()
        last = next((line for line in reversed(lines) if line.strip()), "")
        return f"signal {-code}" if code < 0 else f"exit code {code}: {last[:300]}"


def _child() -> Child:
    """The child process of this thread."""
    found: Child | None = getattr(_here, "child", None)
    if found is None:
        found = _here.child = Child()
    return found


def _end() -> str:
    """End that of this thread; why it ended, if it had."""
    found, _here.child = _here.child, None
    return found.end()


def close() -> None:
    """End the process of this thread, if there is one."""
    if getattr(_here, "child", None) is not None:
        _end()


def solve(task: Task) -> Verdict:
    """The run's verdict; its row is in the store then.  A run that is over its time, or whose
    process ended `DEATHS` times, has one as well.

    Raises InputError where the store cannot be written."""
    why = ""
    for _ in range(DEATHS):
        answer, late = _child().ask(task)
        if late:
            _end()
            return _put(task, "timeout", f"took longer than {task.limit:g} s", task.limit or 0.0)
        if answer:
            found = json.loads(answer)
            if "fault" in found:
                raise InputError(found["fault"])
            return Verdict(**found)
        why = _end()
    return _put(task, "died", f"its process ended {DEATHS} times ({why})", 0.0)


def _put(task: Task, status: Status, reason: str, seconds: float) -> Verdict:
    row = row_of(task, status, reason, seconds, {})
    Store(Path(task.store)).put(row)
    return Verdict(row.key, row.status, reason, seconds)
