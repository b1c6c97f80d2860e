"""Compilation of small loops by numba, where it is installed; else they run as plain Python."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import update_wrapper
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from typing import Any, ClassVar, NamedTuple, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

HAS_NUMBA = find_spec("numba") is not None
_lock = RLock()


class Kernel:
    """A function that is compiled for the types of its arguments when it is first called with them,
    or loaded where a process before compiled it.

    numba itself is imported at the first call of any kernel, and not for those that only stand in
    a module that was imported."""

    made: ClassVar[list[Kernel]] = []

    def __init__(self, function: Callable[..., Any], makes_arrays: bool = True) -> None:
        update_wrapper(self, function)
        self.function, self.makes_arrays = function, makes_arrays
        self._source = _source_stamp(function)
        self._compiled: Any = None
        self._part: Any = None
        self.made.append(self)

    def __call__(self, *arguments: Any) -> Any:
        return (self._compiled or self.compiled())(*arguments)

    def compiled(self) -> Any:
        """numba's dispatcher of the function."""
        with _lock:
            if self._compiled is None:
                from cosim.kernels.disk_cache import compile_and_keep

                # code of an older text than the file's must not be kept as that of the file
                keep = self._source == _source_stamp(self.function)
                self._compiled = compile_and_keep(self.function, keep)
            return self._compiled

    @property
    def _numba_type_(self) -> Any:
        """What numba takes it for where another kernel calls it: a dispatcher of its own, whose
        code becomes a part of theirs."""
        from numba.core.types import Dispatcher

        with _lock:
            if self._part is None:
                from cosim.kernels.disk_cache import compile_as_part

                self._part = compile_as_part(self.function, self.makes_arrays)
            return Dispatcher(self._part)


def _source_stamp(function: Callable[..., Any]) -> tuple[int, int] | None:
    """When the function's file was changed, ns, and its size; None where it lies in none."""
    with suppress(OSError):
        found = os.stat(function.__code__.co_filename)
        return found.st_mtime_ns, found.st_size
    return None


class CompiledKernel(NamedTuple):
    """What became of a kernel in this process."""

    name: str
    compiled: int
    """For how many types of arguments it was compiled."""
    loaded: int
    """For how many it was found compiled."""
    folder: Path | None
    """Where it is kept; None where it is kept nowhere."""


def compiled_kernels() -> Iterator[CompiledKernel]:
    """Those that Python called in this process; kernels that they call are parts of them."""
    for kernel in Kernel.made:
        if kernel._compiled is not None:
            _, hits, misses = kernel._compiled.stats
            path = kernel._compiled.stats.cache_path
            if hits or misses:
                folder = None if path is None else Path(path)
                name = f"{kernel.function.__module__}.{kernel.function.__name__}"
                yield CompiledKernel(name, len(misses), len(hits), folder)


def compile_kernel(function: Function) -> Function:
    """The function as a `Kernel`, where numba is installed.

    A kernel calls only others of its own file: numba looks at no other one when it decides whether
    to compile anew."""
    if not HAS_NUMBA:
        return function
    kernel: Any = Kernel(function)
    return kernel


def compile_part(function: Function) -> Function:
    """The function as a `Kernel` for others of its file, which makes no arrays: by far the faster
    for a short one that is given some."""
    if not HAS_NUMBA:
        return function
    kernel: Any = Kernel(function, makes_arrays=False)
    return kernel
