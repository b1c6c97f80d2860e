"""The words that cases, results and reports use: `cosim glossary`."""

from __future__ import annotations

from importlib.resources import files
from typing import Annotated

import typer
from rich import box
from rich.markdown import Markdown
from rich.table import Table

from cosim.commands.terminal import console, exit_on_error
from cosim.errors import InputError

HEADING = "## Glossary\n"


def glossary(
    word: Annotated[str | None, typer.Argument(help="Only the entries with this word.")] = None,
) -> None:
    """Explain the words and axes that cases, results and reports use.

    Example: cosim glossary excursion"""
    entries = read_glossary()
    with exit_on_error():
        if word is not None:
            entries = {
                name: meaning
                for name, meaning in entries.items()
                if word.casefold() in f"{name} {meaning}".casefold()
            }
            if not entries:
                raise InputError(f"{word}: no entry of the glossary; cosim glossary shows them all")
    table = Table("word", "means", box=box.SIMPLE, pad_edge=False)
    for name, meaning in entries.items():
        table.add_row(name, Markdown(meaning))
    console().print(table)


def read_glossary() -> dict[str, str]:
    """The meaning of each word, from the table in this package's README."""
    text = (files("cosim") / "README.md").read_text(encoding="utf-8").partition(HEADING)[2]
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return dict(rows[1:])
