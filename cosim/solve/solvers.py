"""The solvers of a case, by its task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cosim.case.schema import Case, Task
from cosim.errors import Progress, quiet
from cosim.models.build import Models
from cosim.models.fit import check_fit
from cosim.solve.motion import solve_motion
from cosim.solve.one_way import solve_one_way
from cosim.solve.session import Session
from cosim.solve.states import States
from cosim.solve.static import solve_static

SOLVERS: Mapping[Task, Callable[[Case, Session, Progress], Any]] = {
    "static": solve_static,
    "one_way": solve_one_way,
    "motion": solve_motion,
}


def solve(
    case: Case, session: Session | None = None, progress: Progress = quiet
) -> tuple[Models, States]:
    """The models and the two equilibria of a case at rest, coupled or in one pass.

    Raises InputError and ConvergenceError."""
    check_fit(case)
    found: tuple[Models, States] = SOLVERS[case.task](case, session or Session(), progress)
    return found
