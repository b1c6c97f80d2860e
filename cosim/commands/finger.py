"""The commands about fingers: `cosim moment-arms` and `mjcf`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.analyses.mjcf_hood import (
    Arm,
    HoodFile,
    HoodName,
    attach,
    check_names,
    hood_file,
    hood_muscles,
    judge_attached,
    path_arms,
)
from cosim.analyses.moment_arms import (
    ACTION,
    by_posture,
    compare_published,
    draw,
    published_arms,
    sweep,
)
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.commands.options import CaseName, Settings
from cosim.commands.terminal import exit_on_error, print_table, stages
from cosim.errors import InputError
from cosim.files import check_file, output_file
from cosim.fingers.kinds import joint_ranges
from cosim.models.build import OPENING, build, mjcf_of, narrow_limits, tensions
from cosim.results.picture import write_figure
from cosim.scoring.names import FingerName, check_present, match_names, read_names
from cosim.scoring.plausible import against_published
from rigid.mjcf.attach import write_attached
from rigid.mjcf.hood import STEP
from rigid.mjcf.read import part_names

ATTACHED = "network_edc"
"""The case whose hood is attached where none is named."""

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


def moment_arms(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for table and plot.")] = Path(
        "moment_arms"
    ),
    steps: Annotated[int, typer.Option(min=2, max=1000, help="Postures of each joint.")] = 9,
) -> None:
    """Moment arms of all tendons while each joint passes its range, beside published ones."""
    with exit_on_error():
        checked = load_case(case, settings or ())
        check_file(out / "moment_arms.csv")
        with stages(checked.name) as progress:
            progress.say("building the models")
            models = build(checked)
            tension, _ = tensions(checked, models)
            ranges = joint_ranges(models.finger)
            table, lost = sweep(models, tension, ranges, steps, progress.say)
        known = published_arms(checked.finger.kind)
        compared = None if known.empty else compare_published(models, known)
        _write(out, table, compared, draw(table, checked.title, known, models.posture))
        _show(table)
        if compared is not None:
            _show_published(compared)
        for reason in lost:
            typer.echo(f"left out, the hood found no equilibrium: {reason}", err=True)
        typer.echo(f"table and plot in {out}")


def _write(
    out: Path, table: pandas.DataFrame, compared: pandas.DataFrame | None, figure: Figure
) -> None:
    with output_file(out / "moment_arms.csv") as path:
        table.round(4).to_csv(path, index=False)
    if compared is not None:
        with output_file(out / "published.csv") as path:
            compared.round(4).to_csv(path, index=False)
    with output_file(out / "moment_arms.png") as path:
        write_figure(figure, path, 130)


def _show(table: pandas.DataFrame) -> None:
    """A line for each tendon and joint that it acts on, a column for each posture."""
    for joint, of_joint in table.groupby("joint", sort=False):
        wide = of_joint.pivot(index="tendon", columns="angle_deg", values="arm_mm")
        wide = wide.loc[
            [t for t in dict.fromkeys(of_joint.tendon) if wide.loc[t].abs().max() >= 1e3 * ACTION]
        ]
        rows = [
            (str(tendon), *(f"{arm:.2f}" if isfinite(arm) else "-" for arm in arms))
            for tendon, arms in zip(wide.index, wide.to_numpy(), strict=True)
        ]
        print_table("", (f"{joint} deg, arm mm", *(f"{angle:.0f}" for angle in wide.columns)), rows)


def _show_published(compared: pandas.DataFrame) -> None:
    """A table for each joint: the model's arms and each source's, a column for each posture."""
    for joint, wide in by_posture(compared).items():
        rows = [
            (str(tendon), str(source), *(f"{arm:.1f}" if isfinite(arm) else "-" for arm in arms))
            for (tendon, source), arms in zip(wide.index, wide.to_numpy(), strict=True)
        ]
        print_table("", (f"{joint}, arm mm at MCP/PIP/DIP", "", *map(str, wide.columns)), rows)


def mjcf(
    case: Annotated[
        str | None,
        typer.Argument(
            metavar="CASE",
            help=f"Case file, or a packaged case; with --attach {ATTACHED} where none is given.",
        ),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The file to write; finger.xml, or HAND_FINGER_hood.xml."),
    ] = None,
    hood: Annotated[
        HoodName | None,
        typer.Option(help="Write the case's hood too, which must be of this kind."),
    ] = None,
    attach_to: Annotated[
        Path | None,
        typer.Option(
            "--attach",
            metavar="HAND.xml",
            help="Put the case's hood on a finger of this MuJoCo hand, in place of the fixed paths "
            "of its extensors.",
        ),
    ] = None,
    finger: Annotated[
        FingerName | None,
        typer.Option(
            help="With --attach: the finger of the hand that gets the hood; index where none is "
            "named."
        ),
    ] = None,
    names: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help='With --attach: a TOML file of lines EDC = "EDCI", which part of the hand is '
            "which.",
        ),
    ] = None,
) -> None:
    """Write a case's finger as a model for plain MuJoCo: bones with their shapes, joints with
    passive torques and limits, its own tendons with an actuator each, whose control is the tension,
    and the keyframe "posture" with the resting tensions; without what holds the tip.

    With --hood the hood's tendons are in it too, as junctions on slides and elastic tendons, and
    their errors over postures and loads are told: "network" of a case with a network or two bands,
    "reduced" of one that `cosim reduce` wrote, as it does of a sheet or a net of cables.

    With --attach the hood goes onto a finger of a hand model of yours (MyoSuite's, for example):
    muscles keep their paths up to the metacarpal and their actuators. `cosim score` reads the
    result."""
    with exit_on_error():
        if attach_to is not None:
            checked = load_case(case or ATTACHED, settings or ())
            _attach(checked, hood or "network", attach_to, finger or "index", names, out)
            return
        for option, given in (("--finger", finger), ("--names", names)):
            if given is not None:
                raise InputError(
                    f"{option}: is of a hand that gets the hood; name the hand with --attach "
                    f"HAND.xml, or leave {option} out"
                )
        if case is None:
            raise InputError("name a case, or a hand with --attach HAND.xml")
        checked = load_case(case, settings or ())
        out = out or Path("finger.xml")
        check_file(out)
        made = None
        if hood is None:
            text = mjcf_of(checked)
        else:
            with stages(checked.name) as progress:
                made = hood_file(checked, hood, progress.say)
            text = made.text
            show_hood_errors(made)
        with output_file(out) as path:
            path.write_text(text + "\n", encoding="utf-8")
        typer.echo(
            f"finger in {out}, without the tip's support{'' if made else ' and the hood'}; begin "
            'in its keyframe "posture"; its first lines say what differs from ours'
        )
        for words in narrow_limits(checked):
            typer.echo(f"{words}; to open them: --set '{OPENING}'")


def _attach(
    case: Case, hood: HoodName, hand: Path, finger: FingerName, names: Path | None, out: Path | None
) -> None:
    """Write a hand with the case's hood on one finger, and tell what was changed."""
    out = out or Path(f"{hand.stem}_{finger}_hood.xml")
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
    check_names(case, hood, hand, finger, matched)
    with stages(case.name) as progress:
        made = hood_file(case, hood, progress.say, states=0)
        progress.say("putting the hood in place of the model's paths")
        attached = attach(case, finger, hand, matched, made)
        doubts = _signs(hand, finger, matched, made)
        with output_file(out) as path:
            path.write_text(write_attached(attached.root, out) + "\n", encoding="utf-8")
        progress.say("running the written file beside the hood")
        errors, arms = judge_attached(case, hood, hand, out, attached)
    show_hood_errors(replace(made, errors=errors))
    _show_arms(case, arms)
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
