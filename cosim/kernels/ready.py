"""Imported, it readies numba to load compiled kernels, which else the first of them does."""

from cosim.kernels.kernel import HAS_NUMBA

if HAS_NUMBA:
    from numba.core.registry import cpu_target

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
