"""Prepare numba, on import, to load compiled kernels; else the first kernel does it."""

from cosim.kernels.kernel import HAS_NUMBA

if HAS_NUMBA:
    from cosim.kernels.disk_cache import prepare

    prepare()
