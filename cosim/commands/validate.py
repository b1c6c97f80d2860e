"""The command of the validations: `cosim validate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from cosim.analyses.mesh_series import MeshSeries, mesh_factors
from cosim.commands.door import door
from cosim.commands.options import option, to
from cosim.commands.terminal import console, print_table, say, show_table, warn_of_audits
from cosim.commands.validate_curves import check_update, validate_curves
from cosim.files import check_file
from cosim.validation.mesh import USUAL, finenesses, mesh_series, mesh_versions, tally
from cosim.validation.page import IN_TERMINAL, mesh_table, rows_of, tally_text, write_page
from cosim.validation.records import write_record
from cosim.validation.run import Board, by_kind, choose_groups, run_validation
from cosim.validation.scoreboard import (
    JudgedBoard,
    differences,
    join_uncertainty,
    read_rows,
    write_scoreboard,
)
from cosim.validation.trial import TrialGroup
from cosim.validation.uncertainty import FILE, UncertaintyFile, read_committed, sentence
from cosim.validation.uncertainty import update as update_uncertainty
from cosim.validation.versions import (
    Key,
    Version,
    form_values,
    form_versions,
    input_spreads,
    input_versions,
    read_inputs,
    run_versions,
)

OUT = Path("runs/validation")
PLACE = Path("cases/scoreboard.json")
"""Where the committed scoreboard is, of a checkout; the uncertainties are beside it."""
MESH = "hood.mesh"


def validate_trials(
    only: str | None = None,
    out: Path = OUT,
    settings: list[str] | None = None,
    published: Annotated[
        Path | None, option("The published hood's file (FEBio's test suite).", metavar="MI29.FEB")
    ] = None,
    meshes: Annotated[
        int | None,
        option(
            "Repeat on so many meshes of the family: order, limit and u_num of every number.",
            min=2,
            max=5,
        ),
    ] = None,
    samples: Annotated[
        int | None,
        option(
            "Repeat at so many samples of the inputs (study input_uncertainty): u_input.",
            min=5,
            max=10000,
        ),
    ] = None,
    forms: Annotated[
        bool,
        option("Repeat with every hood of the ladder and with friction: their spread.", "--forms"),
    ] = False,
    workers: int = 2,
    listed: bool = False,
    update: bool = False,
    against: Annotated[
        Path | None,
        option(
            "Say what differs from an earlier board; exit code 1 where anything does.",
            metavar="SCOREBOARD.JSON",
        ),
    ] = None,
) -> None:
    """The board of all compared numbers."""
    hoods, other_settings = _hoods(settings or [])
    if update:
        check_update(only, other_settings)
    groups = choose_groups(only, hoods[-1] if hoods else published)
    if listed:
        _list(groups)
        return
    before = None if against is None else read_rows(against)
    asked = _Asked(meshes or 0, samples or 0, forms, tuple(other_settings), workers)
    places = [out / PLACE.name, *([PLACE] if update else [])]
    boards, known = _judge(groups, asked, out, places)
    judged_boards = join_uncertainty(boards, known.by_key())
    changed = []
    if before is not None:
        changed = differences(before, read_rows(places[0]), part=only is not None)
    _print(judged_boards)
    if meshes:
        _print_meshes({row.key: row.meshes for row in known.rows if row.meshes is not None})
    for name, why in known.failed.items() if asked.anything else ():
        console().print(f"no result: {name}: {why}")
    typer.echo(f"scoreboard in {out / 'scoreboard.html'} and {' and '.join(map(str, places))}")
    if before is not None:
        typer.echo(f"{len(changed) or 'no'} differences from {against}")
        for line in changed:
            typer.echo(f"  {line}")
    missed = warn_of_audits(
        {name: why for board in boards for name, why in board.audit_misses.items()}
    )
    failed = any(board.failures for board in boards)
    raise typer.Exit(1 if failed or changed else missed)


class _Asked(NamedTuple):
    """What of the numbers' uncertainty is to be found anew."""

    meshes: int
    samples: int
    forms: bool
    settings: tuple[str, ...]
    workers: int

    @property
    def anything(self) -> bool:
        """Whether anything is."""
        return bool(self.meshes or self.samples or self.forms)

    def uncertainty(
        self, groups: list[TrialGroup], boards: list[Board], place: Path
    ) -> UncertaintyFile:
        """What is known of the boards' numbers: what the package says, and over it what is found
        anew, part by part, each written to `place` as it is there.  Variants have no versions.
        Raises InputError."""
        known = update_uncertainty(read_committed(), boards)
        shipped = [group for group in groups if not group.variant]
        if self.meshes:
            versions = mesh_versions(self.meshes, self.settings)
            found, failed = self._run(shipped, versions, "other mesh ")
            series = mesh_series(boards, found, finenesses(shipped, self.settings))
            factors = mesh_factors(self.meshes, USUAL)
            known = update_uncertainty(known, boards, {"meshes": series}, failed, meshes=factors)
            write_record(place, known)
        if self.samples:
            versions = input_versions(read_inputs(self.samples), self.settings)
            found, failed = self._run(shipped, versions)
            spreads = input_spreads(found)
            known = update_uncertainty(
                known, boards, {"inputs": spreads}, failed, samples=self.samples
            )
            write_record(place, known)
        if self.forms:
            found, failed = self._run(shipped, form_versions(self.settings))
            known = update_uncertainty(known, boards, {"forms": form_values(found)}, failed)
        return known

    def _run(
        self, groups: list[TrialGroup], versions: Mapping[str, Version], prefix: str = ""
    ) -> tuple[dict[str, list[Board]], dict[str, str]]:
        """The boards by version, and why trials have no result there."""
        found = run_versions(groups, versions, self.workers, say)
        failed = {
            f"{trial}, {prefix}{name}": why
            for name, boards in found.items()
            for board in boards
            for trial, why in board.failures.items()
        }
        return found, failed


