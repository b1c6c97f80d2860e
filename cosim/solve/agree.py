"""The coupled equilibrium of a case's models by the scheme that the case names."""

from __future__ import annotations

from cosim.build.models import Models
from cosim.build.scheme import accelerator_of
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.coupling.fixed_point import fixed_point
from cosim.port import Array, Progress, State


def agree(
    case: Case,
    models: Models,
    start: State,
    state: State,
    hood_tension: Array,
    finger_tension: Array,
    progress: Progress,
) -> Equilibrium:
    """The coupled equilibrium by the case's scheme, from the finger's `start` and the hood's
    `state`, under tensions in N."""
    finger, hood, coupling = models.finger, models.hood, case.coupling
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    if coupling.scheme != "implicit":
        return equilibrium(
            finger, hood, start, state, hood_tension, finger_tension, options, progress
        )
    return fixed_point(
        finger,
        hood,
        start,
        state,
        hood_tension,
        finger_tension,
        options,
        accelerator_of(coupling),
        coupling.tolerance,
        progress,
    )
