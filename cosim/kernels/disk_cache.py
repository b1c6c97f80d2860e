"""Compiled kernels on disk: read from where they are, written to where that is allowed."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

_compile: Any = partial(
    numba.njit, nogil=True, error_model="numpy", boundscheck=False, no_cfunc_wrapper=True
)
"""No wrapper for C: nobody calls kernels from there."""

HASHING = b"_numba_hashsecret"
"""How the names begin that code refers to which hashes texts, as sets and dicts of them do."""


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


def compile_and_keep(function: Callable[..., Any], keep: bool = True) -> Any:
    """numba's dispatcher of a function, whose compiled code is kept on disk where one can, and if
    it is to `keep`."""
    dispatcher = _compile(function)
    if not keep:
        return dispatcher
    cache = dispatcher._cache = KernelCache(function)  # as enable_caching() would set numba's own
    compile_signature = dispatcher.compile

    def load_or_compile(sig: Any) -> Any:
        try:
            return compile_signature(sig)
        finally:
            cache.end_turn()

    dispatcher.compile = load_or_compile
    return dispatcher


def prepare() -> None:
    """Make numba ready to load what was compiled."""
    rtsys.initialize(cpu_target.target_context)


class KernelCache(caching.NullCache):
    """What numba's cache does, without its errors: it refuses to compile where it can write
    nowhere, and passes on whatever a stale or damaged file raises.

    Code is looked for in NUMBA_CACHE_DIR where that is set, else beside the module, also where one
    may not write there, and then in the user's cache folder.  What is found nowhere is compiled,
    and kept in the first of these that takes it.  Of processes that need it at the same time one
    compiles, and the others wait for it; where no file can be locked each compiles."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._places = list(_places(function))
        self._path: str | None = None
        self._turn: FileLock | None = None

    @property
    def cache_path(self) -> str | None:
        """The folder that the code was loaded from or saved in; None where it is kept nowhere."""
        return self._path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature, None where there is none that can be used: then it is this
        process's turn to compile it, until `end_turn`."""
        overload = self._load(sig, target_context)
        if overload is None and self._take_turn():
            overload = self._load(sig, target_context)  # of the process that was waited for
        return overload

    def end_turn(self) -> None:
        """Let the next process have what this one compiled, or compile it where this one failed."""
        if self._turn is not None:
            self._turn.release()
            self._turn = None

    def _take_turn(self) -> bool:
        """Wait until no other process compiles the function; False where none can be waited for."""
        for place in self._places:
            with suppress(OSError):
                lock = FileLock(Path(place.cache_path) / f"{place.index_name}.lock")
                if lock.acquire():
                    self._turn = lock
                    return True
        return False

    def _load(self, sig: Any, target_context: Any) -> Any:
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


class _Place(caching.FunctionCache):
    """numba's cache of a function in one folder."""

    @property
    def index_name(self) -> str:
        """What the names of the function's files begin with."""
        return str(self._impl.filename_base)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature, None where there is none.

        numba's own first imports all that it can compile, 200 of its modules; to load what was
        compiled, its runtime is enough, and of those modules one that hashes."""
        prepare()
        data = self._cache_file.load(self._index_key(sig, target_context.codegen()))
        if data is None:
            return None
        _, kind, code = data[0]
        if any(HASHING in part for part in (code if kind == "object" else [code])):
            target_context.refresh()
        return self._impl.rebuild(target_context, data)


def _places(function: Callable[..., Any]) -> Iterator[_Place]:
    """numba's caches of a function in each place where it may have been kept."""
    by_user, *others = caching.CompileResultCacheImpl._locator_classes[:3]
    config: Any = numba.config
    for locator in (by_user,) if config.CACHE_DIR else others:
        trusted = type(locator.__name__, (locator,), {"ensure_cache_path": lambda self: None})
        impl = type("Impl", (caching.CompileResultCacheImpl,), {"_locator_classes": [trusted]})
        place = type("Place", (_Place,), {"_impl_class": impl})
        with suppress(Exception):  # a module that lies in an archive has no file
            yield place(function)


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
