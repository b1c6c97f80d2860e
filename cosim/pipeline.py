"""The main path: case -> build -> solve -> results.  Read this file first."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from cosim.build.fit import check_fit
from cosim.case.schema import Case, Task
from cosim.errors import Progress, quiet
from cosim.processes import one_blas_thread
from cosim.results.motion import observe_motion
from cosim.results.result import Result
from cosim.results.static import observe_static
from cosim.solve.session import Session
from cosim.solve.solvers import SOLVERS

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
    equilibrium, and StoppedError where the user ends a motion."""
    started = time.perf_counter()
    check_fit(case)
    solved = SOLVERS[case.task](case, session or Session(), progress)
    progress("summing up")
    return OBSERVERS[case.task](case, solved, time.perf_counter() - started)
