"""From folders to a report in a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from cosim.errors import InputError, Progress, quiet
from cosim.files import write_text
from cosim.report.tables import tables_of, tables_text
from cosim.results.compare import read_targets
from cosim.results.read import read_runs

Form = Literal["html", "csv", "json", "md"]


def write_report(
    folders: Sequence[Path],
    out: Path | None,
    form: Form,
    against: Path | None = None,
    data: Path | None = None,
    note: Progress = quiet,
) -> str:
    """Write the report and return what to tell: where it is, or without `out` the tables; `note`
    takes what there is to say beside it.  The run `against` may be one of the others.

    Raises InputError where a folder is no run, or the file cannot be written."""
    if not folders:
        raise InputError("a report needs one run or more")
    targets = read_targets(data) if data is not None else ()
    shown, places = list(folders), [folder.resolve() for folder in folders]
    at = None if against is None else against.resolve()
    if against is not None and at not in places:
        shown.append(against)
    every = read_runs(shown, targets)
    others = Counter(t.case for t in targets if t.case not in ("", *(run.case for run in every)))
    for case, count in others.items():
        note(f"{data}: rows for the case {case}, of which no run is reported: {count}")
    runs, reference = every[: len(folders)], None
    if at is not None:
        reference = every[places.index(at)] if at in places else every[-1]
    tables = tables_of(runs, reference)
    if form == "html":
        from cosim.report.page import page

        text = page(runs, reference, tables)
        out = Path("report.html") if out is None else out
    else:
        text = tables_text(form, every, tables)
    if out is None:
        return text
    write_text(out, text)
    return f"{out}: {len(text.encode('utf-8')) / 1e6:.1f} MB"
