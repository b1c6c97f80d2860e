"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

from cosim.errors import InputError

PATIENCE = 2.0 if sys.platform == "win32" else 0.0
"""Seconds that a move waits for another process: Windows moves nothing that one has open, a
scanner for viruses among them."""


def shown_path(path: Path) -> str:
    """The path relative to the working directory where that is shorter, for messages.

    >>> shown_path(Path.cwd() / "case.toml")
    'case.toml'
    """
    try:
        return min(str(path), os.path.relpath(path), key=len)
    except ValueError:  # another drive
        return str(path)


def relative_path(path: Path, folder: Path) -> str:
    """The path from a folder, as a file in it names another on every system; the whole path to
    another drive.

    >>> relative_path(Path("cases/mine.toml"), Path("runs/mine"))
    '../../cases/mine.toml'
    """
    try:
        return Path(os.path.relpath(os.path.realpath(path), os.path.realpath(folder))).as_posix()
    except ValueError:
        return path.resolve().as_posix()


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
def atomic_path(path: Path) -> Iterator[Path]:
    """A place beside `path`, of this writer's own, to write to; moved to `path` once the block has
    ended well, and removed where it has not.  Makes the folder.  Raises OSError."""
    part = path.with_name(f".{path.name[:40]}.{os.getpid()}.{uuid4().hex[:8]}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        move_into_place(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


@contextmanager
def output_file(path: Path) -> Iterator[Path]:
    """The same for a file that a user asked for.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with output_file(Path(folder) / "numbers.csv") as part:
    ...         _ = part.write_text("1, 2")
    ...     (Path(folder) / "numbers.csv").read_text()
    '1, 2'

    Raises InputError where the file cannot be written."""
    check_file(path)
    try:
        with atomic_path(path) as part:
            yield part
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); choose another") from error


@contextmanager
def output_folder(target: Path, mark: str) -> Iterator[Path]:
    """An empty folder beside `target` to write to, moved there once the block has ended well.

    It replaces one that an earlier call left, known by its file `mark`, or an empty one.  Raises
    InputError where it cannot be written, or where something else stands in its place."""
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        check_folder(target, mark)
        part.mkdir(parents=True)
        yield part
        replace_folder(target, part)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"{target}: cannot be written ({reason}); choose another folder"
        ) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def replace_folder(target: Path, part: Path) -> None:
    """Put the folder `part` in the place of `target`, which stays where that fails.

    Raises OSError."""
    old = part.with_suffix(".old")
    if target.exists():
        move_into_place(target, old)
    try:
        move_into_place(part, target)
    except OSError:
        if old.exists():
            move_into_place(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def check_file(path: Path) -> None:
    """Check that a file can be written to `path`: asked before a long solve, and not after it.
    Raises InputError."""
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no file that could be replaced; choose another")
    _check_place(path)


def _check_place(path: Path) -> None:
    """Check that the folder around `path` can be written to or made.  Raises InputError."""
    place = next(p for p in path.absolute().parents if p.exists())
    if not place.is_dir():
        raise InputError(f"{path}: cannot be written ({shown_path(place)} is no folder)")
    try:
        with TemporaryDirectory(prefix=".cosim-", dir=place):  # rights alone do not tell
            pass
    except OSError as error:
        where = f"{shown_path(place)} may not be written to: {error.strerror}"
        raise InputError(f"{path}: cannot be written ({where})") from error


def check_folder(target: Path, mark: str) -> None:
    """Check that nothing stands at the target that may not be replaced, and that the folder can be
    made: asked before a long solve, and not after it.  Raises InputError."""
    _check_place(target)
    if not target.exists():
        return
    if not target.is_dir() or (any(target.iterdir()) and not (target / mark).is_file()):
        raise InputError(
            f"{target}: is in the way and was not written by this command; choose another"
        )
