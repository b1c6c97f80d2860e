"""From folders to a report in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from cosim.compare_files import read_targets
from cosim.files import written_whole
from cosim.report.runs import read_runs
from cosim.report.tables import as_csv, as_json, as_markdown, tables_of


def write_report(
    folders: Sequence[Path],
    out: Path | None,
    form: Literal["html", "csv", "json", "md"],
    against: Path | None = None,
    data: Path | None = None,
) -> str:
    """Write the report and return what to tell: where it is, or without `out` the tables.

    Raises InputError where a folder is no run, or the file cannot be written."""
    targets = read_targets(data) if data is not None else ()
    every = read_runs([*folders, against] if against is not None else folders, targets)
    runs, other = (every, None) if against is None else (every[:-1], every[-1])
    tables = tables_of(runs, other)
    if form == "html":
        from cosim.report.page import page

        text = page(runs, other, tables)
        out = Path("report.html") if out is None else out
    else:
        one = {"csv": as_csv, "md": as_markdown}
        text = as_json(every, tables) if form == "json" else one[form](tables)
    if out is None:
        return text
    with written_whole(out) as part:
        part.write_text(text, encoding="utf-8")
    return f"{out}: {len(text.encode('utf-8')) / 1e6:.1f} MB"
