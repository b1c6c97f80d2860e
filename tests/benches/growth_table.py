"""What a solve costs on ever finer meshes."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from cosim.commands.terminal import print_table, stages
from tests.benches.growth import (
    CASE,
    CPU,
    EACH,
    TENDON,
    Growth,
    SolveCost,
    fit_growth,
    measure_growth,
    meshes_up_to,
)
from tests.benches.pulls import REST

MOST_GROWTH, AIM = 1.25, 1.3
"""What is aimed at: iterations of the finest mesh over those of the coarsest, and the exponent."""


def bench_growth(most: int) -> dict[str, float]:
    """Solve, print and return the growth; raises InputError."""
    with stages("bench", len(meshes_up_to(most))) as shown:
        costs = list(measure_growth(most, shown.begin))
    growth = fit_growth(costs)
    print_costs(costs)
    print_growth(growth)
    ratios = {}
    for g in growth:
        solve = f"{g.state} on {g.elements} quads"
        ratios[f"{solve}: iterations, finest / coarsest"] = g.iterations
        ratios[f"{solve}: exponent of CPU time"] = g.exponents[CPU]
        ratios[f"{solve}: exponent of CPU time for one linear solve"] = g.exponents[EACH]
    return ratios


def print_costs(costs: Sequence[SolveCost]) -> None:
    """Print what each solve took, and the time of each part for one linear solve."""
    header = ("quads", "unknowns", "solve", "iterations", "linear solves", "CPU s", "peak MB")
    rows, parts = [], []
    for cost in costs:
        m, mesh = cost.measured, f"{cost.quads} {cost.elements}"
        solves = f"{m.solves} failed" if m.failure else str(m.solves)
        figures = (str(m.iterations), solves, f"{m.cpu_s:.2f}", f"{cost.peak_mb:.0f}")
        rows.append((mesh, str(m.unknowns), cost.state, *figures))
        times = (m.cpu_s, *cost.parts.values())
        parts.append((mesh, cost.state, *(f"{1e3 * t / max(m.solves, 1):.1f}" for t in times)))
    print_table(f"{CASE}: to {REST} from as it is laid out, then {TENDON} pulled", header, rows)
    names = costs[0].parts if costs else ()
    print_table("CPU time for each linear solve, ms", ("quads", "solve", "all", *names), parts)


def print_growth(growth: Sequence[Growth]) -> None:
    """Print the growth of each solve, beside what is aimed at."""
    if not growth:
        return
    rows = [
        ("iterations", *(f"{g.iterations:.2f}" for g in growth)),
        ("linear solves", *(f"{g.solves:.2f}" for g in growth)),
    ]
    for name in dict.fromkeys(name for g in growth for name in g.exponents):
        fits = (g.exponents.get(name) for g in growth)
        rows.append((f"p, {name}", *("-" if p is None else f"{p:.2f}" for p in fits)))
    title = "finest mesh over coarsest; p of t ~ N^p in the unknowns, of parts for one linear solve"
    print_table(title, ("", *(f"{g.state}, {g.elements}" for g in growth)), rows)
    typer.echo(f"aims: iterations at most {MOST_GROWTH}, p of the CPU time about {AIM}")
