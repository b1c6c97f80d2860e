"""The part of a case that a unit is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fmu_export.motion_parts import moving_part
from cosim.fmu_export.part import UnitPart
from cosim.fmu_export.static_parts import CoupledPart, FingerPart, HoodPart
from cosim.models.build import Models, build

PARTS = ("hood", "finger", "coupled")


def part_of(case: Case, part: str, tangent: bool = True) -> UnitPart:
    """The hood, the finger or both of a case, at rest or, of one with a table [forward], in motion;
    the hood and the finger without the tangent of the hood's load where none is wanted.

    Raises InputError."""
    if part not in PARTS:
        raise InputError(f"part {part!r}: write {', '.join(PARTS[:-1])} or {PARTS[-1]}")
    if case.forward is not None and part != "hood":
        return moving_part(case, case.forward, part, tangent)
    makers: Mapping[str, Callable[[Case, Models], UnitPart]] = {
        "hood": partial(HoodPart, tangent=tangent),
        "finger": partial(FingerPart, tangent=tangent),
        "coupled": CoupledPart,
    }
    return makers[part](case, build(case))
