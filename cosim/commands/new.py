"""The command that makes a case of a user's own anatomy: `cosim new`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from cosim.anatomy.case_folder import new_case
from cosim.anatomy.own_case import OwnBones, new_own_case
from cosim.anatomy.people import EXAMPLE, new_people, read_people
from cosim.anatomy.read import UserAnatomy
from cosim.commands.door import door
from cosim.commands.new_page import write_page
from cosim.commands.options import option, pairs_of, quantity, three_numbers, to
from cosim.commands.terminal import say, stages
from cosim.errors import InputError
from cosim.port import Hand
from cosim.schema import units
from cosim.text_tables import read_toml
from meshes.imported.checks import Placing, parse_axes
from meshes.skeleton import BODIES

Unit = Literal["m", "cm", "mm", "um", "in"]
Frame = Literal["body", "hood", "myohand"]
Files = tuple[Path, Path, Path, Path]


Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the case.")]
Out = Annotated[Path | None, to("The folder to write; else NAME.")]


def new_one(
    name: Name,
    hood: Annotated[
        Path | None,
        option("The hood: quads with named sets, .feb, .vtu, .vtp, .vtk, .msh or .inp."),
    ] = None,
    bones: Annotated[
        Files | None,
        option(
            "Four closed surfaces, STL or OBJ; ours if not given.  Without --hood and "
            "--finger they may lie anywhere, and our hood is laid on them.",
            metavar="METACARPAL PROXIMAL MIDDLE DISTAL",
        ),
    ] = None,
    bone: Annotated[
        list[str] | None,
        option("One of the bones that a hood is laid on; repeatable.", metavar="BODY=FILE"),
    ] = None,
    finger_kind: Annotated[
        str, option("Whose bones they are: index, middle, ..., without --hood.")
    ] = "index",
    hand: Annotated[
        Hand, option("Of which hand the bones are; the case is of that hand.")
    ] = "right",
    landmarks: Annotated[
        Path | None,
        option("A CSV file of points on the bones, bone,landmark,x,y,z, which override."),
    ] = None,
    finger: Annotated[
        Path | None,
        option(
            "A MuJoCo model (.xml) of the finger, with the .json that `cosim import` wrote "
            "beside it; our index finger if not given."
        ),
    ] = None,
    unit: Annotated[Unit, option("Unit of the hood's file.")] = "mm",
    bone_unit: Annotated[
        Unit | None,
        option(
            "Unit of the bones' files; if not given the hood's, or without a hood by their lengths."
        ),
    ] = None,
    bone_frame: Annotated[
        Frame, option("body: each bone in its body's frame; hood: all in the hood's; myohand.")
    ] = "body",
    axes: Annotated[
        str, option('Axes of the file that run distal, radial and dorsal, as "z -x y".')
    ] = "x y z",
    origin: Annotated[
        str, option("The MCP's centre in the hood's file, in its unit and axes.")
    ] = "0 0 0",
    posture: Annotated[
        str | None,
        option(
            "Flexion of MCP, PIP and DIP, deg, in which the hood was laid, 0 0 0 if not "
            "given; or of one scan of the bones that our hood is laid on."
        ),
    ] = None,
    thickness: Annotated[
        str | None, option("The sheet's, as \"0.65 mm\"; else the file's, or the base case's.")
    ] = None,
    length_scale: Annotated[float, option("Scale of our index finger.", min=0.1, max=3.0)] = 1.0,
    set_name: Annotated[
        list[str] | None,
        option("What a set, body, joint or tendon is called; repeatable.", metavar="OURS=YOURS"),
    ] = None,
    names: Annotated[
        Path | None,
        option('A TOML file of such names: end_central = "NSET_12"; or myohand, for MyoSuite\'s.'),
    ] = None,
    out: Out = None,
) -> None:
    """Make one case."""
    if hood is None and finger is None and (bones or bone):
        surfaces = _surfaces(bones, bone or ())
        scan = None if posture is None else _posture(posture)
        own = OwnBones(finger_kind, surfaces, hand, bone_unit, landmarks, scan)
        written = new_own_case(name, own, out or Path(name), say)
        page, lacking = write_page(written, say)
        _show(written.case, (*written.report, f"page: {page}{lacking}"), True)
        return
    if bone or landmarks or hand != "right" or finger_kind != "index":
        raise InputError(
            "--bone, --finger-kind, --hand and --landmarks: are of bones that our hood is laid on; "
            "leave out --hood and --finger"
        )
    centre = np.array(three_numbers("--origin", origin, "0 0 0"))
    placing = Placing(unit, parse_axes(axes), centre)
    given = UserAnatomy(
        hood,
        bones or (),
        finger,
        _names(names, set_name or ()),
        placing,
        bone_unit or unit,
        bone_frame,
        _posture(posture or "0 0 0"),
        _thickness(thickness),
        _scale(length_scale, finger),
    )
    case, report = new_case(name, given, out or Path(name))
    _show(case, report, given.hood is not None)


def new_from_table(
    name: Name,
    table: Annotated[
        Path,
        option(
            f"A case for each row, and a study of all: {EXAMPLE}, if wanted metacarpal_mm and "
            "widths (proximal_width_mm); or a folder of bones in a column bones.",
            "--from-table",
            metavar="PEOPLE.csv",
        ),
    ],
    out: Out = None,
) -> None:
    """Make a case for each person of a table."""
    with stages(name) as progress:
        people = new_people(name, read_people(table), out or Path(name), progress.say)
    for line in people.report:
        typer.echo(line)
    typer.echo(f"{len(people.cases)} cases; run them: cosim study {people.study}")


@door({"": new_one, "--from-table": new_from_table})
def new(name: Name) -> None:
    """Make a case of your own hood mesh, bones and finger, or of bones alone with our hood laid on
    them, and say what was found, assumed and dropped; with --from-table a case for each person of a
    table, and their study."""


def _surfaces(bones: Files | None, single: Sequence[str]) -> dict[str, Path]:
    """The bones' files by body."""
    out = dict(zip(BODIES, bones or (), strict=False))
    for body, file in pairs_of("--bone", single, "proximal=p1.stl"):
        if body not in BODIES:
            raise InputError(f"--bone {body}={file}: expected one of {', '.join(BODIES)}")
        if body in out:
            raise InputError(f"--bone {body}={file}: is given twice")
        out[body] = Path(file)
    return {body: out[body] for body in BODIES if body in out}


