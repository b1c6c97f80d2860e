"""Threads of BLAS and memory of the processes that solve."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KEPT = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""Of glibc, which reads them when a process starts: no block of its own for any size, and freed
memory (bytes) stays with the process.  Handed back and asked for again with each factorisation it
costs a fifth of that, and the kernel's work on page faults keeps processes side by side from each
other."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread for a block, or for a function that this decorates.

    How many threads share a sum decides its last bits, and a result must not depend on the
    environment.  It is faster, too: our dense products are small."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (only a library that is loaded can be limited)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def prepare_process() -> None:
    """Let this process and those that it starts work with one thread of BLAS, whatever the
    environment says, and with memory that stays with them (`KEPT`, where it says nothing)."""
    from threadpoolctl import threadpool_limits

    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))  # of what loads from now on
    threadpool_limits(1, user_api="blas")  # of what has loaded
    for name, value in KEPT.items():
        os.environ.setdefault(name, value)
