"""What is wrong with somebody else's zip archive: asked before anything of it is unpacked."""

from __future__ import annotations

import stat
import struct
import zipfile
from collections import Counter
from collections.abc import Sequence
from lzma import LZMAError
from pathlib import PurePosixPath
from zlib import error as ZlibError

UNREADABLE = (
    *(zipfile.BadZipFile, ZlibError, LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, OSError, ValueError),
)
"""What zipfile raises over archives that are damaged, encrypted or packed in unknown ways."""


def archive_fault(entries: Sequence[zipfile.ZipInfo], most_files: int, most_bytes: int) -> str:
    """What is wrong with an archive of these entries; empty where nothing is.  The sizes are those
    that zipfile holds it to."""
    return next(filter(None, (_crowd(entries, most_files, most_bytes), *map(_fault, entries))), "")


def _crowd(entries: Sequence[zipfile.ZipInfo], most_files: int, most_bytes: int) -> str:
    """What is wrong with the archive as a whole."""
    size, names = sum(e.file_size for e in entries), Counter(e.filename.lower() for e in entries)
    if len(entries) > most_files or size > most_bytes:
        return (
            f"unpacks to {len(entries)} files of {size / 2**20:.0f} MiB, expected at most "
            f"{most_files} of {most_bytes / 2**20:.0f} MiB"
        )
    twice = [name for name, times in names.items() if times > 1]
    if not twice:
        return ""
    return f"holds {twice[0]!r} more than once (upper and lower case are the same on some systems)"


def _fault(entry: zipfile.ZipInfo) -> str:
    """What is wrong with one file of the archive."""
    name, parts = entry.orig_filename, PurePosixPath(entry.orig_filename).parts
    if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or ".." in parts:
        return f"the file {name!r} would lie outside of its folder"
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return f"{name!r} is a link or a device, expected files and folders"
    return f"{name!r} is encrypted" if entry.flag_bits & 1 else ""
