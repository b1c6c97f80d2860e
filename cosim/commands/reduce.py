"""A hood reduced to a network: what `cosim export` writes as .toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.analyses.identify.case_text import check_loads
from cosim.analyses.reduction.case_text import case_text
from cosim.analyses.reduction.errors import errors
from cosim.analyses.reduction.reduce import Reduction, read_grid, reduce_case
from cosim.analyses.reduction.walks import SPREAD
from cosim.case.file import base_name, load_case
from cosim.commands.options import Settings, Workers, option
from cosim.commands.terminal import print_table, say
from cosim.files import check_file, output_file


def reduce(
    case: str,
    out: Path,
    settings: Settings = None,
    grid: Annotated[
        list[str] | None,
        option(
            "Angles of a joint in the grid of postures, in deg; repeatable. A joint without "
            "any stays as in the case. Without it MCP=0,22,45, PIP=10,32,55 and DIP=5,20,35.",
            metavar="JOINT=DEG,DEG,...",
        ),
    ] = None,
    spread: Annotated[
        int,
        option(
            "Postures between the grid's points in which each tendon pulls alone; a third "
            "more in which all pull. Fewer are quicker and less exact.",
            min=1,
            max=10_000,
        ),
    ] = SPREAD,
    samples: Annotated[
        Path | None,
        option(
            "Keep the hood's states in a file as they come; a call after one that was cut "
            "off, or another fit of the same hood, uses them.",
            metavar="FILE.json",
        ),
    ] = None,
    workers: Workers = 2,
) -> None:
    """A case that extends `case`, with a network hood fitted to its shell or cables."""
    stated = tuple(settings or ())
    checked = load_case(case, stated)
    check_file(out)
    reduction = reduce_case(
        checked.source,
        stated,
        read_grid(grid or ()),
        workers,
        say,
        spread,
        samples,
    )
    _show(reduction)
    base, title = base_name(checked.source, out.parent), f"{checked.title}, hood reduced"
    with output_file(out) as part:
        part.write_text(case_text(reduction, title, base, stated), encoding="utf-8")
        check_loads(part)
    typer.echo(f"case in {out}")


def _show(reduction: Reduction) -> None:
    """Errors, rates, and where the hood found no equilibrium."""
    misses = list(errors(reduction))
    rows = [
        (
            e.quantity,
            *(f"{100 * value:.1f} %" for value in (e.fit, e.median, e.most)),
            "" if e.mark is None else f"{100 * e.mark:.0f} %",
            "" if e.mark is None else f"{100 * e.beyond:.0f} %",
        )
        for e in misses
    ]
    header = ("error of", "fitted, median", "held out, median", "most", "mark", "beyond it")
    print_table("Reduced hood less the hood itself", header, rows)
    for e in misses:
        typer.echo(f"{e.quantity}, most: at {e.where}")
    rate = reduction.rate
    typer.echo(
        f"one state: {reduction.seconds:.2f} s by the hood with the way there, "
        f"{1e3 * rate.one:.2f} ms by the reduced one ({reduction.seconds / rate.one:.0f} times "
        f"faster), {1e6 * rate.batched:.1f} us in a batch "
        f"({reduction.seconds / rate.batched:.0f} times)"
    )
    for failure in reduction.failures:
        typer.echo(f"left out: {failure}")
