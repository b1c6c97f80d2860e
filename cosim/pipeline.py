"""The main path: case -> build -> solve -> results.  Read this file first."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from cosim.case.schema import Case, Task
from cosim.errors import ConvergenceError, CosimError, Progress, listening, quiet
from cosim.files import shown_path
from cosim.models.fit import check_fit
from cosim.processes import Memory, one_blas_thread, process_pool
from cosim.results.motion import observe_motion
from cosim.results.result import Result
from cosim.results.static import observe_static
from cosim.results.write import write_files
from cosim.solve.motion import checkpoint_folder
from cosim.solve.session import Session
from cosim.solve.solvers import SOLVERS

T = TypeVar("T")
OBSERVERS: Mapping[Task, Callable[[Case, Any, float], Result]] = {
    "static": observe_static,
    "one_way": observe_static,
    "motion": observe_motion,
}


@one_blas_thread()
def run_case(case: Case, session: Session | None = None, progress: Progress = quiet) -> Result:
    """Build, solve and observe one case, in a `session` that it shares with others or alone.

    `progress` is called with each stage in words.

    >>> from cosim.case.file import load_case
    >>> run_case(load_case("pulley_edc")).audit.passed
    True

    Raises InputError where case and models do not fit, ConvergenceError where there is no
    equilibrium or a step of a motion fails (with what it `reached`), and StoppedError where the
    user ends a motion."""
    started = time.perf_counter()
    check_fit(case)
    session = session or Session()
    with session.lock, listening(progress):
        solved = SOLVERS[case.task](case, session, progress)
        progress("summing up")
        result = OBSERVERS[case.task](case, solved, time.perf_counter() - started)
        if not result.summary["converged"]:
            raise _failure(case, result, session)
        return result


def _failure(case: Case, reached: Result, session: Session) -> ConvergenceError:
    """The error of a motion that failed on its way; what it reached is written beside its
    checkpoint, where it keeps one."""
    message = str(reached.summary["failure"])
    folder = checkpoint_folder(case, session.checkpoints)
    if folder is not None and folder.is_dir():
        try:
            write_files(folder, reached)
            message += f". What it reached is in {shown_path(folder)} (converged: false)"
        except OSError as error:
            message += f". What it reached cannot be written ({error.strerror or error})"
    return ConvergenceError(message, reached)


def run_cases(
    cases: Sequence[Case],
    then: Callable[[Result], T],
    workers: int = 1,
    checkpoints: Path | None = None,
) -> Iterator[tuple[int, T | None, CosimError | None]]:
    """Run cases side by side in so many processes.  As each ends: its place in `cases`,
    what `then` makes of its result in the process that solved it, and the error that it ended with
    (one of the two is None).

    Cases that differ only in their tendons share their models and the unloaded equilibrium in a
    process, and those that differ in what holds the fingertip their hood.  A case gives the same
    bytes for any number of workers.  Raises InputError where a process is ended from outside."""
    alike: dict[str, list[tuple[int, Case]]] = {}
    for i, case in enumerate(cases):
        alike.setdefault(case.hood_key(), []).append((i, case))
    batches = [sorted(batch, key=lambda item: item[1].setting_key()) for batch in alike.values()]
    batches.sort(key=len, reverse=True)
    run_one = partial(_run_one, then=then, checkpoints=checkpoints)
    with process_pool(max(1, min(workers, len(cases)))) as pool:
        yield from pool.as_ended(pool.with_memory(run_one), batches)


def _run_one(
    memory: Memory,
    item: tuple[int, Case],
    then: Callable[[Result], T],
    checkpoints: Path | None,
) -> tuple[int, T | None, CosimError | None]:
    i, case = item
    session: Session = memory.setdefault("session", Session(checkpoints=checkpoints))
    try:
        return i, then(run_case(case, session)), None
    except CosimError as error:
        return i, None, error
