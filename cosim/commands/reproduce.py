"""The command of published figures: `cosim reproduce`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cosim.commands.terminal import exit_on_error
from cosim.errors import InputError
from cosim.files import check_file
from cosim.report.figures import choose_studies, write_figures
from cosim.report.gallery import open_paper


class PaperName(StrEnum):
    """The publications whose figures are computed anew, as their scripts in `cases/papers/` are
    named, and by the names of what they are about."""

    BUCHNER = "buchner1988"
    COORDINATION = "coordination"
    JADELIS = "jadelis"
    THESIS = "thesis"
    NETWORKS = "networks"
    XU = "xu2012"
    ROBOT = "robot"

    @property
    def script(self) -> str:
        """The name of its script."""
        by_subject = {"coordination": "buchner1988", "robot": "xu2012", "thesis": "jadelis"}
        return by_subject.get(self.value, self.value)


def reproduce(
    paper: Annotated[
        PaperName,
        typer.Argument(
            help="networks: interconnected tendon networks; buchner1988 or coordination: Buchner, "
            "Hines and Hemami 1988, interphalangeal coordination; xu2012 or robot: the pneumatic "
            "robotic finger; jadelis or thesis: the extensor hood by finite elements and rigid "
            "bodies."
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
        if mi29 is not None and paper.script != "jadelis":
            raise InputError(f"--mi29 {mi29}: is a mesh of the thesis; {paper.value} has none")
        folder = Path("reproduced") / paper.value if out is None else out
        command = "" if mi29 is None else f"cosim reproduce {paper.value} --mi29 {mi29.name}"
        script = open_paper(paper.script, {} if mi29 is None else {"MI29": mi29})
        page = script.page(paper.value, command)
        studies = choose_studies(page, only or ())
        check_file(folder / "index.html")
        count = write_figures(page, studies, folder, lambda text: typer.echo(text, err=True))
        figures = "figure" if count == 1 else "figures"
        typer.echo(f"{count} {figures} in {folder / 'index.html'}")
