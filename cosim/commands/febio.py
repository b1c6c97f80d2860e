"""Stand-alone shell models: `cosim solve`, and what `cosim export` writes as .feb."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings, option
from cosim.commands.terminal import console, exit_on_error, stages
from cosim.errors import ConvergenceError, InputError
from cosim.files import check_file, check_folder
from cosim.models.build import build, tensions
from cosim.models.febio import written_hood
from cosim.schema.units import LENGTH, parse
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.hood.as_job import job_of_hood, mirrored
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.job.job import Job
from fe_solver.job.model import JobOptions, move_to_mid_surface
from fe_solver.job.results import (
    SUMMARY,
    body_motions,
    body_reactions,
    farthest,
    reactions,
    write_job,
)
from fe_solver.job.solve import JobResult, JobState, solve_job, spread_times
from fe_solver.q4ans.model import obstacles
from fe_solver.q4ans.solve import alternatives, solve_solid

Model = Annotated[Path, typer.Argument(metavar="MODEL.feb", help="A FEBio 4 file.")]
NO_LIMIT = "none"
OWN_SHELL = "element: our own shell"
PENETRATION = 2e-6
"""m, the largest of our own shell where none is asked for."""


class ShellElement(StrEnum):
    """What a model is solved with: FEBio's own shell and contact, or ours; `auto` is FEBio's where
    they cover the model and find its equilibrium."""

    AUTO = "auto"
    Q4ANS = "q4ans"
    SHELL = "shell"


def solve(
    model: Model,
    until: Annotated[
        float | None, option("The last time; else the end of the file's last step.")
    ] = None,
    states: Annotated[int, option("States to keep of each step, beside must-points.", min=1)] = 1,
    out: Annotated[
        Path | None, option("Folder of the result; else runs/MODEL.", "--out", "-o")
    ] = None,
    penetration: Annotated[
        str | None,
        option(
            'Largest penetration of contact, or "none" for a penalty alone; else 2 um with '
            "our own shell, none with q4ans."
        ),
    ] = None,
    length_unit: Annotated[str, option("The file's unit of length.")] = "mm",
    spacing: Annotated[str, option("Spacing of the grids of the bodies' distances.")] = "0.25 mm",
    element: Annotated[
        ShellElement,
        option(
            "FEBio's shell and contact as documented (q4ans), our own shell, or (auto) the "
            "first where it covers the model and finds its equilibrium."
        ),
    ] = ShellElement.AUTO,
    own_shell: Annotated[
        bool, option("As --element shell: bend and touch as thin sheets do.", "--own-shell")
    ] = False,
    increments: Annotated[
        bool,
        option(
            "Take at least the file's time_steps of each step; else as few as it needs, but "
            "for friction, which remembers them.",
            "--increments",
        ),
    ] = False,
    mid_surface: Annotated[
        bool,
        option("Our own shell, with springs, ties and loads on its mid-surface.", "--mid-surface"),
    ] = False,
) -> None:
    """Solve a FEBio model and write its states; the forces' unit in the file is N."""
    with exit_on_error():
        folder = out or Path("runs") / model.stem
        check_folder(folder, SUMMARY)
        given = {
            "--element shell": element == ShellElement.SHELL,
            "--own-shell": own_shell,
            "--mid-surface": mid_surface,
        }
        asked = [option for option, is_given in given.items() if is_given]
        if asked and element == ShellElement.Q4ANS:
            raise InputError(
                "--own-shell and --mid-surface are of our own shell: leave them out, or --element "
                "q4ans"
            )
        unit, grid = _length(f"1 {length_unit}"), _length(spacing)
        limit = None if penetration in (None, NO_LIMIT) else _length(penetration)
        job = read_feb(model, unit)
        ways, times = alternatives(job) if asked else [], spread_times(job, until, states)
        is_own = _takes_own_shell(job, element, asked)
        if mid_surface:
            job = move_to_mid_surface(job)
        result: JobResult | None = None
        with stages(model.name) as progress:
            progress.say(f"solving {len(job.sheet.quads)} elements")
            options = JobOptions(penetration=limit, spacing=grid, increments=increments)
            if not is_own:
                try:
                    result = solve_solid(job, options=options, times=times)
                except ConvergenceError as error:
                    if element == ShellElement.Q4ANS:
                        raise ConvergenceError(f"{error} To try: --own-shell") from error
                    typer.echo(
                        f"{OWN_SHELL}, since FEBio's (q4ans) finds no equilibrium:\n  {error}"
                    )
            if result is None:
                if penetration is None:
                    options = replace(options, penetration=PENETRATION)
                result = solve_job(job, options=options, times=times, ways=ways)
        _show(result)
        typer.echo(f"results in {write_job(folder, result)}")


