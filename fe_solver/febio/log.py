"""Forces on rigid bodies as FEBio logs them: sections of its log file, and data files.

FEBio writes a record at each output time (FECore/DataRecord.cpp, FEBio 2.9 and 4): into the log

    Data Record #1
    ===========================================================================
    Step = 1
    Time = 0.1
    Data = Fx;Fy;Fz

and, of a record with a file of its own, into that file `*Step  = 1`, `*Time  = 0.1`,
`*Data  = Fx;Fy;Fz`.  A row for each body follows, its number first.  Fx, Fy, Fz are the reaction
force of a rigid body and Mx, My, Mz the reaction moment about its centre of mass, in the model's
axes and units.  The reaction is what holds the body: the opposite of what tissue and contact do to
it (FEBioMech/FEResidualVector.cpp subtracts that).
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.files import MB, read_bytes
from cosim.number_text import MOST_NUMBER, read_number
from cosim.port import Array

FORCE, MOMENT = ("Fx", "Fy", "Fz"), ("Mx", "My", "Mz")
MOST_BYTES = 256 * MB
MOST_WORD = 40
KEYS = ("Step", "Time", "Data", "File")
RECORD = "Data Record #"
SEPARATOR = re.compile(r"[\s,;]+")
TITLE = "*Title"
SOLVING = "beginning time step"
NORMAL = "NORMALTERMINATION"


@dataclass(frozen=True)
class RigidReactions:
    """Reactions of rigid bodies over time, in FEBio's axes and the model's units."""

    time: Array
    """(n,) increasing."""
    bodies: tuple[int, ...]
    """FEBio's numbers of the rigid bodies."""
    force: Array
    """(n, nb, 3)."""
    moment: Array | None
    """(n, nb, 3) about the centres of mass; None where none was logged."""


@dataclass
class _Section:
    """One record at one time, as it stands in the file."""

    line: int
    record: str
    time: float | None = None
    columns: tuple[str, ...] = ()
    elsewhere: bool = False
    """The record has a file of its own, and no rows here."""
    rows: dict[int, list[float]] = field(default_factory=dict)


def read_reactions(paths: Sequence[Path], columns: Sequence[str] = ()) -> RigidReactions:
    """The reactions in log files and data files together; each body comes once, at the same times.

    `columns` are those of records whose Data line names none ("name" of the log's XML replaces it).
    Raises InputError, with file and line, for what is no such file, a file that is cut off, values
    that are not finite, bodies or columns that a time lacks or that come twice, times that do not
    increase, and files whose times differ."""
    series: dict[tuple[int, str], Array] = {}
    first: Array | None = None
    for path in paths:
        for record in _records(path, tuple(columns)):
            time, by_quantity = _table(path, record)
            if first is not None and not np.array_equal(first, time):
                raise InputError(
                    f"{path}, line {record[0].line}: {len(time)} times, the first {time[0]:g} and "
                    f"the last {time[-1]:g}; before there were {len(first)}, {first[0]:g} to "
                    f"{first[-1]:g}. Log all bodies at the same times"
                )
            first = time
            for key, values in by_quantity.items():
                if key in series:
                    body, column = key
                    raise InputError(f"{path}: {column} of body {body} comes twice; name it once")
                series[key] = values
    if first is None:
        raise InputError(f"{', '.join(map(str, paths))}: {_WANTED}")
    return _assemble(paths, first, series)


_WANTED = (
    "no record of rigid bodies' reactions; expected rows under a Data line such as Fx;Fy;Fz, as "
    '<rigid_body_data data="Fx;Fy;Fz;Mx;My;Mz"> makes them, or the names with --columns'
)


def _assemble(
    paths: Sequence[Path], time: Array, series: Mapping[tuple[int, str], Array]
) -> RigidReactions:
    bodies = tuple(sorted({body for body, _ in series}))
    has_moment = any(column in MOMENT for _, column in series)
    for body in bodies:
        for column in FORCE + (MOMENT if has_moment else ()):
            if (body, column) not in series:
                raise InputError(
                    f"{', '.join(map(str, paths))}: body {body} has no {column}; log "
                    f"{';'.join(FORCE + (MOMENT if has_moment else ()))} of each body"
                )

    def stack(columns: Sequence[str]) -> Array:
        return np.stack(
            [np.column_stack([series[body, c] for c in columns]) for body in bodies], axis=1
        )

    return RigidReactions(time, bodies, stack(FORCE), stack(MOMENT) if has_moment else None)


def _table(path: Path, record: list[_Section]) -> tuple[Array, dict[tuple[int, str], Array]]:
    """The times of a record and its series, by body and column."""
    time = np.array([section.time for section in record], dtype=float)
    head = record[0]
    for before, section in itertools.pairwise(record):
        assert before.time is not None  # `_check_section` sees to it
        assert section.time is not None
        if section.time <= before.time:
            raise InputError(
                f"{path}, line {section.line}: time {section.time:g} follows {before.time:g}; "
                "times must increase. Keep the steps in the order in which FEBio wrote them"
            )
        if section.columns != head.columns:
            raise InputError(
                f"{path}, line {section.line}: the columns are {';'.join(section.columns)}, at "
                f"the first time they were {';'.join(head.columns)}"
            )
    bodies = set().union(*(section.rows for section in record))
    for section in record:
        if missing := sorted(bodies - set(section.rows)):
            raise InputError(
                f"{path}, line {section.line}, time {section.time:g}: body "
                f"{', '.join(map(str, missing))} is missing, which other times have. Is the file "
                "cut off? Take one of a run that has ended"
            )
    return time, {
        (body, column): np.array([section.rows[body][k] for section in record])
        for body in bodies
        for k, column in enumerate(head.columns)
        if column in FORCE + MOMENT
    }