def _judge(
    groups: list[TrialGroup], asked: _Asked, out: Path, places: Sequence[Path]
) -> tuple[list[Board], UncertaintyFile]:
    """Run the groups, and write their runs and page to `out`, and the board to each of the places.
    Raises InputError."""
    check_file(places[0])
    boards = run_validation(groups, out, asked.settings, asked.workers, say)
    known = asked.uncertainty(groups, boards, out / FILE)
    judged_boards = join_uncertainty(boards, known.by_key())
    for place in places:
        write_scoreboard(place, judged_boards)
        write_record(place.with_name(FILE), known)
    write_page(out / "scoreboard.html", judged_boards)
    return boards, known


def _hoods(settings: list[str]) -> tuple[list[Path], list[str]]:
    """The hood meshes among settings, which have trials of their own, and the other settings."""
    pairs = [text.partition("=") for text in settings]
    hoods = [Path(value.strip().strip("\"'")) for key, _, value in pairs if key.strip() == MESH]
    return hoods, ["".join(pair) for pair in pairs if pair[0].strip() != MESH]


def _list(groups: list[TrialGroup]) -> None:
    for group in groups:
        typer.echo(group.listed)
        for trial in group.trials:
            typer.echo(f"  {trial.name}")


def _print(boards: list[JudgedBoard]) -> None:
    screen = console()
    for board in by_kind([b.board for b in boards]):
        _print_tallies(board)
    for judged_board in boards:
        board = judged_board.board
        _print_tallies(board)
        if judged_board.known:
            for answer, counts in judged_board.judgements().items():
                screen.print(f"  {answer}, beside u_val: {tally_text(counts)}")
        for line in board.hand_lines:
            screen.print(f"  {line}")
        print_table("", IN_TERMINAL, rows_of(judged_board).only(*IN_TERMINAL).words())
        for row, budget in judged_board.changed_verdicts():
            words = f"{row.verdict}, but {budget.judgement}"
            screen.print(f"  {row.target.name}: {words}: {sentence(row, budget)}")
        for name, why in board.failures.items():
            console().print(f"failed: {name}: {why}")


def _print_tallies(board: Board) -> None:
    variant = " (variant)" if board.variant else ""
    console().print(f"\n{board.group}{variant}: {board.headline}")
    for answer, counts in board.tallies().items():
        console().print(f"  {answer}: {tally_text(counts) or 'nothing counts'}")


def _print_meshes(series: Mapping[Key, MeshSeries]) -> None:
    show_table(mesh_table(series))
    console().print(tally_text(tally(series)))


@door({"": validate_trials, "--curves": validate_curves})
def validate(
    only: Annotated[
        str | None,
        option(
            "Only the group of this name, or the trials whose name contains it.", metavar="NAME"
        ),
    ] = None,
    out: Annotated[Path, to("Folder for the runs and the page.")] = OUT,
    settings: Annotated[
        list[str] | None,
        option(
            "Replace a value of every trial; hood.mesh=MI29.FEB is --published.",
            "--set",
            metavar="KEY=VALUE",
        ),
    ] = None,
    workers: Annotated[int, option("Processes.", min=1, max=64)] = 2,
    listed: Annotated[bool, option("Name the trials by group, and run none.", "--list")] = False,
    update: Annotated[
        bool,
        option(
            f"Write {PLACE}, the committed scoreboard, as well, with --curves the curves'.",
            "--update",
        ),
    ] = False,
) -> None:
    """Run the validations; print the tally by kind of reference, the skill over null models, and
    every compared number, misses first."""
