"""`cosim study`."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.commands.door import door
from cosim.commands.identify import sensitivity
from cosim.commands.options import Settings, option, to
from cosim.commands.terminal import print_table, say, warn
from cosim.errors import InputError, span
from cosim.extras import require
from cosim.files import output_file
from cosim.results.compare import number, reference_text
from cosim.study import engine
from cosim.study.answers import too_few_for_ends
from cosim.study.bands import ENDS, MIDDLE, PERCENTILES, cost_of
from cosim.study.engine import Solve
from cosim.study.execute import StudyOutcome, check_libraries, execute_study
from cosim.study.file import OVER
from cosim.study.files import write_study
from cosim.study.plan import StudyPlan, read_plan
from cosim.study.progress import notes, progress, state_text
from cosim.study.results import StudyResults
from cosim.study.store import Store
from cosim.text_tables import read_csv

if TYPE_CHECKING:
    import pandas as pd

REASONS = 8
"""Told in the terminal."""


def solve_study(
    file: Annotated[
        str, typer.Argument(metavar="STUDY", help="Study file, or name of a packaged study.")
    ],
    case: Annotated[
        str | None, option("Case file or name, in place of the study's own.", metavar="CASE")
    ] = None,
    settings: Settings = None,
    samples: Annotated[
        int | None, option("Samples, in place of the study's own.", min=2, max=2**22)
    ] = None,
    over: Annotated[
        str | None,
        option(f'Every sample at each value of a key: "{OVER}": curves.', metavar="KEY=VALUES"),
    ] = None,
    workers: Annotated[
        int, option("Processes on this machine; 0: in this process alone.", min=0, max=1024)
    ] = 2,
    scheduler: Annotated[
        str | None, option("A Dask scheduler to use instead, tcp://host:8786.", metavar="ADDRESS")
    ] = None,
    retry: Annotated[bool, option("Do failed runs again.", "--retry")] = False,
    store: Annotated[
        Path | None, option("Folder of finished runs, which studies may share; else OUT/store.")
    ] = None,
    surrogate: Annotated[
        Path | None,
        option(
            "Fit a Gaussian process to each output and let it answer these points, a column "
            "for each parameter in the study's units: surrogate.csv, each answer with its SD. An "
            "output of which it explains less than 80 % of runs held out is refused.",
            metavar="POINTS.csv",
        ),
    ] = None,
    allow_poor: Annotated[
        bool, option("Answer with a poor surrogate too.", "--allow-poor")
    ] = False,
    out: Annotated[Path, to("Folder of table and page; of --sensitivity: sensitivity.")] = Path(
        "studies"
    ),
) -> None:
    """Solve the runs of a study that are not yet in its store, and write what they say."""
    check_libraries(scheduler is not None)
    points = None if surrogate is None else _points(surrogate)
    plan = read_plan(file, case, tuple(settings or ()), samples, over)
    if workers == 0 and scheduler is None and plan.most_seconds is not None:
        raise InputError("limits.time needs a process that can be ended: --workers 1 or more")
    typer.echo(f"{plan.name}: {cost_of(plan)}", err=True)
    kept = Store((store or out / "store").absolute()).open()
    try:
        with _engine(workers, scheduler) as solve, progress(plan.name, kept) as tell:
            done = execute_study(plan, kept, solve, retry, tell)
    except KeyboardInterrupt:
        typer.echo(f"stopped; what had finished is in {kept.root}: the same command goes on")
        raise typer.Exit(130) from None
    folder = out / plan.name
    results = write_study(plan, done, kept, folder)
    _show(plan, done, results, folder)
    if points is not None:
        _write_surrogates(results, points, allow_poor, folder / "surrogate.csv")
    raise typer.Exit(1 if done.count.failed or done.was_stopped else 0)


def _points(path: Path) -> pd.DataFrame:
    """The points of a CSV file.  Raises InputError."""
    require("a surrogate", "sklearn")
    import pandas as pd

    rows = read_csv(path, "slip_stiffness,PIP").rows
    return pd.DataFrame([row.cells for row in rows])


def _write_surrogates(
    results: StudyResults, points: pd.DataFrame, allow_poor: bool, path: Path
) -> None:
    """The answers of every output's surrogate at the points, and how far each is to be trusted.
    Raises InputError where none is good enough."""
    table, rows, refused = points.copy(), [], []
    for name in results.outputs:
        try:
            found = results.surrogate(name, allow_poor)
        except InputError as error:
            refused.append(str(error))
            continue
        answers = found(points)
        table[name], table[f"{name}_sd"] = answers["mean"], answers["sd"]
        unit = "" if found.unit == "1" else f", {found.unit}"
        fits = (number(found.q2, 3), number(found.rms, 3), f"{found.covered:.0%}")
        rows.append((f"{name}{unit}", str(found.runs), *fits))
    if not rows:
        raise InputError("\n  ".join(["no surrogate", *refused]))
    header = ("", "runs", "Q2 held out", "RMS held out", "within 95 % interval")
    print_table("Surrogates: Gaussian processes, judged by runs held out", header, rows)
    for reason in refused:
        typer.echo(f"no surrogate: {reason}")
    with output_file(path) as part:
        table.to_csv(part, index=False, lineterminator="\n")
    typer.echo(f"{len(points)} points answered in {path}")


def _engine(workers: int, scheduler: str | None) -> AbstractContextManager[Solve]:
    if scheduler is not None:
        return engine.remote(scheduler, say)
    return engine.local(workers) if workers else nullcontext(engine.in_this_process)


def _show(plan: StudyPlan, done: StudyOutcome, results: StudyResults, folder: Path) -> None:
    if plan.bands:
        _show_bands(plan, results.bands)
    rows = []
    for name in results.outputs:
        band, unit = results.band(name), results.units[name]
        if band is not None:
            low, _, middle, _, high = map(number, band.quantiles)
            label = name if unit == "1" else f"{name}, {unit}"
            rows.append((label, number(band.mean), number(band.sd, 3), low, middle, high))
    header = ("", "mean", "SD", "2.5 %", "median", "97.5 %")
    if rows:
        print_table(f"{plan.title}: {len(plan.points)} runs", header, rows)
    _show_fits(results)
    warn(
        {
            name: [f"too few runs: {text}" for text in results.too_few(name)]
            for name in results.outputs
        }
    )
    count = done.count
    for reason, times in count.reasons.most_common(REASONS):
        typer.echo(f"{times} without an answer: {reason}")
    if len(count.reasons) > REASONS:
        typer.echo(f"and {len(count.reasons) - REASONS} more reasons, in the table")
    if done.was_stopped:
        typer.echo(
            f"stopped at {count.failed} failures (limits.failures); {count.total - count.done} "
            "runs were not done"
        )
    typer.echo(
        f"{count.solved} runs solved, {count.done - count.solved - len(done.refused)} found in the "
        f"store, {count.failed} without an answer; page and tables in {folder}"
    )


def _show_bands(plan: StudyPlan, bands: pd.DataFrame) -> None:
    """Percentiles of the first numbers beside the case as it is."""
    axes = [*bands.columns[3 : bands.columns.get_loc("as_it_is")]]
    columns = [*axes, "as_it_is", *ENDS]
    beside = {t.quantity: reference_text(t) for t in plan.targets}
    rows = [
        (
            f"{row.meaning}, {row.unit}",
            *(number(row[name]) for name in columns),
            str(row.runs),
            *([beside.get(row.quantity, "")] if beside else []),
        )
        for _, row in bands.iterrows()
    ]
    files = ", ".join(dict.fromkeys(t.source for t in plan.targets))
    heads = ("as it is", *(f"{p} %" for p in PERCENTILES), "runs", *([files] if beside else []))
    print_table(f"{plan.case.stem}: bands by {plan.name}", ("", *axes, *heads), rows)
    if few := too_few_for_ends(int(bands.runs.min()), MIDDLE):
        typer.echo(few)


def _show_fits(results: StudyResults) -> None:
    """How much of each output a sum of straight lines explains, and a quadratic."""
    rows = []
    for name in results.outputs:
        line, surface = results.slopes(name), results.surface(name)
        if line is not None and surface is not None:
            fits = [number(x, 3) for x in (line.r2, line.rms, surface.r2, surface.rms)]
            pair, change = next(iter(results.pairs(name).items()), ((), 0.0))
            strongest = f"{' x '.join(pair)} {number(change, 3)}" if pair else ""
            rows.append((name, *fits, strongest))
    header = ("", "R2 linear", "RMS left", "R2 with products", "RMS left", "strongest pair")
    if rows:
        print_table("Does it add up?", header, rows)


def status(
    folder: Annotated[
        Path,
        option(
            "How far the studies of a folder of finished runs are.", "--status", metavar="STORE"
        ),
    ],
) -> None:
    """Show the progress of the studies in a store."""
    studies = notes(folder)
    if not studies:
        typer.echo(f"{folder}: no study has begun")
        return
    rows = []
    for n in studies:
        rate = "-" if n.rate is None else f"{n.rate:.3g}/s"
        left = "-" if n.remaining is None else span(n.remaining)
        waiting = n.total - n.done - n.handed_out
        counts = (f"{n.done}/{n.total}", str(n.failed), str(n.handed_out), str(waiting))
        rows.append((n.name, *counts, rate, left, state_text(n, time.time())))
    header = ("study", "done", "failed", "handed out", "waiting", "rate", "left", "")
    print_table("", header, rows, of_words=True)


@door({"": solve_study, "--sensitivity": sensitivity, "--status": status})
def study() -> None:
    """Solve a case for many values of its parameters, and say what its results depend on.  A study
    that was cut off continues where it was; a finished run is never repeated.  Exit code 1 where a
    run has no answer.

    With --sensitivity no file of a study is needed: each thing that the case assumes is varied
    alone: moduli, thickness, rest lengths, ligaments, fibres, contact, joints, posture, mesh; a
    tornado chart for each quantity, and a table."""
