"""The solvers of a case, by its task."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import inf

from cosim.case.schema import Case
from cosim.errors import ConvergenceError, PatienceError, Progress, quiet, relay_progress
from cosim.models.build import Models
from cosim.models.fit import check_fit
from cosim.solve.motion import SolvedMotion, solve_motion
from cosim.solve.one_way import solve_one_way
from cosim.solve.session import Session
from cosim.solve.static import States, solve_static

Equilibria = tuple[Models, States]
Solved = Equilibria | SolvedMotion
"""What a solver hands to its observer: the two equilibria of a case at rest, or its motion."""


def solve_case(case: Case, session: Session, progress: Progress) -> Solved:
    """The equilibria or the motion of a case.

    Raises InputError, ConvergenceError and StoppedError."""
    if case.task == "motion":
        check_fit(case)
        with limit_patience(case, progress) as tell:
            return solve_motion(case, session, tell)
    return solve(case, session, progress)


def solve(case: Case, session: Session | None = None, progress: Progress = quiet) -> Equilibria:
    """The models and the two equilibria of a case at rest, coupled or in one pass.

    Raises InputError and ConvergenceError."""
    check_fit(case)
    solver = solve_one_way if case.task == "one_way" else solve_static
    with limit_patience(case, progress) as tell:
        return solver(case, session or Session(), tell)


@contextmanager
def limit_patience(case: Case, progress: Progress) -> Iterator[Progress]:
    """Progress that ends the solve within when the case's patience is over.

    Raises ConvergenceError, which says how far it came and what to try."""
    stated = case.solve.patience
    try:
        with relay_progress(progress, inf if stated is None else stated) as tell:
            yield tell
    except PatienceError as error:
        raise ConvergenceError(
            f"{error}. Try a longer solve.patience, a smaller tension, or a solve that is cheaper: "
            "fewer elements (hood.mesh.quads), a larger solve.hood_tolerance"
        ) from error
