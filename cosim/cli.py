"""The command line: which commands there are, and where.

Exit codes: 0 done, 1 a solve did not converge, 2 the input is at fault, 3 a run missed its audit,
130 the user stopped it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from cosim.processes import prepare_process
from cosim.version import __version__

COMMANDS = {
    "Run cases": {
        "run": ("run.run", "Run cases; each leaves its results in a folder."),
        "resume": ("run.resume", "Go on with a motion that was stopped or killed."),
        "check": ("run.check", "Check cases and run nothing."),
        "report": ("report.report", "Show runs, beside measured values, in one HTML page."),
        "view": ("view.view", "Show a run's hood in a window."),
        "lesion": ("lesion.lesion", "A case without its lesion and with it, side by side."),
        "ladder": ("ladder.ladder", "A case with every hood, from a fixed split to a shell."),
        "hood": ("hood.show_hood", "A hood over postures, beside literature."),
        "moment-arms": ("finger.moment_arms", "Moment arms over each joint's range."),
    },
    "Make cases": {
        "new": ("new.new", "A case of your own hood mesh, bones and finger."),
        "mesh": ("view.mesh", "Write the hood mesh of a case."),
        "schema": ("run.schema", "JSON Schema of a case file, for editors."),
        "reduce": ("reduce.reduce", "Fit a network hood to a case's shell or cables."),
    },
    "Estimate, fit and study": {
        "estimate": ("estimate.estimate", "Muscle tensions from forces, torques or a motion."),
        "identify": ("identify.identify", "Fit parameters to measured values."),
        "sensitivity": ("identify.sensitivity", "How results answer to what a case assumes."),
        "study": ("study.study", "Solve a case for many values of its parameters."),
        "status": ("study.status", "How far the studies of a store are."),
    },
    "Exchange": {
        "fmu": ("fmu.fmu", "Write hood, finger or both as an FMU."),
        "opensim": ("opensim.opensim", "Muscle forces from OpenSim, reactions to it."),
        "sto": ("opensim.sto", "Write a run as .sto tables for OpenSim."),
        "import": ("opensim.import_model", "Turn an OpenSim model into MJCF."),
        "mjcf": ("finger.mjcf", "Write the MuJoCo model of a case's finger."),
        "solve": ("febio.solve", "Solve a FEBio model."),
        "export": ("febio.export", "Write the shell hood of a case as a FEBio model."),
    },
    "Trust and understand": {
        "validate": ("validate.validate", "Compare with what was measured and published."),
        "verify": ("verify.verify", "Solve problems whose answers are known."),
        "reproduce": ("reproduce.reproduce", "Compute a paper's figures and tables anew."),
        "bench": ("bench.bench", "Time the solvers, as ratios."),
        "glossary": ("glossary.glossary", "The words and axes of cases and results."),
        "info": ("verify.info", "What is installed and in use."),
    },
}
"""By heading and name: the function in `cosim.commands`, imported when it is first needed, and its
line in the help."""
HELP = {"help_option_names": ["-h", "--help"]}


class _Lazily(TyperGroup):
    """The commands, each imported when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for commands in COMMANDS.values() for name in commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in self.commands:
            places = {n: place for named in COMMANDS.values() for n, (place, _) in named.items()}
            if cmd_name not in places:
                names: Any = dict.fromkeys(places)  # of which the nearest are told
                self.commands.update(names)
                return None
            self.commands[cmd_name] = _load(cmd_name, places[cmd_name])
        return self.commands[cmd_name]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for heading, named in COMMANDS.items():
            with formatter.section(heading):
                formatter.write_dl([(name, line) for name, (_, line) in named.items()])


def _load(name: str, place: str) -> Any:
    module, _, function = place.partition(".")
    found = getattr(import_module(f"cosim.commands.{module}"), function)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(
            add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
        )
        alone.command(name, context_settings=HELP)(found)
        found = alone
    command = get_command(found)
    command.name = name
    return command


app = typer.Typer(
    cls=_Lazily,
    context_settings=HELP,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Co-simulation of a finger's extensor hood and its bones.",
)


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
