"""`cosim view` and `cosim mesh`."""

from __future__ import annotations

import os
import sys
from math import degrees
from pathlib import Path
from typing import Annotated

import typer

import cosim
from cosim.anatomy.write import check_ending, write_hood
from cosim.commands.options import Settings
from cosim.commands.run import load_cases
from cosim.commands.terminal import exit_on_error
from cosim.errors import InputError
from cosim.extras import require
from cosim.files import check_file, shown_path
from cosim.fingers.kinds import skeleton_of
from cosim.models.build import hood_mesh


def view(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
) -> None:
    """Show a run in a window: hood, bones, tendons and forces; a motion plays.

    Space plays and stops, the slider chooses a time or state, the mouse turns."""
    with exit_on_error():
        if not (folder / "summary.json").is_file():
            raise InputError(
                f"{folder}: is not the folder of a run; for example runs/isometric_edc"
            )
        if not _has_display():
            picture = folder / "picture.png"
            instead = f"the picture is {picture}" if picture.is_file() else "nor was a picture made"
            typer.echo(f"there is no display here; {instead}; `cosim film` needs none")
            return
        require("a window in space", "pyvista")
        cosim.open_run(folder).view().show()


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def mesh(
    case: Annotated[str, typer.Argument(help="Case file, or name of a packaged case.")],
    settings: Settings = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The mesh file to write.")] = Path(
        "hood.json"
    ),
) -> None:
    """Write the hood mesh of a case: .json for hood.mesh.kind = "file", with its sets .inp, .feb,
    .msh or .vtu, which `cosim new` reads, or its surface as .stl."""
    with exit_on_error():
        check_ending(out)
    (checked,) = load_cases([case], settings)
    with exit_on_error():
        check_file(out)
        typer.echo(f"{checked.name}: laying out the hood", err=True)
        generated = hood_mesh(checked)
        lost = write_hood(generated, skeleton_of(checked.native_finger()), out)
        typer.echo(f"{len(generated.quads)} quads in {shown_path(out)}")
        if lost:
            typer.echo(f"not in the file: {lost}")
        if any(generated.rest_posture.values()):
            angles = ", ".join(f"{j} {degrees(a):g}" for j, a in generated.rest_posture.items())
            typer.echo(f"laid at {angles} deg (cosim new --posture)")
