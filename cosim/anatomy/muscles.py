"""Muscles of OpenSim, whose numbers `cosim import` leaves beside a finger, as a case has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cosim.errors import InputError
from cosim.schema.fields import is_number
from cosim.tendons.table import TendonConfig
from cosim.text_tables import read_json_file

FORCE, RIGID = "max_isometric_force", "ignore_tendon_compliance"
FIBRE = {
    "optimal_fibre_length": ("optimal_fiber_length", 1e3, "mm"),
    "tendon_slack_length": ("tendon_slack_length", 1e3, "mm"),
    "pennation": ("pennation_angle_at_optimal", degrees(1.0), "deg"),
}
"""The keys of a muscle's table: OpenSim's name, and how the case states it."""


def imported_muscles(
    finger: Path, names: Mapping[str, str], tendons: Sequence[str]
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """What the JSON that `cosim import` wrote beside a finger says of its tendons, as their tables
    of a case, and what there is to tell.  `names`: the finger's name of each of ours.

    Raises InputError where the file is there and cannot be read."""
    beside = finger.with_suffix(".json")
    stated: dict[str, Any] = {}
    match read_json_file(beside) if beside.is_file() else {}:
        case {"muscles": dict(muscles)}:
            stated = muscles
    tables: dict[str, dict[str, Any]] = {}
    told: list[str] = []
    for tendon in tendons:
        name = names.get(tendon, tendon)
        if name in stated:
            table = _table(f"{beside}: {name}", stated[name])
            try:
                TendonConfig.model_validate(table)
            except ValidationError as error:
                fault = error.errors()[0]
                where = ".".join(map(str, fault["loc"]))
                told.append(f"dropped: muscle {tendon} of {beside.name}: {where} {fault['msg']}")
                continue
            tables[tendon] = table
    if tables:
        told.append(
            f"greatest forces, fibre lengths and pennation of {', '.join(tables)} from "
            f"{beside.name}; their fibres have the optimal length in the posture (assumed)"
        )
    return tables, told


def _table(place: str, muscle: Any) -> dict[str, Any]:
    """A tendon's table.  Raises InputError where it is none that the import writes."""
    match muscle:
        case {"properties": dict(numbers)}:
            pass
        case _:
            raise InputError(f"{place}: is no muscle; import the model again")
    wanted = [FORCE, *(key for key, _, _ in FIBRE.values())]
    if wrong := [key for key in wanted if key in numbers and not is_number(numbers[key])]:
        raise InputError(f"{place}: {wrong[0]} is {numbers[wrong[0]]!r}, no number")
    table: dict[str, Any] = {}
    if FORCE in numbers:
        table["max_force"] = f"{numbers[FORCE]:.9g} N"
    if all(key in numbers for key, _, _ in FIBRE.values()):
        tendon = "rigid" if numbers.get(RIGID) is True else "elastic"
        fibre = {ours: f"{f * numbers[key]:.9g} {u}" for ours, (key, f, u) in FIBRE.items()}
        table["muscle"] = {"kind": "millard", **fibre, "tendon": tendon}
    return table