def _show(case: Path, report: Sequence[str], has_hood: bool) -> None:
    for line in report:
        typer.echo(line)
    pulled = "" if not has_hood else " --set tendons.EDC.activation=0.1"
    typer.echo(f"case in {case}; for example: cosim run {case}{pulled}")


def _posture(text: str) -> dict[str, float]:
    """Read the joint angles (rad) in which the hood was laid."""
    angles = three_numbers("--posture", text, "20 40 11")
    limits = {"MCP": (-30, 90), "PIP": (0, 110), "DIP": (0, 70)}
    for (joint, (low, high)), angle in zip(limits.items(), angles, strict=True):
        if not low <= angle <= high:
            raise InputError(f"--posture: {joint} {angle:g} deg is not from {low} to {high} deg")
    return {joint: math.radians(angle) for joint, angle in zip(limits, angles, strict=True)}


def _thickness(text: str | None) -> float | None:
    if text is None:
        return None
    value = quantity("--thickness", text, units.LENGTH)
    if not 0 < value <= 5e-3:
        raise InputError(f"--thickness {text!r}: expected a thickness up to 5 mm")
    return value


def _scale(scale: float, finger: Path | None) -> float:
    if finger is not None and scale != 1.0:
        raise InputError(
            "--length-scale: is of our finger; one of your own (--finger) has its size"
        )
    return scale


def _names(file: Path | None, settings: Sequence[str]) -> dict[str, str]:
    out = {} if file is None else _table(file)
    return out | dict(pairs_of("--set-name", settings, "end_central=NSET_12"))


def _table(file: Path) -> dict[str, str]:
    packaged = Path(str(resources.files("cases"))) / "data" / f"names_{file.name}.toml"
    if not file.suffix and not file.exists() and packaged.is_file():
        file = packaged
    try:
        values = read_toml(file)
    except InputError as error:
        raise InputError(f"--names {error}") from None
    wrong = [name for name, value in values.items() if not isinstance(value, str)]
    if wrong:
        raise InputError(f'--names {file}: {wrong[0]}: write a name, as {wrong[0]} = "NSET_12"')
    return values
