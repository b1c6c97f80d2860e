"""Why a compared number misses: what the sensitivity study found, beside the row that it explains.

`cases/data/validation_reasons.csv` has a line for each kind of miss: patterns of
the groups' and the rows' names (as of file names) and the reason, with the study's own figures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from typing import NamedTuple

from cosim.results.compare import Comparison, Verdict
from cosim.text_tables import packaged_rows

NOT_KNOWN = "not known"
MISSES: tuple[Verdict, ...] = ("outside", "no value")


class Reason(NamedTuple):
    """Why rows miss whose names are like `pattern`, in the groups whose names are like `group`."""

    group: str
    pattern: str
    text: str


@cache
def reasons() -> tuple[Reason, ...]:
    """Those of the packaged file, in its order."""
    rows = (row.cells for row in packaged_rows("validation_reasons"))
    return tuple(Reason(row["group"], row["pattern"], row["reason"]) for row in rows)


def reason_of(group: str, name: str) -> str | None:
    """The first that fits a row, None where there is none."""
    fits = (
        r.text for r in reasons() if fnmatchcase(group, r.group) and fnmatchcase(name, r.pattern)
    )
    return next(fits, None)


def explain_misses(group: str, rows: Iterable[Comparison]) -> Iterator[Comparison]:
    """The rows, those that miss with the reason in their note, or that none is known."""
    for row in rows:
        if row.verdict not in MISSES:
            yield row
            continue
        why = reason_of(group, row.target.name) or NOT_KNOWN
        note = "; ".join(part for part in (row.target.note, f"why: {why}") if part)
        yield replace(row, target=replace(row.target, note=note))
