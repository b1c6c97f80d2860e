"""Files that are read up to a size, and files and folders that are written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from stat import S_ISREG
from tempfile import TemporaryDirectory, gettempdir
from typing import TypeGuard
from uuid import uuid4

from cosim.errors import CosimError, InputError, NoRoomError, unexpected

MB = 1 << 20
FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
"""Faults of a disk without room, and of a file or user at their limit."""
PASSING = re.compile(r"\..+\.(?P<process>\d+)\.(?P<machine>[0-9a-f]{4})\w{8}\.(part|old|probe)")
"""Names of what stands beside its place while it is written (`beside`)."""
SLACK = 60.0
"""Seconds by which a process may seem to have begun after what it wrote: clocks are set."""
_CLEARED: set[Path] = set()
"""Folders of `clear_leftovers`."""
MOVE_LIMIT = 2.0 if sys.platform == "win32" else 0.0
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


MOST_PART = 255
"""Bytes of the name of a file or folder."""


def is_path(given: object) -> TypeGuard[str | Path]:
    """Whether it is a text or a path that a file can have."""
    if not isinstance(given, str | os.PathLike) or not isinstance(os.fspath(given), str):
        return False
    try:
        longest = max((len(os.fsencode(part)) for part in Path(given).parts), default=0)
    except UnicodeEncodeError:
        return False
    return longest <= MOST_PART and "\0" not in os.fspath(given)


def path_from(place: str, given: object) -> Path:
    """A path that is an argument.  Raises InputError."""
    if not is_path(given):
        raise unexpected(place, "a path", given)
    return Path(given)


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
    end = time.monotonic() + MOVE_LIMIT
    while True:
        try:
            part.replace(target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
            time.sleep(0.02)


def beside(path: Path, ending: str = "part") -> Path:
    """A name beside `path` that no writer has, on no machine; it says whose it is, for
    `clear_leftovers`."""
    mark = f"{os.getpid()}.{_machine()}{uuid4().hex[:8]}"
    return path.with_name(f".{path.name[:40]}.{mark}.{ending}")


@cache
def _machine() -> str:
    """Four digits for what numbers the processes: this machine, and in a container that."""
    try:
        numbering = os.readlink("/proc/self/ns/pid")
    except OSError:  # not Linux
        numbering = ""
    return hashlib.sha256(f"{socket.gethostname()} {numbering}".encode()).hexdigest()[:4]


def clear_leftovers(folder: Path) -> None:
    """Remove what processes of this machine that were killed left half-written in a folder."""
    _CLEARED.add(folder.absolute())
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            found = PASSING.fullmatch(path.name)
            if found and found["machine"] == _machine() and _is_left(path, int(found["process"])):
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    with suppress(OSError):
                        path.unlink()


def clear_again() -> None:
    """Remove what the processes that this one ended left where it cleared before."""
    for folder in list(_CLEARED):
        clear_leftovers(folder)


def _is_left(path: Path, number: int) -> bool:
    """Whether the process of that number that wrote to a path has ended; another one may have the
    number now, which began later."""
    import psutil

    try:
        process = psutil.Process(number)
        began, is_ended = process.create_time(), process.status() == psutil.STATUS_ZOMBIE
        return is_ended or began > path.lstat().st_mtime + SLACK
    except psutil.NoSuchProcess:
        return True
    except (psutil.Error, OSError):
        return False


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


def temporary_folder(name: str) -> TemporaryDirectory[str]:
    """A folder for files that pass, which goes with this value; after a process that was killed,
    with the next one that asks for one."""
    clear_leftovers(Path(gettempdir()))
    start = f".{name}.{os.getpid()}.{_machine()}"
    return TemporaryDirectory(prefix=start, suffix=".part", ignore_cleanup_errors=True)


def unwritable(path: Path, error: OSError, choose: str, needed: int = 0) -> CosimError:
    """The error in words for what could not be written: without room NoRoomError, with how much is
    there and the bytes that were `needed`, if that is known; else InputError."""
    if error.errno not in FULL:
        return InputError(f"{path}: cannot be written ({error.strerror or error}); {choose}")
    known = [f"{_size(needed)} are needed"] if needed else []
    if error.errno == errno.ENOSPC:
        place = next(p for p in path.absolute().parents if p.exists())
        known.append(f"{_size(shutil.disk_usage(place).free)} are free")
    words = ", ".join([error.strerror or str(error), *known])
    return NoRoomError(f"{path}: there is no room for it ({words}); make room, or {choose}")


def _size(size: float) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e7 else f"{size / 1e3:.0f} kB"


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A place beside `path`, of this writer's own, to write to; moved to `path` once the block has
    ended well, and removed where it has not.  Makes the folder.  Raises OSError."""
    part = beside(path)
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

    Raises InputError where the file cannot be written, NoRoomError on a full disk."""
    check_file(path)
    try:
        with atomic_path(path) as part:
            yield part
    except OSError as error:
        raise unwritable(path, error, "choose another") from error


def write_text(path: Path, text: str) -> None:
    """Write a text to a file that a user asked for.  Raises as `output_file` does."""
    with output_file(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def output_folder(target: Path, mark: str) -> Iterator[Path]:
    """An empty folder beside `target` to write to, moved there once the block has ended well.

    It replaces one that an earlier call left, known by its file `mark`, or an empty one.  Raises
    InputError where it cannot be written, or where something else stands in its place, and
    NoRoomError on a full disk."""
    part = beside(target)
    try:
        check_folder(target, mark)
        part.mkdir(parents=True)
        yield part
        replace_folder(target, part)
    except OSError as error:
        raise unwritable(target, error, "choose another folder") from error
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
    clear_leftovers(place)
    probe = beside(place / path.name, "probe")
    try:
        probe.mkdir()  # rights alone do not tell
        probe.rmdir()
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
