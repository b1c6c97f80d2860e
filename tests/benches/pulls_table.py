"""The table of pulls, in linear solves beside what they once took."""

from __future__ import annotations

from rich.table import Table

from cosim.commands.terminal import console, stages
from tests.benches.pulls import REST, MeasuredPull, measure_pulls, read_pulls


def bench_pulls() -> dict[str, float]:
    """Solve, print the table and return the totals.  Raises InputError."""
    pulls = read_pulls()
    settings = list(dict.fromkeys((p.case, p.settings) for p in pulls))
    with stages("bench", len(settings)) as progress:
        measured = list(measure_pulls(pulls, progress.begin))
    table = Table("hood", "tendon")
    for name in ("N", "linear solves", "before", "CPU s"):
        table.add_column(name, justify="right")
    shown = ""
    for m in measured:
        hood = " ".join((m.pull.case, *m.pull.settings))
        force = f"{m.pull.force:g}" if m.pull.tendon else ""
        solves = f"{m.solves} failed" if m.failure else str(m.solves)
        row = [m.pull.tendon or REST, force, solves, str(m.pull.solves_before), f"{m.cpu_s:.2f}"]
        table.add_row("" if hood == shown else hood, *row)
        shown = hood
    screen = console()
    screen.print(table)
    drawn = [m for m in measured if m.pull.tendon]
    resting = [m for m in measured if not m.pull.tendon]
    ratios: dict[str, float] = {}
    for what, some in (("pulls", drawn), ("goings to rest", resting)):
        screen.print(_total(what, some))
        total, total_before = _solves(some)
        ratios[f"{what}: linear solves each"] = total / len(some)
        ratios[f"{what}: linear solves / before"] = total / total_before
        ratios[f"{what}: failed"] = sum(bool(m.failure) for m in some)
    return ratios


def _total(what: str, some: list[MeasuredPull]) -> str:
    solves, earlier = _solves(some)
    failures = sum(bool(m.failure) for m in some)
    return (
        f"{len(some)} {what}: {solves / len(some):.1f} linear solves each, {solves / earlier:.2f} "
        f"of before; {sum(m.cpu_s for m in some) / len(some):.2f} s CPU each; {failures} failed"
    )


def _solves(some: list[MeasuredPull]) -> tuple[int, int]:
    """Linear solves of all, and before."""
    return sum(m.solves for m in some), sum(m.pull.solves_before for m in some)
