"""A case solved many times with other settings: what sensitivity and identification share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cosim.case.file import load_case
from cosim.port import CosimError, InputError
from cosim.results.compare import unit_of, value_of

Settings = tuple[str, ...]
"""KEY=VALUE, as --set takes them; a later one has the last word."""
Status = Literal["converged", "failed", "refused"]


@dataclass(frozen=True)
class Outcome:
    """Of one solve: the run's summary, or why there is none ("refused": the case file does not
    allow the settings)."""

    status: Status
    summary: Mapping[str, Any]
    reason: str = ""


def outcome(source: Path, settings: Settings) -> Outcome:
    """The case at `source` with settings on top, solved."""
    from cosim.pipeline import run_case

    try:
        case = load_case(source, settings)
    except InputError as error:
        return Outcome("refused", {}, one_line(error))
    try:
        return Outcome("converged", run_case(case).summary)
    except CosimError as error:
        return Outcome("failed", {}, one_line(error))


def one_line(error: CosimError) -> str:
    """What is wrong, in one line."""
    return " ".join(str(error).split())


def measured(summary: Mapping[str, Any], quantity: str) -> float | None:
    """The number at a path of keys, or of A/B the ratio of two; None where there is none."""
    above, slash, below = quantity.partition("/")
    value = value_of(summary, above)
    if not slash or value is None:
        return value
    other = value_of(summary, below)
    return value / other if other else None


def unit(quantity: str) -> str:
    """Of a quantity; a ratio of two in one unit has the unit 1."""
    above, slash, below = quantity.partition("/")
    if not slash:
        return unit_of(above)
    units = (unit_of(above), unit_of(below))
    return "1" if units[0] == units[1] else f"{units[0]} / ({units[1]})"
