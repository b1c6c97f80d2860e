"""A case before and after its lesion, with the fingertip free and held: four runs.

Free, the tendons' tensions set the posture; held, they make slip forces and a fingertip force."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.common import HeldTipConfig, JointedFingerConfig
from cosim.fingers.kinds import NativeFinger

Side = Literal["before", "after"]
Tip = Literal["free", "held"]
FREE_JOINTS = "base/free_joints"
"""The case of the index finger whose joints turn freely over their range."""
NARROW = float(np.radians(30.0))
"""Half the range of joints that a case holds about its posture."""
SIDES: tuple[Side, ...] = ("before", "after")
TIPS: tuple[Tip, ...] = ("free", "held")


def both_sides(case: Case) -> dict[tuple[Tip, Side], Case]:
    """The four runs of a case: free, with free joints (`free_joints`), and held as the case holds
    the fingertip (at a point, where it leaves it free), each without the lesion and with it.

    Raises InputError for a case without a lesion, and for one that is no equilibrium of a finger
    whose fingertip can be held."""
    if case.lesion is None:
        raise InputError(
            f"{case.name}: has no table [lesion]; write for example "
            "--set 'lesion.cut=[\"central_slip\"]'"
        )
    return {(tip, side): one_side(case, tip, side) for tip in TIPS for side in SIDES}


def one_side(case: Case, tip: Tip, side: Side) -> Case:
    """A case with its lesion, if it has one, or before it, its fingertip free or held.  Raises
    InputError for a motion, and for a finger whose fingertip cannot be held."""
    if case.forward is not None:
        raise InputError(f"{case.name}: is a motion; leave out [forward] to compare equilibria")
    return (case if side == "after" else case.without_lesion()).model_copy(
        update={
            "name": f"{case.name}_{side}_{tip}",
            "title": f"{case.title}: {side}, fingertip {tip}",
            "finger": _with_tip(case, tip),
        }
    )


def _with_tip(case: Case, tip: Tip) -> NativeFinger:
    finger = case.native_finger()
    stated = finger.tip
    if not isinstance(stated, HeldTipConfig):
        raise InputError(
            f"{case.name}: its fingertip is in a device; write finger.tip.kind = "
            '"free", "point", "clamped" or "posture"'
        )
    if tip == "free":
        return free_joints(finger).model_copy(update={"tip": HeldTipConfig(kind="free")})
    held = "point" if stated.kind == "free" else stated.kind
    return finger.model_copy(update={"tip": HeldTipConfig(kind=held)})


def free_joints(finger: NativeFinger) -> NativeFinger:
    """The finger with the limits and passive torques of FREE_JOINTS in place of limits within
    NARROW of its posture and of linear torques about that; passive torques of another rest are
    kept."""
    if not is_held_by_limits(finger):
        return finger
    free = load_case(FREE_JOINTS).native_finger()
    stated = {j: p for j, p in finger.passive.items() if p.rest != "posture"}
    passive = {**free.passive, **stated}
    return finger.model_copy(update={"limit": free.limit, "passive": passive})


def is_held_by_limits(finger: NativeFinger) -> bool:
    """Whether limits hold a finger with the joints of a human one within NARROW of its posture."""
    limit = finger.limit
    return (
        isinstance(finger, JointedFingerConfig)
        and limit is not None
        and (limit.half_range < NARROW)
    )


def freed_text(case: Case) -> Iterator[str]:
    """What `both_sides` changes of a case's joints, in words."""
    finger = case.native_finger()
    if is_held_by_limits(finger) and finger.limit is not None:
        yield (
            f"The case holds each joint within {np.degrees(finger.limit.half_range):g} deg of its "
            "posture. With the fingertip free the joints are freed: no limits, and the passive "
            "torques of the index finger's joints (base/free_joints.toml) in place of those that "
            "rest in the posture. For another choice write finger.limit and finger.passive."
        )


def lesion_text(case: Case) -> Iterator[str]:
    """The lesion in words."""
    lesion = case.lesion
    if lesion is None:
        return
    for verb, names in (("cut", lesion.cut), ("grown onto the bone", lesion.adhere)):
        yield from (f"{name.replace('_', ' ')} {verb}" for name in names)
    for name, share in lesion.cut_partly.items():
        yield f"{name.replace('_', ' ')} cut through {100 * share:g} % of its width"
    for name, suture in lesion.suture.items():
        gap = f", {1e3 * suture.gap:g} mm apart" if suture.gap else ""
        yield f"{name.replace('_', ' ')} sutured with {1e-3 * suture.stiffness:g} N/mm{gap}"
    for name, graft in lesion.graft.items():
        end = graft.end or f"{graft.bone} bone"
        way = f"from the {graft.start} to the {end}".replace("_", " ")
        yield f"graft {name.replace('_', ' ')} {way}, {1e-3 * graft.stiffness:g} N/mm"
    for name, more in lesion.length_changes().items():
        word = "shorter" if more < 0 else "longer"
        yield f"{name.replace('_', ' ')} {1e3 * abs(more):g} mm {word}"


def named_parts(case: Case) -> list[str]:
    """The parts that the lesion names."""
    if case.lesion is None:
        return []
    return [name for names in case.lesion.names().values() for name in names]
