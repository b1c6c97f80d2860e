"""The command of the validations: `cosim validate`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from cosim.commands.terminal import console, exit_on_error, warn_of_audits
from cosim.errors import InputError
from cosim.files import check_file
from cosim.results.compare import marks, misses_first, number, reference_text
from cosim.validation.mesh import Change, changes, refine_meshes, tally, write_changes
from cosim.validation.page import write_page
from cosim.validation.run import Board, by_kind, choose_groups, run_validation, write_scoreboard
from cosim.validation.trial import TrialGroup

PLACE = Path("cases/scoreboard.json")
"""Where the committed scoreboard is, of a checkout."""
CHANGES = "mesh_convergence.json"
"""Beside it, what a finer mesh changes."""
MESH = "hood.mesh"


def validate(
    only: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Only the group of this name, or the trials whose name contains it.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the runs and the page.")
    ] = Path("runs/validation"),
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Replace a value of every trial; hood.mesh=MI29.FEB is --published.",
        ),
    ] = None,
    published: Annotated[
        Path | None,
        typer.Option(metavar="MI29.FEB", help="The published hood's file (FEBio's test suite)."),
    ] = None,
    finer: Annotated[
        int | None,
        typer.Option(
            metavar="QUADS",
            min=120,
            max=20000,
            help="Repeat on hoods of so many quads: what the mesh changes in every number.",
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Processes.")] = 2,
    listed: Annotated[
        bool, typer.Option("--list", help="Name the trials by group, and run none.")
    ] = False,
    update: Annotated[
        bool, typer.Option("--update", help=f"Write {PLACE}, the committed scoreboard, as well.")
    ] = False,
) -> None:
    """Run the validations; print the tally by kind of reference, the skill over null models, and
    every compared number, misses first."""
    with exit_on_error():
        hoods, other_settings = _hoods(settings or [])
        if update and (only or other_settings):
            raise InputError("--update takes all trials as they are: leave out --only and --set")
        if update and not PLACE.parent.is_dir():
            raise InputError(f"--update: there is no {PLACE.parent}/ here; run it in a checkout")
        groups = choose_groups(only, hoods[-1] if hoods else published)
        if listed:
            _list(groups)
            return
        check_file(out / "scoreboard.json")
        finer_groups = [] if finer is None else refine_meshes(groups, finer, other_settings)
        boards = run_validation(groups, out, other_settings, workers, _progress)
        again = run_validation(finer_groups, out / "finer", (), workers, _progress)
        mesh_changes = changes(boards, again)
        places = [out / "scoreboard.json", *([PLACE] if update else [])]
        for place in places:
            write_scoreboard(place, boards)
            if finer is not None:
                write_changes(place.with_name(CHANGES), finer, again, mesh_changes)
        write_page(out / "scoreboard.html", boards, mesh_changes)
    _print(boards)
    if finer is not None:
        _print_changes(again, mesh_changes)
    typer.echo(f"scoreboard in {out / 'scoreboard.html'} and {' and '.join(map(str, places))}")
    every = (*boards, *again)
    missed = warn_of_audits(
        {name: why for board in every for name, why in board.audit_misses.items()}
    )
    raise typer.Exit(1 if any(board.failures for board in every) else missed)


def _hoods(settings: list[str]) -> tuple[list[Path], list[str]]:
    """The hood meshes among settings, which have trials of their own, and the other settings."""
    pairs = [text.partition("=") for text in settings]
    hoods = [Path(value.strip().strip("\"'")) for key, _, value in pairs if key.strip() == MESH]
    return hoods, ["".join(pair) for pair in pairs if pair[0].strip() != MESH]


def _progress(text: str) -> None:
    typer.echo(text, err=True)


def _list(groups: list[TrialGroup]) -> None:
    for group in groups:
        typer.echo(group.listed)
        for trial in group.trials:
            typer.echo(f"  {trial.name}")


def _print(boards: list[Board]) -> None:
    screen = console()
    for board in by_kind(boards):
        _print_tallies(board)
    for board in boards:
        _print_tallies(board)
        for line in board.hand_lines:
            screen.print(f"  {line}")
        _print_rows(board)
        _print_failures(board)


def _print_tallies(board: Board) -> None:
    variant = " (variant)" if board.variant else ""
    console().print(f"\n{board.group}{variant}: {board.headline}")
    for answer, counts in board.tallies().items():
        console().print(f"  {answer}: {_summary_sentence(counts) or 'nothing counts'}")


def _summary_sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _print_rows(board: Board) -> None:
    table = Table()
    for name in ("what", "model", "reference", "difference", "verdict", "kind"):
        table.add_column(name)
    for row in misses_first(board.rows):
        t = row.target
        name = " ".join([t.name, *(f"[{mark}]" for mark in marks(t))])
        gap, model = number(row.difference, 3), number(row.model, 3)
        table.add_row(name, f"{model} {t.unit}", reference_text(t), gap, row.verdict, t.kind)
    console().print(table)


def _print_changes(again: list[Board], mesh_changes: list[Change]) -> None:
    screen = console()
    table = Table(title="mesh: what more quads change", title_justify="left")
    for name in ("what", "model", "finer", "change", "at most", "verdict"):
        table.add_column(name)
    for c in mesh_changes:
        model = f"{number(c.model, 3)} {c.unit}"
        numbers = (number(value, 3) for value in (c.finer, c.change, c.bound))
        table.add_row(f"{c.name} [{c.case or c.group}]", model, *numbers, c.verdict)
    screen.print(table)
    screen.print(", ".join(f"{count} {word}" for word, count in tally(mesh_changes).items()))
    for board in again:
        _print_failures(board)


def _print_failures(board: Board) -> None:
    for name, why in board.failures.items():
        console().print(f"failed: {name}: {why}")
