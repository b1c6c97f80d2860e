"""Cases solved again and again at nearby parameters, for a fit over several cases.

A case with held bones stays with one process, which begins from the equilibria that it solved last
(`cosim.analyses.trials.by_tangent`), so that what it finds does not depend on how many processes
there are.  Any other case is solved from scratch, in whichever process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cosim.analyses.trials.by_tangent import predict_summary, solve_from
from cosim.case.file import Settings, load_case
from cosim.case.schema import Case
from cosim.errors import ConvergenceError
from cosim.models.build import Models
from cosim.outcome import Outcome, outcome_of
from cosim.pipeline import run_case
from cosim.processes import ProcessPool, one_blas_thread
from cosim.results.static import observe_static
from cosim.solve.solvers import solve
from cosim.solve.static import States

Summary = Mapping[str, Any]
Trial = Outcome[Summary]
"""The summary of a case with settings, or why there is none."""


@dataclass(frozen=True)
class SolvedCase:
    """A case with held bones in equilibrium."""

    case: Case
    settings: Settings
    models: Models
    states: States


SolvedCases = dict[str, SolvedCase]
"""The last solved state of each case, by its name."""


class CaseWorkers:
    """Processes that solve; case i is of process i modulo their number."""

    def __init__(
        self, cases: Sequence[tuple[str, Path, bool]], pool: ProcessPool, arms: bool
    ) -> None:
        """Cases: name, file, and whether the tangent serves it; `arms`: whether anybody looks at
        moment arms by force, as in `by_tangent.predict_summary`."""
        self._cases, self._pool, self._arms = cases, pool, arms

    def solve(self, settings: Mapping[int, Settings], afresh: bool = False) -> dict[int, Trial]:
        """An outcome for each case by its place, with its settings; `afresh` from scratch."""
        asked = {}
        for i, case_settings in settings.items():
            name, source, serves = self._cases[i]
            asked[i] = self._pool.submit(
                i, solve_one, name if serves else "", source, case_settings, self._arms, afresh
            )
        return {i: future.result() for i, future in asked.items()}

    def solve_nearby(
        self, around: Sequence[Settings], beside: Sequence[Sequence[Settings]]
    ) -> list[list[Trial]]:
        """Outcomes, by case, of settings that differ little from those `around`: by the tangent
        where that serves."""
        whole: dict[int, Future] = {}
        each: dict[int, list[Future]] = {}
        count = 0
        for i, (name, source, serves) in enumerate(self._cases):
            if serves:
                neighbours = tuple(beside[i])
                whole[i] = self._pool.submit(
                    i, solve_many, name, source, around[i], neighbours, self._arms
                )
                continue
            each[i] = []
            for settings in beside[i]:
                each[i].append(
                    self._pool.submit(count, solve_one, "", source, settings, True, True)
                )
                count += 1
        return [
            whole[i].result() if i in whole else [future.result() for future in each[i]]
            for i in range(len(self._cases))
        ]


@one_blas_thread()
def solve_one(
    kept: SolvedCases, name: str, source: Path, settings: Settings, arms: bool, afresh: bool
) -> Trial:
    """The case solved, with a `name` from what is kept, if anything is, and not `afresh`."""
    if not name:
        return run_trial(source, settings)

    def summary() -> Summary:
        case = load_case(source, settings)
        models, states = _solve(case, None if afresh else kept.get(name), arms)
        kept[name] = SolvedCase(case, settings, models, states)
        return observe_static(case, (models, states), 0.0).summary

    return outcome_of(summary)


def run_trial(source: Path, settings: Settings) -> Trial:
    """The case at `source` with settings on top, solved from scratch."""
    return outcome_of(lambda: run_case(load_case(source, settings)).summary)


def _solve(case: Case, neighbour: SolvedCase | None, arms: bool) -> tuple[Models, States]:
    if neighbour is not None:
        with suppress(ConvergenceError):
            transferred = solve_from(case, neighbour.models, neighbour.states, arms)
            if transferred is not None:
                return transferred
    return solve(case)


@one_blas_thread()
def solve_many(
    kept: SolvedCases,
    name: str,
    source: Path,
    around: Settings,
    beside: Sequence[Settings],
    arms: bool,
) -> list[Trial]:
    """The case with each of the settings `beside`, which differ little from those `around`."""
    if name not in kept or kept[name].settings != around:
        outcome = solve_one(kept, name, source, around, arms, afresh=False)
        if outcome.status != "converged":
            return [outcome] * len(beside)
    return [outcome_of(partial(_solve_nearby, kept[name], source, s, arms)) for s in beside]


def _solve_nearby(solved: SolvedCase, source: Path, settings: Settings, arms: bool) -> Summary:
    """The summary by the tangent; where the mesh changes by Newton's method from the solved case,
    because the nodes' coordinates are rounded; from scratch where neither serves."""
    case = load_case(source, settings)
    if case.mesh_key() == solved.case.mesh_key():
        summary = predict_summary(case, solved.models, solved.states, arms)
    else:
        reached = solve_from(case, solved.models, solved.states, arms)
        summary = None if reached is None else observe_static(case, reached, 0.0).summary
    return run_case(case).summary if summary is None else summary
