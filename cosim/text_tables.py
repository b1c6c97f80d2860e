"""Tables in text files: TOML, CSV and JSON as they are found, and TOML as the program writes it."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
import tomlkit

from cosim.errors import InputError, first_twice
from cosim.files import MB, read_bytes, shown_path
from cosim.number_text import read_number
from cosim.port import Array

MOST_TOML, MOST_TEXT = 4 * MB, 32 * MB
"""Bytes of a case or study, and of a table, which takes some ten times as much in memory."""
WIDTH = 98
"""Characters of a line of notes in a file that is written."""
SEPARATOR = re.compile(r"sep=([,;])[,;]*", re.IGNORECASE)
"""The first line by which a table tells a spreadsheet how its columns are parted."""
UNIT_IN_BRACKETS = re.compile(r"(.+?)\s*[\[(]\s*([^\])]+?)\s*[\])]")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


def read_text(path: Path, most: int = MOST_TEXT) -> str:
    """The text of a file in UTF-8 of at most `most` bytes, a byte order mark left out.

    Raises InputError."""
    try:
        if path.is_char_device():
            raise InputError(f"{shown_path(path)}: is a device; name a file")
        return read_bytes(path, most).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{shown_path(path)}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{shown_path(path)}: is not a text file in UTF-8") from error
    except ValueError as error:  # a character that no path has
        raise InputError(f"{str(path)!a}: cannot be read: {error}") from error


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.  Raises InputError, with the line that is at fault."""
    text = read_text(path, MOST_TOML)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(_toml_fault(shown_path(path), text, str(error))) from error
    except ValueError as error:  # e.g. an integer of thousands of digits
        raise InputError(f"{shown_path(path)}: is not valid TOML: {error}") from error
    except RecursionError:
        raise InputError(f"{shown_path(path)}: tables are nested too deeply") from None


def packaged_files(folder: str) -> list[Path]:
    """The TOML files of a folder of the packaged cases."""
    return sorted(Path(str(resources.files("cases"))).glob(f"{folder}/*.toml"))


def find_file(path_or_name: str | Path, folder: str, what: str) -> Path:
    """The file at a path, or the packaged one of that name in a folder of the cases; `what` it is.

    Raises InputError."""
    text, packaged = str(path_or_name), {path.stem: path for path in packaged_files(folder)}
    for place in (Path(text), packaged.get(text, Path())):
        try:
            if place.is_file():
                return place.resolve()
        except (OSError, ValueError):  # too long, or a character that no name may have
            continue
    raise InputError(
        f"{text!r}: no such {what} file and no packaged {what}; packaged are: {', '.join(packaged)}"
    )


def read_json_file(path: Path) -> Any:
    """What a JSON file holds.  Raises InputError, with the line that is at fault."""
    try:
        return json.loads(read_text(path))
    except ValueError as error:
        raise InputError(f"{shown_path(path)}: is not valid JSON: {error}") from error
    except RecursionError:
        raise InputError(f"{shown_path(path)}: lists or tables are nested too deeply") from None


def _toml_fault(shown: str, text: str, message: str) -> str:
    """tomllib's message with the line it is about, in plain words."""
    place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", message)
    what = message[: place.start()] if place else message
    twice = re.search(
        r"Cannot overwrite a value|Cannot (?:declare|mutate).*(?:twice|namespace)", what
    )
    if twice:
        what = "this key or table is given twice; keep one"
    if not place or not place[1]:
        return f"{shown}: is not valid TOML: {what} (at the end of the file)"
    line = text.splitlines()[int(place[1]) - 1].strip() if text.splitlines() else ""
    if hint := _hint(what, line, text):
        what = f"{what}: {hint}"
    return f"{shown}, line {place[1]}, column {place[2]}: {what}\n  {line[:100]}"


def _hint(what: str, line: str, text: str) -> str:
    """What to write where a person wrote what other programs take."""
    if "\\" in line and re.search("hex value|Unescaped|escape", what):
        return 'a backslash in " " begins an escape; write the path with / or in single quotes'
    in_table = "{" in line and what.startswith("Invalid initial character for a key part")
    if in_table and re.search(r",\s*}", line):
        return "leave out the comma before the }"
    if in_table:
        return "a table in { } stands on one line; write it so, or as a [table] of its own"
    return _typographic(line)


def _typographic(line: str) -> str:
    found = [mark for mark in "“”„‘’«»" if mark in line]
    return f"write straight quotes, \" or ', in place of {found[0]}" if found else ""


def toml_value(text: str) -> Any:
    """What a text says as a value of TOML; where it is none, the text itself.

    >>> toml_value("[1, 2]"), toml_value("3 N")
    ([1, 2], '3 N')
    """
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if len(parsed) == 1 else text


def toml_text(values: Mapping[str, Any]) -> str:
    """Tables as TOML that reads back the same; a list of lists has a line for each of them.

    >>> print(toml_text({"title": "it", "hood": {"kind": "shell"}}))
    title = "it"
    <BLANKLINE>
    [hood]
    kind = "shell"
    <BLANKLINE>
    """
    return tomlkit.dumps(_with_lines(values))


def _with_lines(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _with_lines(inner) for key, inner in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], list):
        rows = tomlkit.array()
        rows.extend(value)
        return rows.multiline(True)
    return value


def toml_settings(settings: Sequence[str]) -> str:
    """Texts KEY=VALUE, as --set takes them, as lines of TOML; a later one comes on top of those
    before it, key by key.

    >>> toml_settings(["hood.mesh.quads=250", "tendons.EDC={tension='5 N'}"])
    'hood.mesh.quads = 250\\ntendons.EDC.tension = "5 N"\\n'
    """
    merged: dict[str, Any] = {}
    for text in settings:
        key, _, value = text.partition("=")
        table = toml_value(value.strip())
        for name in reversed([name.strip() for name in key.split(".")]):
            table = {name: table}
        merged = _merge(merged, table)
    lines = tomlkit.document()
    for path, value in leaves(merged) if merged else ():
        lines.append(tomlkit.key(path), _inline(value))
    return lines.as_string()