def _records(path: Path, columns: tuple[str, ...]) -> list[list[_Section]]:
    """The sections of each record that holds reactions, in the order of the file."""
    text = _text(path)
    is_log = any(line.strip().startswith(RECORD) for line in text.splitlines())
    if is_log:
        _check_end(path, text)
    records: dict[str, list[_Section]] = {}
    for section in _sections(path, text, is_log, columns):
        if not section.elsewhere and set(section.columns) & set(FORCE + MOMENT):
            records.setdefault(section.record, []).append(section)
    return list(records.values())


def _text(path: Path) -> str:
    try:
        raw = read_bytes(path, MOST_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8; expected a log of FEBio") from error
    if text and not text.endswith("\n"):
        raise InputError(
            f"{path}, line {len(text.splitlines())}: the file ends within a line, so that its last "
            "number may be cut off. Take a file of a run that has ended"
        )
    return text


def _check_end(path: Path, text: str) -> None:
    """A log of a whole run, not an extract of one, must say that the run ended well."""
    if SOLVING in text and NORMAL not in text.replace(" ", ""):
        raise InputError(
            f"{path}: FEBio's run did not end well, or its log is cut off: there is no "
            "N O R M A L   T E R M I N A T I O N. Take the log of a run that has ended"
        )


def _sections(path: Path, text: str, is_log: bool, columns: tuple[str, ...]) -> Iterator[_Section]:
    current: _Section | None = None
    record = ""
    for k, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        key, value = _head(line)
        starts = line.startswith(RECORD) if is_log else key == "Step"
        ends = is_log and current is not None and bool(current.rows) and not _is_row(line)
        if current is not None and (starts or ends):
            yield _check_section(path, current)
            current = None
        if starts:
            record = line.removeprefix(RECORD) if is_log else ""
            current = _Section(k, record)
        elif current is not None and key and not current.rows:
            _note(path, k, current, key, value, columns)
        elif current is not None and current.columns and not current.elsewhere and line:
            if _is_row(line) or not is_log:
                _add_row(path, k, current, line)
        elif line and not is_log and not line.startswith(TITLE):
            raise InputError(
                f"{path}, line {k}: {line[:40]!r} without *Step, *Time and *Data before it; "
                'expected a data file of FEBio, written with comments="on", or its log'
            )
    if current is not None:
        yield _check_section(path, current)


def _head(line: str) -> tuple[str, str]:
    """Key and value of a line of a section's head; empty texts of any other line."""
    key, equals, value = line.partition("=")
    key = key.lstrip("*").strip()
    return (key, value.strip()) if equals and key in KEYS else ("", "")


def _is_row(line: str) -> bool:
    return line[:1].isdigit() and line[:1].isascii()


def _note(
    path: Path, line: int, section: _Section, key: str, value: str, columns: tuple[str, ...]
) -> None:
    """Keep what a line of a section's head says."""
    if key == "Time":
        section.time = _number(path, line, 0, value)
    elif key == "Data":
        named = tuple(word.strip() for word in value.split(";"))
        section.columns = named if set(named) & set(FORCE + MOMENT) else columns or named
    elif key == "File":
        section.elsewhere = True


def _add_row(path: Path, line: int, section: _Section, text: str) -> None:
    if not set(section.columns) & set(FORCE + MOMENT):
        return
    words = [word for word in SEPARATOR.split(text) if word]
    if not (words and words[0].isascii() and words[0].isdigit()):
        raise InputError(f"{path}, line {line}: {text[:40]!r}: expected a body's number")
    if len(words) != 1 + len(section.columns):
        raise InputError(
            f"{path}, line {line}: {len(words) - 1} values of body {words[0][:12]}, expected "
            f"{len(section.columns)} ({';'.join(section.columns)}). Is the file cut off?"
        )
    body = int(words[0][:18])
    if body in section.rows:
        raise InputError(f"{path}, line {line}: body {body} comes twice at time {section.time}")
    section.rows[body] = [_number(path, line, k, word) for k, word in enumerate(words[1:], 1)]


def _number(path: Path, line: int, place: int, word: str) -> float:
    """A finite number; `place`: of the value in its row, 0 for a time."""
    value = read_number(word) if len(word) <= MOST_WORD else None
    if value is None:
        what = f"value {place}" if place else "Time"
        raise InputError(
            f"{path}, line {line}, {what}: {word[:20]!r}, expected a finite number of at most "
            f"{MOST_NUMBER:g}"
        )
    return value


def _check_section(path: Path, section: _Section) -> _Section:
    """The section, once it is whole."""
    if section.elsewhere or (section.columns and not set(section.columns) & {*FORCE, *MOMENT}):
        return section
    missing = [
        what
        for what, given in (
            ("Time", section.time is not None),
            ("Data line", bool(section.columns)),
            ("rows", bool(section.rows)),
        )
        if not given
    ]
    if missing:
        raise InputError(
            f"{path}, line {section.line}: the record that begins here has no "
            f"{' and no '.join(missing)}. Is the file cut off?"
        )
    return section
