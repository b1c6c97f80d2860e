"""OpenSim's tables over time: .sto and .mot, of motions, states and forces.

A header of `key=value` lines up to `endheader`, a line of labels of which the first is `time`, then
a row per time.  Version 1 states nRows and nColumns; version 3 states DataType and OpenSimVersion.
`inDegrees=yes` means that angles are in degrees; a file does not say which columns are angles, so
whoever reads or writes one names them.  Here they are in rad always.

Markers over time: .trc, the tables of motion capture that OpenSim reads.

Two lines of keys and their values (the unit of length among them) follow the first line; then come
`Frame#`, `Time` and the markers' names, each over three columns, a line `X1 Y1 Z1 ...`, and a row
per frame.  A marker that the cameras lost has empty cells.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cosim.errors import InputError, ReadingWarning
from cosim.files import MB, read_bytes, write_text
from cosim.number_text import MOST_NUMBER, RANGE, is_plain, read_number
from cosim.port import Array

MOST_BYTES = 64 * MB
MOST_HEADER = 1 << 16
"""Characters."""
OPENSIM = "4.6"
"""OpenSim's version whose layout version 3 is written in."""
STATES = ("value", "speed")
"""Ends of the columns of a coordinate's states, `/jointset/JOINT/COORDINATE/value`."""


@dataclass(frozen=True)
class StoTable:
    """Columns over time: `time` (n,) s, increasing; `values` (n, m) in SI units, angles in rad.

    `angles` are the coordinates (or columns) that are angles; `in_degrees` says whether the file
    holds them in degrees.  Raises InputError where the parts do not fit."""

    name: str
    columns: tuple[str, ...]
    time: Array
    values: Array
    in_degrees: bool = False
    angles: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.columns))
        if self.time.shape != shape[:1] or self.values.shape != shape:
            raise InputError(
                f"table {self.name!r}: expected values {shape}, got {self.values.shape}"
            )
        if len(set(self.columns)) < len(self.columns):
            twice = next(c for c in self.columns if self.columns.count(c) > 1)
            raise InputError(f"table {self.name!r}: the column {twice!r} comes twice")
        if not (np.isfinite(self.time).all() and np.isfinite(self.values).all()):
            raise InputError(f"table {self.name!r} holds a value that is not finite")
        if not (np.diff(self.time) > 0).all():
            k = int(np.argmax(np.diff(self.time) <= 0))
            raise InputError(
                f"table {self.name!r}: time must increase, but {self.time[k]:g} s is followed by "
                f"{self.time[k + 1]:g} s (row {k + 2})"
            )


def is_angle(column: str, angles: Collection[str]) -> bool:
    """Whether a column is one of `angles`, or the value or speed of one in a file of states."""
    parts = column.split("/")
    return column in angles or (len(parts) > 1 and parts[-1] in STATES and parts[-2] in angles)


def coordinate_of(column: str) -> str:
    """The coordinate whose values a column holds, under its path in a file of states too; the
    column's own label where it is none such."""
    *above, last = column.split("/")
    return above[-1] if above and last == STATES[0] else column


def _scale(columns: Sequence[str], angles: Collection[str]) -> Array:
    """The columns' factors (m,), degrees per unit: 180/pi of an angle, 1 of others."""
    return np.where([is_angle(c, angles) for c in columns], np.degrees(1.0), 1.0)


def read_sto(path: Path, angles: Collection[str] | None = None) -> StoTable:
    """Read a .sto or .mot.  `angles`: the rotational coordinates, whose columns (and those of their
    states) are taken from degrees to rad where the file says `inDegrees=yes`.

    Warns (ReadingWarning) of a header that counts other rows or columns, as OpenSim 4.5 leaves it,
    and of a first or last row that is there twice, of which one is taken.

    Raises InputError (naming file and line) for what is no such table, for a value that is not
    finite, for time that does not increase, and for degrees where `angles` is not given.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from rigid.opensim.sto import StoTable, read_sto, write_sto
    >>> table = StoTable("forces", ("EDC", "FDP"), np.array([0.0, 0.1]), np.ones((2, 2)))
    >>> with TemporaryDirectory() as folder:
    ...     write_sto(Path(folder) / "forces.sto", table)
    ...     read_sto(Path(folder) / "forces.sto").columns
    ('EDC', 'FDP')
    """
    lines = read_lines(path)
    header, at = _header(lines, path)
    fields = dict(_fields(header))
    if (kind := fields.get("datatype", "double")) != "double":
        raise InputError(f"{path}: DataType is {kind[:20]}, expected double")
    columns = _labels(lines, at, path)
    table = _numbers(lines, at + 1, len(columns), path)
    _warn_of_counts(fields, table, path)
    table = _drop_doubled_ends(table, path)
    degrees = _in_degrees(fields, path)
    values = table[:, 1:]
    if degrees:
        if angles is None:
            raise InputError(f"{path}: its angles are in degrees; say which columns are angles")
        values = values / _scale(columns[1:], angles)
    name = header[0].strip() if header and "=" not in header[0] else ""
    try:
        return StoTable(name, columns[1:], table[:, 0], values, degrees, tuple(angles or ()))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_lines(path: Path) -> list[str]:
    """The lines of a table over time, a text in UTF-8.  Raises InputError."""
    try:
        return read_bytes(path, MOST_BYTES).decode("utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text in UTF-8; expected a table over time") from error


