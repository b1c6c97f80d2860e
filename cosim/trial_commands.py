"""The commands that solve a case many times: `cosim sensitivity` and `cosim identify`."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.files import written_whole
from cosim.port import InputError
from cosim.terminal import print_table, told

if TYPE_CHECKING:
    from collections.abc import Callable

    from cosim.compare import Target
    from cosim.identify import Fit
    from cosim.sensitivity import Sensitivity
    from cosim.variations import Variation

CaseName = Annotated[str, typer.Argument(metavar="CASE", help="Case file, or a packaged case.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of the case; repeatable."),
]
Jobs = Annotated[int, typer.Option(min=1, max=61, help="Processes that solve side by side.")]
"""A pool of processes has at most 61 on Windows."""
STRONGEST = 6
"""Rows for each quantity in the terminal."""


def sensitivity(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, typer.Option(help="Folder for table and charts.")] = Path("sensitivity"),
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY",
            help="Where summary.json has the number (slip_force_N.central), or A/B for a ratio; "
            "repeatable. Without it: forces, strains and arms that one looks at.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Vary what has NAME in its name alone; repeatable."),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            help="CSV of measured numbers, as `cosim report --data` takes them: their quantities "
            "are looked at too, and shown in the charts."
        ),
    ] = None,
    jobs: Jobs = 2,
) -> None:
    """How a case's results answer to what it assumes: moduli, thickness, rest lengths, ligaments,
    fibres, contact, joints, posture, mesh; a tornado chart for each quantity, and a table."""
    with told():
        from cosim.case import load_case
        from cosim.compare_files import read_targets
        from cosim.sensitivity import study, to_csv, to_json
        from cosim.variations import variations

        own = tuple(settings or ())
        checked = load_case(case, own)
        varied = _chosen(variations(checked), only or ())
        targets = [t for t in read_targets(data) if t.case in ("", checked.name)] if data else []
        also = [t.quantity for t in targets]
        with _counted(checked.name) as progress:
            found = study(
                checked.source, own, varied, quantity or (), also, jobs=jobs, progress=progress
            )
        folder = out / checked.name
        for name, text in (
            ("sensitivity.csv", to_csv(found)),
            ("sensitivity.json", to_json(found)),
        ):
            with written_whole(folder / name) as part:
                part.write_text(text, encoding="utf-8")
        charts = _write_charts(folder, found, targets)
        _show_sensitivity(found)
        typer.echo(f"table and {charts} charts in {folder}")


def _chosen(every: Sequence[Variation], only: Sequence[str]) -> list[Variation]:
    if not only:
        return list(every)
    found = [v for v in every if any(word.casefold() in v.name.casefold() for word in only)]
    if not found:
        raise InputError(
            f"--only {', '.join(only)}: nothing of that name; there are "
            + "; ".join(v.name for v in every)
        )
    return found


@contextmanager
def _counted(name: str) -> Iterator[Callable[[int, int, str], None]]:
    """What tells of the runs: a bar on a terminal, else a line for each."""
    if not sys.stderr.isatty():
        yield lambda done, total, what: typer.echo(f"{name}: {done}/{total} {what}", err=True)
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(name)
        yield lambda done, total, what: bar.update(
            task, completed=done, total=total, description=f"{name}: {what}"
        )


def _write_charts(folder: Path, found: Sensitivity, targets: Sequence[Target]) -> int:
    """A chart for each quantity that answers to anything; how many."""
    from cosim.sensitivity import bars
    from cosim.tornado import draw_tornado

    target = {t.quantity: t for t in targets}
    drawn = [q for q in found.base if any(bar.swing > 0 for bar in bars(found, q))]
    for quantity in drawn:
        name = re.sub(r"[^\w.-]+", "_over_", quantity)
        with written_whole(folder / f"{name}.png") as part:
            figure = draw_tornado(found, quantity, target.get(quantity))
            figure.savefig(part, dpi=130, format="png", bbox_inches="tight")
    return len(drawn)


def _show_sensitivity(found: Sensitivity) -> None:
    """The strongest answers of each quantity, and the runs that have none."""
    from cosim.compare import number
    from cosim.sensitivity import bars
    from cosim.trials import unit

    for quantity, base in found.base.items():
        rows = [
            (
                bar.variation,
                *(bar.low.set_to, number(bar.low.values.get(quantity))),
                *(bar.high.set_to, number(bar.high.values.get(quantity))),
            )
            for bar in bars(found, quantity)[:STRONGEST]
            if bar.swing > 0
        ]
        of = "" if unit(quantity) == "1" else f" {unit(quantity)}"
        title = f"{quantity}: {number(base)}{of}"
        if rows:
            print_table(title, ("", "low", "then", "high", "then"), rows)
        else:
            typer.echo(f"{title}, answers to nothing that was varied\n")
    for run in found.runs:
        if run.status != "converged" or run.reason:
            what = f"{run.variation}, {run.side}" + (f" ({run.set_to})" if run.set_to else "")
            typer.echo(f"{what}: {run.status}: {run.reason}")


def identify(
    case: CaseName,
    targets: Annotated[
        Path,
        typer.Option(
            help="CSV of measured numbers, as `cosim report --data` takes them. A band pulls where "
            "the model lies outside of it; SDs are the weights, 1 unit where there is none."
        ),
    ],
    settings: Settings = None,
    free: Annotated[
        Path | None,
        typer.Option(
            help="TOML, a table for each parameter: low, high, start, unit and settings = "
            "['KEY={value}']; of c1, toe, c4, modulus_across, shear_modulus the bounds alone. "
            "Without it those that the case's laws have."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="CASE.toml", help="Case file to write, extending CASE.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, max=1000, help="Steps of the search, at most.")] = 30,
    jobs: Jobs = 2,
) -> None:
    """Fit a case's parameters to measured numbers, within bounds; say with intervals, correlations
    and singular values what the numbers could not tell."""
    with told():
        from cosim.case import load_case
        from cosim.compare_files import read_targets
        from cosim.identified import base_of, case_text, check_loads
        from cosim.identify import fit
        from cosim.parameters import built_in, read_free

        own = tuple(settings or ())
        checked = load_case(case, own)
        wanted = read_targets(targets)
        chosen = built_in(checked) if free is None else read_free(free, checked)
        found = fit(
            checked.source,
            own,
            chosen,
            wanted,
            jobs,
            steps,
            lambda text: typer.echo(text, err=True),
        )
        _show_fit(found)
        if out is not None:
            base, title = base_of(checked.source, out), f"{checked.title}, identified"
            with written_whole(out) as part:
                part.write_text(case_text(found, title, base, own, targets.name), encoding="utf-8")
                check_loads(part)
            typer.echo(f"case in {out}")


def _show_fit(found: Fit) -> None:
    """Parameters, misses, correlations, singular values."""
    from cosim.compare import number, stated
    from cosim.identify import interval, standing

    rows = []
    for p in found.parameters:
        value, bounds = number(found.values[p.name]), f"{p.low:g} to {p.high:g}"
        told = "{:.3g} to {:.3g}".format(*interval(found, p.name)) if p in found.within else "-"
        rows.append(
            (f"{p.name} {p.unit}", number(p.start), value, told, bounds, standing(found, p.name))
        )
    header = ("", "start", "fitted", "95 % interval", "bounds", "")
    print_table("Parameters", header, rows)
    rows = [
        (
            f"{row.target.name}, {row.target.unit}",
            *(number(before.model), number(row.model), stated(row.target)),
            *(f"{miss:+.3g}", row.target.kind),
        )
        for before, row, miss in zip(found.start, found.rows, found.misses, strict=True)
    ]
    print_table("Targets", ("", "before", "after", "target", "miss, SDs", "kind"), rows)
    _show_confidence(found)
    typer.echo(
        f"{found.solves} solves, {len(found.failures)} of which did not converge; {found.ended}; "
        f"gradients by {'the tangent of the hood' if found.by_tangent else 'differences of solves'}"
    )
    for failure in found.failures:
        typer.echo(f"did not converge: {failure}")


def _show_confidence(found: Fit) -> None:
    """Of the rows that pull; and what every row would tell if it were a point, not a band."""
    import numpy as np

    from cosim.identify import confidence

    every = [p.name for p in found.parameters]
    names, pulling = [p.name for p in found.within], found.confidence
    rows = [
        (name, *("-" if np.isnan(r) else f"{r:+.2f}" for r in line))
        for name, line in zip(names, pulling.correlation, strict=True)
    ]
    if len(names) > 1:
        print_table("Correlations of the logarithms", ("", *names), rows)
    points = confidence(found.slopes, found.misses)
    for title, header, seen in (
        ("the rows that pull (parameters at bounds held)", names, pulling),
        ("all rows as if points (all parameters)", every, points),
    ):
        rows = [
            (f"{s:.3g}", *(f"{part:+.2f}" for part in direction))
            for s, direction in zip(seen.singular_values, seen.directions, strict=True)
        ]
        print_table(f"Singular values of {title}, SDs per e-fold", ("", *header), rows)
    if pulling.inflation > 1:
        typer.echo(f"intervals widened {pulling.inflation:.3g} times: rows miss by more than SDs")
