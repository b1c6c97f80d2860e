"""How large a file may be that is read: asked before any of it is in memory."""

from __future__ import annotations

from pathlib import Path
from stat import S_ISREG

from cosim.errors import InputError

MB = 1 << 20


def check_file_size(path: Path, most: int) -> None:
    """Check that a file has at most `most` bytes; of a pipe or a device nothing is known.

    >>> check_file_size(Path(__file__), MB)

    Raises InputError for a larger one, and OSError where there is none."""
    status = path.stat()
    if S_ISREG(status.st_mode) and status.st_size > most:
        raise InputError(
            f"{path}: has {_megabytes(status.st_size)}; of such a file at most {_megabytes(most)} "
            "are read"
        )


def read_bytes(path: Path, most: int) -> bytes:
    """The bytes of a file, a pipe or a device, at most `most`.

    Raises InputError where it has more, and OSError where it cannot be read."""
    check_file_size(path, most)
    with path.open("rb") as stream:
        raw = stream.read(most + 1)
    if len(raw) > most:
        raise InputError(f"{path}: has more than {_megabytes(most)}, the most that is read")
    return raw


def _megabytes(size: int) -> str:
    return f"{max(size / MB, 0.001):,.3g} MB" if size < 1000 * MB else f"{size / MB:,.0f} MB"