def _header(lines: list[str], path: Path) -> tuple[list[str], int]:
    """The lines before `endheader` and the number of the one behind it."""
    size = 0
    for k, line in enumerate(lines):
        if line.strip().lower() == "endheader":
            return lines[:k], k + 1
        size += len(line) + 1
        if size > MOST_HEADER:
            raise InputError(f"{path}, line {k + 1}: no endheader in {MOST_HEADER >> 10} kB")
    raise InputError(f"{path}: the line endheader is missing; expected a .sto or .mot table")


def _fields(header: Sequence[str]) -> Iterator[tuple[str, str]]:
    for line in header:
        key, equals, value = line.partition("=")
        if equals:
            yield key.strip().lower(), value.strip()


def _in_degrees(fields: Mapping[str, str], path: Path) -> bool:
    word = fields.get("indegrees", "no").lower()
    if word not in ("yes", "no"):
        raise InputError(f"{path}: inDegrees is {word[:20]!r}, expected yes or no")
    return word == "yes"


def _labels(lines: list[str], at: int, path: Path) -> tuple[str, ...]:
    line = lines[at] if at < len(lines) else ""
    labels = tuple(c.strip() for c in (line.strip().split("\t") if "\t" in line else line.split()))
    if not labels or labels[0].lower() != "time":
        raise InputError(f"{path}, line {at + 1}: expected labels, the first of them time")
    return tuple(label for label in labels if label)


def _numbers(lines: list[str], at: int, columns: int, path: Path) -> Array:
    """The numbers (n, columns) of the lines from `at` on, empty ones left out."""
    rows, places = [], []
    for k, line in enumerate(lines[at:], at + 1):
        row = line.split()
        if not is_plain(line):
            raise InputError(f"{path}, line {k}: expected numbers, got {line[:40]!r}")
        if row and len(row) != columns:
            raise InputError(f"{path}, line {k}: {len(row)} values, expected {columns} as labels")
        if row:
            rows.append(row)
            places.append(k)
    try:
        out = np.array(rows, dtype=float).reshape(-1, columns)
    except ValueError as error:
        raise _not_numbers(rows, places, path) from error
    bad = ~(np.abs(out) <= MOST_NUMBER)
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise InputError(
            f"{path}, line {places[i]}, column {j + 1}: {rows[i][j][:20]}, expected a finite "
            f"number of at most {MOST_NUMBER:g}"
        )
    return out


def _not_numbers(rows: list[list[str]], places: list[int], path: Path) -> InputError:
    for row, place in zip(rows, places, strict=True):
        for j, word in enumerate(row):
            try:
                float(word)
            except ValueError:
                what = f"{word[:20]!r} in column {j + 1}, expected a number"
                return InputError(f"{path}, line {place}: {what}")
    return InputError(f"{path}: its values are not numbers")


def _warn_of_counts(fields: Mapping[str, str], table: Array, path: Path) -> None:
    for key, count in zip(("nrows", "ncolumns"), table.shape, strict=True):
        said = fields.get(key, str(count))
        if said != str(count):
            what = {"nrows": "nRows", "ncolumns": "nColumns"}[key]
            warnings.warn(
                f"{path}: the header says {what}={said[:20]}, the file has {count}: it is stale, "
                "or the file was cut off",
                ReadingWarning,
                stacklevel=3,
            )


def _drop_doubled_ends(table: Array, path: Path) -> Array:
    """The table without a first or last row that has the time of its neighbour; the outer one
    goes."""
    for first, second, place in ((0, 1, "first"), (-1, -2, "last")):
        if len(table) > 1 and table[first, 0] == table[second, 0]:
            warnings.warn(
                f"{path}: its {place} two rows have one time, {table[first, 0]:g} s; the "
                f"{place} is left out",
                ReadingWarning,
                stacklevel=3,
            )
            table = table[1:] if first == 0 else table[:-1]
    return table


