"""What half a degree of each joint of the posture would change, by the tangent: how finely a sweep
over postures has to be sampled, and what an error of a measured posture makes of the result.

The case's posture is moved by a small angle to both sides.  The finger is brought into equilibrium
there, held anew at its fingertip, with limits and springs about the new posture, under the hood's
load as its jacobian foresees it; the shape of a hood of finite elements follows by its tangent.
"""

from __future__ import annotations

from contextlib import suppress
from copy import copy
from typing import Any, cast

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.coupling.finger_equilibrium import affine
from cosim.errors import ConvergenceError
from cosim.fingers.chain import joint_torques
from cosim.models.build import Models, case_finger
from cosim.port import STATIC, Motion, OpenFinger
from cosim.results.conventions import by_axis, by_name
from cosim.solve.static import States

HALF = np.deg2rad(0.5)
DIFFERENCE_STEP = 1e-5
"""rad, to either side: small against the contact's smoothing."""
FINGER_TOLERANCE = 1e-10
"""Relative residual of the finger."""


Numbers = dict[str, dict[str, float]]
"""What is compared of a posture, as in a summary; the torques are the hood's."""


def half_degree(case: Case, models: Models, states: States) -> dict[str, Any]:
    """The changes by half a degree of each joint, tensions held: fingertip force, slips' forces and
    the hood's joint torques.  None of a one-way pass, of a load that was held while parts relaxed,
    of a fingertip that is free, which has no posture of its own, and where the finger finds no
    equilibrium beside its own."""
    e = states.loaded
    if states.one_way is not None or states.held is not None or e.balance is None:
        return {}
    if case.native_finger().tip.kind == "free":
        return {}
    with suppress(ConvergenceError):
        fresh, each = case_finger(case), models.posture
        return {"half_degree": {joint: _change(case, models, fresh, e, joint) for joint in each}}
    return {}


def _change(
    case: Case, models: Models, fresh: OpenFinger, e: Equilibrium, joint: str
) -> dict[str, Any]:
    """The change by half a degree of a joint, from one posture to either side within its range."""
    low, high = models.finger.ranges.get(joint, (-np.inf, np.inf))
    at = models.posture[joint]
    ends = np.clip([at - DIFFERENCE_STEP, at + DIFFERENCE_STEP], low, high)
    before, after = (_neighbour(case, models, fresh, e, joint, angle) for angle in ends)
    share = HALF / (ends[1] - ends[0])
    change: dict[str, Any] = {
        key: {name: float(share * (after[key][name] - value)) for name, value in values.items()}
        for key, values in before.items()
        if values
    }
    return {**change, "joint_torque_Nmm": {"hood": change["joint_torque_Nmm"]}}


def _neighbour(
    case: Case, models: Models, fresh: OpenFinger, e: Equilibrium, joint: str, angle: float
) -> Numbers:
    """The equilibrium with the joint's posture at `angle` (rad), of a copy of the `fresh` finger,
    which was asked nothing yet: the models' own knows in which posture it was asked last."""
    own = case.native_finger()
    posture = own.posture.model_copy(update={joint: angle})
    moved = own.model_copy(update={"posture": posture})
    finger = cast(Any, copy(fresh))
    finger.law = joint_torques(moved, fresh.joints)
    turn = models.finger.unknowns(e.finger_state)
    turn = turn - models.finger.unknowns(models.finger.start(models.posture))
    start = finger.displace(finger.start(posture.angles()), turn)
    by_motion = e.jacobian.load_motion
    load = affine(e.load, by_motion, e.motion, finger.motion(start))
    state, _ = finger.settle(start, load, by_motion, e.finger_tension, FINGER_TOLERANCE)
    motion = finger.motion(state)
    load = affine(e.load, by_motion, e.motion, motion)
    torque = 1e3 * finger.jacobian(state).T @ load.total().ravel()
    return {
        "fingertip_force_N": by_axis(finger.tip_force(state)),
        "slip_force_N": _slips(models, e, motion),
        "joint_torque_Nmm": by_name(finger.joints, torque),
    }


def _slips(models: Models, e: Equilibrium, motion: Motion) -> dict[str, float]:
    """The slips' forces at poses nearby: of a hood of finite elements to first order."""
    built = models.built
    if built.slips is None:  # tendons of the finger make them, whose tensions are held
        return dict(models.slips_of(e))
    if built.nearby is None:
        moved = models.hood.advance(e.response.state, motion, e.hood_tension, STATIC).state
    else:
        moved = built.nearby(e.response.state, motion)
    return dict(built.slips(moved))
