"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cosim.port import InputError


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A place beside `path` to write to, moved there once the block has ended well.

    Raises InputError where the file cannot be written."""
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no file that could be replaced; choose another")
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); choose another") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
