"""A finger and its hood for MuJoCo, and a hood on a hand: what `cosim export` writes as .xml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from cosim.analyses.mjcf_hood import (
    Arm,
    HoodFile,
    HoodName,
    check_names,
    hood_file,
    hood_muscles,
    judge_attached,
    path_arms,
)
from cosim.analyses.mjcf_hood import attach as attach_hood
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.commands.options import Settings, option
from cosim.commands.terminal import print_table, stages
from cosim.errors import InputError
from cosim.files import check_file, write_text
from cosim.models.build import OPENING, mjcf_of, narrow_limits
from cosim.scoring.names import FingerName, check_present, match_names, read_names
from cosim.scoring.plausible import against_published
from rigid.mjcf.attach import write_attached
from rigid.mjcf.hood import STEP
from rigid.mjcf.read import part_names

ATTACHED = "network_edc"
"""The case whose hood is attached where none is named."""
HoodKind = Annotated[
    HoodName | None, option("Write the case's hood too, which must be of this kind.")
]


def mjcf(case: str, out: Path, settings: Settings = None, hood: HoodKind = None) -> None:
    """A case's finger, and with `hood` its hood, for plain MuJoCo."""
    checked = load_case(case, settings or ())
    check_file(out)
    made = None
    if hood is None:
        text = mjcf_of(checked)
    else:
        with stages(checked.name) as progress:
            made = hood_file(checked, hood, progress.say)
        text = made.text
        show_hood_errors(made)
    write_text(out, text + "\n")
    typer.echo(
        f"finger in {out}, without the tip's support{'' if made else ' and the hood'}; begin "
        'in its keyframe "posture"; its first lines say what differs from ours'
    )
    for words in narrow_limits(checked):
        typer.echo(f"{words}; to open them: --set '{OPENING}'")


def attach(
    out: Path,
    hand: Annotated[
        Path,
        option(
            "Put the case's hood on a finger of this MuJoCo hand, in place of the fixed paths "
            f"of its extensors; {ATTACHED}'s where no CASE is named.",
            "--attach",
            metavar="HAND.xml",
        ),
    ],
    case: str = ATTACHED,
    settings: Settings = None,
    hood: HoodKind = "network",
    finger: Annotated[FingerName, option("The finger of the hand that gets the hood.")] = "index",
    names: Annotated[
        Path | None,
        option(
            'A TOML file of lines EDC = "EDCI", which part of the hand is which.', metavar="FILE"
        ),
    ] = None,
) -> None:
    """Write a hand with the case's hood on one finger, and tell what was changed."""
    checked, kind = load_case(case, settings or ()), hood or "network"
    if out.suffix.lower() != ".xml":
        raise InputError(f"{out}: a hand is written to a file ending in .xml; name one")
    if out.exists() and hand.exists() and out.samefile(hand):
        raise InputError(
            f"--out {out}: is the hand itself, which stays as it is; name another file"
        )
    check_file(out)
    parts, given = part_names(hand), None
    if names is not None:
        given = read_names(names)
        check_present(parts, given, hand, names)
    matched = match_names(parts, finger, given).names
    check_names(checked, kind, hand, finger, matched)
    with stages(checked.name) as progress:
        made = hood_file(checked, kind, progress.say, states=0)
        progress.say("putting the hood in place of the model's paths")
        attached = attach_hood(checked, finger, hand, matched, made)
        doubts = _signs(hand, finger, matched, made)
        write_text(out, write_attached(attached.root, out) + "\n")
        progress.say("running the written file beside the hood")
        errors, arms = judge_attached(checked, kind, hand, out, attached)
    show_hood_errors(replace(made, errors=errors))
    _show_arms(checked, arms)
    for line in (*attached.told, *(f"doubt: {doubt}" for doubt in doubts)):
        typer.echo(line)
    typer.echo(f"hand in {out}; its meshes stay where they are. Judge it: cosim score {out}")


def _signs(hand: Path, finger: FingerName, names: Mapping[str, str], made: HoodFile) -> list[str]:
    """What to doubt of the muscles that get the hood, as `cosim score` does.  Raises InputError for
    one that everywhere bends a joint the wrong way."""
    found = list(against_published(finger, path_arms(hand, names, hood_muscles(made, names))))
    wrong = [d for d in found if d.always and d.joint != "MCP_abduction"]
    if wrong:
        raise InputError(
            f"{hand}: {'; '.join(d.words for d in wrong)}. A hood on such a path is on another "
            "muscle: say which is which, --names FILE"
        )
    return [d.words for d in found]


def _show_arms(case: Case, arms: Sequence[Arm]) -> None:
    """A line for each muscle: its arms on its own path, and through the hood."""
    joints = tuple(dict.fromkeys(arm.joint for arm in arms))
    rows: dict[str, list[str]] = {}
    for arm in arms:
        cell = f"{1e3 * arm.path:.1f} > {1e3 * arm.hood:.1f}"
        rows.setdefault(arm.muscle, [arm.muscle]).append(cell)
    print_table(
        f"Arms in the posture of {case.name}, mm, before > with the hood, each muscle alone at 1 N",
        ("", *(joint.replace("_", " ") for joint in joints)),
        [tuple(row) for row in rows.values()],
    )


def show_hood_errors(made: HoodFile) -> None:
    """A line for each quantity, and what was written."""
    rows = [(e.quantity, f"{100 * e.median:.2g} %", f"{100 * e.most:.2g} %") for e in made.errors]
    print_table("The file's hood less the case's", ("error of", "median", "most"), rows)
    for line in (*made.doubts, *made.notes):
        typer.echo(line)
    typer.echo(
        f"the case's finger with its hood, alone in plain MuJoCo: {made.rate:.3g} steps a second "
        f"of one core, measured in steps of {1e3 * STEP:g} ms, whatever timestep the file states"
    )
