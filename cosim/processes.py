"""What the environment tells the processes that solve side by side."""

from __future__ import annotations

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KEPT = {"MALLOC_MMAP_THRESHOLD_": str(2**30), "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""Bytes, of glibc, which reads them when a process starts: freed memory stays with it.  Handed back
and asked for again with each factorisation, it costs a tenth of a solve in page faults, and the
kernel's work on these keeps processes side by side from each other."""
