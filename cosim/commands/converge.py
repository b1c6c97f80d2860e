"""`cosim converge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.analyses.converge import (
    MOST_MESHES,
    MeshStudy,
    add_errors,
    keep_errors,
    meshes_of,
    solve_meshes,
    table_of,
    to_csv,
    to_json,
)
from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings, Workers, option, to
from cosim.commands.terminal import show_table, stages, warn_of_audits
from cosim.files import check_file, check_folder, output_folder
from cosim.processes import process_context

MARK = "converge.json"


def converge(
    case: CaseName,
    settings: Settings = None,
    meshes: Annotated[int, option("How many; an order takes three.", min=2, max=MOST_MESHES)] = 3,
    out: Annotated[Path, to("Folder for the tables.", "FOLDER")] = Path("converge"),
    workers: Workers = 1,
    add_to: Annotated[
        Path | None, option("Also add the errors to this JSON file, for a package.", metavar="FILE")
    ] = None,
) -> None:
    """Run a case on coarser and finer meshes of one family: order of convergence, limit, and the
    error and grid convergence index (GCI) of its first numbers.  `cosim run` shows them from then
    on beside the same case's numbers.  Exit code 1 where a mesh has no result."""
    if workers > 1:
        process_context()  # imports while the case is read
    checked = load_case(case, settings or ())
    target = out / checked.name
    check_folder(target, MARK)
    if add_to is not None:
        check_file(add_to)
    sizes = [each.hood.generated_quads for each in meshes_of(checked, meshes)]
    with stages(checked.name, meshes) as progress:
        progress.say(f"0/{meshes}, {sizes[0]} to {sizes[-1]} quads")
        study = solve_meshes(checked, meshes, workers, progress.end)
    with output_folder(target, MARK) as folder:
        (folder / MARK).write_text(to_json(study), encoding="utf-8")
        (folder / "converge.csv").write_text(to_csv(study), encoding="utf-8")
    missed = warn_of_audits(study.missed)
    if not (missed or study.reasons):
        keep_errors(study)
        if add_to is not None:
            add_errors(study, add_to)
    _show(study)
    typer.echo(f"tables in {target}")
    raise typer.Exit(1 if study.reasons else missed)


def _show(study: MeshStudy) -> None:
    show_table(table_of(study))
    verdicts = [n.series.verdict for n in study.numbers]
    counts = (f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts))
    typer.echo(
        f"{', '.join(counts)}\n"
        "within: changes over the meshes by at most 1 % (strains 0.2 points); converges: by more, "
        "with an observed order; beyond: neither\n"
        "*: the case's own mesh; error: from the limit, else the range of all meshes; GCI: 1.25 "
        "times that, or three times the range"
    )
    for name, why in study.reasons.items():
        typer.echo(f"{name}: no result: {why}")