def _length(text: str) -> float:
    """Read a length with its unit (m).  Raises InputError."""
    try:
        return parse(text, LENGTH)
    except ValueError as error:
        raise InputError(str(error)) from error


def _takes_own_shell(job: Job, element: ShellElement, asked: Sequence[str]) -> bool:
    """Say what a job is solved with, our own shell or FEBio's, and why."""
    if asked:
        typer.echo(f"{OWN_SHELL}, since {' and '.join(asked)} asks for it")
        return True
    if element == ShellElement.Q4ANS:
        typer.echo("element: FEBio's shell and contact, since --element q4ans asks for them")
        return False
    reasons = obstacles(job)
    if not reasons:
        typer.echo("element: FEBio's shell and contact (q4ans), which cover all of the model")
        return False
    typer.echo(f"{OWN_SHELL}, since FEBio's (q4ans) does not cover all of the model:")
    for reason in reasons:
        typer.echo(f"  {reason}")
    return True


def _show(result: JobResult) -> None:
    screen = console()
    screen.print(f"{result.job.name}: {len(result.job.sheet.quads)} elements")
    for state in result.states:
        table = Table(title=f"t = {state.time:g}", title_justify="left", show_header=False)
        for row in _rows(result, state):
            table.add_row(*row)
        screen.print(table)
    e = result.effort
    screen.print(
        f"CPU: {result.setup_s:.2f} s to set up, {e.cpu_s:.2f} s to solve "
        f"({e.iterations} iterations, {e.solves} linear solves, {e.steps} steps, {e.failures} cut "
        f"back, {e.relaxations} relaxed)"
    )
    for touch in result.touches:
        if not touch.touched:
            screen.print(touch.words)
    for note in result.job.notes:
        screen.print(f"left out: {note}")


def _rows(result: JobResult, state: JobState) -> Iterator[tuple[str, str]]:
    largest, node = farthest(result.job, state)
    yield "largest displacement", f"{1e3 * largest:.5g} mm at node {node}"
    for name, (at, turned) in body_motions(result.job, state).items():
        for word, values, unit in (("motion", 1e3 * at, "mm"), ("turn", turned, "degrees")):
            yield f"{word} of {name}", ", ".join(f"{v:.4g}" for v in values + 0.0) + f" {unit}"
    for i, name in enumerate(state.bodies):
        force = state.contact[i]
        if force.any():
            yield f"contact force on {name}", ", ".join(f"{v:.4g}" for v in force) + " N"
    for r in reactions(result.job, state.reaction, state.time):
        if r.force.any():
            total = ", ".join(f"{v:.4g}" for v in r.force.sum(axis=0) + 0.0)
            yield f"reaction of {r.condition}", f"{total} N"
    for name, w in body_reactions(result.job, state).items():
        if w.any():
            force, couple = (", ".join(f"{v:.4g}" for v in x) for x in (w[:3], 1e3 * w[3:]))
            yield f"reaction of body {name}", f"{force} N; {couple} N mm about its origin"
    for s, f in zip(result.job.springs, state.spring_forces, strict=True):
        figures = f"largest {f.max(initial=0.0) + 0.0:.4g} N, sum {f.sum() + 0.0:.4g} N"
        yield f"springs {s.name}", f"{figures}, {(f != 0).sum()} of {len(f)} active"
    if result.job.contacts:
        yield "deepest penetration", f"{1e6 * state.penetration:.3g} um"
    yield "residual", f"{state.residual:.1e} N"
    force, moment = state.imbalance
    yield "out of balance", f"{force:.1e} N, {1e3 * moment:.1e} N mm"
    yield "CPU", f"{state.effort.cpu_s:.2f} s"


def export(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, option("The FEBio file to write.", "--out", "-o")] = Path("hood.feb"),
) -> None:
    """Write the shell hood of a case at its posture, under its tendons' tensions, for FEBio."""
    with exit_on_error():
        checked = load_case(case, settings or ())
        check_file(out)
        typer.echo(f"{checked.name}: building the models", err=True)
        models = build(checked)
        if not isinstance(models.hood, ShellHood) or checked.hood.kind != "shell":
            raise InputError(
                f"{checked.name}: its hood is no sheet of shells, which alone is written for "
                f'FEBio, but of kind "{checked.hood.kind}" ({checked.hood.title})'
            )
        with stages(checked.name) as progress:
            written = written_hood(checked, models, progress.say)
        tension, _ = tensions(checked, models)
        job = job_of_hood(written.hood, written.motion, tension, written.surfaces, checked.name)
        if checked.finger.side() == "left":
            job = mirrored(job)
        write_feb(job, out, remarks=written.remarks, in_middle=True)
        typer.echo(f"{len(job.sheet.quads)} elements in {out}")
        for line in written.remarks:
            typer.echo(line)
