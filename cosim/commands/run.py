"""The commands that run cases or check them: `cosim run` and `check`."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import typer

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.case.usual import unusual_values
from cosim.commands.door import door
from cosim.commands.options import AsJsonLines, Cases, Quiet, Settings, Workers, option, to
from cosim.commands.terminal import (
    CODES,
    INCOMPLETE,
    console,
    note,
    stages,
    tell,
    warn,
    warn_of_audits,
)
from cosim.coupling.checkpoint import NAME
from cosim.errors import InputError, Progress, StoppedError, quiet, span
from cosim.extras import require
from cosim.files import clear_leftovers, shown_path
from cosim.json_text import json_text
from cosim.models.build import mesh_warnings
from cosim.models.fit import check_fit
from cosim.outcome import Outcome, outcome_of
from cosim.pipeline import run_case, run_cases
from cosim.processes import process_context
from cosim.results.answer import answer, doubts, trust
from cosim.results.audit import describe_misses
from cosim.results.result import Result
from cosim.results.summary_tables import batch_table, tables
from cosim.results.table import Cell, ReportTable
from cosim.results.write import check_target, without_nan, write_run
from cosim.solve.motion import UNFINISHED, check_not_begun, checkpoint_folder
from cosim.solve.session import Session
from cosim.stopwatch import Stopwatch, stopwatch

if TYPE_CHECKING:
    from rich.table import Table

    from cosim.ui.desk import Desk

Voice = Literal["plain", "quiet", "json"]


class Ended(NamedTuple):
    """What a run left: its summary, the folder of its results, and what could not be made there
    beside summary and arrays."""

    summary: Mapping[str, Any]
    folder: Path
    lacking: tuple[str, ...]


def load_cases(names: Sequence[str], settings: Sequence[str] | None) -> list[Case]:
    """All cases; the faults of every one are printed before the exit."""
    cases, faults = [], []
    for name in names:
        try:
            cases.append(load_case(name, settings or ()))
        except InputError as error:
            faults.append(error)
    if faults:
        raise typer.Exit(max([tell(fault) for fault in faults]))
    return cases


def begin(
    cases: Cases,
    settings: Settings = None,
    out: Annotated[Path, to("Folder for the results.")] = Path("runs"),
    workers: Workers = 1,
    pictures: Annotated[
        bool, option("Draw each case's pictures, or none.", "--pictures/--no-pictures")
    ] = True,
    restart: Annotated[
        bool, option("Begin motions anew, even if a part is kept.", "--restart")
    ] = False,
    watch: Annotated[
        bool,
        option("Show the run, of one case, in a page of your browser as it goes on.", "--watch"),
    ] = False,
    browser: Annotated[
        bool, option("With --watch: open the browser, or not.", "--browser/--no-browser")
    ] = True,
    profile: Annotated[
        bool, option("Print where the time went; with --workers 1.", "--profile")
    ] = False,
    quiet: Quiet = False,
    as_json: AsJsonLines = False,
) -> None:
    """Run cases from their beginning."""
    if profile and workers > 1:
        raise InputError(f"--profile: measures one process, not {workers}; leave --workers out")
    if workers > 1:
        process_context()  # imports while the cases are read
    if watch:
        require("the page", "starlette", "uvicorn")
    none = () if pictures else ("output.picture=false",)
    checked = load_cases(cases, (*(settings or ()), *none))
    warn({case.name: list(unusual_values(case)) for case in checked})
    note({case.name: case.dropped for case in checked})
    _check_targets(checked, out)
    if watch and len(checked) > 1:
        raise InputError(f"--watch: shows one case, not {len(checked)}; run them one by one")
    _check_unfinished(checked, out, restart)
    voice = _voice(quiet, as_json)
    if watch:
        _run_watched(checked[0], out, voice, browser)
    if not profile:
        _run_all(checked, out, voice, workers)
    before = time.process_time()
    with stopwatch() as measured:
        try:
            _run_all(checked, out, voice)
        finally:
            console(to_errors=True).print(_profile(measured, before))


def _run_watched(case: Case, out: Path, voice: Voice, opens: bool) -> None:
    """Run a case beside a page that shows it, which stays until the user ends it."""
    from cosim.ui.desk import Desk
    from cosim.ui.server import serving, wait_for_end

    desk = Desk(case, out, is_live=False)
    with serving(desk, 0, opens, lambda text: typer.echo(text, err=True)):
        try:
            _run_all([case], out, voice, desk=desk)
        except typer.Exit as ended:
            if ended.exit_code != CODES[StoppedError]:
                typer.echo("the page stays until you press Ctrl-C", err=True)
                wait_for_end()
            raise


def _run_all(
    cases: Sequence[Case], out: Path, voice: Voice, workers: int = 1, desk: Desk | None = None
) -> None:
    """Run cases until the user stops them; their warnings, and what their audits missed, are said
    last."""
    summaries: dict[str, Mapping[str, Any] | None] = {}
    lacking: dict[str, tuple[str, ...]] = {}
    failed, started = 0, time.perf_counter()
    ran = (
        _one_by_one(cases, out, voice, desk)
        if workers == 1
        else _side_by_side(cases, out, voice, workers)
    )
    for case, outcome in ran:
        ended, error = outcome.value, outcome.error
        summaries[case.name] = None if ended is None else ended.summary
        lacking[case.name] = () if ended is None else ended.lacking
        if error is not None:
            failed = max(failed, tell(type(error)(f"{case.name}: {error}")))
        if ended is not None:
            _tell_end(case, ended, voice, alone=len(cases) == 1)
        if voice == "plain" and len(cases) > 1:
            _count(case.name, len(summaries), len(cases), time.perf_counter() - started)
        if type(error) is StoppedError:
            break
    if voice == "plain" and len(cases) > 1:
        console().print(batch_table([case.name for case in cases], summaries))
        typer.echo(f"results in {shown_path(out)}")
    told = voice == "plain" and len(cases) == 1  # before the tables
    warnings = {n: () if told else (s or {}).get("warnings", ()) for n, s in summaries.items()}
    warn({name: [*texts, *lacking[name]] for name, texts in warnings.items()})
    missed = warn_of_audits({n: list(describe_misses(s or {})) for n, s in summaries.items()})
    raise typer.Exit(failed or missed or (INCOMPLETE if any(lacking.values()) else 0))


def _profile(measured: Stopwatch, before: float) -> Table:
    """The parts of a run, those within a part indented; `before`: processor's s before it."""
    rows: list[Sequence[Cell]] = [["start, imports, case (processor)", "", "", before]]
    for way, part in measured.parts.items():
        name = "  " * (len(way) - 1) + way[-1]
        rows.append([name, part.calls, part.factorisations or "", part.seconds])
    columns = ["part", "calls", "factorisations", "time s"]
    return ReportTable("profile", "", columns, rows, digits=3).in_terminal()


