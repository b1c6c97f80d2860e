"""Execute a study: hand out the runs that the store lacks, and count all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.case.cache_key import address, case_table, code_version
from cosim.case.file import load_case
from cosim.errors import InputError, nearest_names
from cosim.extras import require
from cosim.port import Array
from cosim.results.compare import numbers_of, value_of
from cosim.study.engine import Solve
from cosim.study.plan import Point, StudyPlan
from cosim.study.store import Store
from cosim.study.task import Task, Verdict, stored_outcome

PACK = 5000
"""Runs solved, after which the store is packed."""
MOST_IN_TURN = 5000
"""Runs that are put in turn, in a second or two."""
NEAREST = 3
"""Names that are shown in place of one that is not there."""


def check_libraries(by_scheduler: bool = False) -> None:
    """Check, before a study begins, that what it samples, keeps and, `by_scheduler`, hands out its
    runs with is installed.  Raises InputError."""
    require("a study", "pyarrow", "SALib")
    if by_scheduler:
        require("--scheduler", "distributed")


@dataclass
class Count:
    """How far a study is, in runs that differ."""

    total: int
    done: int = 0
    """Ended, failed ones too."""
    failed: int = 0
    solved: int = 0
    """Ended now, not found in the store."""
    handed_out: int = 0
    """Given to the workers now, and not ended."""
    reasons: Counter[str] = field(default_factory=Counter)

    def end(self, verdict: Verdict) -> None:
        """A run has ended, or had."""
        self.done += 1
        self.solved += verdict.solved
        if verdict.status != "converged":
            self.failed += 1
            self.reasons[verdict.reason] += 1


@dataclass(frozen=True)
class StudyOutcome:
    """Where every run's row is, or why the case does not allow it; without all of them where the
    study stopped for its failures."""

    keys: dict[Point, str]
    refused: dict[Point, str]
    count: Count

    @property
    def was_stopped(self) -> bool:
        """Whether runs are left that were not made."""
        return self.count.done < self.count.total


def execute_study(
    plan: StudyPlan, store: Store, solve: Solve, again: bool, tell: Callable[[Count], None]
) -> StudyOutcome:
    """Do what is left of the study, the case as it is first; `again`: also what had failed.

    Raises InputError for an output that a run has not and for a store that cannot be written;
    every run that ended is in the store then."""
    points = list(dict.fromkeys([*plan.as_it_is, *plan.points]))
    if plan.base.get("solve", {}).get("start") == "nearby":
        points = in_turn(points)
    done = StudyOutcome({}, {}, Count(len(points)))
    count, is_checked = done.count, False

    def note(verdict: Verdict) -> None:
        nonlocal is_checked
        count.end(verdict)
        if verdict.status == "converged" and not (is_checked or plan.bands):
            (row,) = store.rows([verdict.key])
            check_outputs(plan.outputs, row.summary)
            is_checked = True
        tell(count)

    def tasks() -> Iterator[Task]:
        code = code_version()
        for point in points:
            if plan.most_failures is not None and count.failed >= plan.most_failures:
                return
            try:
                task = _task(plan, point, store, code, again)
            except InputError as error:
                done.refused[point] = _faults(error)
                note(Verdict("", "refused", done.refused[point], 0.0, solved=False))
                continue
            done.keys[point] = task.key
            stored = stored_outcome(task, store)
            if stored is not None:
                note(stored)
                continue
            count.handed_out += 1
            yield task

    tell(count)
    for verdict in solve(tasks()):
        count.handed_out -= 1
        note(verdict)
        if count.solved and count.solved % PACK == 0:
            store.pack()
    store.pack()
    return done


def in_turn(points: Sequence[Point]) -> list[Point]:
    """The points in an order in which near ones follow each other: after the first ever the nearest
    of those that are left, by the places of their values among all; more than `MOST_IN_TURN` as
    they are.

    >>> in_turn([(0.0,), (9.0,), (1.0,), (8.0,)])
    [(0.0,), (1.0,), (8.0,), (9.0,)]
    """
    if len(points) > MOST_IN_TURN:
        return [*points]
    places = [_places(column) for column in zip(*points, strict=True)]
    left, at = np.column_stack([np.arange(len(points)), *places]), 0
    order = []
    while len(left):
        here, left = left[at], np.delete(left, at, axis=0)
        order.append(points[int(here[0])])
        at = int(np.argmin(np.abs(left[:, 1:] - here[1:]).sum(axis=1))) if len(left) else 0
    return order


def _places(column: Sequence[Any]) -> Array:
    """The places (n,) of values among all that differ, from 0 to 1; of no value in the middle."""
    known = sorted({v for v in column if v is not None}, key=lambda v: (isinstance(v, str), v))
    place = {v: i / max(1, len(known) - 1) for i, v in enumerate(known)}
    return np.array([place.get(v, 0.5) for v in column])


def check_outputs(outputs: Mapping[str, str], summary: Mapping[str, Any]) -> None:
    """Check that a run has a number wherever the study looks; a ratio whose divisor is zero in this
    run is let pass.  Raises InputError, with the nearest paths that there are."""
    known = list(numbers_of(summary))
    faults = []
    for name, quantity in outputs.items():
        for path in quantity.partition("/")[::2]:
            if path and value_of(summary, path) is None:
                near = nearest_names(path, known, NEAREST)
                hint = f"; nearest: {', '.join(near)}" if near else ""
                faults.append(f"outputs.{name}: the run has no number at {path}{hint}")
    if faults:
        raise InputError("\n  ".join(["what the study looks at is not there", *faults]))


def _faults(error: InputError) -> str:
    """The error in a line, without the path of the file, which the first line shows."""
    lines = str(error).splitlines()
    return " ".join(" ".join(lines[1:] or lines).split())


def _task(plan: StudyPlan, point: Point, store: Store, code: str, again: bool) -> Task:
    """The run of a point.  Raises InputError where the case does not allow it."""
    case = load_case(plan.case, plan.settings_at(point))
    return Task(
        address(case, code),
        case_table(case),
        case.name,
        str(case.source),
        str(store.root),
        code,
        plan.arrays,
        plan.most_seconds,
        again,
    )
