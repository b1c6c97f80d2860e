"""A case solved many times with other settings: what sensitivity and identification share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cosim.case.file import Settings, load_case
from cosim.errors import CosimError, InputError
from cosim.pipeline import run_case

Status = Literal["converged", "failed", "refused"]


@dataclass(frozen=True)
class Outcome:
    """The end of one solve: the run's summary, or why there is none ("refused": the case file does
    not allow the settings)."""

    status: Status
    summary: Mapping[str, Any]
    reason: str = ""


def outcome(source: Path, settings: Settings) -> Outcome:
    """The case at `source` with settings on top, solved."""
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
