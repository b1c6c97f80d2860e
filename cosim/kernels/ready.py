"""Prepare numba, on import, to load compiled kernels; else the first kernel does it."""

from cosim.kernels.kernel import HAS_NUMBA

if HAS_NUMBA:
    from numba.core.registry import cpu_target

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
