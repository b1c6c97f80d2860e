"""Markers over time: .trc, the tables of motion capture that OpenSim reads.

Two lines of keys and their values (the unit of length among them) follow the first line; then come
`Frame#`, `Time` and the markers' names, each over three columns, a line `X1 Y1 Z1 ...`, and a row
per frame.  A marker that the cameras lost has empty cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.number_text import RANGE, read_number
from cosim.port import Array
from rigid.opensim.sto import read_lines

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
