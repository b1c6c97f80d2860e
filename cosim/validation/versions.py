"""The trials of validations in other versions: on other meshes, with other inputs or hoods.

A version makes a case of a trial.  Its runs leave no folder, and stand beside the same references.
Experiments of several runs, and hoods whose mesh is a file of its own, have no versions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from cosim.case.schema import Case
from cosim.errors import ConvergenceError, Progress, quiet
from cosim.outcome import Outcome
from cosim.pipeline import plain_summary, run_each
from cosim.results.audit import describe_misses
from cosim.results.compare import Comparison
from cosim.results.result import Result
from cosim.validation.run import Board, board_of, with_trials
from cosim.validation.trial import Trial, TrialGroup

Version = Callable[[Trial], Case]
"""The case of a trial in a version.  Raises InputError where the trial has none."""
Key = tuple[str, str, str, str]
"""Of a compared number: its group, case, name and quantity."""
LEFT_OUT = (
    "experiments of several runs, and hoods whose mesh is a file of its own, have no versions"
)


def key_of(group: str, row: Comparison) -> Key:
    """The key of a row in its group."""
    t = row.target
    return group, t.case, t.name, t.quantity


def values_of_boards(boards: Iterable[Board]) -> dict[Key, float | None]:
    """The model's number of every row."""
    return {key_of(b.group, row): row.model for b in boards for row in b.rows}


def run_versions(
    groups: Sequence[TrialGroup],
    versions: Mapping[str, Version],
    workers: int = 2,
    progress: Progress = quiet,
) -> dict[str, list[Board]]:
    """The boards of the groups in each version, by its name.  A run that misses its audit has no
    numbers here.  Raises InputError where a process is ended from outside."""
    trials = {t.name: t for g in groups for t in g.trials if not (t.study or t.published)}
    places = [(version, name) for version in versions for name in trials]

    def ended(done: int, i: int, outcome: Outcome[Any]) -> None:
        version, name = places[i]
        words = f"{name}, {version}: {outcome.reason or 'done'}"
        progress(f"{done} of {len(places)}: {words}")

    makers = [partial(versions[version], trials[name]) for version, name in places]
    outcomes: dict[str, dict[str, Outcome[Any]]] = {name: {} for name in versions}
    for (version, name), outcome in zip(
        places, run_each(makers, audited_summary, workers, ended), strict=True
    ):
        outcomes[version][name] = outcome
    chosen = [with_trials(g, [t for t in g.trials if t.name in trials]) for g in groups]
    kept = [g for g in chosen if g.trials]
    return {name: [board_of(g, of_version) for g in kept] for name, of_version in outcomes.items()}


def audited_summary(result: Result) -> Mapping[str, Any]:
    """The summary of a run.  Raises ConvergenceError where it misses its audit."""
    if misses := list(describe_misses(result.summary)):
        raise ConvergenceError(f"misses its audit: {'; '.join(misses)}")
    return plain_summary(result)
