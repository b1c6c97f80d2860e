"""The scheme and accelerator that a case's table `coupling` states."""

from __future__ import annotations

from cosim.case.schema import CouplingConfig
from cosim.coupling.accelerators import Accelerator, Aitken, ConstantRelaxation, QuasiNewton
from cosim.coupling.schemes import Explicit, Implicit, Linear, Newton, Scheme


def scheme_of(coupling: CouplingConfig) -> Scheme:
    """The scheme of a motion in time that a case states."""
    if coupling.scheme == "implicit":
        return Implicit(accelerator_of(coupling), coupling.tolerance)
    if coupling.scheme == "newton":
        return Newton(coupling.tolerance)
    if coupling.scheme == "linear":
        return Linear()
    return Explicit(parallel=coupling.scheme == "jacobi")


def accelerator_of(coupling: CouplingConfig) -> Accelerator:
    """The accelerator of the scheme "implicit" that a case states."""
    accelerators: dict[str, Accelerator] = {
        "constant": ConstantRelaxation(),
        "aitken": Aitken(),
        "iqn_ils": QuasiNewton(),
    }
    return accelerators[coupling.accelerator]
