"""One run of a study: what is to be solved, and solving it."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.errors import CosimError
from cosim.json_text import json_text
from cosim.outcome import Status, one_line
from cosim.study.store import Store, StoreRow

if TYPE_CHECKING:
    from cosim.solve.session import Session

NOT_NUMBERS = ("case", "version", "wall_s")
"""Keys of a summary that differ between two runs of one case."""


@dataclass(frozen=True)
class Task:
    """A run: the case as stated whole, so that a file that is edited meanwhile changes nothing.

    `again`: solve it even where it failed before; `arrays`: keep all (True), none or some."""

    key: str
    case: Mapping[str, Any]
    name: str
    source: str
    store: str
    code: str
    arrays: bool | tuple[str, ...] = False
    limit: float | None = None
    again: bool = False


@dataclass(frozen=True)
class Verdict:
    """What the study needs to know of a run at once; `solved`: not found in the store."""

    key: str
    status: Status
    reason: str
    seconds: float
    solved: bool = True


def stored_outcome(task: Task, store: Store) -> Verdict | None:
    """What the store says of a run, None where it must be solved."""
    row = store.find(task.key)
    if row is None:
        return None
    if row.status != "converged":
        outlasted = row.status == "timeout" and _longer(task.limit, row.limit)
        if task.again or outlasted:
            return None
    elif task.arrays and not store.arrays(task.key).is_file():
        return None
    return Verdict(row.key, row.status, row.reason, row.seconds, solved=False)


def _longer(limit: float | None, before: float | None) -> bool:
    return limit is None or before is None or limit > before


def run_task(task: Task, store: Store, session: Session | None = None) -> Verdict:
    """The run's verdict, by solving it where the store has none; its row is in the store then.
    Runs of one `session` that differ in their tendons alone share models and unloaded equilibrium.

    Raises StoreError."""
    found = stored_outcome(task, store)
    if found is not None:
        return found
    store.log("begun", task.key)
    row = _solve(task, store, session)
    store.put(row)
    store.log("ended", task.key)
    return Verdict(row.key, row.status, row.reason, row.seconds)


def row_of(
    task: Task, status: Status, reason: str, seconds: float, summary: Mapping[str, Any]
) -> StoreRow:
    """For the store."""
    limit = task.limit if status == "timeout" else None
    host = socket.gethostname()
    return StoreRow(task.key, status, reason, summary, task.name, seconds, host, task.code, limit)


def _solve(task: Task, store: Store, session: Session | None) -> StoreRow:
    from cosim.case.schema import Case, CaseFile
    from cosim.pipeline import run_case

    begun = time.perf_counter()
    checked = CaseFile.model_validate(task.case)
    case = Case.model_construct(name=task.name, source=Path(task.source), **dict(checked))
    try:
        result = run_case(case, session)
    except CosimError as error:
        seconds = time.perf_counter() - begun
        return row_of(task, "failed", one_line(error), seconds, {})
    if task.arrays:
        _keep(result.data, task, store)
    missed = ", ".join(result.summary.get("audit_missed", ()))
    reason = f"audit missed: {missed}" if missed else ""
    return row_of(task, "converged", reason, time.perf_counter() - begun, _numbers(result.summary))


def _numbers(summary: Mapping[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in summary.items() if key not in NOT_NUMBERS}
    found: dict[str, Any] = json.loads(json_text(kept))
    return found


def _keep(dataset: Any, task: Task, store: Store) -> None:
    """The arrays that were asked for and that the run has."""
    wanted = dataset.data_vars if isinstance(task.arrays, bool) else task.arrays
    chosen = dataset[[name for name in wanted if name in dataset.data_vars]]
    path = store.arrays(task.key)
    store.write_by(path, lambda part: chosen.to_netcdf(part, engine="h5netcdf"))
