"""`cosim identify`, and `cosim study --sensitivity`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from cosim.analyses.identify.case_text import case_text, check_loads, check_same_settings
from cosim.analyses.identify.cases import FitCase, fit_cases, stated_cases
from cosim.analyses.identify.fit import Fit, confidence, fit_all, identifiability, interval, miss
from cosim.analyses.identify.information import Information
from cosim.analyses.identify.profile_plot import draw_profiles, profile_interval, profiles_csv
from cosim.analyses.identify.sensitivity import (
    Sensitivity,
    bars,
    study,
    to_csv,
    to_json,
    variations,
)
from cosim.analyses.identify.tornado import draw_tornado
from cosim.case.file import base_name, load_case
from cosim.commands.options import Settings, Workers, option, to
from cosim.commands.terminal import print_table, say, stages
from cosim.errors import InputError
from cosim.files import check_file, output_file, write_text
from cosim.hoods.variation import Variation
from cosim.results.compare import Comparison, Target, number, read_targets, reference_text, unit_of
from cosim.results.picture import write_figure

STRONGEST = 6
"""Rows for each quantity in the terminal."""


def sensitivity(
    of: Annotated[
        str,
        option(
            "How the results of this case depend on what it assumes.",
            "--sensitivity",
            metavar="CASE",
        ),
    ],
    settings: Settings = None,
    out: Path = Path("sensitivity"),
    quantity: Annotated[
        list[str] | None,
        option(
            "Where summary.json has the number (slip_force_N.central), or A/B for a ratio; "
            "repeatable. Without it: the usual forces, strains and arms.",
            metavar="KEY",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        option("Vary what has NAME in its name alone; repeatable.", metavar="NAME"),
    ] = None,
    data: Annotated[
        Path | None,
        option(
            "CSV of measured numbers, as `cosim show --data` takes them: their quantities "
            "are included, and shown in the charts."
        ),
    ] = None,
    workers: int = 2,
) -> None:
    """Vary each thing that a case assumes alone; a chart for each quantity, and a table."""
    all_settings = tuple(settings or ())
    checked = load_case(of, all_settings)
    folder = out / checked.name
    check_file(folder / "sensitivity.csv")
    varied = _choose(variations(checked), only or ())
    targets = [t for t in read_targets(data) if t.case in ("", checked.name)] if data else []
    also = [t.quantity for t in targets]
    with stages(checked.name) as told:
        result = study(
            checked.source,
            all_settings,
            varied,
            quantity or (),
            also,
            workers,
            lambda done, total, what: told.say(f"{done}/{total} {what}"),
        )
    for name, text in (("sensitivity.csv", to_csv(result)), ("sensitivity.json", to_json(result))):
        write_text(folder / name, text)
    typer.echo(f"{checked.name}: drawing the charts", err=True)
    charts = _write_charts(folder, result, targets)
    _show_sensitivity(result)
    typer.echo(f"table and {charts} charts in {folder}")


def _choose(every: Sequence[Variation], only: Sequence[str]) -> list[Variation]:
    if not only:
        return list(every)
    chosen = [v for v in every if any(word.casefold() in v.name.casefold() for word in only)]
    if not chosen:
        raise InputError(
            f"--only {', '.join(only)}: nothing of that name; there are "
            + "; ".join(v.name for v in every)
        )
    return chosen


def _write_charts(folder: Path, result: Sensitivity, targets: Sequence[Target]) -> int:
    """A chart for each quantity that answers to anything; how many."""
    target = {t.quantity: t for t in targets}
    drawn = [q for q in result.base if any(bar.swing > 0 for bar in bars(result, q))]
    for quantity in drawn:
        name = re.sub(r"[^\w.-]+", "_over_", quantity)
        with output_file(folder / f"{name}.png") as part:
            figure = draw_tornado(result, quantity, target.get(quantity))
            write_figure(figure, part, 130, bbox_inches="tight")
    return len(drawn)


def _show_sensitivity(result: Sensitivity) -> None:
    """The strongest answers of each quantity, and the runs that have none."""
    for quantity, base in result.base.items():
        rows = [
            (
                bar.variation,
                *(bar.low.set_to, number(bar.low.values.get(quantity))),
                *(bar.high.set_to, number(bar.high.values.get(quantity))),
            )
            for bar in bars(result, quantity)[:STRONGEST]
            if bar.swing > 0
        ]
        of = "" if unit_of(quantity) == "1" else f" {unit_of(quantity)}"
        title = f"{quantity}: {number(base)}{of}"
        if rows:
            print_table(title, ("", "low", "then", "high", "then"), rows)
        else:
            typer.echo(f"{title}, depends on nothing that was varied\n")
    for run in result.runs:
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
        option(
            "CSV of measured numbers, as `cosim show --data` takes them. A band counts if "
            "the model lies outside it; SDs are the weights, 1 unit if there is none. The column "
            "case says which case a row is for; empty: for each."
        ),
    ],
    settings: Settings = None,
    free: Annotated[
        Path | None,
        option(
            "TOML, a table for each parameter: low, high, start, unit, settings = "
            "['KEY={value}'] and, for a number of any sign, scale = 'linear'; of c1, toe, c4, "
            "modulus_across, shear_modulus the bounds alone. Without it: the parameters of the "
            "cases' laws. Tables [cases.NAME] with set = ['KEY=VALUE'] make several cases of the "
            "one CASE (or of `from`), for example one for each posture."
        ),
    ] = None,
    held_out: Annotated[
        Path | None,
        option(
            "CSV of rows that are compared and shown, but not fitted; so are rows of "
            "--targets with yes in a column held_out."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        to("Case file to write, extending CASE; of several CASEs the settings alone.", "CASE.toml"),
    ] = None,
    profiles: Annotated[
        Path | None,
        option(
            "Hold each parameter on a grid while the others are fitted again, and write these "
            "profile likelihoods as profiles.csv and profiles.png; a dozen fits a parameter.",
            metavar="FOLDER",
        ),
    ] = None,
    allow_unidentified: Annotated[
        bool,
        option(
            "Fit even where the rows cannot tell some of the parameters at the start.",
            "--allow-unidentified",
        ),
    ] = False,
    most: Annotated[
        int,
        option(
            "Evaluations of all cases in the search, at most; gradients and the last solves, "
            "from scratch, come on top.",
            "--most",
            "--steps",
            min=1,
            max=1000,
        ),
    ] = 30,
    workers: Workers = 2,
) -> None:
    """Fit parameters of one or several cases to measured numbers, within bounds; say with
    intervals, correlations and singular values what the numbers do not determine.  Where they
    cannot tell a parameter at all, there is no fit unless --allow-unidentified."""
    stated = stated_cases(cases, tuple(settings or ()), free)
    wanted = read_targets(targets)
    apart = read_targets(held_out) if held_out is not None else ()
    chosen = fit_cases(stated, free, wanted, apart)
    if out is not None:
        check_file(out)
        check_same_settings(chosen)
    if profiles is not None:
        check_file(profiles / "profiles.csv")
    fit = fit_all(
        chosen,
        workers,
        most,
        say,
        allow_unidentified=allow_unidentified,
        profiles=profiles is not None,
    )
    _show_fit(fit, len(chosen) > 1)
    if profiles is not None:
        _write_profiles(profiles, fit)
    if out is not None:
        _write_fit(out, fit, chosen, tuple(settings or ()), targets.name)
    else:
        typer.echo("nothing was written: --out CASE.toml writes the fitted case")


def _write_profiles(folder: Path, fit: Fit) -> None:
    write_text(folder / "profiles.csv", profiles_csv(fit))
    with output_file(folder / "profiles.png") as part:
        write_figure(draw_profiles(fit), part, 130)
    typer.echo(f"profiles of {len(fit.profiles)} parameters in {folder}")


def _write_fit(
    out: Path, fit: Fit, cases: Sequence[FitCase], settings: tuple[str, ...], targets: str
) -> None:
    """The case that all cases are made of, or, where they are made of several, the settings."""
    stated = [case.stated for case in cases]
    source = stated[0].source
    of_one = all(case.source == source for case in stated)
    base = base_name(source, out.parent) if of_one else None
    title = f"{load_case(source, settings).title}, identified"
    with output_file(out) as part:
        text = case_text(fit, title, base, settings, targets, stated)
        part.write_text(text, encoding="utf-8")
        if of_one:
            check_loads(part)
    typer.echo(f"{'case' if of_one else 'settings'} in {out}")


def _show_fit(fit: Fit, several: bool) -> None:
    """Parameters, misses, correlations, singular values."""
    _show_information(fit.before)
    rows = []
    for p in fit.parameters:
        value, bounds = number(fit.values[p.name]), f"{p.low:g} to {p.high:g}"
        limits = "{:.3g} to {:.3g}".format(*interval(fit, p.name)) if p in fit.within else "-"
        rows.append(
            (
                f"{p.name} {p.unit}",
                number(p.start),
                value,
                limits,
                bounds,
                identifiability(fit, p.name),
            )
        )
    header = ("", "start", "fitted", "95 % interval", "bounds", "")
    print_table("Parameters", header, rows)
    pairs = list(zip(fit.start, fit.rows, strict=True))
    measured = [pair for pair in pairs if pair[1].target.kind != "requirement"]
    required = [pair for pair in pairs if pair[1].target.kind == "requirement"]
    held_out = list(zip(fit.held_out_start, fit.held_out, strict=True))
    for title, shown in (
        ("Targets", measured),
        ("Requirements, which nobody measured", required),
        ("Held out, which did not pull", held_out),
    ):
        _show_rows(title, shown, several)
    for title, shown in (("targets", pairs), ("rows held out", held_out)):
        if shown:
            before, after = (
                sum(miss(row.target, row.model or 0.0) ** 2 for row in rows)
                for rows in zip(*shown, strict=True)
            )
            typer.echo(f"{title}: sum of squared misses {before:.4g} before, {after:.4g} after")
    columns = ("", "rows", "before", "after", "null: all 0")
    parts = [
        (p.name, str(p.count), *(number(x, 3) for x in (p.start, p.end, p.zero))) for p in fit.parts
    ]
    print_table("RMS of the misses, SDs", columns, parts)
    _show_confidence(fit)
    if fit.profiles:
        curves = [
            (f"{p.name} {p.unit}", number(fit.values[p.name]), profile_interval(p, profile))
            for p, profile in zip(fit.parameters, fit.profiles, strict=True)
        ]
        print_table("Profile likelihoods", ("", "fitted", "95 % interval"), curves)
    by = f"the tangent of the hood in {', '.join(fit.by_tangent)}" if fit.by_tangent else ""
    typer.echo(
        f"{fit.evaluations} evaluations, {fit.solves} solves, {len(fit.failures)} of which "
        f"did not converge; {fit.stop_reason}; gradients by {by or 'differences of solves'}"
    )
    for failure in fit.failures:
        typer.echo(f"did not converge: {failure}")
    for note in fit.notes:
        typer.echo(f"note: {note}")


def _show_information(before: Information) -> None:
    """What the rows could tell at the start."""
    lost = {name for group in before.lost for name in group}
    rows = [
        (
            name,
            number(float(change), 3),
            "no" if name in lost else "yes",
            *("-" if np.isnan(r) else f"{r:+.2f}" for r in line),
        )
        for name, change, line in zip(before.names, before.changes, before.correlation, strict=True)
    ]
    several = before.names if len(before.names) > 1 else ()
    title = (
        f"Before the fit: the rows, as points, can tell {before.rank} of {len(before.names)} "
        "parameters; correlations"
    )
    header = ("", "change of all rows over its range, SDs", "told", *several)
    print_table(title, header, [row[: len(header)] for row in rows])
    for fault in before.faults():
        typer.echo(f"not told: {fault}")


def _show_rows(title: str, pairs: Sequence[tuple[Comparison, Comparison]], several: bool) -> None:
    """Rows before and after."""
    rows = [
        (
            *([row.target.case] if several else []),
            f"{row.target.name}, {row.target.unit}",
            *(number(at_start.model), number(row.model), reference_text(row.target)),
            *(f"{miss(row.target, row.model or 0.0):+.3g}", row.target.kind),
        )
        for at_start, row in pairs
    ]
    head = ("", "before", "after", "target", "miss, SDs", "kind")
    if rows:
        print_table(title, ("case", *head) if several else head, rows)


def _show_confidence(fit: Fit) -> None:
    """Show what the rows that pull say of the parameters, and what every row would say if it were
    a point and no band."""
    every = [p.name for p in fit.parameters]
    names, pulling = [p.name for p in fit.within], fit.confidence
    rows = [
        (name, *("-" if np.isnan(r) else f"{r:+.2f}" for r in line))
        for name, line in zip(names, pulling.correlation, strict=True)
    ]
    if len(names) > 1:
        print_table("Correlations", ("", *names), rows)
    points = confidence(fit.slopes, fit.misses)
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
        typer.echo(f"intervals widened {pulling.inflation:.3g} times: misses exceed the SDs")
