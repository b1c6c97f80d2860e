"""Compilation of small loops by numba, where it is installed; else they run as plain Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from importlib.util import find_spec
from threading import RLock
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

HAS_NUMBA = find_spec("numba") is not None
_lock = RLock()


class Kernel:
    """A function that is compiled for the types of its arguments when it is first called with them,
    or loaded where a process before compiled it.

    numba itself is imported at the first call of any kernel, and not for those that only stand in
    a module that was imported."""

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.function = function
        self._compiled: Any = None

    def __call__(self, *arguments: Any) -> Any:
        return (self._compiled or self.compiled())(*arguments)

    def compiled(self) -> Any:
        """numba's dispatcher of the function."""
        with _lock:
            if self._compiled is None:
                from cosim.kernels.disk_cache import compile_and_keep

                names = self.function.__globals__
                self._compiled = compile_and_keep(self.function)
                # numba looks the kernels that this one calls up among the names of its module
                for name, value in list(names.items()):
                    if type(value) is Kernel:
                        names[name] = value.compiled()
            return self._compiled


def compile_kernel(function: Function) -> Function:
    """The function as a `Kernel`, where numba is installed.

    A kernel calls only others of its own file: numba looks at no other one when it decides whether
    to compile anew."""
    if not HAS_NUMBA:
        return function
    kernel: Any = Kernel(function)
    return kernel
