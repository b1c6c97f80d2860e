"""Keys of values by their content: what determines a result, in 64 hexadecimal digits."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
LIBRARIES = ("numpy", "scipy", "mujoco", "numba", "feral-solver", "pypardiso")
"""What computes: the last four where they are installed."""
SETTINGS = ("FE_SOLVER_", "NUMBA_", "NPY_", "OPENBLAS_CORETYPE", "MKL_CBWR", "MKL_ENABLE")
"""How the names of variables of the environment begin that can change the last digits."""
WITHOUT_EFFECT = ("FE_SOLVER_THREADS", "NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS")
"""Variables that begin so and change none."""


class UnknownContentError(TypeError):
    """A value of which it is not known what determines it."""


def content_key(value: Any, packages: tuple[str, ...] = ()) -> str:
    """The sha256 of a value: numbers, texts and arrays in tuples, lists, dicts and dataclasses, of
    their fields only, whose classes are of the `packages`, and partial calls of their functions.
    Two values that share it are equal to the last bit.

    Raises UnknownContentError for anything else, such as a function or a user's own class.

    >>> content_key((1, 2.0))[:8] == content_key((1, 2.0))[:8]
    True
    >>> content_key((1, 2.0)) == content_key((1.0, 2.0))
    False
    """
    digest = hashlib.sha256()
    _add(digest.update, value, packages)
    return digest.hexdigest()


def _add(update: Callable[[Any], None], value: Any, packages: tuple[str, ...]) -> None:
    """Pass a value to `update` so that no two differ in nothing that is passed: each part begins
    with its type and its size."""
    kind = f"{type(value).__module__}.{type(value).__qualname__}"
    match value:
        case np.ndarray() | np.generic():
            array = np.asarray(value)
            if array.dtype.hasobject:
                raise UnknownContentError(f"{kind}: an array of objects")
            order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
            update(f"{kind} {array.dtype.str} {array.shape} {order}\n".encode())
            update(np.ascontiguousarray(array).data)
        case None | bool() | int() | float() | str() | bytes() if kind.startswith("builtins."):
            text = repr(value)
            update(f"{kind} {len(text)} {text}\n".encode())
        case tuple() | list() if kind.startswith("builtins.") or _is_of(value, packages):
            update(f"{kind} {len(value)}\n".encode())
            for item in value:
                _add(update, item, packages)
        case dict() if kind == "builtins.dict":
            update(f"{kind} {len(value)}\n".encode())
            for item in value.items():
                _add(update, item, packages)
        case partial(func=FunctionType() as called) if _is_named(called, packages):
            update(f"{kind} {called.__module__}.{called.__qualname__}\n".encode())
            _add(update, (value.args, value.keywords), packages)
        case _ if is_dataclass(value) and _is_of(value, packages):
            parts = fields(value)
            update(f"{kind} {len(parts)}\n".encode())
            for part in parts:
                _add(update, (part.name, getattr(value, part.name)), packages)
        case _:
            raise UnknownContentError(f"{kind}: its content is not known")


def arrays_key(place: str, arrays: Mapping[str, Any]) -> str:
    """The sha256 of arrays by name, and of the place for which they were written: what tells of a
    file of them that it is whole, unchanged and in its place."""
    digest = hashlib.sha256(place.encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _is_of(value: Any, packages: tuple[str, ...]) -> bool:
    return _is_within(type(value).__module__, packages)


def _is_named(function: FunctionType, packages: tuple[str, ...]) -> bool:
    """Whether it is a function of the packages that its name finds: no lambda, no closure."""
    return "<" not in function.__qualname__ and _is_within(function.__module__, packages)


def _is_within(module: str, packages: tuple[str, ...]) -> bool:
    return any(module == package or module.startswith(f"{package}.") for package in packages)


def sources_key(files: Iterable[Path]) -> str:
    """The sha256 of the names below this program's folder and the contents of files."""
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(f"{path.relative_to(ROOT).as_posix()}\n".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def library_version(name: str) -> str:
    """Name and version of a library, or a dash where it is not installed."""
    try:
        return f"{name} {version(name)}"
    except PackageNotFoundError:
        return f"{name} -"


def machine() -> tuple[str, ...]:
    """What the last digits depend on beside the program and its input: Python, the libraries that
    compute, the settings in the environment, the processor and what numpy uses of it."""
    names = sorted(n for n in os.environ if n.startswith(SETTINGS) and n not in WITHOUT_EFFECT)
    settings = (f"{name}={os.environ[name]}" for name in names)
    return (*_installed(), *settings)


@cache
def _installed() -> tuple[str, ...]:
    system = (sys.platform, platform.machine(), _processor(), platform.python_version())
    config: Any = np.show_config(mode="dicts")
    used = config.get("SIMD Extensions", {}).get("found", ())
    return (*system, *map(library_version, LIBRARIES), *used)


def _processor() -> str:
    """The processor's name, from which libraries choose their code."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    about = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features")
    stated = dict.fromkeys(line for line in lines if line.split("\t")[0].strip() in about)
    return "\n".join(stated)
