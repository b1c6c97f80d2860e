"""The board of curves on the command line: `cosim validate --curves`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from cosim.commands.options import option
from cosim.commands.terminal import say, show_table
from cosim.errors import InputError
from cosim.files import check_file
from cosim.validation.curves import (
    FILE,
    Curve,
    CurvesFile,
    curves_file,
    headline,
    read_committed,
    run_curves,
    write_points,
)
from cosim.validation.curves_page import table_of, write_page
from cosim.validation.records import write_record
from cosim.validation.sweeps import read_sweeps

PLACE = Path("cases") / FILE
"""Where the committed board of curves is, of a checkout."""


def validate_curves(
    curves: Annotated[
        bool,
        option(
            "In place of the trials sweep postures by two degrees: how rough forces and "
            "moment arms are, beside aims. Some 20 minutes.",
            "--curves",
        ),
    ],
    only: str = "",
    out: Path = Path("runs/validation"),
    settings: Sequence[str] = (),
    full: Annotated[
        bool, option("Every muscle over every joint, on other meshes. Hours.", "--full")
    ] = False,
    workers: int = 2,
    listed: bool = False,
    update: bool = False,
) -> None:
    """Run the sweeps, print how rough they are, and leave points, roughness and page in `out`, with
    `update` the roughness in the checkout too.  Exit code 1 where a run has no result."""
    if update:
        check_update(only, settings)
        if full:
            raise InputError("--full: does not go with --update; leave it out")
    sweeps = read_sweeps(full, settings, only)
    if listed:
        for sweep in sweeps:
            typer.echo(f"{sweep.name}: {len(sweep.cases)} runs")
        return
    places = [out / FILE, *([PLACE] if update else [])]
    check_file(places[0])
    before = read_committed()
    found = run_curves(sweeps, workers, say)
    write_points(out / "curves.csv", found)
    for place in places:
        write_record(place, curves_file(found))
    write_page(out / "curves.html", found, before)
    _print(found, before)
    typer.echo(f"curves in {out / 'curves.html'}, {out / 'curves.csv'} and {places[-1]}")
    raise typer.Exit(1 if any(curve.gaps for curve in found) else 0)


def check_update(only: str | None, settings: Sequence[str]) -> None:
    """Check that a committed board can be written anew.  Raises InputError."""
    if only or settings:
        raise InputError("--update takes all trials as they are: leave out --only and --set")
    if not PLACE.parent.is_dir():
        raise InputError(f"--update: there is no {PLACE.parent}/ here; run it in a checkout")


def _print(curves: Sequence[Curve], before: CurvesFile) -> None:
    show_table(table_of(curves, before))
    for curve in curves:
        for angle, why in curve.gaps.items():
            typer.echo(f"no result: {curve.sweep.name} {angle:g} deg: {why}")
    typer.echo(headline(curves))
