"""The figures of benches over commits: a table that a checkout keeps, and its page."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import InputError
from cosim.files import output_file, write_text
from cosim.report.templates import html_page
from cosim.text_tables import CsvRow, read_csv
from tests.benches.files import BenchRecord

COLUMNS = ("date", "source", "processor", "cores", "linear solver", "bench", "figure", "value")
GREATER_IS_BETTER = ("runs per second",)
"""How the names of figures begin that should be large; all others should be small."""
WORSE = 0.1
"""Share by which a figure is worse than the one before, from which on it is a regression."""


@dataclass(frozen=True)
class FigureLine:
    """A figure over the commits of one machine, the oldest first."""

    name: str
    values: tuple[float | None, ...]

    @property
    def worse(self) -> tuple[bool, ...]:
        """Of each commit whether the figure is a regression from the commit before that has it."""
        last, found = None, []
        for value in self.values:
            found.append(value is not None and last is not None and self._is_worse(last, value))
            last = last if value is None else value
        return tuple(found)

    def _is_worse(self, before: float, now: float) -> bool:
        if self.name.startswith(GREATER_IS_BETTER):
            return now < before * (1 - WORSE)
        return now > before * (1 + WORSE) + 1e-12


@dataclass(frozen=True)
class BenchHistory:
    """A bench on one machine."""

    bench: str
    machine: str
    sources: tuple[str, ...]
    """Commit and day."""
    lines: tuple[FigureLine, ...]

    @property
    def regressions(self) -> tuple[str, ...]:
        """Names of the figures that are worse at the newest commit."""
        return tuple(line.name for line in self.lines if line.worse[-1])


def append_record(path: Path, record: BenchRecord) -> None:
    """Write the ratios of a record as rows after those of the file.  Raises InputError."""
    head = "" if path.exists() else ",".join(COLUMNS) + "\n"
    kept = path.read_text(encoding="utf-8") if path.exists() else head
    m = record.machine
    about = (record.date, record.source, m["processor"], m["cores"], m["linear solver"])
    with output_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(kept)
        rows = csv.writer(file, lineterminator="\n")
        for bench, ratios in record.ratios.items():
            for name, value in ratios.items():
                rows.writerow((*about, bench, name, f"{value:.6g}"))


def read_history(path: Path) -> list[BenchHistory]:
    """The benches of a table by machine.  Raises InputError where it is none."""
    if not path.is_file():
        raise InputError(
            f"{path}: no figures are kept there; python -m tests.benches all --keep adds them"
        )
    table = read_csv(path, ",".join(COLUMNS))
    if lacking := [name for name in COLUMNS if name not in table.columns]:
        raise InputError(f"{path}: has no column {lacking[0]}; expected {', '.join(COLUMNS)}")
    kinds: dict[tuple[str, str], list[CsvRow]] = {}
    for row in table.rows:
        kinds.setdefault((row.cells["bench"], _machine(row)), []).append(row)
    return [_history(rows, *kind) for kind, rows in kinds.items()]


def _machine(row: CsvRow) -> str:
    return f"{row.cells['processor']}, {row.cells['linear solver']}"


def _history(rows: Sequence[CsvRow], bench: str, machine: str) -> BenchHistory:
    times = sorted({(r.cells["date"], r.cells["source"]) for r in rows})
    values = {
        (r.cells["figure"], r.cells["date"], r.cells["source"]): r.number("value") for r in rows
    }
    lines = (
        FigureLine(name, tuple(values.get((name, *time)) for time in times))
        for name in dict.fromkeys(r.cells["figure"] for r in rows)
    )
    sources = tuple(f"{source}, {date[:10]}" for date, source in times)
    return BenchHistory(bench, machine, sources, tuple(lines))


def write_history_page(histories: Sequence[BenchHistory], path: Path) -> None:
    """Write one HTML page, the regressions of the newest commit first.  Raises InputError."""
    said = list(regressions(histories))
    page = html_page(
        "bench.html.j2", "tests.benches", histories=histories, regressions=said, worse=WORSE
    )
    write_text(path, page)


def regressions(histories: Sequence[BenchHistory]) -> Iterator[str]:
    """A line for each figure that is worse at the newest commit of its machine."""
    for history in histories:
        for name in history.regressions:
            (line,) = (line for line in history.lines if line.name == name)
            before, now = [v for v in line.values if v is not None][-2:]
            yield f"{history.bench}: {name}: {before:.4g} to {now:.4g} ({history.machine})"
