"""The table of a study: a row for each run, in the study's order, and nothing that the clock, the
machine or the number of workers has a say in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import output_file
from cosim.results.compare import unit_of, value_of
from cosim.study.execute import StudyOutcome
from cosim.study.plan import StudyPlan
from cosim.study.store import Store

if TYPE_CHECKING:
    import pandas as pd

STATUS = ("status", "reason")
KEY = "key"


def table_of(plan: StudyPlan, done: StudyOutcome, store: Store) -> pd.DataFrame:
    """Columns: run, the parameters, status and reason, the outputs, the address in the store.
    Runs that were not done are "waiting".  Of a parameter that is now a number and now a word every
    value is text."""
    import pandas as pd

    found = {
        row.key: (row.status, row.reason, *_values(row.summary, plan.outputs))
        for row in store.rows(set(done.keys.values()))
    }
    absent = (None,) * len(plan.outputs)
    records = []
    for run, point in enumerate(plan.points):
        key = done.keys.get(point, "")
        if point in done.refused:
            told: tuple[Any, ...] = ("refused", done.refused[point], *absent)
        else:
            told = found.get(key, ("waiting", "", *absent))
        records.append((run, *point, *told, key))
    names = [p.name for p in plan.parameters]
    columns = ["run", *names, *STATUS, *plan.outputs, KEY]
    table = pd.DataFrame.from_records(records, columns=columns)
    for name in names:
        if table[name].map(type).nunique() > 1:
            table[name] = table[name].map(str)
    return table.astype(dict.fromkeys(plan.outputs, float))


def _values(summary: Mapping[str, Any], outputs: Mapping[str, str]) -> list[float | None]:
    return [value_of(summary, quantity) for quantity in outputs.values()]


def units_of(plan: StudyPlan) -> dict[str, str]:
    """The unit of each parameter and output, by name; "1" of a factor, a plain number or a word."""
    return {p.name: p.unit or "1" for p in plan.parameters} | {
        name: unit_of(quantity) for name, quantity in plan.outputs.items()
    }


def write_table(table: pd.DataFrame, folder: Path) -> None:
    """table.parquet and table.csv, numbers in full.  Raises InputError."""
    with output_file(folder / "table.parquet") as part:
        table.to_parquet(part, index=False)
    with output_file(folder / "table.csv") as part:
        table.to_csv(part, index=False, lineterminator="\n")
