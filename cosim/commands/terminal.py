"""What all commands share: errors as one message with an exit code, and tables of a fixed width
where the output is no terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from cosim.errors import CosimError, InputError, NoMemoryError, NoRoomError, StoppedError, span
from cosim.results.table import Cell, ReportTable

CODES = {NoRoomError: 1, InputError: 2, StoppedError: 130}
"""Exit codes of errors, by the first that an error is; 1 of all others."""
AUDIT_MISSED = 3
"""Exit code where a run missed its audit; its results are written."""
INCOMPLETE = 3
"""Exit code where a picture or table of a run could not be made; what is solved is written."""
WIDTH = 120
"""Columns where the output is no terminal."""


def tell(error: CosimError) -> int:
    """Say what is wrong; the exit code."""
    typer.echo(f"cosim: {error}", err=True)
    return next((code for kind, code in CODES.items() if isinstance(error, kind)), 1)


def warn_of_audits(missed: Mapping[str, Sequence[str]]) -> int:
    """Say on the error stream what the audits of runs missed, by the run's name; the exit code."""
    for name, misses in missed.items():
        if misses:
            typer.echo(f"cosim: {name}: THE AUDIT IS MISSED, do not trust this result", err=True)
        for miss in misses:
            typer.echo(f"  {miss}", err=True)
    return AUDIT_MISSED if any(missed.values()) else 0


def warn(warnings: Mapping[str, Sequence[str]]) -> None:
    """Say on the error stream what to know of runs before their results are used, by the run's
    name; the exit code stays."""
    for name, texts in warnings.items():
        for text in texts:
            typer.echo(f"cosim: {name}: WARNING: {text}", err=True)


def say(text: str) -> None:
    """Tell on the error stream what is done now."""
    typer.echo(text, err=True)


def note(texts: Mapping[str, Sequence[str]]) -> None:
    """Say on the error stream what is in order but easily overlooked, by the run's name."""
    for name, each in texts.items():
        for text in each:
            typer.echo(f"cosim: {name}: {text}", err=True)


@contextmanager
def exit_on_error() -> Iterator[None]:
    """Faults as one message and an exit code."""
    try:
        yield
    except CosimError as error:
        raise typer.Exit(tell(error)) from None
    except MemoryError as error:
        raise typer.Exit(tell(NoMemoryError.of(error))) from None


def console(to_errors: bool = False) -> Console:
    """The printer of plain text, as wide as the terminal."""
    width = None if sys.stdout.isatty() else WIDTH
    return Console(width=width, highlight=False, markup=False, stderr=to_errors)


class Stages:
    """The signs of life of what takes more than two seconds: its stages, and of those that can be
    counted n of m with the time left."""

    def __init__(self, name: str, total: int, show: Callable[[str], None]) -> None:
        self._head, self._total, self._show = f"{name}: " if name else "", total, show
        self._done, self._started = 0, time.perf_counter()

    def say(self, text: str) -> None:
        """Tell what is done now."""
        self._show(f"{self._head}{text}")

    def begin(self, text: str) -> None:
        """Tell that the next of the counted stages begins."""
        self._tell(self._done + 1, text)
        self._done += 1

    def end(self, text: str) -> None:
        """Tell that one of the counted stages, which may run side by side, has ended."""
        self._done += 1
        self._tell(self._done, text)

    def _tell(self, number: int, text: str) -> None:
        seconds, left = time.perf_counter() - self._started, self._total - self._done
        rest = f", about {span(seconds / self._done * left)} left" if self._done and left else ""
        self.say(f"{number}/{self._total} {text}{rest}")


@contextmanager
def stages(name: str = "", total: int = 0) -> Iterator[Stages]:
    """Tell of the stages of a command on the error stream: on a terminal in one line that moves,
    with the seconds that have passed, else in a line for each."""
    if not sys.stderr.isatty():
        yield Stages(name, total, lambda text: typer.echo(text, err=True))
        return

    words = TextColumn("{task.description}", markup=False)
    columns = (SpinnerColumn(), words, TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield Stages(name, total, lambda text: bar.update(task, description=text))


def print_table(
    title: str, header: Sequence[str], rows: Sequence[Sequence[Cell]], of_words: bool = False
) -> None:
    """The title, if there is one, and below it the rows, the first column to the left; of a table
    of words all."""
    if title:
        typer.echo(title)
    console().print(ReportTable("", title, header, rows).in_terminal(of_words))


def show_table(table: ReportTable, of_words: bool = False) -> None:
    """Print a table under its title."""
    print_table(table.title, table.columns, table.words(), of_words)
