"""Published models of FEBio's users, solved in two ways, beside FEBio's figures and times."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table

from cosim.commands.terminal import console
from cosim.errors import InputError
from cosim.schema.units import LENGTH, parse
from tests.proofs.fe.febio_figures import SOURCE
from tests.proofs.fe.febio_models import (
    ComparedQuantity,
    Formulation,
    ModelComparison,
    ModelRun,
    compare,
)


def bench_febio(folder: Path | None, spacing: str) -> dict[str, float]:
    """Print our answers and costs beside FEBio's; the ratios of the costs by name, where FEBio's
    are known.  Raises CosimError."""
    if folder is None:
        raise InputError("bench febio: name the folder of the models with --models")
    grid = parse(spacing, LENGTH)
    screen = console()
    typer.echo("bench: solving each model in two ways; many minutes", err=True)
    ratios: dict[str, float] = {}
    for result in compare(folder, grid):
        ratios |= _print_comparison(screen, result)
    screen.print(f"FEBio's figures: {SOURCE}.")
    screen.print(
        "In brackets: differences from FEBio's figure, or where there is none from q4ans; of "
        "displacements in % of the largest one.  --element q4ans: FEBio's element and contact.  "
        "All contact by a penalty alone.  Verdicts: agrees: our own shell, within 3 %; "
        "formulation: not that, but q4ans is; differs: neither."
    )
    return ratios


def _print_comparison(screen: Console, result: ModelComparison) -> dict[str, float]:
    """Print a model's figures and costs; the CPU times over FEBio's by name."""
    table = Table(title=result.model, title_justify="left")
    for name in ("quantity", *(e.value for e in Formulation), "FEBio"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    table.add_column("verdict")
    for r in result.rows:
        values = (_with_difference(r, v) for v in (r.own, r.q4ans, r.febio))
        table.add_row(r.quantity, *values, r.verdict)
    screen.print(table)
    costs = {
        f"{result.model} {element.value}: CPU time / FEBio's": _print_cost(
            screen, element.value, solved, result.febio_s
        )
        for element, solved in result.solved.items()
    }
    theirs = result.published
    if theirs is not None:
        scaled = "" if result.febio_s is None else f"CPU {result.febio_s:.2f} s on this machine; "
        depth = f"deepest penetration {theirs.penetration:.1f} um"
        screen.print(f"FEBio: {scaled}{depth}; peak memory {theirs.peak_mb:.0f} MB")
    return {name: cost for name, cost in costs.items() if cost is not None}


def _with_difference(row: ComparedQuantity, value: float | None) -> str:
    """A figure with its difference from FEBio's."""
    if value is None:
        return "-"
    off = None if value is row.reference else row.off(value)
    return f"{value:.5g}" if off is None else f"{value:.5g} ({100 * off:+.1f} %)"


def _print_cost(
    screen: Console, name: str, solved: ModelRun | str, febio_s: float | None
) -> float | None:
    """Print a solve's cost; its CPU time over FEBio's, if both are known."""
    if isinstance(solved, str):
        screen.print(f"{name}: {solved}")
        return None
    ratio = None if febio_s is None else solved.solve_s / febio_s
    share = "" if ratio is None else f", {ratio:.2f} of FEBio's"
    solve_mb = solved.peak_mb - solved.import_mb
    screen.print(
        f"{name}: CPU {solved.solve_s:.2f} s{share} ({solved.iterations} iterations, "
        f"{solved.linear_solver}), set-up {solved.setup_s:.2f} s; deepest penetration "
        f"{solved.penetration:.1f} um; peak memory {solved.peak_mb:.0f} MB, of which the solve "
        f"{solve_mb:.0f}"
    )
    return ratio