def _voice(quiet: bool, as_json: bool) -> Voice:
    if quiet and as_json:
        raise typer.BadParameter("--quiet and --json: one of the two")
    return "quiet" if quiet else "json" if as_json else "plain"


def _check_targets(cases: Sequence[Case], out: Path) -> None:
    names = [case.name for case in cases]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"two cases are named {', '.join(twice)}: run them one by one with --out")
    for name in names:
        check_target(out, name)


def _one_by_one(
    cases: Sequence[Case], out: Path, voice: Voice, desk: Desk | None
) -> Iterator[tuple[Case, Outcome[Ended]]]:
    """Run and write each case in this process, its stages told, on the page of a desk too."""
    session = Session(checkpoints=out, watch=None if desk is None else desk.show_motion)
    for case in cases:
        unfinished = checkpoint_folder(case, out)
        try:
            outcome = outcome_of(partial(_run_one, case, session, out, voice, desk))
        except KeyboardInterrupt:
            stopped = StoppedError(f"stopped before its end; {_what_stays(unfinished)}")
            outcome = Outcome("failed", None, stopped)
        if outcome.error is None:
            _forget(unfinished)
        elif desk is not None:
            desk.fail(outcome.error)
        yield case, outcome


def _run_one(
    case: Case, session: Session, out: Path, voice: Voice, desk: Desk | None = None
) -> Ended:
    with _progress(case.name, voice) as tell_user:

        def say(text: str) -> None:
            tell_user(text)
            if desk is not None:
                desk.hear(text)

        result = run_case(case, session, say)
        if desk is not None:
            desk.show(result)
        tell_user("writing the results")
        return _save(result, out)


def _side_by_side(
    cases: Sequence[Case], out: Path, voice: Voice, workers: int
) -> Iterator[tuple[Case, Outcome[Ended]]]:
    """Run and write cases in so many processes; each as it ends."""
    waiting = set(range(len(cases)))
    for folder in filter(None, (checkpoint_folder(case, out) for case in cases)):
        clear_leftovers(folder)  # and again, should the processes be ended
    if voice == "plain":
        typer.echo(f"0/{len(cases)}: {min(workers, len(cases))} processes begin", err=True)
    try:
        for i, outcome in run_cases(cases, partial(_save, out=out), workers, checkpoints=out):
            waiting.remove(i)
            if outcome.error is None:
                _forget(checkpoint_folder(cases[i], out))
            yield cases[i], outcome
    except InputError as error:  # of the pool: a process was ended from outside
        yield cases[min(waiting)], Outcome("died", None, error)
    except KeyboardInterrupt:
        begun = [checkpoint_folder(cases[i], out) for i in sorted(waiting)]
        kept = [shown_path(folder) for folder in begun if folder is not None and folder.exists()]
        words = f"; go on with: cosim run --resume {', '.join(kept)}" if kept else ""
        stopped = StoppedError(f"stopped with {len(waiting)} cases left{words}")
        yield cases[min(waiting)], Outcome("failed", None, stopped)


