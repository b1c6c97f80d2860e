"""The validations: every trial run, every compared number with its verdict, misses included."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cosim import __version__
from cosim.audit import describe_misses
from cosim.build_finger import held_by
from cosim.build_fit import check_fit
from cosim.case import load_case
from cosim.case_schema import Case
from cosim.compare import Comparison, as_dict, tally
from cosim.compare_files import write_json
from cosim.files import written_whole
from cosim.observe import result
from cosim.port import ConvergenceError, InputError
from cosim.results import plain, write_result
from cosim.run import solve
from cosim.validation_plan import groups, rows_of
from cosim.validation_published import published_summary
from cosim.validation_reasons import explained
from cosim.validation_trial import Group, Trial
from cosim.verification_thesis import force_and_bound

FORMAT = "cosim scoreboard 1"
Told = Callable[[str], None]
Task = tuple[Trial, tuple[str, ...], str]
"""A trial, settings beside its own, and the folder for its run."""


@dataclass(frozen=True)
class Outcome:
    """What a trial said, or why it said nothing."""

    trial: str
    summary: dict[str, Any] | None
    failure: str | None


@dataclass(frozen=True)
class Board:
    """The rows of one group, the trials that failed, and what the audits of others missed."""

    group: str
    rows: tuple[Comparison, ...]
    failures: dict[str, str]
    missed: Mapping[str, list[str]] = field(default_factory=dict)


def chosen(only: str | None, published: Path | None = None) -> list[Group]:
    """The groups, or of each the trials whose name holds `only`; with the `published` hood's file
    those on it as well.  Raises InputError for none."""
    every = groups(published)
    if only is None:
        return list(every)
    kept = []
    for group in every:
        trials = tuple(t for t in group.trials if only in t.name)
        names = {t.name for t in trials}
        if trials:
            targets = tuple(t for t in group.targets if t.case in names)
            kept.append(Group(group.name, trials, targets))
    if not kept:
        raise InputError(
            f"--only {only}: no trial is called so; there are, for example, "
            + ", ".join(g.trials[0].name for g in every)
        )
    return kept


def validated(
    chosen_groups: Sequence[Group],
    folder: Path,
    settings: Sequence[str] = (),
    workers: int = 2,
    told: Told = lambda text: None,
) -> list[Board]:
    """Run the trials of the groups, leave a run folder of each in `folder` with its comparison, and
    compare.  Raises InputError."""
    jobs = [(g, t) for g in chosen_groups for t in g.trials]
    tasks = [(t, tuple(settings), str(folder)) for _, t in jobs]
    outcomes = {}
    for done, outcome in enumerate(_all(tasks, workers), 1):
        outcomes[outcome.trial] = outcome
        word = "" if outcome.failure is None else f": {outcome.failure}"
        told(f"{done} of {len(tasks)}: {outcome.trial}{word}")
    return [_board(group, outcomes, folder) for group in chosen_groups]


def _all(tasks: Sequence[Task], workers: int) -> Iterator[Outcome]:
    """What the trials said, as they end.

    Raises InputError where a process was ended from outside."""
    batches = _batches(tasks)
    if workers == 1:
        yield from (_run(task) for batch in batches for task in batch)
        return
    with ExitStack() as stack:
        running: dict[Future[Outcome], tuple[ProcessPoolExecutor, list[Task]]] = {}
        for _ in range(min(workers, len(batches))):
            pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
            first, *rest = batches.pop(0)
            running[stack.enter_context(pool).submit(_run, first)] = pool, rest
        while running:
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                pool, rest = running.pop(done)
                if not rest and batches:
                    rest = batches.pop(0)
                try:
                    outcome = done.result()
                    if rest:
                        running[pool.submit(_run, rest[0])] = pool, rest[1:]
                except BrokenProcessPool:
                    raise InputError(
                        "a process that ran trials was ended from outside, it may be for want of "
                        "memory; --workers 1 needs the least"
                    ) from None
                yield outcome


def _batches(tasks: Sequence[Task]) -> list[list[Task]]:
    """The tasks whose cases share an unloaded equilibrium, which one process solves but once, in
    one batch each, the largest first."""
    found: dict[str, list[Task]] = {}
    for task in tasks:
        key = task[0].name if task[0].published else _case(task).setting_key()
        found.setdefault(key, []).append(task)
    return sorted(found.values(), key=len, reverse=True)


def _case(task: Task) -> Case:
    """Raises InputError."""
    trial, settings, _ = task
    case = load_case(trial.case, [*trial.settings, *settings])
    return case.model_copy(update={"name": folder_name(trial.name)})


def _run(task: Task) -> Outcome:
    trial, _, folder = task
    started = time.perf_counter()
    if trial.published:
        return Outcome(trial.name, published_summary(trial), None)
    case = _case(task)
    check_fit(case)
    try:
        models, states = solve(case)
    except ConvergenceError as error:
        return Outcome(trial.name, None, str(error))
    made = result(case, models, states, time.perf_counter() - started)
    write_result(folder, case, made)
    summary = json.loads(json.dumps(made.summary, default=plain))
    if held_by(case) == "point":
        summary["bound_N"] = force_and_bound(models, states)[1]
    return Outcome(trial.name, summary, None)


def folder_name(trial: str) -> str:
    """The trial's name as a folder's."""
    return "".join(c if c.isalnum() else "_" for c in trial)


def _board(group: Group, outcomes: dict[str, Outcome], folder: Path) -> Board:
    mine = [outcomes[t.name] for t in group.trials]
    summaries = {o.trial: o.summary for o in mine if o.summary is not None}
    rows = tuple(explained(group.name, rows_of(group, summaries)))
    for name in summaries:
        own = [row for row in rows if row.target.case == name]
        if own and (folder / folder_name(name)).is_dir():
            write_json(folder / folder_name(name) / "comparison.json", own)
    failures = {o.trial: o.failure for o in mine if o.failure is not None}
    missed = {name: found for name, s in summaries.items() if (found := list(describe_misses(s)))}
    return Board(group.name, rows, failures, missed)


def scoreboard(boards: Sequence[Board]) -> str:
    """The text of the file: the same rows give the same bytes."""
    content = {
        "format": FORMAT,
        "version": __version__,
        "tally": {b.group: tally(b.rows) for b in boards},
        "failed": {name: why for b in boards for name, why in b.failures.items()},
        "groups": {b.group: [_rounded(row) for row in b.rows] for b in boards},
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _rounded(row: Comparison) -> dict[str, Any]:
    """Six digits are more than the models are good for, and hide the last bits of a machine, which
    a difference of almost equal numbers would show: it is that of the numbers as they are told."""
    numbers = {k: six_digits(getattr(row.target, k)) for k in ("reference", "sd", "low", "high")}
    told = Comparison(replace(row.target, **numbers), six_digits(row.model))
    return {k: six_digits(v) for k, v in as_dict(told).items()}


def six_digits(value: Any) -> Any:
    """A float to six digits, anything else as it is."""
    return float(f"{value:.6g}") if isinstance(value, float) else value


def write_scoreboard(path: Path, boards: Sequence[Board]) -> None:
    """Raises InputError where the file cannot be written."""
    with written_whole(path) as part:
        part.write_text(scoreboard(boards), encoding="utf-8")
