"""`cosim import`: files of OpenSim, and FEBio's logs for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from cosim.analyses.opensim.loads import Handover, mass_centres, write_loads
from cosim.analyses.opensim.tensions import read_tensions, tensions_at, write_case
from cosim.commands.door import door
from cosim.commands.options import one_of, option, pairs_of, quantity, three_numbers, to
from cosim.errors import InputError
from cosim.port import Array
from cosim.schema import units
from rigid.opensim.losses import report
from rigid.opensim.osim import import_osim, write_import

ForceUnit = Literal["N", "mN", "kN"]
LengthUnit = Literal["m", "cm", "mm", "um"]
TOLERANCES = (5e-4, 1e-3, 2e-3, 5e-3)
"""m, with which an import says how many muscles more would come."""


def import_model(
    files: list[Path],
    out: Path,
    tolerance: Annotated[
        str, option("By how much the length of an imported muscle may be off OpenSim's.")
    ] = "0.1 mm",
    only: Annotated[
        list[str] | None,
        option(
            "Take this body, with what carries it, or this muscle; with * and ?.  Repeat it.",
            metavar="NAME",
        ),
    ] = None,
) -> None:
    """Turn an OpenSim model into MJCF."""
    model = one_of(files, "a .xml")
    off = quantity("--tolerance", tolerance, units.LENGTH)
    imported = import_osim(model, off, only or ())
    written = write_import(imported, out)
    for line in report(imported.losses):
        typer.echo(line)
    paths = ", ".join(str(path) for path in written)
    muscles = f"{len(imported.muscles)} of {imported.path_actuators} muscles"
    typer.echo(f"{len(imported.coordinates)} coordinates and {muscles} in {paths}")
    more = [
        f"{count} with {1e3 * size:g} mm"
        for size in TOLERANCES
        if (count := sum(off < each <= size for each in imported.beyond.values()))
    ]
    if more:
        typer.echo(f"more muscles come with a wider --tolerance: {', '.join(more)}")
    if imported.path_actuators and not imported.muscles:
        raise InputError(f"{model}: {muscles} imported; {written[2]} says why of each")


def tensions(
    files: list[Path],
    out: Path,
    extends: Annotated[
        str, option("The case that the tensions are laid over: a file or packaged case.")
    ] = "base/index_finger.toml",
    time: Annotated[float | None, option("Time of the tensions, s; else the table's last.")] = None,
    column: Annotated[
        list[str] | None,
        option(
            "Column of a tendon's force, if it has not the tendon's name; repeatable.",
            metavar="TENDON=COLUMN",
        ),
    ] = None,
    over_time: Annotated[
        bool, option("The columns as tensions over time, of a case in motion.", "--over-time")
    ] = False,
) -> None:
    """Write a case with the muscle forces of an OpenSim table as tendon tensions."""
    forces = one_of(files, "a .toml")
    if over_time and time is not None:
        raise InputError("--time and --over-time: one of the two")
    table = read_tensions(forces, dict(_pairs(column or (), "--column", "EDC=EDC1")))
    case = write_case(forces, table, out, extends, time, over_time)
    for tendon, tension in tensions_at(table, time).items():
        what = "over time" if over_time else f"{tension:.6g} N"
        typer.echo(f"{tendon}: {what}, column {table.column[tendon]}")
    if table.left_out:
        typer.echo(f"left out: {', '.join(table.left_out)}")
    for tendon, pull in case.tendons.items():
        if tendon not in table.column and (pull.force or pull.excursion or pull.actuation):
            typer.echo(f"{tendon}: pulls as in {extends}")
    typer.echo(f"case in {out}; for example: cosim run {out}")


def loads(
    files: list[Path],
    out: Path,
    body: Annotated[
        list[str],
        option(
            "FEBio's number of a rigid body and OpenSim's name of it; repeatable.",
            metavar="NUMBER=NAME",
        ),
    ],
    model: Annotated[
        Path | None,
        option(
            "Where the forces act: at the centres of mass of this model's bodies.",
            metavar="MODEL.osim",
        ),
    ] = None,
    point: Annotated[
        list[str] | None,
        option(
            "Or at this point, m in OpenSim's frame of the body; repeatable.",
            metavar='NAME="X Y Z"',
        ),
    ] = None,
    axes: Annotated[
        str, option("OpenSim's x, y, z in FEBio's axes; the thesis's if not given.")
    ] = "-x -z -y",
    mean: Annotated[
        tuple[float, float] | None,
        option("The mean between two times of FEBio, repeated for --duration.", metavar="FROM TO"),
    ] = None,
    duration: Annotated[float, option("Time for which a mean is repeated, s.")] = 2.0,
    opposite: Annotated[
        bool,
        option(
            "The opposite of FEBio's reactions: what tissue and contact do to the bodies.",
            "--opposite",
        ),
    ] = False,
    no_moments: Annotated[bool, option("Forces alone, as in the thesis.", "--no-moments")] = False,
    force_unit: Annotated[ForceUnit, option("FEBio's.")] = "N",
    length_unit: Annotated[LengthUnit, option("FEBio's, of moments.")] = "mm",
    columns: Annotated[str, option('Of records that are named otherwise: "Fx;Fy;Fz".')] = "",
) -> None:
    """Write the reactions of rigid bodies that FEBio logged as OpenSim's external loads."""
    names = _bodies(body)
    handover = Handover(
        names,
        _points(list(names.values()), model, point or ()),
        axes,
        -1.0 if opposite else 1.0,
        mean,
        duration,
        force_unit,
        length_unit,
        not no_moments,
        tuple(word.strip() for word in columns.split(";") if word.strip()),
    )
    paths, notes = write_loads(files, handover, out)
    for note in notes:
        typer.echo(note)
    typer.echo(f"wrote {' and '.join(map(str, paths))}")


