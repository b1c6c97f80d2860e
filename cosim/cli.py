"""The command line: which commands there are, and where.

Exit codes: 0 done, 1 a solve did not converge, 2 the input is at fault, 3 a run missed its audit,
130 the user stopped it, 143 SIGTERM, 129 SIGHUP (the terminal was closed).
"""

from __future__ import annotations

import gc
import sys
import warnings
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any, NamedTuple, TextIO

import typer
from typer.core import TyperGroup
from typer.main import get_command

from cosim.errors import ReadingWarning
from cosim.files import clear_again
from cosim.interrupts import (
    exit_code,
    exit_on_request,
    ignore_requests,
    interrupt_on_request,
    is_asked,
)
from cosim.processes import prepare_process
from cosim.version import __version__


class Command(NamedTuple):
    """A command: the function in `cosim.commands`, imported when it is first needed, its line in
    the list of commands, and an example of its use."""

    place: str
    line: str
    example: str


COMMANDS = {
    "Run cases": {
        "run": Command(
            "run.run",
            "Run cases, each into a folder; go on with a motion.",
            "cosim run isometric_edc --set 'tendons.EDC.tension=\"5 N\"'",
        ),
        "check": Command("run.check", "Check cases and run nothing.", "cosim check isometric_edc"),
        "show": Command(
            "show.show",
            "A run as a window, page, film or tables.",
            "cosim show runs/isometric_edc -o edc.html",
        ),
        "ui": Command(
            "ui.ui",
            "Work on a case in a page of your browser.",
            "cosim ui isometric_edc",
        ),
        "lesion": Command(
            "lesion.lesion",
            "A case without its lesion and with it, side by side.",
            "cosim lesion lesion_mallet",
        ),
        "ladder": Command(
            "ladder.ladder",
            "A case with every hood, from a fixed split to a shell.",
            "cosim ladder pulley_edc -o ladder",
        ),
        "moment-arms": Command(
            "moment_arms.moment_arms",
            "Moment arms over each joint's range.",
            "cosim moment-arms split_edc",
        ),
    },
    "Make cases": {
        "new": Command(
            "new.new",
            "A case of your own hood mesh, bones and finger.",
            'cosim new mine --hood hood.inp --finger finger.xml --posture "20 40 11"',
        ),
        "list": Command(
            "listing.list_things", "Cases, studies, trials and kinds.", "cosim list materials"
        ),
        "explain": Command(
            "listing.explain",
            "What a key of a case file or a word means; schemas.",
            "cosim explain hood.regions",
        ),
    },
    "Estimate, fit and study": {
        "estimate": Command(
            "estimate.estimate",
            "Muscle tensions from forces, torques or a motion.",
            'cosim estimate split_edc --force "-1 N free -2 N"',
        ),
        "identify": Command(
            "identify.identify",
            "Fit parameters to measured values.",
            "cosim identify lengths_edc --targets rows.csv --out found.toml",
        ),
        "study": Command(
            "study.study",
            "A case for many values of its parameters; sensitivities.",
            "cosim study network_saltelli --workers 2",
        ),
    },
    "Exchange": {
        "export": Command(
            "export.export",
            "A case for FEBio, MuJoCo, FMI or meshers; a reduced hood.",
            "cosim export network_edc --hood network -o finger.xml",
        ),
        "import": Command(
            "imports.import_file",
            "OpenSim's models and forces; FEBio's reactions for it.",
            "cosim import model.osim -o finger.xml",
        ),
        "solve": Command("febio.solve", "Solve a FEBio model.", "cosim solve model.feb"),
    },
    "Trust and understand": {
        "validate": Command(
            "validate.validate",
            "Compare with what was measured and published.",
            "cosim validate --only lengths",
        ),
        "score": Command(
            "score.score",
            "Judge hand models by what was measured.",
            "cosim score myohand.xml hand.osim isometric_edc -o scores",
        ),
        "converge": Command(
            "converge.converge",
            "A case on coarser and finer meshes: order, limit, error.",
            "cosim converge isometric_edc",
        ),
        "verify": Command(
            "verify.verify", "Solve problems whose answers are known.", "cosim verify fe"
        ),
        "reproduce": Command(
            "reproduce.reproduce",
            "Compute a paper's figures and tables anew.",
            "cosim reproduce networks",
        ),
        "info": Command(
            "info.info", "What is installed and in use; compile ahead.", "cosim info --warm"
        ),
    },
}
"""The commands by heading and name."""
MOVED = {
    "report": "show RUN... -o report.html",
    "view": "show RUN",
    "film": "show RUN -o film.gif",
    "sto": "show RUN -o run.sto",
    "mjcf": "export CASE -o finger.xml",
    "fmu": "export CASE -o hood.fmu",
    "mesh": "export CASE -o hood.inp",
    "reduce": "export CASE -o reduced.toml",
    "opensim": "import FORCES.sto -o case.toml, or of FEBio's logs: import LOG... -o loads.mot",
    "schema": "explain --schema",
    "sensitivity": "study --sensitivity CASE",
    "status": "study --status STORE",
    "resume": "run --resume RUN",
    "warm": "info --warm",
}
"""What is typed now for commands that there were."""
HELP = {"help_option_names": ["-h", "--help"]}


class _Lazily(TyperGroup):
    """The commands, each imported when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for commands in COMMANDS.values() for name in commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in self.commands:
            every = {name: c for named in COMMANDS.values() for name, c in named.items()}
            if cmd_name in MOVED:
                ctx.fail(f"No such command {cmd_name!r}. It is now: cosim {MOVED[cmd_name]}")
            if cmd_name not in every:
                names: Any = dict.fromkeys(every)  # of which the nearest are named
                self.commands.update(names)
                return None
            self.commands[cmd_name] = _load(cmd_name, every[cmd_name])
        return self.commands[cmd_name]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for heading, named in COMMANDS.items():
            with formatter.section(heading):
                formatter.write_dl([(name, command.line) for name, command in named.items()])


def _load(name: str, listed: Command) -> Any:
    from cosim.commands.terminal import exit_on_error

    module, _, function_name = listed.place.partition(".")
    function = getattr(import_module(f"cosim.commands.{module}"), function_name)
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(name, context_settings=HELP)(exit_on_error()(function))
    command = get_command(alone)
    command.name = name
    command.epilog = f"\b\nExample:\n  {listed.example}"  # \b: as it is, not wrapped
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
    exit_on_request()
    prepare_process()
    warnings.showwarning = _show_warning
    for stream in (sys.stdout, sys.stderr):
        # A Windows pipe has a code page of 256 characters: what it lacks is shown as "?".
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        interrupt_on_request()
        app(prog_name="cosim")
    except (Exception, SystemExit, KeyboardInterrupt) as ended:
        # a library may make an error of a KeyboardInterrupt
        ignore_requests()
        if not is_asked():
            raise
        clear_again()
        raise SystemExit(exit_code(getattr(ended, "code", None))) from None
    finally:
        gc.freeze()  # a last search for garbage among all objects takes half a second


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning about a file of the user's as one line; of libraries as Python shows them."""
    if issubclass(category, ReadingWarning):
        typer.echo(f"cosim: WARNING: {message}", err=True)
    else:
        text = warnings.formatwarning(message, category, filename, lineno, line)
        typer.echo(text, err=True, nl=False)


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
