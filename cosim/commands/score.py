"""The command that judges hand models: `cosim score`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from cosim.commands.options import Workers, option, quantity, to
from cosim.commands.terminal import console, show_table, stages
from cosim.errors import InputError
from cosim.files import check_file
from cosim.schema import units
from cosim.scoring.names import FingerName, read_names
from cosim.scoring.page import answer, skill_table
from cosim.scoring.references import update_references
from cosim.scoring.run import HandScore
from cosim.scoring.scores import PAGE, Scores, score_models

MOST_LINES = 8
"""Losses of a model that the terminal lists; the page has all."""
REFERENCES = Path("cases/data/score_references.csv")


def score(
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL...",
            help="MuJoCo (.xml) or OpenSim (.osim) hands, cases, or shipped names.",
        ),
    ],
    out: Annotated[Path, to("Folder for score.html and .csv, or the page's file.")] = Path(
        "scores"
    ),
    names: Annotated[
        list[str] | None,
        option(
            'A TOML file of lines EDC = "EDCI": which part is which; of one model of several '
            "MODEL=FILE.  Repeatable.",
            metavar="FILE",
        ),
    ] = None,
    finger: Annotated[
        FingerName | None,
        option("The finger to judge; else the index finger, where the model has one."),
    ] = None,
    tolerance: Annotated[
        str, option("By how much a muscle's length may be off OpenSim's, of .osim files.")
    ] = "0.1 mm",
    workers: Workers = 2,
    update: Annotated[
        bool, option(f"Write the numbers into {REFERENCES} of a checkout as well.", "--update")
    ] = False,
) -> None:
    """Judge hand models by what was measured: moment arms, forces of a clamped fingertip, shares of
    the flexion moment, slips and strains.  Prints what reading a model lost, its skill over no
    answer, its place among reference models (An's normative paths, MyoHand, a fixed split, our
    hoods), and what to doubt; writes one page and a table.  Ends with code 2 where a model has no
    finger or no muscle that can be found."""
    if update and not REFERENCES.is_file():
        raise InputError(f"--update: there is no {REFERENCES} here; run it in a checkout")
    check_file(out if out.suffix == ".html" else out / PAGE)
    off = quantity("--tolerance", tolerance, units.LENGTH)
    with stages("score") as progress:
        scores = score_models(models, _names(names or ()), finger, off, workers, progress.say)
    page, table = scores.write(out)
    if update:
        update_references(REFERENCES, list(scores.judged_values()))
    _show(scores)
    typer.echo(f"page in {page}, table in {table}")
    for why in scores.refused.values():
        typer.echo(f"cosim: not judged: {why}", err=True)
    raise typer.Exit(2 if scores.refused else 0)


def _names(texts: Sequence[str]) -> dict[str, dict[str, str]]:
    """The mappings by the model's name, that of all under the empty text.  Raises InputError."""
    out = {}
    for text in texts:
        model, equals, path = text.rpartition("=")
        out[Path(model).stem if equals else ""] = read_names(Path(path))
    return out


def _show(scores: Scores) -> None:
    for hand in scores.hands:
        _show_losses(hand)
    for hand in scores.hands:
        typer.echo(answer(hand))
    show_table(skill_table(scores.hands, "/"))
    typer.echo("* the same data once more, not counted; – cannot be judged:")
    reasons: dict[str, list[str]] = {}
    for hand in scores.hands:
        for g in hand.groups:
            for why in (g.why_not, *dict.fromkeys(g.unjudged.values())):
                if why:
                    place = f"{g.group.name}: {why.removeprefix('cannot be judged: ')}"
                    reasons.setdefault(place, []).append(hand.model.name)
    for why, who in reasons.items():
        typer.echo(f"  {why} [{', '.join(who) if len(who) < len(scores.hands) else 'all'}]")
    for hand in scores.hands:
        for doubt in hand.doubts:
            typer.echo(f"doubt: {hand.model.name}: {doubt}")
        for trial, why in hand.failures.items():
            typer.echo(f"failed: {hand.model.name}: {trial}: {why}")


def _show_losses(hand: HandScore) -> None:
    """What reading a foreign model lost, and which muscles were found under which names."""
    model = hand.model
    if model.matched is None:
        return
    lines = model.losses_of_finger
    rest = len(model.lost) - len(lines)
    typer.echo(f"{model.name} ({model.source}, {model.finger} finger), lost or changed in reading:")
    for line in lines[:MOST_LINES]:
        console().print(f"  {line}")
    more = len(lines) - MOST_LINES
    tail = [f"{more} more of the finger"] * (more > 0) + [f"{rest} of other parts"] * (rest > 0)
    if tail:
        typer.echo(f"  and {' and '.join(tail)}, on the page")
    found = ", ".join(f"{ours} = {theirs}" for ours, theirs in model.matched.tendons.items())
    typer.echo(f"  muscles: {found}")
    if model.unread:
        typer.echo(f"  FOUND, BUT DROPPED (see above and the page): {', '.join(model.unread)}")
    if unfound := [m for m in model.missing if m not in model.unread]:
        typer.echo(f"  NO MUSCLE FOUND for {', '.join(unfound)}; name them by --names FILE")
