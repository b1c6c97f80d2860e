"""The store: a row for each run that ended, under its address, whole or not there.

    format.json          what this folder is
    rows/ab/ab12....json a run that ended; written beside, synced and moved into place
    parts/....parquet    rows that `pack` has put together, named by their content
    arrays/ab/ab12....nc arrays of a run, where they were asked for
    executions.log       begun and ended runs, a line each
    studies/NAME.json    how far a study is, for `cosim study --status`

Many processes on many machines may write at once: a row is one file with one name, and the same
address means the same row.  Only rows that converged are packed, and those never change.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from cosim.errors import InputError, NoRoomError
from cosim.files import FULL, atomic_path, clear_leftovers
from cosim.json_text import json_text
from cosim.outcome import Status

FORMAT = {"format": "cosim study store 1"}
COLUMNS = ("key", "status", "reason", "summary", "case", "seconds", "host", "code", "limit")


class StoreError(InputError):
    """The store cannot be written; what had finished stays."""


class FullStoreError(StoreError, NoRoomError):
    """There is no room for the store (exit code 1)."""


@dataclass(frozen=True)
class StoreRow:
    """What came of a run; `limit`: the seconds it was given, where that is why it ended."""

    key: str
    status: Status
    reason: str
    summary: Mapping[str, Any]
    case: str
    seconds: float
    host: str
    code: str
    limit: float | None = None


@dataclass
class Store:
    """The folder, and what is known of its parts, which never change."""

    root: Path
    _parts: dict[str, frozenset[str]] = field(default_factory=dict, repr=False)

    def open(self) -> Store:
        """Made if need be.  Raises InputError where the folder is another's, or cannot be made."""
        mark = self.root / "format.json"
        try:
            if self.root.is_dir() and any(self.root.iterdir()) and not mark.is_file():
                raise InputError(f"{self.root}: is no store of studies; choose another folder")
            if not mark.is_file():
                self.write(mark, json.dumps(FORMAT).encode())
            stored = json.loads(mark.read_bytes())
        except (OSError, ValueError) as error:
            raise InputError(f"{self.root}: cannot be used as a store ({error})") from error
        for folder in (self.root, *self.root.glob("*/"), *self.root.glob("*/*/")):
            clear_leftovers(folder)
        if stored != FORMAT:
            raise InputError(f"{mark}: expected {FORMAT['format']!r}; choose another folder")
        return self

    def find(self, key: str) -> StoreRow | None:
        """The row under an address; of one that is packed all but its summary."""
        if (row := self._loose(key)) is not None:
            return row
        if self.is_packed(key):
            return StoreRow(key, "converged", "", {}, "", 0.0, "", "")
        return None

    def _loose(self, key: str) -> StoreRow | None:
        try:
            return StoreRow(**json.loads(self._path(key).read_bytes()))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{self._path(key)}: is no row ({error}); delete it") from error

    def _path(self, key: str) -> Path:
        return self.root / "rows" / key[:2] / f"{key}.json"

    def arrays(self, key: str) -> Path:
        """Where a run's arrays are, if they are."""
        return self.root / "arrays" / key[:2] / f"{key}.nc"

    def is_packed(self, key: str) -> bool:
        """Whether a part has it; parts that others wrote in the meantime are seen."""
        self._read_parts()
        return any(key in keys for keys in self._parts.values())

    def _read_parts(self) -> None:
        folder = self.root / "parts"
        if not folder.is_dir():
            return
        for path in sorted(folder.glob("*.parquet")):
            if path.name not in self._parts:
                from pyarrow import parquet

                column = parquet.read_table(path, columns=["key"]).column("key")
                self._parts[path.name] = frozenset(column.to_pylist())

    def put(self, row: StoreRow) -> None:
        """Write the row of a run that ended.  Raises StoreError."""
        self.write(self._path(row.key), json_text(asdict(row), None, ensure_ascii=True).encode())

    def write(self, path: Path, content: bytes) -> None:
        """The file whole, synced, or as it was.  Raises StoreError."""
        self.write_with(path, lambda part: _sync(part, content))

    def write_with(self, path: Path, writer: Callable[[Path], None]) -> None:
        """The same as `write`, by a function that writes to a path.  Raises StoreError."""
        try:
            with atomic_path(path) as part:
                writer(part)
            _sync_folder(path.parent)
        except OSError as error:
            raise self.unwritable(error) from error

    def unwritable(self, error: OSError) -> StoreError:
        """The fault in words."""
        kind = FullStoreError if error.errno in FULL else StoreError
        return kind(
            f"the store {self.root} cannot be written ({error.strerror or error}); every run that "
            "had finished is kept: make room, and give the same command again"
        )

    def log(self, word: Literal["begun", "ended"], key: str) -> None:
        """A line in the book of executions.  Raises StoreError."""
        line = f"{word} {key} {socket.gethostname()} {os.getpid()} {time.time():.3f}\n"
        try:
            with (self.root / "executions.log").open("ab", buffering=0) as file:  # O_APPEND
                file.write(line.encode())
        except OSError as error:
            raise self.unwritable(error) from error

    def rows(self, keys: Collection[str]) -> Iterator[StoreRow]:
        """The rows at these addresses, each once, in no order.

        Loose ones are read first: one that is packed meanwhile is found in its part then."""
        wanted = set(keys)
        for key in list(wanted):
            if (row := self._loose(key)) is not None:
                wanted.discard(key)
                yield row
        self._read_parts()
        for name, held in self._parts.items():
            in_part = wanted & held
            if in_part:
                wanted -= in_part
                yield from (row for row in _read(self.root / "parts" / name) if row.key in in_part)

    def pack(self) -> int:
        """Put the loose rows that converged into a part; how many.  Raises StoreError."""
        loose = sorted((self.root / "rows").glob("*/*.json"))
        rows = [row for path in loose if (row := self._loose(path.stem)) is not None]
        rows = [row for row in rows if row.status == "converged"]
        if not rows:
            return 0
        digest = hashlib.sha256("".join(row.key for row in rows).encode()).hexdigest()
        self.write_with(
            self.root / "parts" / f"{digest}.parquet", lambda part: _write_part(part, rows)
        )
        self._read_parts()
        for row in rows:
            with suppress(OSError):
                self._path(row.key).unlink(missing_ok=True)
        return len(rows)


def _sync(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """So that a file's new name outlives a power cut, where the system can."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _write_part(path: Path, rows: list[StoreRow]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    schema = pa.schema(
        [(c, pa.float64() if c in ("seconds", "limit") else pa.string()) for c in COLUMNS]
    )
    records = [asdict(row) | {"summary": json.dumps(row.summary)} for row in rows]
    table = pa.Table.from_pylist(records, schema=schema)
    parquet.write_table(table, path, compression="zstd")
    with path.open("r+b") as file:  # Windows syncs only what may be written to
        os.fsync(file.fileno())


def _read(path: Path) -> Iterator[StoreRow]:
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        for batch in file.iter_batches(1000):
            for record in batch.to_pylist():
                yield StoreRow(**(record | {"summary": json.loads(record["summary"])}))
