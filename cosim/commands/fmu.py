"""The command of Functional Mock-up Units: `cosim fmu`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings
from cosim.commands.terminal import exit_on_error, stages
from cosim.files import check_file
from cosim.fmu_export.write import write_fmu


class FmuPart(StrEnum):
    """What of a case goes into the FMU."""

    hood = "hood"
    finger = "finger"
    coupled = "coupled"


def fmu(
    case: CaseName,
    part: Annotated[FmuPart, typer.Option(help="What goes into it.")] = FmuPart.hood,
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Version of the standard.")] = 2,
    tangent: Annotated[
        bool,
        typer.Option(help="The derivatives of the hood's load cross too."),
    ] = True,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="The file to write; else CASE_PART_FMI.fmu in this folder."
        ),
    ] = None,
) -> None:
    """Write a case's hood, finger or coupled finger, at rest or in motion, as an FMU.

    It holds the whole case and runs where this package is installed, at the same version."""
    with exit_on_error():
        checked = load_case(case, settings or ())
        path = out or Path(f"{checked.name}_{part.value}_fmi{fmi}.fmu")
        check_file(path)
        with stages(checked.name) as told:
            told.say(f"building and describing its {part.value}")
            write_fmu(checked, part.value, fmi, path, tangent=tangent)
        typer.echo(f"{part.value} in {path}, FMI {fmi}")
