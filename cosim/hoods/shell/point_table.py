"""The points that a case names on a sheet: in its file, in a table of its own, or on a grid."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from cosim.errors import InputError, ReadingWarning
from cosim.port import AXES
from cosim.schema import units
from cosim.schema.fields import fault
from cosim.schema.types import COORDINATE, Coordinate, Count, Table
from cosim.text_tables import CsvRow, CsvTable, read_csv

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
    """Check the names of points: none that no quantity could hold, none twice, no more than
    MOST_POINTS.  Raises ValueError."""
    if len(names) > MOST_POINTS:
        raise ValueError(f"{len(names)} points in all; at most {MOST_POINTS}")
    seen = set()
    for name in names:
        if not name.strip() or any(c in name for c in SEPARATORS):
            raise ValueError(
                f"{name!r} is no name of a point: expected a text without points and slashes, "
                f"which separate the keys of a quantity"
            )
        if name in seen:
            raise ValueError(f"two points are called {name}; rename one")
        seen.add(name)


def read_points(path: Path, also: Collection[str] = ()) -> dict[str, Place]:
    """The points of a CSV file by name: a column `name`, and one for each of the world's axes with
    its unit, `distal_mm`, `radial_mm` and `dorsal_mm`.  Lines that begin with `#` are for people.
    Other columns are left out, which is told of those that are not `also` the caller's.

    Raises InputError, which names the line."""
    table = read_csv(path, HEAD)
    units_of = _units(table, also)
    places: dict[str, Place] = {}
    for row in table.rows:
        name = row.cells["name"]
        try:
            check_names([*places, name])
        except ValueError as error:
            raise InputError(f"{row.place}: {error}") from None
        places[name] = _place(row, units_of)
    if not places:
        raise InputError(f"{table.place}: has no point below the names of its columns")
    return places


HEAD = ",".join(("name", *(f"{axis}_mm" for axis in AXES)))


def _units(table: CsvTable, also: Collection[str]) -> dict[str, str]:
    """The unit of each axis, from the names of the columns."""
    unit_of_axis: dict[str, str] = {}
    left_out = []
    for title in table.columns:
        axis, _, unit = title.partition("_")
        if title != "name" and axis not in AXES:
            left_out += [title] if title not in also else []
            continue
        if title != "name" and not _is_length(unit):
            raise InputError(
                f"{table.place}: column {title!r}; expected name and, each with a unit of length, "
                f"{', '.join(AXES)}: {HEAD}"
            )
        if axis in unit_of_axis:
            raise InputError(f"{table.place}: two columns are of {axis}; keep one")
        unit_of_axis[axis] = unit
    if lacking := [name for name in ("name", *AXES) if name not in unit_of_axis]:
        raise InputError(f"{table.place}: has no column of {', '.join(lacking)}; expected {HEAD}")
    if left_out:
        warnings.warn(
            f"{table.place}: left out: {', '.join(left_out)}", ReadingWarning, stacklevel=3
        )
    return unit_of_axis


def _is_length(unit: str) -> bool:
    try:
        return bool(units.parse(f"1 {unit}", units.LENGTH))
    except ValueError:
        return False


def _place(row: CsvRow, unit_of: Mapping[str, str]) -> Place:
    def coordinate(axis: str) -> float:
        unit = unit_of[axis]
        number = row.number(f"{axis}_{unit}")
        if number is None:
            raise InputError(f"{row.place}, {axis}: is empty; expected a number")
        try:
            value: float = COORDINATE.read(f"{number!r} {unit}")
        except PydanticCustomError as error:
            raise InputError(f"{row.place}, {axis}: {number:g} {unit} {error.message()}") from None
        return value

    distal, radial, dorsal = (coordinate(axis) for axis in AXES)
    return distal, radial, dorsal
