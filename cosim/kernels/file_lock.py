"""A lock that processes on one machine take in turn, and that ends with its holder."""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from pathlib import Path

LONGEST_WAIT = 600.0
"""Seconds that a process waits for one that lives and does not come to an end."""
POLL = 0.02


class FileLock:
    """A lock on a file, which is made where there is none and stays.

    The system holds it for the process, and lets go when the process ends, however it does."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._handle: int | None = None

    def acquire(self, patience: float = LONGEST_WAIT) -> bool:
        """Wait for the lock; False where it was not had after `patience` s.

        Raises OSError where the file cannot be made or locked."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        end = time.monotonic() + patience
        try:
            while not _try_lock(handle):
                if time.monotonic() >= end:
                    return False
                time.sleep(POLL)
            self._handle, handle = handle, -1
            return True
        finally:
            if handle >= 0:
                os.close(handle)

    def release(self) -> None:
        """Let the next one have it."""
        if self._handle is not None:
            with suppress(OSError):
                os.close(self._handle)
            self._handle = None


def _try_lock(handle: int) -> bool:
    """Lock an open file where no other process has it.  Raises OSError where none can be locked."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            # a record lock: a fork does not inherit it, and could hold another kind for ever
            fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True
