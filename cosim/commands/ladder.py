"""`cosim ladder`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from cosim.analyses.ladder import (
    Rung,
    draw_ladder,
    reasons,
    rungs_of,
    side_by_side,
    solve_rungs,
    to_csv,
    to_html,
    to_json,
    to_markdown,
)
from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings, Workers, to
from cosim.commands.terminal import show_table, stages
from cosim.files import check_folder, output_folder
from cosim.processes import process_context
from cosim.results.picture import write_figure

MARK = "ladder.json"


def ladder(
    case: CaseName,
    settings: Settings = None,
    out: Annotated[Path, to("Folder for page and tables.", "FOLDER")] = Path("ladder"),
    workers: Workers = 1,
) -> None:
    """Run one case with every hood, from a fixed split to a shell with fibres, side by side; a hood
    that does not fit the case is a column with its reason.  Exit code 1 where one that fits did not
    converge."""
    if workers > 1:
        process_context()  # imports while the case is read
    checked = load_case(case, settings or ())
    target = out / checked.name
    check_folder(target, MARK)
    names = rungs_of(checked)
    with stages(checked.name, len(names)) as progress:
        progress.say(f"0/{len(names)}, from {names[0]} to {names[-1]}")

        def ended(rung: Rung) -> None:
            how = rung.status if rung.status != "converged" else f"{rung.wall:.1f} s"
            progress.end(f"{rung.name}: {how}")

        rungs = solve_rungs(checked, workers, ended)
    with output_folder(target, MARK) as folder:
        _write(folder, rungs, checked.title)
    _show(rungs, checked.title)
    typer.echo(f"page, tables and picture in {target}")
    raise typer.Exit(1 if any(rung.status == "failed" for rung in rungs) else 0)


def _write(folder: Path, rungs: Sequence[Rung], title: str) -> None:
    for name, text in (
        (MARK, to_json(rungs)),
        ("ladder.csv", to_csv(rungs)),
        ("ladder.md", to_markdown(rungs, title)),
        ("index.html", to_html(rungs, title)),
    ):
        (folder / name).write_text(text, encoding="utf-8")
    write_figure(draw_ladder(rungs, title), folder / "ladder.png", 140)


def _show(rungs: Sequence[Rung], title: str) -> None:
    show_table(side_by_side(rungs, title))
    for line in reasons(rungs):
        typer.echo(line)
