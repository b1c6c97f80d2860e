"""The cache key of a run: the address of a case as this code solves it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from cosim.case.schema import Case
from cosim.content_key import LIBRARIES, ROOT, library_version, sources_key
from cosim.errors import InputError
from cosim.version import __version__

PACKAGES = ("cosim", "fe_solver", "rigid", "meshes")
ABOUT_RESULTS = (
    *("cosim/report", "cosim/study"),
    *("cosim/commands/report.py", "cosim/commands/study.py"),
)
"""What only shows results or says how runs are spread; it changes no number."""
CHOICES = ("FE_SOLVER_LINEAR", "FE_SOLVER_NO_NUMBA")
"""Variables of the environment that say by what."""
NOT_CODE = (".pyc", ".css", ".js", ".j2", ".md", ".nbi", ".nbc", ".lock")
WORDS = ("title", "notes", "output")
"""Keys of a case that change no number."""


def code_version() -> str:
    """A key of this program: its version, its sources and the data in them, and the libraries that
    compute, with what the environment says of them. Two programs that share it give the same
    numbers on the same kind of machine."""
    chosen = [f"{name}={os.environ[name]}" for name in CHOICES if os.environ.get(name)]
    return " ".join([_installed_version(), *chosen])


@cache
def _installed_version() -> str:
    files = (
        path
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file()
        and path.suffix not in NOT_CODE
        and not path.relative_to(ROOT).as_posix().startswith(ABOUT_RESULTS)
    )
    libraries = " ".join(library_version(name) for name in LIBRARIES)
    return f"{__version__} {sources_key(files)[:16]} {libraries}"


def case_table(case: Case) -> dict[str, Any]:
    """The whole case as its file would state it; `CaseFile` reads the same case from it."""
    return case.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)


def address(case: Case, code: str) -> str:
    """sha256 of the case, with the contents of its files in place of their paths, and of the code.

    Raises InputError where a file cannot be read."""
    files = {str(path): _content(path) for path in _paths(case.model_dump(mode="python"))}
    table = {key: value for key, value in case_table(case).items() if key not in WORDS}
    text = json.dumps([_with_contents(table, files), code], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _paths(values: Any) -> Iterator[Path]:
    match values:
        case Path():
            yield values
        case dict():
            for key, value in values.items():
                if key != "source":
                    yield from _paths(value)
        case list() | tuple():
            for value in values:
                yield from _paths(value)


def _with_contents(values: Any, files: dict[str, str]) -> Any:
    match values:
        case dict():
            return {key: _with_contents(value, files) for key, value in values.items()}
        case list():
            return [_with_contents(value, files) for value in values]
        case str():
            return files.get(values, values)
    return values


def _content(path: Path) -> str:
    try:
        stamp = path.stat()
        return _hash(path, stamp.st_mtime_ns, stamp.st_size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


@lru_cache(maxsize=256)
def _hash(path: Path, time: int, size: int) -> str:
    return f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}"
