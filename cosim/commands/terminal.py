"""What all commands share: errors as one message with an exit code, and tables of a fixed width
where the output is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from cosim.errors import CosimError, InputError, StoppedError

if TYPE_CHECKING:
    from rich.console import Console

CODES = {InputError: 2, StoppedError: 130}
"""Exit codes of errors; 1 of all others."""
AUDIT_MISSED = 3
"""Exit code where a run missed its audit; its results are written."""
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
    for name, found in warnings.items():
        for text in found:
            typer.echo(f"cosim: {name}: WARNING: {text}", err=True)


@contextmanager
def exit_on_error() -> Iterator[None]:
    """Faults as one message and an exit code."""
    try:
        yield
    except CosimError as error:
        raise typer.Exit(tell(error)) from None


def console() -> Console:
    """The printer of plain text, as wide as the terminal."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False, markup=False)


def print_table(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], of_words: bool = False
) -> None:
    """The title, if there is one, and below it the rows, the first column to the left; of a table
    of words all."""
    from rich import box
    from rich.table import Table

    if title:
        typer.echo(title)
    table = Table(box=box.SIMPLE, pad_edge=False)
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 or of_words else "right")
    for row in rows:
        table.add_row(*row)
    console().print(table)
