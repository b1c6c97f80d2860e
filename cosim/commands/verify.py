"""`cosim verify`: the proofs of a checkout, run by pytest."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

import cosim
from cosim.commands.options import option
from cosim.errors import InputError
from cosim.extras import is_installed
from cosim.files import check_file

ROOT = Path(cosim.__file__).parents[1]
NOTHING_FOUND = 5
"""pytest's exit code where no test has the name."""


def verify(
    area: Annotated[
        Literal["fe", "fingers", "hoods", "coupling", "robot", "studies"],
        typer.Argument(
            help="fe: the shell solver; fingers: fingers, muscles, devices, OpenSim files; hoods: "
            "in lumped form and of cables; coupling: schemes in time and at rest, FMUs; robot: the "
            "pneumatic robotic finger; studies: signs of lesions, lengths and cuts."
        ),
    ],
    only: Annotated[
        str | None, option("Only the proofs whose name contains this.", metavar="NAME")
    ] = None,
    slow: Annotated[bool, option("Run the slow proofs too.", "--slow")] = False,
    rows: Annotated[
        Path | None, option("Write the rows to this file.", "--json", metavar="FILE")
    ] = None,
) -> None:
    """Solve problems whose answers are known, and print the numbers beside them; exit code 1 where
    one is off.  Needs a checkout: the proofs are tests, in `tests/proofs`."""
    folder = ROOT / "tests" / "proofs" / area
    if not folder.is_dir():
        raise InputError(
            "cosim verify: the proofs are tests, which an installation does not hold: clone "
            "the repository, and in it pip install -e '.[test]'"
        )
    if not is_installed("pytest"):
        raise InputError("cosim verify needs pytest: pip install -e '.[test]' in the checkout")
    words = ["-q", "-n", "0", "--table", "-m", "slow or not slow" if slow else "not slow"]
    if only is not None:
        words += ["-k", "_".join(only.split())]
    if rows is not None:
        check_file(rows)
        words += ["--rows", str(rows.absolute())]
    call = [sys.executable, "-m", "pytest", str(folder), *words]
    done = subprocess.run(call, cwd=ROOT, check=False)
    if done.returncode == NOTHING_FOUND:
        hint = "" if slow else ", or it is slow: --slow"
        raise InputError(f"--only {only}: no proof of {area} has this name{hint}")
    raise typer.Exit(done.returncode)
