"""The command of reports: `cosim report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cosim.commands.terminal import exit_on_error, stages
from cosim.report.write import write_report

Format = Literal["html", "csv", "json", "md"]


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The file to write; else report.html, or the terminal."),
    ] = None,
    form: Annotated[
        Format, typer.Option("--format", help="A page, or its tables alone as csv, json or md.")
    ] = "html",
    against: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Run to tell the differences of every RUN from."),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            help="CSV of measured or published numbers, with the columns name, quantity (where "
            "summary.json has it: slip_force_N.central), unit, reference, sd, low, high, source, "
            "kind; also case, geometry, fitted, note."
        ),
    ] = None,
) -> None:
    """Show runs, and what they are compared with, in one HTML page that needs nothing else."""
    with exit_on_error(), stages("report") as told:
        told.say(f"reading and drawing {len(runs)} run{'s' if len(runs) > 1 else ''}")
        notes: list[str] = []
        written = write_report(runs, out, form, against, data, notes.append)
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(written, nl=not written.endswith("\n"))
