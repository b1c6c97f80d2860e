"""Rows of proofs: computed numbers beside their targets, judged by the test that makes them, and
printed or written when the tests end (`--table`, `--rows FILE`)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
from rich import box
from rich.table import Table

from cosim.commands.terminal import console

LEFT = "rows"
"""The property of a test's report that holds its rows."""


@dataclass(frozen=True)
class Row:
    """A computed quantity beside its target.

    `measure` says how the error is taken: relative to the target, as the absolute difference, or
    "bound" for a quantity that must not exceed its target.  A "comparison" with an experiment is
    absolute and never fails: its tolerance is the experiment's spread, and it says whether the
    model lies within.  A row that is only "shown", as every time that a clock took, has a relative
    error and no tolerance.
    `order` is the measured order of convergence where two meshes were solved; `source` says where
    the target is from."""

    name: str
    quantity: str
    target: float
    computed: float
    tolerance: float
    source: str
    measure: Literal["relative", "absolute", "bound", "comparison", "shown"] = "relative"
    order: float | None = None

    @property
    def error(self) -> float:
        """Relative or absolute error; of a bound, what exceeds it (0 where nothing does)."""
        difference = self.computed - self.target
        if self.measure == "bound":
            return max(difference, 0.0)
        scale = abs(self.target) if self.measure in ("relative", "shown") else 1.0
        return abs(difference) / scale

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; NaN never is.  A comparison, or a row that is
        only shown, needs only be computed."""
        if self.measure in ("comparison", "shown"):
            return math.isfinite(self.error)
        return self.error <= self.tolerance

    @property
    def verdict(self) -> str:
        """ "pass" or "FAIL"; "within" or "outside" for a comparison; "shown"."""
        if self.measure == "comparison" and self.passed:
            return "within" if self.error <= self.tolerance else "outside"
        if self.measure == "shown" and self.passed:
            return "shown"
        return "pass" if self.passed else "FAIL"


Judge = Callable[[Iterable[Row]], list[Row]]


def add_options(parser: pytest.Parser) -> None:
    """Add the options that show rows."""
    group = parser.getgroup("proofs")
    group.addoption("--table", action="store_true", help="Print the rows of the proofs.")
    group.addoption("--rows", metavar="FILE", help="Write the rows of the proofs as JSON.")


def judge_of(request: pytest.FixtureRequest) -> Judge:
    """What judges rows, leaves them in the test's report and returns them; those made before an
    error are left too."""

    def judge(made: Iterable[Row]) -> list[Row]:
        found: list[Row] = []
        try:
            for row in made:
                found.append(row)
        finally:
            records = [record(row) for row in found]
            request.node.user_properties.append((LEFT, records))
        assert found, "no rows"
        assert all(row.source and row.name and row.quantity for row in found)
        failed = [
            f"{r.name}, {r.quantity}: {r.computed:g} for {r.target:g}, {r.source}"
            for r in found
            if not r.passed
        ]
        assert not failed, "\n".join(failed)
        return found

    return judge


def record(row: Row) -> dict[str, Any]:
    """A row for JSON: what is not a number is null."""
    out = asdict(row) | {"error": row.error, "verdict": row.verdict}
    return {key: _finite(value) for key, value in out.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, str) or value is None:
        return value
    return float(value) if math.isfinite(value) else None


def show(reports: Iterable[Any], config: pytest.Config) -> None:
    """Print and write the rows that reports hold, as the options ask."""
    records = [
        one
        for report in reports
        if getattr(report, "when", "") == "call"
        for name, rows in report.user_properties
        if name == LEFT
        for one in rows
    ]
    if place := config.getoption("--rows"):
        Path(place).write_text(json.dumps(records, indent=2), encoding="utf-8")
    if config.getoption("--table") and records:
        _print(records)


def _print(records: Sequence[dict[str, Any]]) -> None:
    out = console()
    sources = list(dict.fromkeys(r["source"] for r in records))
    out.print(_table(records, sources))
    for number, source in enumerate(sources, 1):
        out.print(f"[{number}] {source}")
    verdicts = [r["verdict"] for r in records]
    outside = verdicts.count("outside")
    compared = f", {outside} outside an experiment's spread" if outside else ""
    out.print(f"{len(records)} rows, {verdicts.count('FAIL')} failed{compared}")


def _table(records: Sequence[dict[str, Any]], sources: Sequence[str]) -> Table:
    """The rows, a name said once where it repeats and the source by its number; of a bound the
    target is the most allowed."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("name", ratio=1)
    table.add_column("quantity", ratio=1)
    for title in ("target", "computed", "error", "tolerance", "order", "verdict", "source"):
        table.add_column(title, justify="right", no_wrap=True)
    last = ""
    for r in records:
        number = f"[{sources.index(r['source']) + 1}]"
        table.add_row("" if r["name"] == last else r["name"], r["quantity"], *_figures(r), number)
        last = r["name"]
    return table


def _figures(r: dict[str, Any]) -> tuple[str, ...]:
    nan = float("nan")
    target, computed, error, tolerance = (
        nan if r[key] is None else r[key] for key in ("target", "computed", "error", "tolerance")
    )
    if r["measure"] == "bound":
        figures = (f"<= {target + tolerance:.2g}", f"{computed:.2g}", "-", "-")
    else:
        relative = r["measure"] in ("relative", "shown")
        within = "-" if r["measure"] == "shown" else _percent(tolerance, relative)
        figures = (f"{target:.5g}", f"{computed:.5g}", _percent(error, relative), within)
    return (*figures, "" if r["order"] is None else f"{r['order']:.1f}", r["verdict"])


def _percent(value: float, relative: bool) -> str:
    if not relative or value == 0:
        return f"{value:.1g}"
    return f"{100 * value:.2f} %" if value >= 5e-5 else f"{value:.0e}"
