"""Compilation of small loops by numba, where it is installed; else they run as plain Python."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, TypeVar

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compile_kernel(kernel: Kernel) -> Kernel:
    """The kernel compiled when it is first called, and kept on disk.

    A kernel calls only others of its own file: numba looks at no other one when it decides whether
    to compile anew."""
    if find_spec("numba") is None:
        return kernel
    import numba

    jit: Any = numba.njit(cache=True, error_model="numpy")
    made: Kernel = jit(kernel)
    return made
