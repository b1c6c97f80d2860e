"""The coupled equilibrium of a case's models by the scheme that the case names."""

from __future__ import annotations

from collections.abc import Callable

from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.coupling.fixed_point import fixed_point
from cosim.errors import Progress
from cosim.models.build import Models
from cosim.models.scheme import accelerator_of
from cosim.port import PairState, Response, Tensions


def solve_equilibrium(
    case: Case,
    models: Models,
    start: PairState,
    tensions: Tensions,
    progress: Progress,
    first: Callable[[], Response] | None = None,
) -> Equilibrium:
    """The equilibrium from the states `start`, under tensions in N; `first` gives what
    `first_answer` does.  Raises ConvergenceError."""
    coupling = case.coupling
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    if coupling.scheme != "implicit":
        known = None if first is None else first()
        return equilibrium(models.pair, start, tensions, options, progress, known)
    accelerator = accelerator_of(coupling)
    turn = coupling.tolerance
    return fixed_point(models.pair, start, tensions, options, accelerator, turn, progress)
