"""The board of curves on the command line: `cosim validate --curves`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from cosim.commands.terminal import show_table
from cosim.errors import Progress
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
from cosim.validation.sweeps import PostureSweep

PLACE = Path("cases") / FILE
"""Where the committed board of curves is, of a checkout."""


def validate_curves(
    sweeps: Sequence[PostureSweep], out: Path, workers: int, update: bool, progress: Progress
) -> bool:
    """Run the sweeps, print how rough they are, and leave points, roughness and page in `out`, with
    `update` the roughness in the checkout too.  Whether every run has a result.  Raises
    InputError."""
    places = [out / FILE, *([PLACE] if update else [])]
    check_file(places[0])
    before = read_committed()
    curves = run_curves(sweeps, workers, progress)
    write_points(out / "curves.csv", curves)
    for place in places:
        write_record(place, curves_file(curves))
    write_page(out / "curves.html", curves, before)
    _print(curves, before)
    typer.echo(f"curves in {out / 'curves.html'}, {out / 'curves.csv'} and {places[-1]}")
    return not any(curve.gaps for curve in curves)


def _print(curves: Sequence[Curve], before: CurvesFile) -> None:
    show_table(table_of(curves, before))
    for curve in curves:
        for angle, why in curve.gaps.items():
            typer.echo(f"no result: {curve.sweep.name} {angle:g} deg: {why}")
    typer.echo(headline(curves))
