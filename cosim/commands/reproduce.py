"""The command of the papers' figures: `cosim reproduce`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.commands.terminal import exit_on_error

if TYPE_CHECKING:
    from cosim.report.figures import FigurePage


class PaperName(StrEnum):
    """The papers whose figures are computed anew."""

    NETWORKS = "networks"
    COORDINATION = "coordination"
    ROBOT = "robot"
    THESIS = "thesis"


def reproduce(
    paper: Annotated[
        PaperName,
        typer.Argument(
            help="networks: interconnected tendon networks; coordination: Buchner, Hines and "
            "Hemami 1988, interphalangeal coordination; robot: the pneumatic robotic finger; "
            "thesis: Jadelis, the extensor hood by finite elements and rigid bodies."
        ),
    ],
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="This study alone; repeatable."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; reproduced/PAPER without it.")
    ] = None,
    mi29: Annotated[
        Path | None,
        typer.Option(
            "--mi29",
            metavar="FILE",
            help="thesis: the hood that it started from, Verify/mi29.feb of FEBio's test suite, "
            "which has no licence and is not shipped.",
        ),
    ] = None,
) -> None:
    """Compute a paper's figures anew: a picture and tables of each, and one page of all."""
    with exit_on_error():
        from cosim.files import check_file
        from cosim.report.figures import choose_studies, write_figures

        found = _paper(paper, mi29)
        folder = Path("reproduced") / paper.value if out is None else out
        studies = choose_studies(found, only or ())
        check_file(folder / "index.html")
        count = write_figures(found, studies, folder, lambda text: typer.echo(text, err=True))
        figures = "figure" if count == 1 else "figures"
        typer.echo(f"{count} {figures} in {folder / 'index.html'}")


def _paper(name: PaperName, mi29: Path | None) -> FigurePage:
    """Raises InputError for a mesh that the paper has no use for."""
    from cosim.errors import InputError
    from cosim.report.figures import FigurePage

    if mi29 is not None and name is not PaperName.THESIS:
        raise InputError(f"--mi29 {mi29}: is a mesh of the thesis; {name.value} has none")
    if name is PaperName.NETWORKS:
        from cosim.papers.networks import STUDIES

        title = (
            "Development and Validation of Modeling Framework for Interconnected Tendon Networks "
            "in Robotic and Human Fingers"
        )
        return FigurePage(name.value, title, STUDIES)
    if name is PaperName.ROBOT:
        from cosim.papers.robot import STUDIES as of_robot

        title = (
            "Design of an Anthropomorphic Robotic Finger System with Biomimetic Artificial Joints"
        )
        return FigurePage(name.value, title, of_robot)
    if name is PaperName.THESIS:
        from cosim.papers.thesis import studies

        title = (
            "Jadelis: Index Finger Extensor Hood Mechanics Using Finite Element and Rigid Body "
            "Dynamic Modeling"
        )
        kind = "A thesis's tables and figures, computed anew"
        given = "" if mi29 is None else f"cosim reproduce {name.value} --mi29 {mi29.name}"
        return FigurePage(name.value, title, studies(mi29), kind, given)
    from cosim.papers.coordination import STUDIES as ours

    title = (
        "Buchner, Hines and Hemami 1988: A dynamic model for finger interphalangeal coordination"
    )
    return FigurePage(name.value, title, ours)
