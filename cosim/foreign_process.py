"""A process of its own for what may crash, hang or leave: a library of VTK, a foreign FMU."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import IO, Any

from cosim.errors import InputError

START = "from cosim.foreign_process import serve; serve()"
END_LIMIT = 2.0
"""Seconds for a process that has nothing to do to end."""
HEARTBEAT = 0.5
"""Seconds between two looks at whether the parent is there."""
LOOK = 0.25
"""Seconds between two looks at what a call has spent of its limit."""
BUSY = 0.01
"""Share of the time between two looks, in which a process that got less of a processor sleeps."""
HANG = 10.0
"""Times its limit that a call may take where the system does not say what it has of a processor."""
TAIL = 50
"""Last pieces of what the process printed that are kept, for the reason of its end."""


class ForeignError(InputError):
    """A call failed, or its process ended or was ended: the reason alone, to stand after what was
    asked of whom."""


class ForeignProcess:
    """A process that does one call after the other, each within a limit of its own time: that in
    which it computes or sleeps, but not that in which it waits for a processor, so that a slow or
    crowded machine is no fault of a call.  It ends with this process, however that ends, and what
    its libraries print goes nowhere but into the reason of its end.

    >>> process = ForeignProcess()
    >>> process.call("math:sqrt", 4.0, limit=60.0)
    2.0
    >>> process.end()
    """

    def __init__(self) -> None:
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        group: dict[str, Any] = {"process_group": 0}  # Ctrl-C is the parent's
        if sys.platform == "win32":
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", START, str(os.getpid())],
            env={**os.environ, "PYTHONPATH": paths, "PYTHONSAFEPATH": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **group,
        )
        self._answers: SimpleQueue[Any] = SimpleQueue()
        self._printed: deque[bytes] = deque(maxlen=TAIL)
        self._numbers, self._lock, self._parent = count(), Lock(), os.getpid()
        self._readers = [
            Thread(target=_read_answers, args=(self._process.stdout, self._answers), daemon=True),
            Thread(target=_keep_tail, args=(self._process.stderr, self._printed), daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    @property
    def is_alive(self) -> bool:
        """Whether it can take a call of this process."""
        return self._parent == os.getpid() and self._process.poll() is None

    def call(self, function: str, *args: Any, limit: float) -> Any:
        """What `function` (module:name) returns there, within `limit` s of its own time.

        Raises ForeignError."""
        with self._lock:
            number = next(self._numbers)
            try:
                self._send((number, function, args))
            except (OSError, ValueError):  # it has ended, or was ended
                raise ForeignError(self._end_reason()) from None
            return self._answer(number, limit)

    def _send(self, request: tuple[int, str, tuple[Any, ...]] | None) -> None:
        assert self._process.stdin is not None
        pickle.dump(request, self._process.stdin)
        self._process.stdin.flush()

    def _answer(self, number: int, limit: float) -> Any:
        """The answer to a call.  A call that Ctrl-C interrupted is answered too, before it."""
        time_spent = OwnTime(self._process.pid)
        while True:
            try:
                left = limit - time_spent.seconds()
                answer = self._answers.get(timeout=max(min(left, LOOK), 0.0))
            except Empty:
                if time_spent.seconds() < limit:
                    continue
                self.kill()
                raise ForeignError(f"it did not answer within {limit:g} s") from None
            if answer is None:
                raise ForeignError(self._end_reason())
            if answer[0] == number:
                break
        _, succeeded, value = answer
        if not succeeded:
            raise ForeignError(value)
        return value

    def _end_reason(self) -> str:
        """How the process ended, which it did."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_LIMIT)
        self.kill()
        code = self._process.returncode
        how = f"with exit code {code}" if code >= 0 else f"by {signal.Signals(-code).name}"
        self._readers[1].join(HEARTBEAT)
        lines = b"".join(self._printed).decode(errors="replace").split("\n")
        said = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f"its process ended {how}" + (f", after it said {said[-200:]!r}" if said else "")

    def kill(self) -> None:
        """End the process at once, and what it has started; without effect in a fork."""
        if self._parent != os.getpid():
            return
        with suppress(OSError):
            if sys.platform == "win32":
                self._process.kill()
            elif self._process.returncode is None:
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._close()

    def end(self) -> None:
        """End the process, which has nothing to do."""
        try:
            with self._lock, suppress(OSError, ValueError):
                self._send(None)
            self._close()
            self._process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self.kill()

    def _close(self) -> None:
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.close()


class OwnTime:
    """What a process has spent of its own time since this was made."""

    def __init__(self, pid: int) -> None:
        self._pid, self._spent = pid, 0.0
        self._at, self._of_processor = time.monotonic(), processor_time(pid)

    def seconds(self) -> float:
        """What it computed, in spans in which it did; and of others how long they were, without
        the wait for a processor."""
        now, of_processor = time.monotonic(), processor_time(self._pid)
        span = now - self._at
        if of_processor is None or self._of_processor is None:
            spent = span / HANG
        else:
            computed = of_processor[0] - self._of_processor[0]
            waited = of_processor[1] - self._of_processor[1]
            spent = computed if computed >= BUSY * span else span - waited
        self._spent += min(max(spent, 0.0), span)
        self._at, self._of_processor = now, of_processor
        return self._spent


def processor_time(pid: int) -> tuple[float, float] | None:
    """The seconds that a process's first thread computed, and waited for a processor; None where
    the system does not say it."""
    try:
        words = Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()
        return float(words[0]) / 1e9, float(words[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return None


def _read_answers(stream: IO[bytes], answers: SimpleQueue[Any]) -> None:
    """Hand on the answers of a process, and None at their end."""
    with suppress(Exception), stream:  # whatever an end within an answer looks like
        while True:
            answers.put(pickle.load(stream))
    answers.put(None)


def _keep_tail(stream: IO[bytes], pieces: deque[bytes]) -> None:
    with suppress(OSError, ValueError), stream:
        while piece := os.read(stream.fileno(), 4096):
            pieces.append(piece)


_LEFT_BEHIND: list[Path] = []


def remove_at_orphaning(folder: Path) -> None:
    """Remove a folder if the parent of this process ends before it."""
    _LEFT_BEHIND.append(folder)


def serve() -> None:
    """What the process does until its parent wants no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a library prints is no answer
    Thread(target=_watch_parent, args=(int(sys.argv[1]),), daemon=True).start()
    try:
        while (request := pickle.load(requests)) is not None:
            number, function, args = request
            pickle.dump((number, *_do(function, args)), answers)
            answers.flush()
    except (OSError, EOFError, pickle.UnpicklingError):
        _end_orphaned()
    if sys.platform != "win32":
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, 5 * END_LIMIT)  # a library may hang as it is unloaded


def _do(function: str, args: tuple[Any, ...]) -> tuple[bool, Any]:
    """Whether a call succeeded; what it returned, or the last line of why it failed."""
    module, _, name = function.partition(":")
    try:
        call: Callable[..., Any] = getattr(import_module(module), name)
        return True, call(*args)
    except (Exception, SystemExit) as error:
        return False, str(error) or type(error).__name__


def _watch_parent(parent: int) -> None:
    """End this process when its parent is gone, whatever it does."""
    if sys.platform == "win32":
        import _winapi

        handle = _winapi.OpenProcess(0x00100000, False, parent)  # SYNCHRONIZE
        _winapi.WaitForSingleObject(handle, _winapi.INFINITE)
    else:
        while os.getppid() == parent:
            time.sleep(HEARTBEAT)
    _end_orphaned()


def _end_orphaned() -> None:
    for folder in _LEFT_BEHIND:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)
