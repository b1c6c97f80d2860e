"""The main path: case -> build -> solve -> results.  Read this file first."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from cosim.case.schema import Case
from cosim.errors import (
    ConvergenceError,
    CosimError,
    PatienceError,
    Progress,
    quiet,
    relay_progress,
)
from cosim.files import shown_path
from cosim.json_text import json_text
from cosim.models.build import mesh_advice
from cosim.outcome import Outcome, outcome_of
from cosim.processes import Memory, one_blas_thread, process_pool
from cosim.results.motion import observe_motion
from cosim.results.result import Result
from cosim.results.static import observe_static
from cosim.results.write import write_files
from cosim.solve.motion import SolvedMotion, checkpoint_folder
from cosim.solve.session import Session
from cosim.solve.solvers import Solved, solve_case
from cosim.stopwatch import timed

T = TypeVar("T")


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
    session = session or Session()
    with session.lock, relay_progress(progress):
        try:
            solved = solve_case(case, session, progress)
        except ConvergenceError as error:
            out_of_time = isinstance(error.__cause__, PatienceError)
            if out_of_time or not (advice := mesh_advice(case)):
                raise
            raise ConvergenceError(f"{str(error).rstrip('.')}. {advice}", error.reached) from error
        progress("summing up")
        result = observe(case, solved, time.perf_counter() - started)
        if not result.summary["converged"]:
            raise _failure(case, result, session)
        return result


@timed("summing up")
def observe(case: Case, solved: Solved, wall: float) -> Result:
    """What a solved case leaves behind; `wall`: the seconds that it took."""
    if isinstance(solved, SolvedMotion):
        return observe_motion(case, solved, wall)
    return observe_static(case, solved, wall)


def _failure(case: Case, reached: Result, session: Session) -> ConvergenceError:
    """The error of a motion that failed on its way; what it reached is written beside its
    checkpoint, where it keeps one."""
    message = str(reached.summary["failure"])
    folder = checkpoint_folder(case, session.checkpoints)
    if folder is not None and folder.is_dir():
        try:
            write_files(folder, reached)
            message += f". What it reached is in {shown_path(folder)} (converged: false)"
        except CosimError as error:
            message += f". What it reached cannot be written: {error}"
    return ConvergenceError(message, reached)


def run_cases(
    cases: Sequence[Case],
    then: Callable[[Result], T],
    workers: int = 1,
    checkpoints: Path | None = None,
) -> Iterator[tuple[int, Outcome[T]]]:
    """Run cases side by side in so many processes.  As each ends: its place in `cases`, and its
    outcome with what `then` makes of its result in the process that solved it.

    Cases that differ only in their tendons share their models and the unloaded equilibrium in a
    process, and those that differ in what holds the fingertip their hood.  A case gives the same
    bytes for any number of workers.  Raises InputError where a process is ended from outside."""
    run_one = partial(_run_one, then=then, checkpoints=checkpoints)
    with process_pool(max(1, min(workers, len(cases)))) as pool:
        yield from pool.as_completed(pool.with_memory(run_one), batches_of(cases))


def run_each(
    cases: Sequence[Case | Callable[[], Case]],
    then: Callable[[Result], T],
    workers: int = 1,
    ended: Callable[[int, int, Outcome[T]], object] = lambda done, i, outcome: None,
) -> list[Outcome[T]]:
    """The outcomes of cases in their order, run as `run_cases` does; one that is first made, and
    cannot be, is an outcome too.  `ended` is called as each ends: how many have, place and outcome.

    Raises InputError where a process is ended from outside, and what `ended` raises."""
    made = [outcome_of(c) if callable(c) else Outcome("converged", c) for c in cases]
    ready = {i: one.value for i, one in enumerate(made) if one.value is not None}
    faulty = (
        (i, Outcome[T](o.status, None, o.error, o.seconds)) for i, o in enumerate(made) if o.error
    )
    ran = run_cases([*ready.values()], then, workers) if ready else ()
    outcomes: dict[int, Outcome[T]] = {}
    for i, outcome in chain(faulty, (([*ready][k], outcome) for k, outcome in ran)):
        outcomes[i] = outcome
        ended(len(outcomes), i, outcome)
    return [outcomes[i] for i in range(len(made))]


def plain_summary(result: Result) -> Mapping[str, Any]:
    """The summary of a run as its file has it."""
    summary: Mapping[str, Any] = json.loads(json_text(result.summary))
    return summary


def batches_of(cases: Sequence[Case]) -> list[list[tuple[int, Case]]]:
    """The cases with their places, those of one hood in a batch, the largest batch first, and in it
    those of one unloaded equilibrium side by side."""
    alike: dict[str, list[tuple[int, Case]]] = {}
    for i, case in enumerate(cases):
        alike.setdefault(case.hood_key(), []).append((i, case))
    batches = [sorted(batch, key=lambda item: item[1].setting_key()) for batch in alike.values()]
    return sorted(batches, key=len, reverse=True)


def _run_one(
    memory: Memory,
    item: tuple[int, Case],
    then: Callable[[Result], T],
    checkpoints: Path | None,
) -> tuple[int, Outcome[T]]:
    i, case = item
    session: Session = memory.setdefault("session", Session(checkpoints=checkpoints))
    return i, outcome_of(lambda: then(run_case(case, session)))
