"""How the states of a hood and a finger are written that hold more than arrays."""

from __future__ import annotations

from typing import Any

from cosim.coupling.motion import RecordedFinger
from cosim.coupling.state_arrays import Special
from cosim.errors import InputError
from cosim.port import Hood


def special_states(hood: Hood, finger: RecordedFinger | None = None) -> Special:
    """How the states that hold more than arrays are written: a shell hood's is its shape, from
    which its tangent is made anew; an FMU's is what it writes itself.

    Raises InputError for a hood or a unit whose states cannot be."""
    from cosim.fmu.finger import FmuMovingFinger
    from cosim.fmu.hood import FmuHood
    from cosim.fmu.unit import state_serialisers
    from fe_solver.hood.shell_hood import HoodState, ShellHood

    units = [part.unit for part in (hood, finger) if isinstance(part, FmuHood | FmuMovingFinger)]
    kept = state_serialisers(units) if units else {}
    if not isinstance(hood, ShellHood):
        return kept
    if hood.augment is not None:
        raise InputError(
            "forward.checkpoint: a hood whose contact is augmented (hood.contact.penetration or "
            "friction) has no checkpoints; leave one of the two out"
        )

    def read(template: HoodState, arrays: dict[str, Any]) -> HoodState:
        return hood.from_arrays(arrays)

    return {**kept, HoodState: (hood.to_arrays, read)}
