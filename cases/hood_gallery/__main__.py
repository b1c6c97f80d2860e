"""`python -m cases.hood_gallery`: a hood over postures, as tables and pictures on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cases.hood_gallery.studies import HoodStudies
from cosim.case.file import load_case
from cosim.commands.options import Settings
from cosim.commands.terminal import exit_on_error
from cosim.hoods.kinds import KINDS
from cosim.report.figures import choose_studies, write_figures


def show_hood(
    case: Annotated[
        str, typer.Argument(metavar="CASE", help="A case with a sheet over the bones.")
    ] = "hood_rest",
    settings: Settings = None,
    moduli: Annotated[
        float | None,
        typer.Option(
            min=1e-3,
            max=1e3,
            metavar="FACTOR",
            help="Multiply all moduli of the sheet's regions; 17.4 makes tendons of 1.8 GPa.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="NAME",
            help="This study alone; repeatable: rest, slips, arms, bands, sagittal.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; hood_postures/CASE without it.")
    ] = None,
) -> None:
    """Show a hood over postures, beside literature: torques and slips at rest, the slips' shares
    under load, moment arms and excursions, lateral bands and sagittal bands.

    The case's own posture, load and fingertip are ignored: the bones are held.  Some 120 solves,
    about 12 minutes on one core with --set hood.mesh.quads=400.  A pose without equilibrium is
    shown as such."""
    with exit_on_error():
        chosen = tuple(settings or ())
        checked = load_case(case, chosen)
        if moduli is not None:
            chosen = (*chosen, *KINDS[checked.hood.kind].scaled_moduli(checked.hood, moduli))
            checked = load_case(case, chosen)
        options = [f"--set '{text}'" for text in settings or ()]
        options += [] if moduli is None else [f"--moduli {moduli:g}"]
        studies = HoodStudies(checked, say := lambda text: typer.echo(text, err=True))
        paper = studies.paper(" ".join(["python -m cases.hood_gallery", case, *options]))
        wanted = choose_studies(paper, only or ())
        folder = Path("hood_postures") / checked.name if out is None else out
        count = write_figures(paper, wanted, folder, say)
        for pose in studies.unsolved_poses():
            typer.echo(f"{pose.name}: {pose.status}", err=True)
        typer.echo(f"{count} {'figure' if count == 1 else 'figures'} in {folder / 'index.html'}")


if __name__ == "__main__":
    typer.run(show_hood)
