"""The reference of the documentation, made from what the program knows of itself: its commands, the
keys of a case file, and the numbers of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from typer.main import get_command
from typer.testing import CliRunner

from cosim.case.file import json_schema
from cosim.cli import app
from cosim.commands.listing import LISTS, Rows, Schema, Things, describe_key

REFERENCE = ("reference/commands.md", "reference/case.md", "reference/quantities.md")
"""The places of the pages."""
DEEPEST = 4
"""Tables within tables that are told."""


def reference_pages() -> dict[str, str]:
    """The pages' texts by their places."""
    header, rows = LISTS[Things.QUANTITIES]()
    keys = ["# Keys of a case file", "", *_keys(json_schema(), "")]
    quantities = ["# Numbers of a run", "", *_table(header, rows)]
    texts = ("\n".join(lines) + "\n" for lines in (_commands(), keys, quantities))
    return dict(zip(REFERENCE, texts, strict=True))


def _commands() -> Iterator[str]:
    yield "# Commands"
    command = get_command(app)
    for name in command.list_commands(None):  # type: ignore[attr-defined, arg-type]
        told = CliRunner().invoke(app, [name, "--help"], prog_name="cosim").output
        yield f"\n## cosim {name}\n\n```text\n{told.strip()}\n```"


def _keys(whole: Schema, key: str, seen: frozenset[str] = frozenset()) -> Iterator[str]:
    """Each form of a table of a case file with its keys, then the tables in it."""
    inner: dict[str, None] = {}
    for heading, text, rows in describe_key(whole, key):
        if not rows or (said := "\n".join(_table(("key", "what", "default"), rows))) in seen:
            continue
        seen |= {said}
        yield from (f"## {heading}", "", text, "", said, "")
        names = re.findall(r"by name: (\w+)", text)
        inner |= dict.fromkeys(k for row in rows for k in (names if row[0] == "NAME" else row[:1]))
    if key.count(".") < DEEPEST - 1:
        for name in inner:
            if name != "NAME":
                yield from _keys(whole, f"{key}.{name}" if key else name, seen)


def _table(header: Sequence[str], rows: Rows) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield f"|{'---|' * len(header)}"
    for first, *rest in rows:
        cells = (cell.replace("|", "\\|").replace("<", "&lt;") for cell in rest)
        yield f"| `{first}` | {' | '.join(cells)} |"
