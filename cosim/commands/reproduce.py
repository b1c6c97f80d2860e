"""The command of published figures: `cosim reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cosim.commands.options import option, to
from cosim.commands.terminal import say
from cosim.errors import InputError
from cosim.files import check_file
from cosim.report.figures import choose_studies, write_figures
from cosim.report.gallery import open_paper

PaperName = Literal[
    "buchner1988", "coordination", "jadelis", "thesis", "networks", "xu2012", "robot"
]
"""Publications by the names of their scripts in `cases/papers/`, and of what they are about."""
BY_SUBJECT = {"coordination": "buchner1988", "robot": "xu2012", "thesis": "jadelis"}


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
        list[str] | None, option("This study alone; repeatable.", "--only", metavar="NAME")
    ] = None,
    out: Annotated[Path | None, to("Folder; reproduced/PAPER without it.")] = None,
    mi29: Annotated[
        Path | None,
        option(
            "thesis: the hood that it started from, Verify/mi29.feb of FEBio's test suite, "
            "which has no licence and is not shipped.",
            "--mi29",
            metavar="FILE",
        ),
    ] = None,
) -> None:
    """Compute a paper's figures anew: a picture and tables of each, and one page of all."""
    name = BY_SUBJECT.get(paper, paper)
    if mi29 is not None and name != "jadelis":
        raise InputError(f"--mi29 {mi29}: is a mesh of the thesis; {paper} has none")
    folder = Path("reproduced") / paper if out is None else out
    command = "" if mi29 is None else f"cosim reproduce {paper} --mi29 {mi29.name}"
    script = open_paper(name, {} if mi29 is None else {"MI29": mi29})
    page = script.page(paper, command)
    studies = choose_studies(page, only or ())
    check_file(folder / "index.html")
    count = write_figures(page, studies, folder, say)
    figures = "figure" if count == 1 else "figures"
    typer.echo(f"{count} {figures} in {folder / 'index.html'}")
