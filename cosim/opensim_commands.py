"""The command of OpenSim's models: `cosim import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.terminal import told


def import_model(
    model: Annotated[Path, typer.Argument(metavar="MODEL.osim", help="A model of OpenSim 4.")],
    out: Annotated[
        Path | None, typer.Option(help="The MJCF to write; else MODEL.xml in this folder.")
    ] = None,
) -> None:
    """Turn an OpenSim model into MJCF and list what was dropped or changed; the numbers of its
    muscles and joint limits go into a JSON file beside.  Ends with code 2 where the model has
    muscles and none could be imported."""
    with told():
        from cosim.port import InputError
        from rigid.opensim.losses import report
        from rigid.opensim.osim import import_osim, write_import

        imported = import_osim(model)
        written = write_import(imported, out or Path(f"{model.stem}.xml"))
        for line in report(imported.losses):
            typer.echo(line)
        made = ", ".join(str(path) for path in written)
        muscles = f"{len(imported.muscles)} of {imported.path_actuators} muscles"
        typer.echo(f"{len(imported.coordinates)} coordinates and {muscles} in {made}")
        if imported.path_actuators and not imported.muscles:
            raise InputError(f"{model}: {muscles} imported; {written[2]} says why of each")


def sto(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the tables; else that of the run.")
    ] = None,
) -> None:
    """Write a run's motions and forces as .sto tables, which OpenSim plots."""
    with told():
        from cosim.sto import write_tables

        for path in write_tables(run, out or run):
            typer.echo(f"wrote {path}")
