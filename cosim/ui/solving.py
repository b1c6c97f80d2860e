"""The solves that a page asks for: one thread has the newest solved in a process of its own.

What is older is dropped, and a solve that nobody waits for any more is interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Condition, Thread, Timer
from typing import Any, Literal, Protocol

from cosim.case.schema import Case
from cosim.errors import CosimError
from cosim.pipeline import observe, run_case
from cosim.processes import Memory, WorkerProcess, do_with_memory, tell_caller
from cosim.report.views import View, view_of
from cosim.results.result import Result
from cosim.solve.motion import SolvedMotion
from cosim.solve.session import Session

INTERRUPT_LIMIT = 4.0
"""s in which a solve that was interrupted ends; else its process is ended."""
CALM = 1.0
"""s after an answer without a change, until it is solved once more from rest."""
Start = Literal["nearby", "from rest"]
"""Where a solve begins: at the last equilibrium, or as `cosim run` begins."""


@dataclass(frozen=True)
class Request:
    """A solve that was asked for."""

    number: int
    case: Case
    label: str = ""
    """The case, and what was changed in it."""
    start: Start = "nearby"
    is_drag: bool = False
    """While a slider moves."""
    is_check: bool = False
    """Whether it solves an answer that is shown once more, from rest."""
    is_reduced: bool = False
    """With the reduced hood."""


class Asking(Protocol):
    """Who asks for solves, the desk; all but `is_closed` are called with its lock held."""

    @property
    def is_closed(self) -> bool: ...
    def check_wanted(self) -> Request | None: ...
    def is_stale(self, request: Request) -> bool: ...
    def begin(self, request: Request) -> None: ...
    def hear(self, message: Any) -> None: ...
    def take(self, request: Request, found: Answer) -> None: ...
    def fail_request(self, request: Request, error: CosimError) -> None: ...


class Solving:
    """The thread and the process that solve what `desk` asks for."""

    def __init__(self, desk: Asking, changed: Condition) -> None:
        self._desk, self._changed = desk, changed
        self._process = WorkerProcess()
        self._wanted: Request | None = None
        self._running: Request | None = None
        self._thread = Thread(target=self._work, daemon=True)

    def start(self) -> None:
        """Begin to solve."""
        self._thread.start()

    @property
    def is_busy(self) -> bool:
        """Whether something is solved, or is to be."""
        return self._running is not None or self._wanted is not None

    def put(self, request: Request) -> None:
        """Have a request solved in place of what runs or waits."""
        running, self._wanted = self._running, request
        if running is not None and not (request.is_drag and running.is_drag):
            self._interrupt(running)

    def drop(self) -> None:
        """Solve nothing of what runs or waits."""
        self._wanted = None
        if self._running is not None:
            self._interrupt(self._running)

    def close(self) -> None:
        """End the process, once the desk is closed."""
        self._process.kill()
        self._thread.join(INTERRUPT_LIMIT)
        self._process.end()

    def _interrupt(self, running: Request) -> None:
        """End the solve that runs; where it does not end soon, its process."""
        self._process.interrupt()

        def end() -> None:
            if self._running is running:
                self._process.end_call()

        timer = Timer(INTERRUPT_LIMIT, end)
        timer.daemon = True
        timer.start()

    def _work(self) -> None:
        """Solve what is wanted, one after the other, until the desk is closed."""
        while (request := self._next()) is not None:
            try:
                found = self._process.call(
                    do_with_memory, answer, request.case, request.start, hear=self._hear(request)
                )
            except CosimError as error:
                self._fail(request, error)
            except Exception as error:  # a fault of ours is said, and the page goes on
                self._fail(request, CosimError(f"the program failed: {error!r}"))
            else:
                with self._changed:
                    self._running = None
                    self._desk.take(request, found)

    def _fail(self, request: Request, error: CosimError) -> None:
        with self._changed:
            self._running = None
            self._desk.fail_request(request, error)

    def _next(self) -> Request | None:
        """The request that is wanted next; the check of an answer once nothing else is.  None where
        the desk is closed."""
        with self._changed:
            while not self._desk.is_closed:
                if self._wanted is None:
                    is_due = self._desk.check_wanted() is not None
                    if self._changed.wait(CALM if is_due else None) or not is_due:
                        continue
                    self._wanted = self._wanted or self._desk.check_wanted()
                    if self._wanted is None:
                        continue
                self._running, self._wanted = self._wanted, None
                self._desk.begin(self._running)
                return self._running
            return None

    def _hear(self, request: Request) -> Any:
        def hear(message: Any) -> None:
            with self._changed:
                is_stale = self._desk.is_stale(request)
                if not is_stale and not request.is_check:
                    self._desk.hear(message)
            if is_stale:  # it was not yet solving when interrupted
                self._process.interrupt()

        return hear


@dataclass(frozen=True)
class Answer:
    """A result, and what the page draws of it."""

    result: Result
    view: View


@dataclass(frozen=True)
class SoFar:
    """A motion on its way, as the page draws it."""

    view: View


def answer(memory: Memory, case: Case, start: Start) -> Answer:
    """The result of a case; its stages, and the frames of a motion as they come, are told to the
    caller.

    Raises what `run_case` does."""
    session = memory.get(start)
    if session is None:
        session = memory[start] = Session(warm=start == "nearby", watch=_tell_motion)
    return answer_of(run_case(case, session, tell_caller))


def answer_of(result: Result) -> Answer:
    """A result with what the page draws of it."""
    return Answer(result, view_of(result))


def _tell_motion(case: Case, so_far: SolvedMotion) -> None:
    tell_caller(motion_so_far(case, so_far))


def motion_so_far(case: Case, so_far: SolvedMotion) -> SoFar:
    """What there is to see of a motion on its way."""
    return SoFar(view_of(observe(case, so_far, 0.0)))
