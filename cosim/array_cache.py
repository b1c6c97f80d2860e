"""Arrays that took long to compute, kept in the user's cache folder for later processes.

Each entry is an .npz file of plain arrays under a key that names all that determines them
(`cosim.content_key`), with a digest of the arrays.  A file that is cut off, damaged, packed, or of
another place or user is not used, and the next writer replaces it.  The digest tells of accidents,
not of intent: whoever uses an entry checks that it is an answer, and drops it where it is none.  No
failure of the disk fails a run.
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cosim.content_key import arrays_key
from cosim.files import atomic_path

VARIABLE = "COSIM_CACHE_DIR"
"""Variable of the environment that names the folder, or says `OFF`."""
OFF = "off"
MOST_BYTES = 1_000_000_000
DIGEST = "digest"
Kind = Literal["distances", "equilibria", "mesh_errors"]
FOLDERS: tuple[str, ...] = ("distances", "equilibria", "mesh_errors", "")
"""The folders of the kinds; the last is where versions before this one kept distances."""
OURS = re.compile(r"[0-9a-f]{64}\.npz|\.[0-9a-f]{40}\.\d+\.[0-9a-f]{8,12}\.part")
"""Names of the files that the cache writes, or a version before wrote; it removes no others."""


class Contents(NamedTuple):
    """How much lies in a cache."""

    files: int
    bytes: int


@dataclass(frozen=True)
class ArrayCache:
    """A folder of entries by kind and key, of at most `most_bytes` together.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cache, key = ArrayCache(Path(folder)), 64 * "0"
    ...     cache.write("distances", key, {"x": np.arange(3.0)})
    ...     cache.read("distances", key)
    ...     cache.clear().files
    {'x': array([0., 1., 2.])}
    1
    """

    folder: Path
    """It may not exist yet."""
    most_bytes: int = MOST_BYTES

    def read(self, kind: Kind, key: str) -> dict[str, Any] | None:
        """The arrays by name that were written under a key (64 hexadecimal digits), None where none
        can be used.  They are marked as used last."""
        file = self._file(kind, key)
        with suppress(Exception):  # whatever zipfile, zlib and numpy raise of a spoilt file
            if not _is_own(file.stat()):
                return None
            arrays = read_arrays(file, f"{kind} {key}", self.most_bytes)
            with suppress(OSError):
                os.utime(file)
            return arrays
        return None

    def drop(self, kind: Kind, key: str) -> None:
        """Remove what is kept under a key, where it proved to be wrong."""
        with suppress(OSError):
            self._file(kind, key).unlink()

    def write(self, kind: Kind, key: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays under a key, and remove what was used longest ago where there is too much.  A
        folder that cannot be written to only costs the time to compute them again."""
        file = self._file(kind, key)
        with suppress(OSError):
            with atomic_path(file) as part, part.open("wb") as stream:
                digest = np.array(arrays_key(f"{kind} {key}", arrays))
                np.savez(stream, **{**arrays, DIGEST: digest})
            self._shrink(file)

    def contents(self) -> dict[str, Contents]:
        """How much there is of each kind; the key "" counts what an older version left."""
        found: dict[str, Contents] = {}
        for folder in FOLDERS:
            sizes = [stat.st_size for _, stat in self._entries(folder)]
            if sizes or folder:
                found[folder] = Contents(len(sizes), sum(sizes))
        return found

    def clear(self) -> Contents:
        """Remove all entries, and say how much was removed."""
        count = size = 0
        for folder in FOLDERS:
            for path, stat in self._entries(folder):
                with suppress(OSError):
                    path.unlink()
                    count, size = count + 1, size + stat.st_size
        return Contents(count, size)

    def _file(self, kind: Kind, key: str) -> Path:
        return self.folder / kind / f"{key}.npz"

    def _entries(self, folder: str) -> Iterator[tuple[Path, os.stat_result]]:
        with suppress(OSError):
            for path in list((self.folder / folder).iterdir()):
                if OURS.fullmatch(path.name):
                    with suppress(OSError):  # another process has removed it
                        yield path, path.stat()

    def _shrink(self, newest: Path) -> None:
        """Remove what was used longest ago, but never `newest`, until the rest is small enough."""
        entries = [entry for folder in FOLDERS for entry in self._entries(folder)]
        size = sum(stat.st_size for _, stat in entries)
        for path, stat in sorted(entries, key=lambda entry: entry[1].st_mtime_ns):
            if size <= self.most_bytes:
                return
            if path != newest:
                size -= stat.st_size
                with suppress(OSError):
                    path.unlink()


def read_arrays(path: Path, place: str, most_bytes: int) -> dict[str, Any]:
    """The arrays by name of an .npz file that was written for `place`, without their digest.

    Raises ValueError for a file that was changed, is packed, or is or says that it is larger than
    `most_bytes` or than itself, of which no array is read; and whatever zipfile and numpy raise of
    one that is none."""
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise ValueError("it is no file")
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
            raise ValueError("it is packed, and none is")
        if sum(entry.file_size for entry in archive.infolist()) > min(size, most_bytes):
            raise ValueError("it says that it is larger than it is")
    with np.load(path, allow_pickle=False) as stored:
        arrays: dict[str, Any] = {name: stored[name] for name in stored.files}
    if str(arrays.pop(DIGEST, "")) != arrays_key(place, arrays):
        raise ValueError("it was changed after it was written: its digest differs")
    return arrays


def _is_own(status: os.stat_result) -> bool:
    """Whether a file is of the user who asks; where files have no owner, yes."""
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def user_cache() -> ArrayCache | None:
    """The user's cache, None where `VARIABLE` turns it off."""
    named = os.environ.get(VARIABLE)
    if named == OFF:
        return None
    if named:
        return ArrayCache(Path(named))
    from platformdirs import user_cache_path

    return ArrayCache(user_cache_path("cosim", appauthor=False))