def _merge(below: Any, above: Any) -> Any:
    if isinstance(below, dict) and isinstance(above, dict):
        return below | {key: _merge(below.get(key), value) for key, value in above.items()}
    return above


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """What is no table, or an empty one, with its keys."""
    match value:
        case dict() if value:
            for key, inner in value.items():
                yield from leaves(inner, (*path, key))
        case _:
            yield path, value


def _inline(value: Any) -> Any:
    """The value on one line, tables within it too."""
    match value:
        case dict():
            table = tomlkit.inline_table()
            table.update({key: _inline(inner) for key, inner in value.items()})
            return table
        case list():
            items = tomlkit.array()
            items.extend(_inline(item) for item in value)
            return items
    return tomlkit.item(value)


def notes(paragraphs: Iterable[str]) -> str:
    """Paragraphs as comments of a file, each with its further lines indented."""
    lines = [
        line
        for text in paragraphs
        for line in wrap(text, WIDTH, subsequent_indent="    ", break_long_words=False) or [""]
    ]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


@dataclass(frozen=True)
class CsvRow:
    """A row of a table; `place` names its file and line."""

    place: str
    cells: Mapping[str, str]
    """The texts by column."""
    has_commas: bool = False
    """Whether decimal commas are allowed, in a file whose columns are parted by semicolons."""

    def number(self, column: str) -> float | None:
        """The number in a column, None where it is empty or there is no such column.

        Raises InputError for another text."""
        text = self.cells.get(column, "")
        if self.has_commas and DECIMAL_COMMA.fullmatch(text):
            text = text.replace(",", ".")
        if not text:
            return None
        if (value := read_number(text)) is None:
            raise InputError(f"{self.place}: {column} is {text!r}; expected a finite number")
        return value


@dataclass(frozen=True)
class CsvTable:
    """A table of the user's, its first line the names of the columns."""

    path: Path
    place: str
    """The file and the line of the names."""
    columns: tuple[str, ...]
    rows: tuple[CsvRow, ...]

    def numbers(self, column: str) -> Array:
        """The numbers (n,) of a column without gaps.  Raises InputError, naming the line."""
        if column not in self.columns:
            raise InputError(
                f"{self.path}: has no column {column!r}; it has {', '.join(self.columns)}"
            )
        values = [(row, row.number(column)) for row in self.rows]
        for row, value in values:
            if value is None:
                raise InputError(f"{row.place}: {column} is empty; expected a number")
        return np.array([value for _, value in values], dtype=float)


def read_csv(path: Path, example: str) -> CsvTable:
    """A table of text: lines that begin with `#` are for people, columns are parted by commas, or
    by semicolons, which allow decimal commas.  A unit of a column may stand in brackets, a line
    `sep=;` may come first; rows without any text are left out.  `example`: what the first line may
    be, for errors.

    Raises InputError, naming the line."""
    shown = shown_path(path)
    lines = [
        (i, line)
        for i, line in enumerate(read_text(path).replace("\r\n", "\n").split("\n"), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(
            f"{shown}: is empty; its first line names the columns, for example {example}"
        )
    stated = SEPARATOR.fullmatch(lines[0][1].strip())
    if stated and len(lines) > 1:
        lines = lines[1:]
    first = lines[0][1]
    guessed = ";" if ";" in first and "," not in first else ","
    mark = stated[1] if stated else guessed
    table = [(place := f"{shown}, line {i}", _cells(place, line, mark)) for i, line in lines]
    place, names = table[0]
    columns = tuple(map(_with_unit, names))
    columns = columns[: max(i for i, name in enumerate(columns, 1) if name or i == 1)]
    if "" in columns:
        raise InputError(f"{place}: column {columns.index('') + 1} has no name")
    if twice := first_twice(columns):
        raise InputError(f"{place}: two columns are called {twice!r}; keep one")
    return CsvTable(path, place, columns, tuple(_rows(columns, table[1:], mark == ";")))


def _with_unit(name: str) -> str:
    """A column's name with its unit as ours have it: `distal [mm]` is distal_mm."""
    found = UNIT_IN_BRACKETS.fullmatch(name)
    if found is None:
        return name
    unit = found[2].replace("°", "deg").replace("%", "percent")
    return f"{found[1].strip()}_{re.sub(r'[ .*·]', '', unit)}"


def _rows(
    columns: Sequence[str], table: Iterable[tuple[str, Sequence[str]]], has_commas: bool
) -> Iterator[CsvRow]:
    for place, cells in table:
        if not any(cells):
            continue
        if len(cells) < len(columns) or any(cells[len(columns) :]):
            raise InputError(f"{place}: has {len(cells)} cells, the first line {len(columns)}")
        yield CsvRow(place, dict(zip(columns, cells, strict=False)), has_commas)


def _cells(place: str, line: str, separator: str) -> tuple[str, ...]:
    try:
        (cells,) = csv.reader([line], skipinitialspace=True, delimiter=separator)
    except csv.Error as error:
        raise InputError(f"{place}: cannot be read as cells ({error})") from None
    return tuple(cell.strip() for cell in cells)


def packaged_rows(name: str) -> tuple[CsvRow, ...]:
    """The rows of the packaged table cases/data/NAME.csv."""
    return read_csv(Path(str(resources.files("cases"))) / "data" / f"{name}.csv", name).rows