def write_sto(path: Path, table: StoTable, version: Literal[1, 3] = 3) -> None:
    """A table as OpenSim reads and plots it, numbers in full precision; where `table.in_degrees`,
    the columns of `table.angles` are written in degrees.

    Raises InputError for labels that hold blanks and where the file cannot be written."""
    for label in (*table.columns, *table.name.split()):
        if not label.isprintable() or len(label.split()) != 1 or "=" in label:
            raise InputError(f"table {table.name!r}: {label!r} is no label; leave out blanks and =")
    scale = _scale(table.columns, table.angles) if table.in_degrees else np.ones(len(table.columns))
    rows = np.column_stack([table.time, table.values * scale])
    lines = [*_header_lines(table, version), "\t".join(("time", *table.columns))]
    lines += ["\t".join(map(repr, row)) for row in rows.tolist()]
    write_text(path, "\n".join(lines) + "\n")


def _header_lines(table: StoTable, version: Literal[1, 3]) -> list[str]:
    name = " ".join(table.name.split()) or "table"
    degrees = f"inDegrees={'yes' if table.in_degrees else 'no'}"
    if version == 1:
        n, m = table.values.shape
        return [name, "version=1", f"nRows={n}", f"nColumns={m + 1}", degrees, "endheader"]
    kept = ["DataType=double", "version=3", f"OpenSimVersion={OPENSIM}"]
    return [name, degrees, *kept, "endheader"]


LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
HEAD = 5
"""Lines before the rows."""


@dataclass(frozen=True)
class MarkerMotion:
    """Markers' places (nt, nm, 3) m in the laboratory, NaN where one is not seen, at times (nt,) s
    that rise."""

    names: tuple[str, ...]
    time: Array
    place: Array


def read_trc(path: Path) -> MarkerMotion:
    """Read a .trc.  Raises InputError, naming the line."""
    lines = read_lines(path)
    if len(lines) < HEAD + 1 or not lines[0].startswith("PathFileType"):
        raise InputError(
            f"{path}: is no .trc: expected PathFileType in line 1, keys, values, names and axes in "
            "the next four, then a row per frame"
        )
    head = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    unit = head.get("Units", "")
    if unit not in LENGTHS:
        known = ", ".join(LENGTHS)
        raise InputError(f"{path}, line 3: Units is {unit!r}; expected one of {known}")
    names = tuple(name for word in lines[3].split("\t")[2:] if (name := word.strip()))
    if not names or len(set(names)) < len(names):
        twice = next((n for n in names if names.count(n) > 1), None)
        what = "names no marker after Frame# and Time" if twice is None else f"names {twice} twice"
        raise InputError(f"{path}, line 4: {what}; names are parted by tabs")
    rows = [
        _row(f"{path}, line {i}", line, len(names))
        for i, line in enumerate(lines[HEAD:], HEAD + 1)
        if line.strip()
    ]
    if not rows:
        raise InputError(f"{path}: has no row of a frame")
    table = np.array(rows)
    time = table[:, 0]
    if not (np.diff(time) > 0).all():
        k = int(np.argmax(np.diff(time) <= 0))
        raise InputError(f"{path}: time must rise; {time[k]:g} s is followed by {time[k + 1]:g} s")
    return MarkerMotion(names, time, LENGTHS[unit] * table[:, 1:].reshape(len(rows), -1, 3))


def _row(place: str, line: str, markers: int) -> list[float]:
    cells = [word.strip() for word in line.split("\t")]
    most = 2 + 3 * markers
    if len(cells) < 2 or any(cells[most:]):
        raise InputError(f"{place}: {len(cells)} cells; expected at most {most}, parted by tabs")
    cells = [*cells[1:most], *[""] * (most - len(cells))]
    numbers = [_number(place, cell) for cell in cells]
    if not np.isfinite(numbers[0]) or np.isinf(numbers).any():
        raise InputError(f"{place}: expected a time and finite places")
    return numbers


def _number(place: str, cell: str) -> float:
    """The number in a cell, NaN in an empty one."""
    if not cell or cell.lower() == "nan":
        return np.nan
    if (number := read_number(cell)) is None:
        raise InputError(f"{place}: {cell[:20]!r} is no number, {RANGE}")
    return number
