"""Processes of one's own, each of which does one call after the other and ends with this one: those
that solve, alone or in a pool, with their threads of BLAS and memory (`WorkerProcess`); and those
for what may crash, hang or leave, a library of VTK or a foreign FMU (`ForeignProcess`)."""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from _thread import interrupt_main
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from types import ModuleType
from typing import IO, TYPE_CHECKING, Any, TypeVar, cast
from weakref import WeakSet

from cosim.errors import CosimError, InputError, StoppedError
from cosim.interrupts import ASKING, ignore_requests

if TYPE_CHECKING:
    from concurrent.futures import Future
    from multiprocessing.connection import Connection
    from multiprocessing.context import BaseContext
    from multiprocessing.process import BaseProcess

    from threadpoolctl import ThreadpoolController

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
MALLOC_SETTINGS = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""Settings of glibc, which reads them when a process starts: no block of its own for any size, and
freed memory (bytes) stays with the process. Handed back and asked for again with each factorisation
it costs a fifth of that, and the kernel's work on page faults keeps processes side by side from
each other."""
PRELOADED = (
    "cosim.cli",
    "cosim.pipeline",
    "cosim.kernels.ready",
    "fe_solver.hood.build",
    "rigid.fingers.index",
    "rigid.mujoco.finger",
    "scipy.ndimage",
)
"""What the server of a pool imports before it forks: what the processes need, and nothing that
starts a thread."""
LONGEST_TEMPORARY = 60
"""Letters of the path of the folder for temporary files; the socket in it has some 40 more, and 107
are the most that Linux takes."""
YOUNG_COLLECTIONS = 200
"""Collections of garbage among younger objects before one among all (Python's own: 10)."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread for a block, or for a function that this decorates.

    How many threads share a sum decides its last bits, and a result must not depend on the
    environment.  It is faster, too: our dense products are small."""
    _BLAS.limit()
    try:
        yield
    finally:
        _BLAS.restore()


class _Blas:
    """BLAS, whose number of threads is the process's: limited by the first thread that asks for it,
    and restored by the last one that has."""

    def __init__(self) -> None:
        self._lock, self._users = Lock(), 0
        self._restore: Callable[[], None] | None = None

    def limit(self) -> None:
        with self._lock:
            self._users += 1
            if self._restore is None:
                self._restore = _blas().limit(limits=1, user_api="blas").restore_original_limits

    def restore(self) -> None:
        with self._lock:
            self._users -= 1
            if not self._users and self._restore is not None:
                self._restore()
                self._restore = None


_BLAS = _Blas()


@cache
def _blas() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (only a library that is loaded can be limited)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def prepare_process() -> None:
    """Let this process and those that it starts work with one thread of BLAS, whatever the
    environment says, and with memory that stays with them (`MALLOC_SETTINGS`, where it says
    nothing); and look through all objects for garbage seldom, a sixth of the time of imports."""
    from threadpoolctl import threadpool_limits

    gc.set_threshold(*gc.get_threshold()[:2], YOUNG_COLLECTIONS)
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))  # of what loads from now on
    threadpool_limits(1, user_api="blas")  # of what has loaded
    for name, value in MALLOC_SETTINGS.items():
        os.environ.setdefault(name, value)
    os.environ["MPLBACKEND"] = "agg"  # it opens no window; a notebook's may not be installed here
    os.environ.setdefault("MUJOCO_GL", "off")  # it loads its windows else, of which we open none


T = TypeVar("T")
R = TypeVar("R")
Memory = dict[str, Any]
"""What one process of a pool keeps from call to call."""
END_LIMIT = 5.0
"""Seconds for a process that has nothing to do to end."""
READY, STOP = b"ready", b"stop"
_memory: Memory = {}
_starting = Lock()
"""Held while a process starts, for which the environment and the main module are others."""


class ProcessEndedError(InputError):
    """The process of a call ended before it answered; `why`: its signal or exit code."""

    why = ""

    @classmethod
    def of(cls, code: int) -> ProcessEndedError:
        """The error of a process that ended with this code, or by a signal (negative)."""
        why = f"signal {-code}" if code < 0 else f"exit code {code}"
        error = cls(
            f"a process that solved was ended from outside ({why}), perhaps for lack of memory; "
            "one worker needs the least"
        )
        error.why = why
        return error


class TimeLimitError(CosimError):
    """A call was over its time, and its process was ended."""


class PoolEndedError(CosimError):
    """The pool of a call ended before it answered."""


class WorkerProcess:
    """A process of its own that does one call after the other: it starts with the first, and anew
    where it ended.  It ends with this process, however that ends.

    >>> process = WorkerProcess()
    >>> process.call(abs, -1, limit=60.0)
    1
    >>> process.end()
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """`environment`: the process's; None: that of this process now."""
        self._environment = dict(os.environ if environment is None else environment)
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._is_closed = False
        self._sending = Lock()

    def call(
        self,
        function: Callable[..., R],
        *args: Any,
        limit: float | None = None,
        hear: Callable[[Any], None] | None = None,
    ) -> R:
        """What the function returns there; `limit`: the seconds it has once the process is ready,
        or from one message to the next.  `hear` is called with what it tells by `tell_caller`.

        Raises what the function raises, TimeLimitError, ProcessEndedError and PoolEndedError."""
        content = pickle.dumps((function, args))
        try:
            pipe = self._start()
            with self._sending:
                pipe.send_bytes(content)
            while True:
                if not pipe.poll(limit):
                    self._stop(at_once=True)
                    raise TimeLimitError(f"took longer than {limit:g} s")
                kind, answer = pickle.loads(pipe.recv_bytes())
                if kind != "told":
                    break
                if hear is not None:
                    hear(answer)
        except (EOFError, OSError):
            raise self._end_reason() from None
        if kind == "failed":
            raise answer
        return cast(R, answer)

    def interrupt(self) -> None:
        """Let the function that runs there end with StoppedError; without effect on the next one.
        May be called from any thread."""
        with suppress(OSError), self._sending:
            if (pipe := self._pipe) is not None:
                pipe.send_bytes(STOP)

    def end_call(self) -> None:
        """End the process at once, from any thread: the call that waits for it raises
        ProcessEndedError, and the next one starts the process anew."""
        if (process := self._process) is not None:
            process.kill()

    def _start(self) -> Connection:
        """The pipe to the process, which is ready.  Raises EOFError where it ended before."""
        if self._pipe is None:
            context = process_context(self._environment)
            atexit.unregister(_kill_all)
            atexit.register(_kill_all)  # after that of multiprocessing, and so called before it
            self._pipe, theirs = context.Pipe()
            process = context.Process(  # type: ignore[attr-defined]
                target=_serve, args=(theirs, self._environment), daemon=True
            )
            with _starting, _unimportable_main():
                process.start()
            theirs.close()
            self._process = process
            _ALIVE.add(self)
            if self._is_closed:
                process.kill()
            self._pipe.recv_bytes()
        return self._pipe

    def _end_reason(self) -> CosimError:
        """Why the process ended on its own, or that it was ended with its pool."""
        code = self._stop()
        if self._is_closed:
            return PoolEndedError("the pool of processes has ended")
        return ProcessEndedError.of(code)

    def _stop(self, at_once: bool = False) -> int:
        """End the process; the exit code of one that has ended by itself."""
        process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if pipe is not None:
            pipe.close()
        if process is None:
            return 0
        process.join(0.0 if at_once else END_LIMIT)
        process.kill()
        process.join()
        return process.exitcode or 0

    def kill(self) -> None:
        """End the process at once; a call that waits for it raises PoolEndedError."""
        self._is_closed = True
        if (process := self._process) is not None:
            process.kill()

    def end(self) -> None:
        """End the process, which has nothing to do."""
        self._is_closed = True
        self._stop()


_ALIVE: WeakSet[WorkerProcess] = WeakSet()


def _kill_all() -> None:
    """End the processes whose pools nobody ended: `multiprocessing` would wait for them."""
    for process in list(_ALIVE):
        process.kill()


class ProcessPool:
    """Processes that work side by side, numbered from 0; or this one."""

    def __init__(self, processes: Sequence[WorkerProcess]) -> None:
        """None: this process does the work."""
        from concurrent.futures import ThreadPoolExecutor

        self._processes = processes
        self._threads = [ThreadPoolExecutor(1) for _ in processes]
        self._own: Memory = {}

    def submit(self, process: int, task: Callable[..., R], *args: Any) -> Future[R]:
        """Do `task(memory, *args)` in that process (modulo their number)."""
        if self._processes:
            at = process % len(self._processes)
            call = self._processes[at].call
            return self._threads[at].submit(call, self.with_memory(task), *args)
        from concurrent.futures import Future

        done: Future[R] = Future()
        done.set_result(self.with_memory(task)(*args))
        return done

    def with_memory(self, task: Callable[..., R]) -> Callable[..., R]:
        """The task with what the process that does it keeps as its first argument."""
        return partial(do_with_memory, task) if self._processes else partial(task, self._own)

    def in_order(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Results of the function of each item, in the items' order."""
        ended: dict[int, R] = {}
        following = 0
        batches = ([item] for item in enumerate(items))
        for i, result in self.as_completed(partial(_apply_numbered, function), batches):
            ended[i] = result
            while following in ended:
                yield ended.pop(following)
                following += 1

    def as_completed(
        self,
        function: Callable[[T], R],
        batches: Iterable[Sequence[T]],
        ahead: int = 1,
        call: Callable[[WorkerProcess, Callable[[T], R], T], R] = WorkerProcess.call,
    ) -> Iterator[R]:
        """Results of the function of each item as they come; the items of a batch go through one
        process, in their order, but for the second half of a batch that a process without work
        takes over.

        A batch is taken when a process has fewer than `ahead` items.  `call` has a process do the
        function of an item."""
        from concurrent.futures import FIRST_COMPLETED, wait

        if not self._processes:
            yield from (function(item) for batch in batches for item in batch)
            return
        waiting = (list(batch) for batch in batches if batch)
        running: dict[Future[R], tuple[int, list[T]]] = {}

        def submit_next(at: int, rest: list[T]) -> None:
            batch = rest or next(waiting, []) or _half_of_the_longest(running.values())
            if batch:
                future = self._threads[at].submit(call, self._processes[at], function, batch[0])
                running[future] = at, batch[1:]

        for at in ahead * list(range(len(self._processes))):
            submit_next(at, [])
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                at, rest = running.pop(future)
                result = future.result()
                submit_next(at, rest)
                yield result

    def end(self, at_once: bool) -> None:
        """End the processes when they have done what they were given, or at once."""
        if at_once:
            for process in self._processes:
                process.kill()
        for thread in self._threads:
            thread.shutdown(cancel_futures=at_once)
        for process in self._processes:
            process.end()


@contextmanager
def process_pool(
    workers: int, *, apart: bool = False, environment: Mapping[str, str] | None = None
) -> Iterator[ProcessPool]:
    """So many processes for the block, which end with it: at once where the block ends by an error
    or Ctrl-C.  One worker is this process, unless it shall be `apart`.  `environment`: variables
    that are others in the processes.

    >>> with process_pool(1) as pool:
    ...     list(pool.in_order(abs, [-1, 2]))
    [1, 2]

    Raises ProcessEndedError where one was ended from outside."""
    if workers == 1 and not apart:
        yield ProcessPool(())
        return
    variables = {**os.environ, **(environment or {})}
    process_context(variables)
    pool, has_ended = ProcessPool([WorkerProcess(variables) for _ in range(workers)]), False
    try:
        yield pool
        has_ended = True
    finally:
        pool.end(at_once=not has_ended)


def process_context(environment: Mapping[str, str] | None = None) -> BaseContext:
    """How the processes of a pool start.  On Linux they are forks of a server, which this process
    starts once, with these variables, and which has imported what they need; elsewhere each begins
    anew (a fork is not safe on macOS and there is none on Windows).

    Call it ahead of a pool to let the server import while this process does something else.

    Raises InputError where the path of the folder for temporary files is too long for its
    socket."""
    from multiprocessing import get_context

    if sys.platform != "linux":
        return get_context("spawn")
    from multiprocessing import forkserver, resource_tracker

    inherited = os.environ if environment is None else environment
    variables = {**MALLOC_SETTINGS, **inherited, **dict.fromkeys(BLAS_THREADS, "1")}
    variables |= _import_paths()
    with _starting:
        forkserver.set_forkserver_preload(list(PRELOADED))
        resource_tracker.ensure_running()  # would unblock the signals below
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ASKING)
        try:
            with _variables(variables):
                forkserver.ensure_running()
        except OSError as error:
            folder = tempfile.gettempdir()
            if len(os.fsencode(folder)) < LONGEST_TEMPORARY:
                raise
            raise InputError(
                f"{folder}: the folder for temporary files (TMPDIR) has too long a path for what "
                "processes talk by; set TMPDIR to a shorter one, for example /tmp, or use one "
                "worker where the command has --workers"
            ) from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return get_context("forkserver")


def _import_paths() -> dict[str, str]:
    """The variables of a process that imports what this one would."""
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    return {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}


@contextmanager
def _variables(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for a block."""
    saved = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in saved.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _unimportable_main() -> Iterator[None]:
    """Keep a process that starts from running the main module again, which Python has it do to find
    what a script defines.  A script without a guard would start processes in its turn, and one
    from the standard input or an editor has no file to run."""
    main = sys.modules["__main__"]

    def find(name: str) -> Any:
        if name == "__file__":
            raise AttributeError(name)
        return getattr(main, name)

    stand_in = ModuleType("__main__")
    stand_in.__getattr__ = find  # type: ignore[method-assign]
    sys.modules["__main__"] = stand_in
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _serve(pipe: Connection, environment: Mapping[str, str]) -> None:
    """What a process of a pool does, until the pipe ends, as it does where the process at its other
    end does: by itself or by any signal, KILL too.  Ctrl-C and SIGTERM, which a terminal or a queue
    of jobs sends to all processes, are for that one.  The environment is that of the pool."""
    ignore_requests()
    signal.signal(STOP_SIGNAL, _CALLER.end_call)
    os.environ.clear()
    os.environ.update(environment)
    calls: SimpleQueue[bytes] = SimpleQueue()
    _CALLER.pipe = pipe
    Thread(target=_listen, args=(pipe, calls), daemon=True).start()
    for name in PRELOADED:  # the time of a call is that of its work
        import_module(name)
    with suppress(OSError):  # nobody waits for an answer any more
        pipe.send_bytes(READY)
        while True:
            pipe.send_bytes(_answer(calls.get()))
    os._exit(0)


class _Caller:
    """Who waits for this process: the pipe to them, and whether a call of theirs runs or is wanted
    no more."""

    def __init__(self) -> None:
        self.pipe: Connection | None = None
        self.is_served, self.stops = False, False

    def end_call(self, *_: object) -> None:
        """End the call that runs, if it is not wanted; a handler of a signal."""
        if self.is_served and self.stops:
            self.stops = False
            raise StoppedError("the call was interrupted")


_CALLER = _Caller()
STOP_SIGNAL = getattr(signal, "SIGUSR1", signal.SIGINT)
"""The signal by which a process ends its own call, wherever that is."""


def tell_caller(message: Any) -> None:
    """Send a message to who waits for the call in this process (`hear` of `WorkerProcess.call`)."""
    if _CALLER.pipe is not None:
        _CALLER.pipe.send_bytes(pickle.dumps(("told", message)))


def _listen(pipe: Connection, calls: SimpleQueue[bytes]) -> None:
    with suppress(EOFError, OSError):
        while True:
            content = pipe.recv_bytes()
            if content == STOP:
                _CALLER.stops = True
                interrupt_main(STOP_SIGNAL)
            else:
                _CALLER.stops = False  # it was for the call before
                calls.put(content)
    os._exit(0)  # nobody waits for an answer any more


def _answer(content: bytes) -> bytes:
    """ "done" or "failed", and the result or error of a call, pickled."""
    try:
        function, args = pickle.loads(content)
        _CALLER.is_served = True
        try:
            answer = function(*args)
        finally:
            _CALLER.is_served = False
        return pickle.dumps(("done", answer))
    except CosimError as error:
        return pickle.dumps(("failed", error))
    except Exception as error:  # of any kind: the caller raises it
        return pickle.dumps(("failed", _portable(error)))


def _portable(error: Exception) -> Exception:
    """The error as it is, or in words where it does not outlive pickling."""
    lines = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever an error of another library does
        error = RuntimeError("".join(traceback.format_exception_only(error)).strip())
    error.add_note(f"in a process of a pool:\n{lines}")
    return error


def do_with_memory(task: Callable[..., R], *args: Any) -> R:
    """Do `task(memory, *args)` with what this process keeps."""
    return task(_memory, *args)


def _half_of_the_longest(running: Iterable[tuple[int, list[T]]]) -> list[T]:
    """The second half of what the batch with the most left has left, which is taken from it."""
    rest = max((left for _, left in running), key=len, default=[])
    half = len(rest) // 2
    taken = rest[len(rest) - half :]
    del rest[len(rest) - half :]
    return taken


def _apply_numbered(function: Callable[[T], R], item: tuple[int, T]) -> tuple[int, R]:
    return item[0], function(item[1])


START = "from cosim.processes import serve_foreign; serve_foreign()"
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
        group: dict[str, Any] = {"process_group": 0}  # Ctrl-C is the parent's
        if sys.platform == "win32":
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", START, str(os.getpid())],
            env={**os.environ, **_import_paths()},
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


def serve_foreign() -> None:
    """What the process does until its parent wants no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a library prints is no answer
    Thread(target=_watch_parent, args=(int(sys.argv[1]),), daemon=True).start()
    try:
        while (request := pickle.load(requests)) is not None:
            number, function, args = request
            pickle.dump((number, *_do_by_name(function, args)), answers)
            answers.flush()
    except (OSError, EOFError, pickle.UnpicklingError):
        _end_orphaned()
    if sys.platform != "win32":
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, 2 * END_LIMIT)  # a library may hang as it is unloaded


def _do_by_name(function: str, args: tuple[Any, ...]) -> tuple[bool, Any]:
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
