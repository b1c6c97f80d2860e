"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cosim.port import InputError

PATIENCE = 2.0 if sys.platform == "win32" else 0.0
"""Seconds that a move waits for another process: Windows moves nothing that one has open, a
scanner for viruses among them."""


def move_into_place(part: Path, target: Path) -> None:
    """Give `part` the name `target`, in place of a file that has it.

    Raises OSError."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            part.replace(target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
            time.sleep(0.02)


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
        move_into_place(part, path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); choose another") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
