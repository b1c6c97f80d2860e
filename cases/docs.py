"""Build the documentation: `python -m cases.docs [FOLDER]`, then open FOLDER/index.html.

Needs `pip install '.[docs]'` and a checkout.  The pages are the READMEs themselves, docstrings, the
measurements, and the scores of three models, which takes a minute or two; neither building nor
reading them calls anything from the net.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from cases.board_numbers import with_numbers
from cases.reference import REFERENCE, reference_pages
from cosim.commands.terminal import tell
from cosim.errors import InputError
from cosim.extras import require
from cosim.face import score
from cosim.report.measured_page import write_measured_page

ROOT = Path(__file__).parents[1]
CONFIGURATION = ".docs"
"""The folder of Sphinx's conf.py, and of the pages that are no README."""
CONTENTS = {
    "Guides": {
        "cosim/README.md": "cosim/index.md",
        "cosim/case/README.md": "cosim/case.md",
        "cosim/anatomy/README.md": "cosim/anatomy.md",
        "cosim/results/README.md": "cosim/results.md",
        "cosim/analyses/README.md": "cosim/analyses.md",
        "cosim/solve/README.md": "cosim/motion.md",
        "cosim/study/README.md": "cosim/study.md",
        "cosim/fmu/README.md": "cosim/fmu.md",
        "cosim/ui/README.md": "cosim/ui.md",
        "cosim/FORMATS.md": "cosim/formats.md",
        "fe_solver/README.md": "fe_solver/index.md",
        "fe_solver/febio/README.md": "fe_solver/febio.md",
        "rigid/README.md": "rigid/index.md",
        "meshes/README.md": "meshes/index.md",
    },
    "Cases and measurements": {
        "cases/README.md": "cases/index.md",
        "cases/papers/README.md": "cases/papers.md",
        "cosim/validation/README.md": "trust.md",
        ".docs/measured.md": "measured.md",
        "cosim/scoring/README.md": "scoring.md",
        ".docs/scores.md": "scores.md",
        ".docs/credibility.md": "credible.md",
    },
    "Python": {
        ".docs/api/cosim.md": "api/cosim.md",
        ".docs/api/port.md": "api/port.md",
        ".docs/api/fe_solver.md": "api/fe_solver.md",
        ".docs/api/rigid.md": "api/rigid.md",
        ".docs/api/meshes.md": "api/meshes.md",
    },
    "Project": {
        ".github/CONTRIBUTING.md": "contributing.md",
        ".github/CHANGELOG.md": "changelog.md",
        "cosim/DEVELOPERS.md": "developers.md",
        "tests/README.md": "tests.md",
        ".github/SUPPORT.md": "support.md",
        ".github/SECURITY.md": "security.md",
        ".github/CODE_OF_CONDUCT.md": "code_of_conduct.md",
    },
}
"""By heading of the navigation the files of the checkout and their places in the documentation."""
PLACES = {"README.md": "index.md"} | {k: v for part in CONTENTS.values() for k, v in part.items()}
SCORED = ("split_edc", "cable_edc", "isometric_edc")
"""The models of the page of scores: one of each way to make an extensor."""
LINK = re.compile(r"\]\((?!\w+:)([^)#\s]+)(#[^)\s]*)?\)")


def lay_pages(stage: Path) -> None:
    """Write each page to its place in a folder, its links rewritten, with the navigation."""
    for source, place in PLACES.items():
        text = with_numbers((ROOT / source).read_text(encoding="utf-8"))
        page = stage / place
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(_linked(text, source, stage), encoding="utf-8")
    places = {heading: [*pages.values()] for heading, pages in CONTENTS.items()}
    with (stage / "index.md").open("a", encoding="utf-8") as home:
        for heading, pages in (places | {"Reference": [*REFERENCE]}).items():
            names = "\n".join(place.removesuffix(".md") for place in pages)
            home.write(f"\n```{{toctree}}\n:caption: {heading}\n:hidden:\n\n{names}\n```\n")


def _linked(text: str, source: str, stage: Path) -> str:
    """The text with links to where the files lie in the documentation; a file that is no page is
    taken along.  Raises InputError for a link that leads nowhere."""
    start = (stage / PLACES[source]).parent

    def rewrite(found: re.Match[str]) -> str:
        target = os.path.normpath(os.path.join(os.path.dirname(source), found[1]))
        file = ROOT / target
        if not file.is_file():
            raise InputError(f"{source}: the link to {found[1]} does not lead to a file")
        place = stage / PLACES.get(target, target)
        if target not in PLACES:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)
        return f"]({Path(os.path.relpath(place, start)).as_posix()}{found[2] or ''})"

    return LINK.sub(rewrite, text)


def build(folder: Path) -> None:
    """Write the documentation to a folder.  Raises InputError without Sphinx or a checkout, and
    where Sphinx has anything to complain of."""
    require("the documentation", "sphinx", "myst_parser", "furo")
    if not (ROOT / CONFIGURATION).is_dir():
        raise InputError(f"the documentation is built in a checkout; {ROOT} has no {CONFIGURATION}")
    from sphinx.cmd.build import build_main

    with TemporaryDirectory() as stage:
        lay_pages(Path(stage))
        for place, text in reference_pages().items():
            page = Path(stage) / place
            page.parent.mkdir(parents=True, exist_ok=True)
            page.write_text(text, encoding="utf-8")
        options = ["-q", "-W", "--keep-going", "-E", "-c", str(ROOT / CONFIGURATION)]
        kept = ["-d", str(Path(stage) / ".doctrees")]
        if build_main(["-b", "html", *options, *kept, stage, str(folder)]):
            raise InputError("the documentation has the faults above; nothing else was built")
    write_measured_page(folder / "measurements.html")
    score(*SCORED).write(folder / "score.html")


if __name__ == "__main__":
    try:
        build(Path(sys.argv[1] if len(sys.argv) > 1 else "site"))
    except InputError as error:
        sys.exit(tell(error))
