"""The command of the validations: `cosim validate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.terminal import console, told, warn_of_audits

if TYPE_CHECKING:
    from cosim.validate import Board
    from cosim.validation_mesh import Change

PLACE = Path("cases/scoreboard.json")
"""Where the committed scoreboard is, of a checkout."""
CHANGES = "mesh_convergence.json"
"""Beside it, what a finer mesh changes."""
MESH = "hood.mesh"


def validate(
    only: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only the trials whose name holds this.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the runs and the page.")] = Path(
        "runs/validation"
    ),
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
            help="Once more on hoods of so many quads: what the mesh changes in every number.",
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Processes.")] = 2,
    update: Annotated[
        bool, typer.Option("--update", help=f"Write {PLACE}, the committed scoreboard, as well.")
    ] = False,
) -> None:
    """Run the validations and print every compared number, the misses too."""
    with told():
        from cosim.port import InputError
        from cosim.scoreboard_page import write_page
        from cosim.validate import chosen, validated, write_scoreboard
        from cosim.validation_mesh import changes, on_finer_meshes, write_changes

        hoods, own = _hoods(settings or [])
        if update and (only or own):
            raise InputError("--update takes all trials as they are: leave out --only and --set")
        if update and not PLACE.parent.is_dir():
            raise InputError(f"--update: there is no {PLACE.parent}/ here; run it in a checkout")
        groups = chosen(only, hoods[-1] if hoods else published)
        finer_groups = [] if finer is None else on_finer_meshes(groups, finer, own)
        boards = validated(groups, out, own, workers, _progress)
        again = validated(finer_groups, out / "finer", (), workers, _progress)
        found = changes(boards, again)
        places = [out / "scoreboard.json", *([PLACE] if update else [])]
        for place in places:
            write_scoreboard(place, boards)
            if finer is not None:
                write_changes(place.with_name(CHANGES), finer, again, found)
        write_page(out / "scoreboard.html", boards, found)
    _print(boards)
    if finer is not None:
        _print_changes(again, found)
    typer.echo(f"scoreboard in {out / 'scoreboard.html'} and {' and '.join(map(str, places))}")
    every = (*boards, *again)
    missed = warn_of_audits({name: why for board in every for name, why in board.missed.items()})
    raise typer.Exit(1 if any(board.failures for board in every) else missed)


def _hoods(settings: list[str]) -> tuple[list[Path], list[str]]:
    """The hood meshes among settings, which have trials of their own, and the other settings."""
    pairs = [text.partition("=") for text in settings]
    hoods = [Path(value.strip().strip("\"'")) for key, _, value in pairs if key.strip() == MESH]
    return hoods, ["".join(pair) for pair in pairs if pair[0].strip() != MESH]


def _progress(text: str) -> None:
    typer.echo(text, err=True)


def _print(boards: list[Board]) -> None:
    from rich.table import Table

    from cosim.compare import marks, number, stated, tally

    screen = console()
    for board in boards:
        table = Table(title=board.group, title_justify="left")
        for name in ("what", "model", "reference", "difference", "verdict", "kind"):
            table.add_column(name)
        for row in board.rows:
            t = row.target
            name = " ".join([t.name, *(f"[{mark}]" for mark in marks(t))])
            gap, model = number(row.difference, 3), number(row.model, 3)
            table.add_row(name, f"{model} {t.unit}", stated(t), gap, row.verdict, t.kind)
        screen.print(table)
        screen.print(", ".join(f"{count} {word}" for word, count in tally(board.rows).items()))
        _print_failures(board)


def _print_changes(again: list[Board], found: list[Change]) -> None:
    from rich.table import Table

    from cosim.compare import number
    from cosim.validation_mesh import tally

    screen = console()
    table = Table(title="mesh: what more quads change", title_justify="left")
    for name in ("what", "model", "finer", "change", "at most", "verdict"):
        table.add_column(name)
    for c in found:
        model = f"{number(c.model, 3)} {c.unit}"
        numbers = (number(value, 3) for value in (c.finer, c.change, c.bound))
        table.add_row(f"{c.name} [{c.case or c.group}]", model, *numbers, c.verdict)
    screen.print(table)
    screen.print(", ".join(f"{count} {word}" for word, count in tally(found).items()))
    for board in again:
        _print_failures(board)


def _print_failures(board: Board) -> None:
    for name, why in board.failures.items():
        console().print(f"failed: {name}: {why}")
