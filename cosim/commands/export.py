"""`cosim export`: a case for other programs, or for another case."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Annotated, Literal

import typer

from cosim.anatomy.write import FORMATS, OWN, check_ending, write_hood
from cosim.case.file import load_case
from cosim.commands.door import door
from cosim.commands.febio import export as feb
from cosim.commands.mjcf import attach, mjcf
from cosim.commands.options import Settings, option, to
from cosim.commands.reduce import reduce
from cosim.commands.terminal import stages
from cosim.files import check_file, shown_path
from cosim.fingers.kinds import skeleton_of
from cosim.fmu_export.write import write_fmu
from cosim.models.build import hood_mesh


def fmu(
    case: str,
    out: Path,
    part: Annotated[Literal["hood", "finger", "coupled"], option("What goes into it.")] = "hood",
    fmi: Annotated[int, option("Version of the standard.", min=2, max=3)] = 2,
    tangent: Annotated[bool, option("Also exchange the derivatives of the hood's load.")] = True,
    settings: Settings = None,
) -> None:
    """A case's hood, finger or coupled finger, at rest or in motion, as an FMU."""
    checked = load_case(case, settings or ())
    check_file(out)
    with stages(checked.name) as progress:
        progress.say(f"building and describing its {part}")
        write_fmu(checked, part, fmi, out, tangent=tangent)
    typer.echo(f"{part} in {out}, FMI {fmi}")


def mesh(
    case: str,
    out: Path,
    settings: Settings = None,
    mesh: Annotated[bool, option("Of a .feb the hood's mesh alone.", "--mesh")] = False,
) -> None:
    """The hood mesh of a case, in the format of the file's ending."""
    check_ending(out)
    checked = load_case(case, settings or ())
    check_file(out)
    typer.echo(f"{checked.name}: laying out the hood", err=True)
    generated = hood_mesh(checked)
    finger = checked.native_finger()
    lost = write_hood(generated, skeleton_of(finger), out, finger.side())
    typer.echo(f"{len(generated.quads)} quads in {shown_path(out)}")
    if lost:
        typer.echo(f"not in the file: {lost}")
    if any(generated.rest_posture.values()):
        angles = ", ".join(f"{j} {degrees(a):g}" for j, a in generated.rest_posture.items())
        typer.echo(f"laid at {angles} deg (cosim new --posture)")


@door(
    {
        ".feb": feb,
        ".xml": mjcf,
        ".fmu": fmu,
        ".toml": reduce,
        **dict.fromkeys((OWN, *sorted(FORMATS.keys() - {".feb"})), mesh),
        "--mesh": mesh,
        "--attach": attach,
    }
)
def export(
    case: Annotated[
        str | None, typer.Argument(metavar="CASE", help="Case file, or a packaged case.")
    ] = None,
    settings: Settings = None,
    out: Annotated[Path | None, to("The file to write; its ending says what.")] = None,
) -> None:
    """Write a case, or what is made of it, for other programs; the ending of --out says what.

    A .feb: the shell hood at its posture, under its tendons' tensions, for FEBio.  A .json for
    hood.mesh.kind = "file", with its sets .inp, .msh or .vtu (or with --mesh .feb), which
    `cosim new` reads, or as .stl its surface: the hood's mesh.

    An .xml: the finger as a model for plain MuJoCo: bones with their shapes, joints with passive
    torques and limits, its own tendons with an actuator each, whose control is the tension, and the
    keyframe "posture" with the resting tensions; without what holds the tip.  With --hood the
    hood's tendons are in it too, as junctions on slides and elastic tendons, and their errors over
    postures and loads are told: "network" of a case with a network or two bands, "reduced" of one
    that was written as .toml here, as it is of a sheet or a net of cables.  With --attach the hood
    goes onto a finger of a hand model of yours (MyoSuite's, for example): muscles keep their paths
    up to the metacarpal and their actuators, and `cosim score` reads the result.

    An .fmu: the hood, finger or coupled finger, at rest or in motion; it holds the whole case and
    runs where this package is installed, at the same version.

    A .toml: a case whose network hood is fitted to what this one's shell or cables do, over a grid
    of postures and loads, for use in real time; the error is that of postures held out."""
