"""Compiled kernels on disk: read from where they are, written to where that is allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_compile: Any = partial(
    numba.njit, nogil=True, error_model="numpy", boundscheck=False, no_cfunc_wrapper=True
)
"""No wrapper for C: nobody calls kernels from there."""


class _Part(JITCodeLibrary):
    """Code of a function that is optimised and made machine code as a part of others alone."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What sets the Python objects of machine code: of a part there are none."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        pass


class _PartCompiler(Compiler):
    def __init__(self, typing: Any, target: Any, library: Any, *more: Any) -> None:
        super().__init__(typing, target, _Part(target.codegen(), "part"), *more)


def compile_as_part(function: Callable[..., Any], makes_arrays: bool) -> Any:
    """numba's dispatcher of a function for those that call it, with whose code its own is kept.

    numba alone optimises it, makes machine code of it and wraps it for Python first, and again as
    a part of each that calls it: of a kernel five calls deep five times.

    One that makes no arrays counts no references to those that it is given either; each count is
    an atomic operation, and takes as long as a formula of a few lines."""
    options = {"pipeline_class": _PartCompiler, "no_cpython_wrapper": True, "_nrt": makes_arrays}
    return _compile(function, **options)


def compile_and_keep(function: Callable[..., Any]) -> Any:
    """numba's dispatcher of a function, whose compiled code is kept on disk where one can."""
    dispatcher = _compile(function)
    dispatcher._cache = KernelCache(function)  # as its enable_caching() would set numba's own
    return dispatcher


class KernelCache(caching.NullCache):
    """What numba's cache does, without its errors: it refuses to compile where it can write
    nowhere, and passes on whatever a stale or damaged file raises.

    Code is looked for in NUMBA_CACHE_DIR where that is set, else beside the module, also where one
    may not write there, and then in the user's cache folder.  What is found nowhere is compiled,
    and kept in the first of these that takes it."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._places = list(_places(function))
        self._path: str | None = None

    @property
    def cache_path(self) -> str | None:
        """The folder that the code was loaded from or saved in; None where it is kept nowhere."""
        return self._path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature, None where there is none that can be used."""
        for place in self._places:
            with suppress(Exception):  # whatever a pickle or LLVM raises of a file that is no good
                overload = place.load_overload(sig, target_context)
                if overload is not None:
                    self._path = place.cache_path
                    return overload
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep the code for a signature in the first place that takes it."""
        for place in self._places:
            for has_failed in (False, True):
                with suppress(Exception):
                    if has_failed:  # its index may be damaged: begin a new one
                        place.flush()
                    Path(place.cache_path).mkdir(parents=True, exist_ok=True)
                    place.save_overload(sig, cres)
                    self._path = place.cache_path
                    return


def _places(function: Callable[..., Any]) -> Iterator[Any]:
    """numba's caches of a function in each place where it may have been kept."""
    by_user, *others = caching.CompileResultCacheImpl._locator_classes[:3]
    config: Any = numba.config
    for locator in (by_user,) if config.CACHE_DIR else others:
        trusted = type(locator.__name__, (locator,), {"ensure_cache_path": lambda self: None})
        impl = type("Impl", (caching.CompileResultCacheImpl,), {"_locator_classes": [trusted]})
        place = type("Place", (caching.FunctionCache,), {"_impl_class": impl})
        with suppress(Exception):  # a module that lies in an archive has no file
            yield place(function)
