"""Muscle forces of an OpenSim table as a case's tendon tensions (Jadelis, thesis, 2.1.2).

One of the files that know the solvers by name."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.case.file import base_name, find_case, load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.files import output_file
from cosim.models.fit import check_fit
from cosim.results.sto import TENSION
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.schema.types import TENDONS
from rigid.opensim.sto import StoTable, read_sto

OUTPUTS = ("", "tendon_force", "actuation", "tension")
"""What may follow a muscle's name in a reporter's label: `/forceset/EDC|tendon_force`."""


@dataclass(frozen=True)
class TensionTable:
    """The table's columns that are tendons of ours."""

    table: StoTable
    column: Mapping[str, str]
    """The table's column of each tendon."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Columns that are no tendon of ours."""
        return tuple(c for c in self.table.columns if c not in self.column.values())


def read_tensions(path: Path, named: Mapping[str, str]) -> TensionTable:
    """The tendons' columns of a .sto or .mot: those called as ours, whatever the case of letters
    and the path before; `named` says of a tendon which column it is.

    Raises InputError for a tendon or column that there is not, a tendon that two columns could be,
    a table without rows or tendons, and a force below zero."""
    table = read_sto(path, ())
    if not len(table.time):
        raise InputError(f"{path}: the table has no rows; expected one time at least")
    for tendon, column in named.items():
        if tendon not in TENDONS:
            raise InputError(f"--column {tendon}={column}: tendons are {', '.join(TENDONS)}")
        if column not in table.columns:
            raise InputError(
                f"{path}: has no column {column!r}; it has {_list_names(table.columns)}"
            )
    columns = dict(named)
    for tendon in TENDONS:
        like = [c for c in table.columns if _is_label_of(c, tendon)]
        if tendon not in named and len(like) > 1:
            raise InputError(
                f"{path}: {tendon} could be {' or '.join(like)}; say which with "
                f"--column {tendon}={like[0]}"
            )
        if tendon not in named and like and like[0] not in named.values():
            columns[tendon] = like[0]
    if not columns:
        raise InputError(
            f"{path}: no column has the name of a tendon; it has {_list_names(table.columns)}. "
            "Say which is which, "
            f"for example --column EDC={table.columns[0] if table.columns else 'EDC1'}"
        )
    for tendon, column in columns.items():
        values = table.values[:, table.columns.index(column)]
        if (values < 0).any():
            k = int(np.argmax(values < 0))
            raise InputError(
                f"{path}, column {column!r}, time {table.time[k]:g} s: {values[k]:g} N for the "
                f"tendon {tendon}; a tendon pulls with zero or more"
            )
    return TensionTable(table, {t: columns[t] for t in TENDONS if t in columns})


def tensions_at(tensions: TensionTable, time: float | None) -> dict[str, float]:
    """Tensions (N) by tendon at a time in s, linear between rows; at the last without one.

    Raises InputError for a time that the table does not span."""
    table = tensions.table
    at = float(table.time[-1]) if time is None else time
    if not table.time[0] <= at <= table.time[-1]:
        raise InputError(
            f"--time {at:g}: the table spans {table.time[0]:g} to {table.time[-1]:g} s"
        )
    return {
        tendon: float(np.interp(at, table.time, table.values[:, table.columns.index(column)]))
        for tendon, column in tensions.column.items()
    }


def write_case(
    source: Path, tensions: TensionTable, out: Path, base: str, time: float | None, over_time: bool
) -> Case:
    """Write a case that lays the tensions over the case `base`, and load it: those at a time, or,
    `over_time`, the table's columns as the tensions of a motion.

    Raises InputError where the case that comes of it has a fault."""
    name = base_name(find_case(base), out.parent)
    lines = [schema_line(CASE_SCHEMA), f"extends = {json.dumps(name)}"]
    if over_time:
        _check_span(tensions.table, base)
        path = json.dumps(Path(os.path.relpath(source, out.parent)).as_posix())
        lines.append(f"title = {json.dumps(f'Tensions of {source.name}')}")
        for tendon, column in tensions.column.items():
            signal = f'{{ kind = "file", path = {path}, column = {json.dumps(column)} }}'
            lines += ["", f"[tendons.{tendon}]", 'tension = "1 N"', f"signal = {signal}"]
    else:
        at = float(tensions.table.time[-1]) if time is None else time
        lines.append(f"title = {json.dumps(f'Tensions of {source.name} at {at:g} s')}")
        for tendon, tension in tensions_at(tensions, time).items():
            note = f"  # column {json.dumps(tensions.column[tendon])}"
            lines += ["", f"[tendons.{tendon}]", f'tension = "{tension!r} N"{note}']
    with output_file(out) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            case = load_case(part)
            check_fit(case)
        except InputError as error:
            raise InputError(str(error).replace(part.name, out.name)) from error
    return case


def _check_span(table: StoTable, base: str) -> None:
    forward = load_case(base).forward
    if forward is None:
        raise InputError(
            f"{base}: is no motion, and --over-time needs one: a case with a table [forward], for "
            "example motion_edc_fdp"
        )
    if table.time[0] > 0 or table.time[-1] < forward.duration:
        raise InputError(
            f"the table spans {table.time[0]:g} to {table.time[-1]:g} s, the motion of {base} 0 "
            f"to {forward.duration:g} s; record "
            "longer, or extend a case with a shorter duration"
        )


def _is_label_of(column: str, tendon: str) -> bool:
    """Whether a label is a tendon's, as OpenSim or as `cosim show` writes it."""
    name, _, output = column.partition("|")
    muscle = name.rpartition("/")[2].lower()
    return muscle in (tendon.lower(), tendon.lower() + TENSION) and output in OUTPUTS


def _list_names(columns: Sequence[str], most: int = 20) -> str:
    more = f" and {len(columns) - most} more" if len(columns) > most else ""
    return ", ".join(columns[:most]) + more
