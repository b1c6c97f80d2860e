"""The scheme and accelerator that a case's table `coupling` states."""

from __future__ import annotations

from cosim.case.schema import CouplingConfig
from cosim.coupling.accelerators import Accelerator, Aitken, ConstantRelaxation, QuasiNewton
from cosim.coupling.schemes import Explicit, Implicit, Linear, Newton, Scheme


def scheme_of(coupling: CouplingConfig) -> Scheme:
    """That of a motion in time."""
    if coupling.scheme == "implicit":
        return Implicit(accelerator_of(coupling), coupling.tolerance)
    if coupling.scheme == "newton":
        return Newton(coupling.tolerance)
    if coupling.scheme == "linear":
        return Linear()
    return Explicit(parallel=coupling.scheme == "jacobi")


def accelerator_of(coupling: CouplingConfig) -> Accelerator:
    """That of the scheme "implicit"."""
    accelerators: dict[str, Accelerator] = {
        "constant": ConstantRelaxation(),
        "aitken": Aitken(),
        "iqn_ils": QuasiNewton(),
    }
    return accelerators[coupling.accelerator]
