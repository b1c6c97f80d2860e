"""`cosim film`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cosim
from cosim.commands.terminal import exit_on_error
from cosim.files import check_file, shown_path
from cosim.results.film import FPS, WIDTH, check_film_file


def film(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The film: a .gif, or a .mp4 (extra film).")
    ] = Path("film.gif"),
    fps: Annotated[float, typer.Option(help="Pictures a second, 0.5 to 50.")] = FPS,
    speed: Annotated[
        float | None,
        typer.Option(
            help="How many times as fast as the motion was; without, every stored frame once.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[int, typer.Option(help="Width in pixels.")] = WIDTH,
) -> None:
    """Write a run as a film: its motion, or its states at rest in turn.

    Bones, hood, tendons and the fingertip's force from two sides, to one scale. A motion has as
    many frames as output.frames of its case asks for. No display is needed."""
    with exit_on_error():
        check_film_file(out)
        check_file(out)
        made = cosim.open_run(folder).animate(out, fps=fps, speed=speed, width=width)
        size = out.stat().st_size / 1e6
        shown = f"{len(made.shown)} pictures in {made.seconds:.1f} s"
        typer.echo(f"{shown_path(out)}: {shown}, {size:.1f} MB")
