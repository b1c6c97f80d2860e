"""`cosim moment-arms`."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.analyses.moment_arms import (
    ACTION,
    by_posture,
    compare_published,
    draw,
    published_arms,
    sweep,
)
from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings, option, to
from cosim.commands.terminal import print_table, stages
from cosim.files import check_file, output_file
from cosim.fingers.kinds import joint_ranges
from cosim.models.build import build, tensions
from cosim.results.picture import write_figure

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


def moment_arms(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, to("Folder for table and plot.")] = Path("moment_arms"),
    steps: Annotated[int, option("Postures of each joint.", min=2, max=1000)] = 9,
) -> None:
    """Moment arms of all tendons while each joint passes its range, beside published ones."""
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
