"""The command of injuries and repairs: `cosim lesion`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cosim.analyses.lesion import TIPS, both_sides, freed_text, lesion_text, named_parts
from cosim.analyses.repairs import (
    MEASURES,
    compare_repairs,
    read_repairs,
    table_of_repairs,
)
from cosim.analyses.repairs_page import repair_sentences, repairs_page
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.commands.options import Settings, Workers, option, to
from cosim.commands.terminal import show_table, stages, warn_of_audits
from cosim.errors import InputError
from cosim.files import check_file, write_text
from cosim.pipeline import run_each
from cosim.report.clinical_signs import sign_sentences
from cosim.report.lesion_page import (
    RunPair,
    lesion_page,
    limit_sentences,
    signs_of,
    tables_of_lesion,
)
from cosim.report.page import Form
from cosim.report.tables import tables_text
from cosim.results.audit import describe_misses
from cosim.results.read import read_run
from cosim.results.result import Result
from cosim.results.table import ReportTable
from cosim.results.write import check_target


def lesion(
    case: Annotated[
        str, typer.Argument(help="Case file with a table [lesion], or a packaged one.")
    ],
    settings: Settings = None,
    page: Annotated[
        Path | None, option("The report to write; else CASE.html.", metavar="FILE")
    ] = None,
    form: Annotated[
        Form, option("A page, or its tables alone as csv, json or md.", "--format")
    ] = "html",
    out: Annotated[Path, to("Folder for the runs.")] = Path("runs"),
    workers: Workers = 2,
    repairs: Annotated[
        Path | None,
        option("Compare the repairs that a TOML file states, or a packaged one.", metavar="FILE"),
    ] = None,
) -> None:
    """Solve a case without its lesion and with it, fingertip free and held, and report both:
    posture, slip forces, fingertip force, strain maps.  With --repairs report each repair beside
    them, ranked by how near it comes to the intact finger."""
    checked = load_case(case, ["output.picture=false", *(settings or ())])
    if repairs is not None:
        _compare_repairs(checked, repairs, page, form, out, workers)
        return
    where = _page_file(page, checked.name, form)
    pairs = _solve_runs(checked, out, workers)
    tables = _write(checked, pairs, where, form)
    for text in (*freed_text(checked), *limit_sentences(pairs)):
        typer.echo(f"{text}\n")
    for text in sign_sentences(signs_of(pairs)):
        typer.echo(text)
    for table in tables:
        show_table(table)
    typer.echo(f"report in {where}, runs in {out}")
    runs = [run for pair in pairs for run in (pair.before, pair.after)]
    raise typer.Exit(warn_of_audits({run.name: list(describe_misses(run.summary)) for run in runs}))


def _page_file(page: Path | None, name: str, form: Form) -> Path:
    """The file of the report.  Raises InputError."""
    where = page or Path(f"{name}.{form}")
    check_file(where)
    if where.suffix.lower() != f".{form}":
        raise InputError(f"--page {where}: expected a name that ends in .{form}, as --format says")
    return where


def _compare_repairs(
    case: Case, source: Path, page: Path | None, form: Form, out: Path, workers: int
) -> None:
    file = read_repairs(source)
    where = _page_file(page, f"{case.name}_repairs", form)
    check_target(out, case.name)
    with stages(case.name) as progress:
        found = compare_repairs(
            case, file, out, workers, lambda done, of: progress.say(f"{done}/{of} runs")
        )
    table = table_of_repairs(found)
    text = repairs_page(found) if form == "html" else tables_text(form, (), [table])
    write_text(where, text)
    for said in repair_sentences(found):
        typer.echo(said)
    m = MEASURES[found.rank]
    show_table(table.only("finger", "rank", f"{m.words}, {m.unit}", "repair bears, N", "remark"))
    typer.echo(f"report in {where}, runs in {out}")


def _solve_runs(case: Case, out: Path, workers: int) -> list[RunPair]:
    """The four runs, each in its folder.  Raises InputError, ConvergenceError."""
    four = both_sides(case)
    cases = list(four.values())
    for one in cases:
        check_target(out, one.name)
    with stages(case.name, len(cases)) as progress:
        progress.say(f"0/{len(cases)} before and after, fingertip free and held")
        outcomes = run_each(
            cases,
            partial(Result.save, folder=out),
            workers,
            lambda _, i, of: progress.end(f"{cases[i].title}{': failed' if of.error else ''}"),
        )
    for one, outcome in zip(cases, outcomes, strict=True):
        if outcome.error is not None:
            raise type(outcome.error)(f"{one.name}: {outcome.error}") from outcome.error
    runs = {key: read_run(out / one.name) for key, one in four.items()}
    return [RunPair(tip, runs[tip, "before"], runs[tip, "after"]) for tip in TIPS]


def _write(case: Case, pairs: Sequence[RunPair], where: Path, form: Form) -> list[ReportTable]:
    tables = tables_of_lesion(pairs)
    if form == "html":
        text = lesion_page(
            case.title, list(lesion_text(case)), named_parts(case), pairs, list(freed_text(case))
        )
    else:
        text = tables_text(form, [run for p in pairs for run in (p.before, p.after)], tables)
    write_text(where, text)
    return tables
