"""The commands that solve a case many times: `cosim sensitivity` and `cosim identify`."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress

from cosim.analyses.identify.case_text import case_text, check_loads, check_same_settings
from cosim.analyses.identify.cases import FitCase, fit_cases, stated_cases
from cosim.analyses.identify.fit import Fit, confidence, fit_all, identifiability, interval, miss
from cosim.analyses.identify.sensitivity import Sensitivity, bars, study, to_csv, to_json
from cosim.analyses.identify.tornado import draw_tornado
from cosim.analyses.identify.variations import variations
from cosim.case.file import base_name, load_case
from cosim.commands.options import CaseName, Settings, Workers
from cosim.commands.terminal import exit_on_error, print_table
from cosim.errors import InputError
from cosim.files import check_file, output_file
from cosim.hoods.variation import Variation
from cosim.results.compare import Comparison, Target, number, read_targets, reference_text, unit_of
from cosim.results.picture import write_figure

STRONGEST = 6
"""Rows for each quantity in the terminal."""


def sensitivity(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for table and charts.")] = Path(
        "sensitivity"
    ),
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
    workers: Workers = 2,
) -> None:
    """How a case's results answer to what it assumes: moduli, thickness, rest lengths, ligaments,
    fibres, contact, joints, posture, mesh; a tornado chart for each quantity, and a table."""
    with exit_on_error():
        own = tuple(settings or ())
        checked = load_case(case, own)
        folder = out / checked.name
        check_file(folder / "sensitivity.csv")
        varied = _choose(variations(checked), only or ())
        targets = [t for t in read_targets(data) if t.case in ("", checked.name)] if data else []
        also = [t.quantity for t in targets]
        with _run_counter(checked.name) as progress:
            found = study(
                checked.source,
                own,
                varied,
                quantity or (),
                also,
                workers=workers,
                progress=progress,
            )
        for name, text in (
            ("sensitivity.csv", to_csv(found)),
            ("sensitivity.json", to_json(found)),
        ):
            with output_file(folder / name) as part:
                part.write_text(text, encoding="utf-8")
        typer.echo(f"{checked.name}: drawing the charts", err=True)
        charts = _write_charts(folder, found, targets)
        _show_sensitivity(found)
        typer.echo(f"table and {charts} charts in {folder}")


def _choose(every: Sequence[Variation], only: Sequence[str]) -> list[Variation]:
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
def _run_counter(name: str) -> Iterator[Callable[[int, int, str], None]]:
    """What tells of the runs: a bar on a terminal, else a line for each."""
    if not sys.stderr.isatty():
        yield lambda done, total, what: typer.echo(f"{name}: {done}/{total} {what}", err=True)
        return

    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(name)
        yield lambda done, total, what: bar.update(
            task, completed=done, total=total, description=f"{name}: {what}"
        )


def _write_charts(folder: Path, found: Sensitivity, targets: Sequence[Target]) -> int:
    """A chart for each quantity that answers to anything; how many."""
    target = {t.quantity: t for t in targets}
    drawn = [q for q in found.base if any(bar.swing > 0 for bar in bars(found, q))]
    for quantity in drawn:
        name = re.sub(r"[^\w.-]+", "_over_", quantity)
        with output_file(folder / f"{name}.png") as part:
            figure = draw_tornado(found, quantity, target.get(quantity))
            write_figure(figure, part, 130, bbox_inches="tight")
    return len(drawn)


def _show_sensitivity(found: Sensitivity) -> None:
    """The strongest answers of each quantity, and the runs that have none."""
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
        of = "" if unit_of(quantity) == "1" else f" {unit_of(quantity)}"
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
    cases: Annotated[
        list[str],
        typer.Argument(metavar="CASE...", help="Case files, or packaged cases, to fit together."),
    ],
    targets: Annotated[
        Path,
        typer.Option(
            help="CSV of measured numbers, as `cosim report --data` takes them. A band pulls where "
            "the model lies outside of it; SDs are the weights, 1 unit where there is none. The "
            "column case says which case a row is for; empty: for each."
        ),
    ],
    settings: Settings = None,
    free: Annotated[
        Path | None,
        typer.Option(
            help="TOML, a table for each parameter: low, high, start, unit, settings = "
            "['KEY={value}'] and, for a number of any sign, scale = 'linear'; of c1, toe, c4, "
            "modulus_across, shear_modulus the bounds alone. Without it those that the cases' laws "
            "have. Tables [cases.NAME] with set = ['KEY=VALUE'] make several cases of the one CASE "
            "(or of `from`), for example of as many postures."
        ),
    ] = None,
    held_out: Annotated[
        Path | None,
        typer.Option(help="CSV of rows that are compared and shown, but do not pull."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="CASE.toml",
            help="Case file to write, extending CASE; of several CASEs the settings alone.",
        ),
    ] = None,
    most: Annotated[
        int,
        typer.Option(
            "--most",
            "--steps",
            min=1,
            max=1000,
            help="Evaluations of all cases in the search, at most; gradients and the last solves, "
            "from scratch, come on top.",
        ),
    ] = 30,
    workers: Workers = 2,
) -> None:
    """Fit parameters of one or several cases to measured numbers, within bounds; say with
    intervals, correlations and singular values what the numbers could not tell."""
    with exit_on_error():
        stated = stated_cases(cases, tuple(settings or ()), free)
        wanted = read_targets(targets)
        apart = read_targets(held_out) if held_out is not None else ()
        chosen = fit_cases(stated, free, wanted, apart)
        if out is not None:
            check_file(out)
            check_same_settings(chosen)
        found = fit_all(chosen, workers, most, lambda text: typer.echo(text, err=True))
        _show_fit(found, len(chosen) > 1)
        if out is not None:
            _write_found(out, found, chosen, tuple(settings or ()), targets.name)
        else:
            typer.echo("nothing was written: --out CASE.toml keeps what was found as a case")


def _write_found(
    out: Path, found: Fit, cases: Sequence[FitCase], own: tuple[str, ...], targets: str
) -> None:
    """The case that all cases are made of, or, where they are made of several, the settings."""
    stated = [case.stated for case in cases]
    source = stated[0].source
    of_one = all(case.source == source for case in stated)
    base = base_name(source, out.parent) if of_one else None
    title = f"{load_case(source, own).title}, identified"
    with output_file(out) as part:
        text = case_text(found, title, base, own, targets, stated)
        part.write_text(text, encoding="utf-8")
        if of_one:
            check_loads(part)
    typer.echo(f"{'case' if of_one else 'settings'} in {out}")


def _show_fit(found: Fit, several: bool) -> None:
    """Parameters, misses, correlations, singular values."""
    rows = []
    for p in found.parameters:
        value, bounds = number(found.values[p.name]), f"{p.low:g} to {p.high:g}"
        told = "{:.3g} to {:.3g}".format(*interval(found, p.name)) if p in found.within else "-"
        rows.append(
            (
                f"{p.name} {p.unit}",
                number(p.start),
                value,
                told,
                bounds,
                identifiability(found, p.name),
            )
        )
    header = ("", "start", "fitted", "95 % interval", "bounds", "")
    print_table("Parameters", header, rows)
    pairs = list(zip(found.start, found.rows, strict=True))
    measured = [pair for pair in pairs if pair[1].target.kind != "requirement"]
    required = [pair for pair in pairs if pair[1].target.kind == "requirement"]
    held_out = list(zip(found.held_out_start, found.held_out, strict=True))
    for title, shown in (
        ("Targets", measured),
        ("Requirements, which nobody measured", required),
        ("Held out, which did not pull", held_out),
    ):
        _show_rows(title, shown, several)
    for title, shown in (("targets", pairs), ("rows held out", held_out)):
        if shown:
            before, after = (_squares(rows) for rows in zip(*shown, strict=True))
            typer.echo(f"{title}: sum of squared misses {before:.4g} before, {after:.4g} after")
    _show_confidence(found)
    by = f"the tangent of the hood in {', '.join(found.by_tangent)}" if found.by_tangent else ""
    typer.echo(
        f"{found.evaluations} evaluations, {found.solves} solves, {len(found.failures)} of which "
        f"did not converge; {found.stop_reason}; gradients by {by or 'differences of solves'}"
    )
    for failure in found.failures:
        typer.echo(f"did not converge: {failure}")
    for note in found.notes:
        typer.echo(f"note: {note}")


def _squares(rows: Sequence[Comparison]) -> float:
    return sum(miss(row.target, row.model or 0.0) ** 2 for row in rows)


def _show_rows(title: str, pairs: Sequence[tuple[Comparison, Comparison]], several: bool) -> None:
    """Rows before and after."""
    rows = [
        (
            *([row.target.case] if several else []),
            f"{row.target.name}, {row.target.unit}",
            *(number(before.model), number(row.model), reference_text(row.target)),
            *(f"{miss(row.target, row.model or 0.0):+.3g}", row.target.kind),
        )
        for before, row in pairs
    ]
    head = ("", "before", "after", "target", "miss, SDs", "kind")
    if rows:
        print_table(title, ("case", *head) if several else head, rows)


def _show_confidence(found: Fit) -> None:
    """Show what the rows that pull tell of the parameters, and what every row would tell if it were
    a point and no band."""
    every = [p.name for p in found.parameters]
    names, pulling = [p.name for p in found.within], found.confidence
    rows = [
        (name, *("-" if np.isnan(r) else f"{r:+.2f}" for r in line))
        for name, line in zip(names, pulling.correlation, strict=True)
    ]
    if len(names) > 1:
        print_table("Correlations", ("", *names), rows)
    points = confidence(found.slopes, found.misses)
    for title, header, seen in (
        ("the rows that pull (parameters at bounds held)", names, pulling),
        ("all rows as if points (all parameters)", every, points),
    ):
        rows = [
            (f"{s:.3g}", *(f"{part:+.2f}" for part in direction))
            for s, direction in zip(seen.singular_values, seen.directions, strict=True)
        ]
        print_table(
            f"Singular values of {title}, SDs per e-fold or whole range", ("", *header), rows
        )
    if pulling.inflation > 1:
        typer.echo(f"intervals widened {pulling.inflation:.3g} times: rows miss by more than SDs")
