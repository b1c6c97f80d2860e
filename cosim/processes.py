"""What the environment tells the processes that solve side by side."""

from __future__ import annotations

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KEPT = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""Of glibc, which reads them when a process starts: no block of its own for any size, and freed
memory (bytes) stays with the process.  Handed back and asked for again with each factorisation it
costs a fifth of that, and the kernel's work on page faults keeps processes side by side from each
other."""
