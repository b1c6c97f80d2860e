"""A case before and after its lesion, with the fingertip free and held: four runs.

Free, the tendons' tensions set the posture; held, they make slip forces and a fingertip force."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.common import HeldTipConfig
from cosim.fingers.kinds import NativeFinger

Side = Literal["before", "after"]
Tip = Literal["free", "held"]
SIDES: tuple[Side, ...] = ("before", "after")
TIPS: tuple[Tip, ...] = ("free", "held")


def both_sides(case: Case) -> dict[tuple[Tip, Side], Case]:
    """The four runs of a case: free, and held as the case holds the fingertip (at a point, where it
    leaves it free), each without the lesion and with it.

    Raises InputError for a case without a lesion, and for one that is no equilibrium of a finger
    whose fingertip can be held."""
    if case.lesion is None:
        raise InputError(
            f"{case.name}: has no table [lesion]; write for example "
            "--set 'lesion.cut=[\"central_slip\"]'"
        )
    if case.forward is not None:
        raise InputError(f"{case.name}: is a motion; leave out [forward] to compare equilibria")
    return {(tip, side): _one(case, tip, side) for tip in TIPS for side in SIDES}


def _one(case: Case, tip: Tip, side: Side) -> Case:
    return case.model_copy(
        update={
            "name": f"{case.name}_{side}_{tip}",
            "title": f"{case.title}: {side}, fingertip {tip}",
            "lesion": case.lesion if side == "after" else None,
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
    held = "point" if stated.kind == "free" else stated.kind
    kind = "free" if tip == "free" else held
    return finger.model_copy(update={"tip": HeldTipConfig(kind=kind)})


def lesion_text(case: Case) -> Iterator[str]:
    """The lesion in words."""
    lesion = case.lesion
    if lesion is None:
        return
    for verb, names in (("cut", lesion.cut), ("grown onto the bone", lesion.adhere)):
        yield from (f"{name.replace('_', ' ')} {verb}" for name in names)
    for name, more in lesion.length_changes().items():
        word = "shorter" if more < 0 else "longer"
        yield f"{name.replace('_', ' ')} {1e3 * abs(more):g} mm {word}"


def named_parts(case: Case) -> list[str]:
    """The parts that the lesion names."""
    if case.lesion is None:
        return []
    return [name for names in case.lesion.names().values() for name in names]
