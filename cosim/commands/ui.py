"""`cosim ui`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.case.file import load_case
from cosim.commands.options import Settings, option, to
from cosim.commands.terminal import say
from cosim.extras import require
from cosim.processes import process_context
from cosim.ui.desk import Desk
from cosim.ui.server import serving, wait_for_end

FIRST_CASE = "isometric_edc"
Port = Annotated[int, option("Port of this machine; 0: one that is free.", min=0, max=65535)]
Browser = Annotated[bool, option("Open the page in the browser, or not.", "--browser/--no-browser")]


def ui(
    case: Annotated[
        str, typer.Argument(metavar="CASE", help="Case file, or a packaged case, to begin with.")
    ] = FIRST_CASE,
    settings: Settings = None,
    out: Annotated[Path, to("Folder for runs that you save.")] = Path("runs"),
    reduced: Annotated[
        str | None,
        option(
            "The case with a reduced hood (`cosim export`), solved while a slider moves.",
            metavar="CASE.toml",
        ),
    ] = None,
    port: Port = 0,
    browser: Browser = True,
) -> None:
    """Work on a case in a page of your browser: sliders for posture, tensions, material, thickness,
    lesion and hood; the finger, its forces and residuals as they are solved; runs to pin, compare
    and save.  Nothing leaves this machine; Ctrl-C ends it."""
    process_context()  # imports while the case is read
    require("the page", "starlette", "uvicorn")
    begun = load_case(case, settings or ())
    lean = None if reduced is None else load_case(reduced)
    desk = Desk(begun, out, lean)
    with serving(desk, port, browser, say):
        wait_for_end()