@door({".xml": import_model, ".toml": tensions, ".mot": loads})
def import_file(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="A model of OpenSim 2 to 4 (.osim); a table of muscle forces (.sto, .mot); or "
            "FEBio's log, or data files of rigid_body_data.",
        ),
    ],
    out: Annotated[Path | None, to("The file to write; its ending says what is read.")] = None,
) -> None:
    """Take in a file of OpenSim, or what FEBio found for OpenSim; the ending of --out says which.

    An .xml: turn an OpenSim model into MJCF and list what was dropped or changed; the numbers of
    its muscles and joint limits go into a JSON file beside.  Ends with code 2 where the model has
    muscles and none could be imported.

    A .toml: write a case with the muscle forces of an OpenSim table as tendon tensions.

    A .mot, with an .xml beside it: write the reactions of rigid bodies that FEBio logged as
    OpenSim's external loads."""


def _pairs(texts: Sequence[str], option: str, example: str) -> list[tuple[str, str]]:
    """Both sides of each `A=B`.  Raises InputError for other texts and for one that comes twice."""
    pairs = pairs_of(option, texts, example)
    for sides in ([left for left, _ in pairs], [right for _, right in pairs]):
        if twice := [side for side in sides if sides.count(side) > 1]:
            raise InputError(f"{option}: {twice[0]!r} comes twice; name it once")
    return pairs


def _bodies(texts: Sequence[str]) -> dict[int, str]:
    out = {}
    for number, name in _pairs(texts, "--body", "2=proximal"):
        if not (number.isascii() and number.isdigit() and len(number) < 10):
            raise InputError(f"--body {number}={name}: write FEBio's number of the body first")
        out[int(number)] = name
    return out


def _points(names: Sequence[str], model: Path | None, texts: Sequence[str]) -> dict[str, Array]:
    """The point (3,) m at which each body's force acts."""
    centres = {} if model is None else mass_centres(model)
    stated = {}
    for name, text in pairs_of("--point", texts, 'proximal="0.02 0 0"'):
        if name not in names:
            raise InputError(f"--point {name}={text}: {name!r} is no body named with --body")
        stated[name] = np.array(three_numbers(f"--point {name}", text, "0.02 0 0"))
    for name in names:
        if model is not None and name not in centres:
            raise InputError(f"{model}: has no body {name!r}; it has {', '.join(centres)}")
        if name not in stated and name not in centres:
            raise InputError(
                f"{name}: say where its force acts: --model MODEL.osim, whose centres of mass are "
                f'taken, or --point {name}="X Y Z"'
            )
    return {name: stated[name] if name in stated else centres[name] for name in names}
