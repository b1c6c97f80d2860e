"""`cosim show`: a run as a window, a page, tables or a film."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, cast

import typer

import cosim
from cosim.commands.door import door
from cosim.commands.options import one_of, option, to
from cosim.commands.terminal import stages
from cosim.errors import InputError
from cosim.extras import require
from cosim.files import check_file, shown_path
from cosim.report.page import Form, write_report
from cosim.results.film import FPS, WIDTH, check_film_file
from cosim.results.sto import write_tables

Against = Annotated[Path | None, option("Run to subtract from every RUN.", metavar="RUN")]
Data = Annotated[
    Path | None,
    option(
        "CSV of measured or published numbers, with the columns name, quantity (where "
        "summary.json has it: slip_force_N.central), unit, reference, sd, low, high, source, "
        "kind; also case, geometry, fitted, note."
    ),
]


def view(runs: list[Path]) -> None:
    """Show a run in a window: hood, bones, tendons and forces; a motion plays."""
    folder = one_of(runs, "a window")
    if not (folder / "summary.json").is_file():
        raise InputError(f"{folder}: is not the folder of a run; for example runs/isometric_edc")
    if not _has_display():
        picture = folder / "picture.png"
        instead = f"the picture is {picture}" if picture.is_file() else "nor was a picture made"
        film = f"cosim show {folder} -o film.gif"
        typer.echo(f"there is no display here; {instead}; a film needs none: {film}")
        return
    require("a window in space", "pyvista")
    cosim.open_run(folder).view().show()


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def print_tables(
    runs: list[Path],
    form: Annotated[
        Literal["csv", "json", "md"], option("Print the tables of a page instead.", "--format")
    ],
    against: Against = None,
    data: Data = None,
) -> None:
    """The tables of a page in the terminal."""
    _report(runs, None, form, against, data)


def page(runs: list[Path], out: Path, against: Against = None, data: Data = None) -> None:
    """A page that needs nothing else, or its tables, by the file's ending."""
    _report(runs, out, cast(Form, out.suffix[1:].lower()), against, data)


def _report(
    runs: Sequence[Path], out: Path | None, form: Form, against: Path | None, data: Path | None
) -> None:
    notes: list[str] = []
    with stages("show") as progress:
        progress.say(f"reading and drawing {len(runs)} run{'s' if len(runs) > 1 else ''}")
        written = write_report(runs, out, form, against, data, notes.append)
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(written, nl=not written.endswith("\n"))


def film(
    runs: list[Path],
    out: Path,
    fps: Annotated[float, option("Pictures a second, 0.5 to 50.")] = FPS,
    speed: Annotated[
        float | None,
        option(
            "How many times as fast as the motion was; without, every stored frame once.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[int, option("Width in pixels.")] = WIDTH,
) -> None:
    """A film without a display: a motion, or states at rest in turn."""
    folder = one_of(runs, "a film")
    check_film_file(out)
    check_file(out)
    made = cosim.open_run(folder).animate(out, fps=fps, speed=speed, width=width)
    size = out.stat().st_size / 1e6
    shown = f"{len(made.shown)} pictures in {made.seconds:.1f} s"
    typer.echo(f"{shown_path(out)}: {shown}, {size:.1f} MB")


def sto(runs: list[Path], out: Path) -> None:
    """A run's motions and forces as tables that OpenSim plots."""
    for path in write_tables(one_of(runs, "a .sto"), out):
        typer.echo(f"wrote {path}")


@door(
    {
        "": view,
        ".html": page,
        ".csv": page,
        ".json": page,
        ".md": page,
        ".gif": film,
        ".mp4": film,
        ".sto": sto,
        "--format": print_tables,
    }
)
def show(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="Folders of runs.")],
    out: Annotated[Path | None, to("The file to write; its ending says what it shows.")] = None,
) -> None:
    """Show a run in a window: hood, bones, tendons and forces; a motion plays.  Space plays and
    stops, the slider chooses a time or state, the mouse turns.

    With --out, without a display: as .html runs and what they are compared with in one page that
    needs nothing else, as .csv, .json and .md its tables; as .gif and .mp4 (extra film) a film of a
    motion, or of states at rest in turn, from two sides and to one scale, with as many frames as
    output.frames of the case asks for; as NAME.sto the tables NAME_motion.sto and NAME_forces.sto,
    which OpenSim plots."""
