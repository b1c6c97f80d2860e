"""What all commands share: errors as one message with an exit code, and tables of a fixed width
where the output is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from cosim.port import CosimError, InputError

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 120
"""Columns where the output is no terminal."""


def tell(error: CosimError) -> int:
    """Say what is wrong; the exit code."""
    typer.echo(f"cosim: {error}", err=True)
    return 2 if isinstance(error, InputError) else 1


@contextmanager
def told() -> Iterator[None]:
    """Faults as one message and an exit code."""
    try:
        yield
    except CosimError as error:
        raise typer.Exit(tell(error)) from None


def console() -> Console:
    """Of plain text, as wide as the terminal."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False, markup=False)


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """The title, if there is one, and below it the rows, the first column to the left."""
    from rich import box
    from rich.table import Table

    if title:
        typer.echo(title)
    table = Table(box=box.SIMPLE, pad_edge=False)
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*row)
    console().print(table)