def _save(result: Result, out: Path) -> Ended:
    return Ended(result.summary, *write_run(out, result))


def _tell_end(case: Case, ended: Ended, voice: Voice, alone: bool) -> None:
    if voice == "json":
        summary = without_nan(ended.summary)
        line = {"case": case.name, "results": str(ended.folder), "summary": summary}
        typer.echo(json_text(line, None, ensure_ascii=True))
    elif voice == "plain" and alone:
        _show(case, ended.summary)
        typer.echo(f"results in {shown_path(ended.folder)}")


def _count(name: str, done: int, total: int, seconds: float) -> None:
    left = seconds / done * (total - done)
    words = f", about {span(left)} left" if done < total else ""
    typer.echo(f"{done}/{total}{words}: {name}", err=True)


def _what_stays(unfinished: Path | None) -> str:
    if unfinished is None or not (unfinished / NAME).is_file():
        return "nothing of this run is kept"
    return f"what was kept before stays. Go on with: cosim run --resume {shown_path(unfinished)}"


def _forget(unfinished: Path | None) -> None:
    if unfinished is not None:
        shutil.rmtree(unfinished, ignore_errors=True)


def _check_unfinished(cases: Sequence[Case], out: Path, restart: bool) -> None:
    """Check that no part of a motion is kept, which a new run would throw away; with `restart` it
    is thrown away.  Raises InputError."""
    for case in cases:
        if restart:
            _forget(checkpoint_folder(case, out))
        check_not_begun(case, out)


def resume(
    run: Annotated[
        Path,
        option(
            "Go on with a motion that was stopped or killed, from its last checkpoint: the "
            "folder of its run.",
            "--resume",
            metavar="RUN",
        ),
    ],
    quiet: Quiet = False,
    as_json: AsJsonLines = False,
) -> None:
    """Go on with a motion that was cut off."""
    name = run.name.removesuffix(UNFINISHED)
    file = run.with_name(name + UNFINISHED) / "case.toml"
    if not file.is_file():
        raise InputError(
            f"{run}: no motion was cut off here: only one that was stopped or killed "
            f"leaves a folder RUN{UNFINISHED}"
        )
    case = load_case(file).model_copy(update={"name": name})
    _run_all([case], run.parent, _voice(quiet, as_json))


@door({"": begin, "--resume": resume})
def run() -> None:
    """Run cases; each writes its results to a folder of its name.  One case prints its results;
    several print a counter, and a table of all at the end."""


@contextmanager
def _progress(name: str, voice: Voice) -> Iterator[Progress]:
    """Show the stages: a spinner on a terminal, else a line for each; or lines of JSON,
    or nothing."""
    if voice == "quiet":
        yield quiet
        return
    if voice == "json":
        yield lambda stage: typer.echo(json.dumps({"case": name, "stage": stage}))
        return
    with stages(name) as progress:
        yield progress.say


def _show(case: Case, summary: Mapping[str, Any]) -> None:
    from cosim.analyses.converge import known_errors

    printer = console()
    printer.print(f"\n{case.name}: {case.title}\n")
    printer.print(" ".join([*answer(summary), trust(summary)]))
    for doubt in doubts(summary):
        printer.print(f"▲ {doubt}")
    warn({case.name: list(summary.get("warnings", ()))})
    errors = known_errors(case, summary)
    for table in tables(summary, errors):
        printer.print(table)
    if errors:
        printer.print("mesh error: grid convergence index, as cosim converge found it")


def check(cases: Cases, settings: Settings = None) -> None:
    """Check cases, with the mesh files that they name, and study files, with their cases; run
    nothing."""
    from cosim.study.file import is_study
    from cosim.study.plan import read_plan

    codes = [0]
    studies = [name for name in cases if is_study(name)]
    for name in studies:
        try:
            typer.echo(f"{name}: in order, a study of {read_plan(name).count} runs")
        except InputError as error:
            codes.append(tell(error))
    for case in load_cases([name for name in cases if name not in studies], settings):
        try:
            check_fit(case)
            case.hood.check_files()
            typer.echo(f"{case.name}: in order")
            for key, text in case.hood.followers().items():
                typer.echo(f"  {key} {text}")
            note({case.name: case.dropped})
            warn({case.name: [*unusual_values(case), *mesh_warnings(case)]})
        except InputError as error:
            codes.append(tell(InputError(f"{case.name}: {error}")))
    raise typer.Exit(max(codes))
