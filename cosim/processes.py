"""The processes that solve: a pool of them, and their threads of BLAS and memory."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from cosim.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future
    from multiprocessing.context import BaseContext

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
    "fe_solver.hood.build_shell",
    "rigid.fingers.index",
    "rigid.mujoco.finger",
    "scipy.ndimage",
)
"""What the server of a pool imports before it forks: what the processes need, and nothing that
starts a thread."""
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


def peak_mb() -> float:
    """Largest memory of this process so far, MB (1e6 bytes)."""
    if sys.platform == "win32":
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 1e6
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


T = TypeVar("T")
R = TypeVar("R")
Memory = dict[str, Any]
"""What one process of a pool keeps from call to call."""
_memory: Memory = {}


class ProcessPool:
    """Processes that work side by side, numbered from 0; or this one."""

    def __init__(self, processes: Sequence[Executor]) -> None:
        """One executor of one process each; none: this process does the work."""
        self._processes = processes
        self._own: Memory = {}

    def submit(self, process: int, task: Callable[..., R], *args: Any) -> Future[R]:
        """Do `task(memory, *args)` in that process (modulo their number)."""
        if self._processes:
            at = process % len(self._processes)
            return self._processes[at].submit(self.with_memory(task), *args)
        from concurrent.futures import Future

        done: Future[R] = Future()
        done.set_result(self.with_memory(task)(*args))
        return done

    def with_memory(self, task: Callable[..., R]) -> Callable[..., R]:
        """The task with what the process that does it keeps as its first argument."""
        return partial(_with_memory if self._processes else self._with_own, task)

    def _with_own(self, task: Callable[..., R], *args: Any) -> R:
        return task(self._own, *args)

    def in_order(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Results of the function of each item, in the items' order."""
        ended: dict[int, R] = {}
        following = 0
        batches = ([item] for item in enumerate(items))
        for i, result in self.as_ended(partial(_apply_numbered, function), batches):
            ended[i] = result
            while following in ended:
                yield ended.pop(following)
                following += 1

    def as_ended(self, function: Callable[[T], R], batches: Iterable[Sequence[T]]) -> Iterator[R]:
        """Results of the function of each item as they come; the items of a batch go through one
        process, in their order, but for the second half of a batch that a process without work
        takes over."""
        from concurrent.futures import FIRST_COMPLETED, wait

        if not self._processes:
            yield from (function(item) for batch in batches for item in batch)
            return
        waiting = [batch for batch in map(list, batches) if batch]
        running: dict[Future[R], tuple[int, list[T]]] = {}

        def go_on(process: int, rest: list[T]) -> None:
            batch = rest or (waiting.pop(0) if waiting else _half_of_the_longest(running.values()))
            if batch:
                future = self._processes[process].submit(function, batch[0])
                running[future] = process, batch[1:]

        for process in range(len(self._processes)):
            go_on(process, [])
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                process, rest = running.pop(future)
                result = future.result()
                go_on(process, rest)
                yield result


@contextmanager
def process_pool(workers: int, option: str = "--workers") -> Iterator[ProcessPool]:
    """So many processes for the block (`workers` = 1: this one), which end with it: at once where
    the block ends by an error or Ctrl-C.

    >>> with process_pool(1) as pool:
    ...     list(pool.in_order(abs, [-1, 2]))
    [1, 2]

    Raises InputError, which names the command's `option`, where one was ended from outside."""
    if workers == 1:
        yield ProcessPool(())
        return
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool
    from multiprocessing import active_children

    others, has_ended = set(active_children()), False
    context, environment = process_context(), dict(os.environ)
    processes = [
        ProcessPoolExecutor(1, context, initializer=_begin, initargs=(environment,))
        for _ in range(workers)
    ]
    try:
        yield ProcessPool(processes)
        has_ended = True
    except BrokenProcessPool:
        raise InputError(
            "a process that solved was ended from outside, it may be for want of memory; "
            f"{option} 1 needs the least"
        ) from None
    finally:
        for executor in processes:
            executor.shutdown(wait=has_ended, cancel_futures=True)
        for child in set(active_children()) - others:
            child.terminate()


def process_context() -> BaseContext:
    """How the processes of a pool start.  On Linux they are forks of a server, which this process
    starts once and which has imported what they need; elsewhere each begins anew (a fork is not
    safe on macOS and there is none on Windows).

    Call it ahead of a pool to let the server import while this process does something else."""
    from multiprocessing import get_context

    if sys.platform != "linux":
        return get_context("spawn")
    from multiprocessing import forkserver, resource_tracker

    forkserver.set_forkserver_preload(list(PRELOADED))
    resource_tracker.ensure_running()  # would unblock the signal below
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    own, blocked = dict(os.environ), signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.update({**MALLOC_SETTINGS, **own, **dict.fromkeys(BLAS_THREADS, "1")})
    os.environ.update(PYTHONPATH=paths, PYTHONSAFEPATH="1")  # it imports what this process would
    try:
        forkserver.ensure_running()
    finally:
        os.environ.clear()
        os.environ.update(own)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return get_context("forkserver")


def _begin(environment: dict[str, str]) -> None:
    """What a process of a pool does first: Ctrl-C reaches it too, and the pool ends it; the
    environment is that of the pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.clear()
    os.environ.update(environment)


def _with_memory(task: Callable[..., R], *args: Any) -> R:
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
