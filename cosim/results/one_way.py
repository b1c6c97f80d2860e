"""What a one-way pass leaves in the summary, and what any coupling counts twice."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.case.schema import Case
from cosim.models.build import Models
from cosim.models.double_count import pairs

if TYPE_CHECKING:
    from cosim.solve.states import States


def one_way_summary(case: Case, models: Models, states: States) -> dict[str, Any]:
    """What a one-way pass handed over, and what is counted twice in it."""
    counted = pairs(case, models.hood, models.finger)
    out: dict[str, Any] = {"double_counted": [str(pair) for pair in counted]} if counted else {}
    if states.one_way is not None:
        force, moment = states.loaded.load.imbalance(states.loaded.motion)
        out["one_way"] = {
            **case.coupling.one_way.model_dump(),
            "interface_residual": states.one_way.interface_residual,
            "handed_over_force_balance": force,
            "handed_over_moment_balance": moment,
            "joint_torque_Nmm": {
                source: dict(zip(models.finger.joints, (1e3 * torque).tolist(), strict=True))
                for source, torque in states.one_way.torque.items()
            },
        }
    return out
