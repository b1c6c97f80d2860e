"""`cosim bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.commands.febio import bench_fe, bench_febio
from cosim.commands.finger import bench_fingers, bench_robotic_finger
from cosim.commands.run import Settings, load_cases
from cosim.commands.study import bench_studies
from cosim.commands.terminal import exit_on_error, stages


def bench(
    case: Annotated[
        str,
        typer.Argument(
            help="Case file or packaged case; or fe, febio, fingers, opensim, pulls, robot, "
            "studies."
        ),
    ],
    settings: Settings = None,
    models: Annotated[
        Path | None, typer.Option(help="Of febio: folder of the models with published figures.")
    ] = None,
    spacing: Annotated[
        str, typer.Option(help="Of febio: of the grids for the distances of the bones.")
    ] = "0.25 mm",
) -> None:
    """Time a coupled run against one assembly and one factorisation of its own tangent; with fe the
    shell solver's iteration against its floor; with febio published models beside FEBio; with
    fingers the static solve of the finger alone; with opensim its motion beside OpenSim's; with
    pulls the linear solves that drawing a tendon takes, beside what they once were; with robot the
    control loop of the robotic finger beside its paper's; with studies what it costs to hand out
    runs, and two workers beside one."""
    if case == "fe":
        bench_fe()
        return
    if case in ("fingers", "opensim"):
        with exit_on_error():
            bench_fingers(beside_opensim=case == "opensim")
        return
    if case == "pulls":
        from cosim.commands.bench_pulls import bench_pulls

        with exit_on_error():
            bench_pulls()
        return
    if case == "robot":
        bench_robotic_finger()
        return
    if case == "studies":
        with exit_on_error():
            bench_studies()
        return
    if case == "febio":
        with exit_on_error():
            bench_febio(models, spacing)
        return
    (checked,) = load_cases([case], settings)
    from cosim.commands.bench_case import bench_case

    with exit_on_error(), stages(checked.name) as told:
        found = bench_case(checked, told.say)
    with exit_on_error():
        for name, value in found.items():
            typer.echo(f"{name:<20} {value:.4g}")
