"""The points that a case names on a sheet: in its file, in a table of its own, or on a grid."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from cosim.errors import InputError
from cosim.files import shown_path
from cosim.port import AXES
from cosim.schema import units
from cosim.schema.fields import fault
from cosim.schema.types import COORDINATE, Coordinate, Count, Table

Place = tuple[float, float, float]
"""m, along the world's axes, on the undeformed hood."""
MOST_POINTS = 2500
"""On one hood: the summary has nine numbers or more of each."""
SEPARATORS = "./"
"""They part the keys of a quantity, so that no name has them."""


class GridConfig(Table):
    """A grid of points over a rectangle of the undeformed hood, seen from dorsal, as a camera for
    image correlation sees it: from one end to the other along the world's distal and radial axes,
    `count` points along each.  The points are called NAME_i_j, counted from 1."""

    distal: tuple[Coordinate, Coordinate]
    """Its two ends along the distal axis."""
    radial: tuple[Coordinate, Coordinate]
    """Its two ends along the radial axis."""
    count: tuple[
        Annotated[Count, Field(ge=2, le=MOST_POINTS)],
        Annotated[Count, Field(ge=2, le=MOST_POINTS)],
    ]
    """Points along the distal and along the radial axis."""

    @model_validator(mode="after")
    def _ends_rise(self) -> GridConfig:
        for name, (first, last) in (("distal", self.distal), ("radial", self.radial)):
            if first >= last:
                raise fault(f"{name}: the second end must be above the first")
        return self

    def names(self, grid: str) -> list[str]:
        """The names of its points, those along the radial axis next to each other."""
        distal, radial = self.count
        return [f"{grid}_{i}_{j}" for i in range(1, distal + 1) for j in range(1, radial + 1)]


def check_names(names: Sequence[str]) -> None:
    """Raises ValueError for a name that no quantity could hold, one that comes twice, and more
    points than MOST_POINTS."""
    if len(names) > MOST_POINTS:
        raise ValueError(f"{len(names)} points in all; at most {MOST_POINTS}")
    seen = set()
    for name in names:
        if not name.strip() or any(c in name for c in SEPARATORS):
            raise ValueError(
                f"{name!r} is no name of a point: expected a text without points and slashes, "
                "which part the keys of a quantity"
            )
        if name in seen:
            raise ValueError(f"two points are called {name}; rename one")
        seen.add(name)


def read_points(path: Path) -> dict[str, Place]:
    """The points of a CSV file by name: a column `name`, and one for each of the world's axes with
    its unit, `distal_mm`, `radial_mm` and `dorsal_mm`.  Lines that begin with `#` are for people.

    Raises InputError, which names the line."""
    shown = shown_path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{shown}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{shown}: is not a text file in UTF-8") from error
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(i, line) for i, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(f"{shown}: is empty; its first line names the columns, for example {HEAD}")
    separator = ";" if ";" in lines[0][1] else ","
    table = [(i, _cells(line, separator)) for i, line in lines]
    columns = _columns(f"{shown}, line {table[0][0]}", table[0][1])
    found: dict[str, Place] = {}
    for i, row in table[1:]:
        where = f"{shown}, line {i}"
        if len(row) != len(table[0][1]):
            raise InputError(f"{where}: expected {len(table[0][1])} values, found {len(row)}")
        name = row[columns["name"][0]]
        try:
            check_names([*found, name])
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        found[name] = _place(where, row, columns)
    if not found:
        raise InputError(f"{shown}: has no point below the names of its columns")
    return found


HEAD = ",".join(("name", *(f"{axis}_mm" for axis in AXES)))


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _columns(where: str, header: Sequence[str]) -> dict[str, tuple[int, str]]:
    """The place of each column and its unit, by `name` or axis."""
    found: dict[str, tuple[int, str]] = {}
    for i, title in enumerate(header):
        axis, _, unit = title.partition("_")
        if title != "name" and (axis not in AXES or not _is_length(unit)):
            raise InputError(
                f"{where}: unknown column {title!r}; expected name and, each with a unit of "
                f"length, {', '.join(AXES)}: {HEAD}"
            )
        if axis in found:
            raise InputError(f"{where}: two columns are of {axis}; keep one")
        found[axis] = (i, unit)
    if lacking := [name for name in ("name", *AXES) if name not in found]:
        raise InputError(f"{where}: has no column of {', '.join(lacking)}; expected {HEAD}")
    return found


def _is_length(unit: str) -> bool:
    try:
        return bool(units.parse(f"1 {unit}", units.LENGTH))
    except ValueError:
        return False


def _place(where: str, row: Sequence[str], columns: Mapping[str, tuple[int, str]]) -> Place:
    def coordinate(axis: str) -> float:
        place, unit = columns[axis]
        cell = row[place]
        try:
            float(cell)
        except ValueError:
            raise InputError(f"{where}, {axis}: {cell!r} is not a number") from None
        try:
            value: float = COORDINATE.read(f"{cell} {unit}")
        except PydanticCustomError as error:
            raise InputError(f"{where}, {axis}: {cell} {unit} {error.message()}") from None
        return value

    distal, radial, dorsal = (coordinate(axis) for axis in AXES)
    return distal, radial, dorsal
