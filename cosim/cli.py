"""The command line.  Exit codes: 0 done, 1 a solve did not converge, 2 the input is at fault, 3 a
run missed its audit, 130 the user stopped it."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from typing import Annotated

import typer

from cosim.commands.bench import bench
from cosim.commands.estimate import estimate
from cosim.commands.febio import export, solve
from cosim.commands.finger import mjcf, moment_arms
from cosim.commands.fmu import fmu
from cosim.commands.hood import show_hood
from cosim.commands.identify import identify, sensitivity
from cosim.commands.ladder import ladder
from cosim.commands.lesion import lesion
from cosim.commands.new import new
from cosim.commands.opensim import import_model, opensim, sto
from cosim.commands.reduce import reduce
from cosim.commands.report import report
from cosim.commands.reproduce import reproduce
from cosim.commands.run import check, resume, run, schema
from cosim.commands.study import status, study
from cosim.commands.validate import validate
from cosim.commands.verify import info, verify
from cosim.commands.view import mesh, view
from cosim.processes import prepare_process
from cosim.version import __version__

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Co-simulation of a finger's extensor hood and its bones.",
)
app.add_typer(verify, name="verify")
app.add_typer(opensim, name="opensim")
app.command()(info)
app.command()(solve)
app.command()(export)
app.command()(moment_arms)
app.command()(mjcf)
app.command("import")(import_model)
app.command()(new)
app.command()(sto)
app.command()(fmu)
app.command()(report)
app.command()(validate)
app.command()(sensitivity)
app.command()(identify)
app.command()(study)
app.command()(status)
app.command()(reproduce)
app.command("hood")(show_hood)
app.command()(estimate)
app.command()(ladder)
app.command()(lesion)
app.command()(reduce)
app.command()(run)
app.command()(resume)
app.command()(check)
app.command()(schema)
app.command()(view)
app.command()(bench)
app.command()(mesh)


def main() -> None:
    """The program `cosim`."""
    prepare_process()
    for stream in (sys.stdout, sys.stderr):
        # A Windows pipe has a code page of 256 characters: what it lacks is shown as "?".
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    app(prog_name="cosim")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cosim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    pass
