"""The command of muscle forces from what a finger does: `cosim estimate`."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from cosim.analyses.estimate.feasible import ForceSet, force_set
from cosim.analyses.estimate.files import (
    forward_path,
    muscle_table,
    write_answer,
    write_motion,
    write_tracking,
)
from cosim.analyses.estimate.joint_motion import JointMotion
from cosim.analyses.estimate.markers import read_any_motion
from cosim.analyses.estimate.of_case import (
    EstimateAnswer,
    MotionEstimate,
    Setup,
    for_force,
    for_motion,
    for_torques,
    force_basis,
    forward_run_text,
    parse_force,
    setup,
)
from cosim.analyses.estimate.tracking import Tracking, setup_to_follow, track
from cosim.case.file import load_case
from cosim.commands.options import CaseName, Settings, option, quantities, quantity, to
from cosim.commands.terminal import print_table, say, warn_of_audits
from cosim.errors import InputError
from cosim.files import check_folder, shown_path
from cosim.models.build import Models
from cosim.port import Array
from cosim.schema import units

POWER: dict[str, Literal[1, 2, 3]] = {"linear": 1, "quadratic": 2, "cubic": 3}
"""Powers of the cost, a sum of (tension over weight) to that power."""


def estimate(
    case: CaseName,
    force: Annotated[
        str | None,
        option(
            'Fingertip force on the world along distal, radial and dorsal: "-1 N 0 N -2 N"; '
            '"free" leaves a component open.',
            metavar='"X Y Z"',
        ),
    ] = None,
    torque: Annotated[
        list[str] | None,
        option(
            'Torque of hood and muscles about a joint: MCP="0.1 N*m"; repeatable, joints not '
            "named bear none.",
            metavar="JOINT=TORQUE",
        ),
    ] = None,
    motion: Annotated[
        Path | None,
        option(
            "Joint angles over time, .sto, .mot or .csv (time, PIP_deg, ...), or markers, "
            ".trc; torques by inverse dynamics."
        ),
    ] = None,
    markers: Annotated[
        Path | None,
        option(
            "Of a .trc: where its markers are on the straight finger, .csv (name, body, "
            "distal_mm, radial_mm, dorsal_mm)."
        ),
    ] = None,
    cost: Annotated[
        Literal["linear", "quadratic", "cubic"], option("Power of the tensions in the cost.")
    ] = "quadratic",
    weights: Annotated[
        Literal["pcsa", "F0", "one"], option("What a tension is divided by.")
    ] = "pcsa",
    area: Annotated[
        list[str] | None, option("A muscle's area; repeatable.", metavar='NAME="2 cm**2"')
    ] = None,
    most: Annotated[
        list[str] | None, option("A muscle's greatest force; repeatable.", metavar='NAME="80 N"')
    ] = None,
    samples: Annotated[
        int | None, option("Of a motion: times in equal steps.", min=2, max=100_000)
    ] = None,
    cutoff: Annotated[str | None, option("Of a motion: low-pass filter.", metavar='"6 Hz"')] = None,
    reserve: Annotated[
        str | None,
        option(
            "Of a motion: torque that may be missing where tensions make no more.",
            metavar='"1 N*mm"',
        ),
    ] = None,
    forward: Annotated[
        bool,
        option(
            "Of a motion: move the finger forward along it, with the tensions planned anew "
            "every 10 ms, and write the case that runs under them.",
            "--forward",
        ),
    ] = False,
    settings: Settings = None,
    out: Annotated[Path, to("Folder for the results.")] = Path("estimates"),
) -> None:
    """Estimate muscle tensions from a fingertip force, joint torques or a motion, with the hood of
    a case, and the set of possible fingertip forces (without a target the set alone)."""
    given = [o for o, v in (("--force", force), ("--torque", torque), ("--motion", motion)) if v]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)}: one of them")
    if motion is None and (forward or (samples, cutoff, reserve, markers) != (None,) * 4):
        raise InputError(
            "--samples, --cutoff, --reserve, --markers and --forward belong to --motion"
        )
    if forward and reserve is not None:
        raise InputError("--reserve: leave it out with --forward, which takes what is nearest")
    if motion is not None and (markers is None) == (motion.suffix.lower() == ".trc"):
        raise InputError("--markers belongs to a --motion of markers, a .trc, and that to it")
    started, faults = time.perf_counter(), list[str]()
    checked = load_case(case, settings or ())
    folder = out / checked.name
    check_folder(folder, "estimate.json")
    say("building the models")
    areas, forces = (
        quantities("--area", area, units.AREA),
        quantities("--most", most, units.FORCE),
    )
    highest = None if cutoff is None else quantity("--cutoff", cutoff, units.FREQUENCY)

    def read(path: Path, models: Models) -> JointMotion:
        return read_any_motion(path, markers, models.finger, models.posture, samples, highest, say)

    if motion is not None and forward:
        problem, asked = setup_to_follow(
            checked, weights, POWER[cost], areas, forces, partial(read, motion)
        )
        tracking = track(problem, asked, say)
        write_tracking(folder, problem, tracking, time.perf_counter() - started)
        _show_tracking(problem, tracking, folder)
        faults = tracking.faults()
        if tracking.stopped is not None:
            reached, whole = tracking.step_time[-1], asked.time[-1] - asked.time[0]
            typer.echo(f"{reached:.4g} of {whole:.4g} s are kept in {folder}", err=True)
            raise tracking.stopped
    else:
        problem = setup(checked, weights, POWER[cost], areas, forces)
    if motion is not None and not forward:
        asked = read(motion, problem.models)
        lacking = 0.0 if reserve is None else quantity("--reserve", reserve, units.TORQUE)
        estimated = for_motion(problem, asked, say, lacking)
        write_motion(folder, problem, estimated, time.perf_counter() - started)
        _show_motion(problem, estimated)
        if estimated.stopped is not None:
            kept = f"{len(estimated.tension)} of {len(asked.time)} times"
            typer.echo(f"{kept} are kept in {folder}", err=True)
            raise estimated.stopped
    elif motion is None:
        answer = _answer(problem, force, torque)
        feasible = _forces(problem, answer)
        write_answer(folder, problem, answer, feasible, time.perf_counter() - started)
        if answer is not None:
            _show(problem, answer)
    typer.echo(f"results in {folder}")
    if code := warn_of_audits({checked.name: faults}):
        raise typer.Exit(code)


def _answer(s: Setup, force: str | None, torque: list[str] | None) -> EstimateAnswer | None:
    """The tensions for a force or for torques; None where neither is asked for."""
    if force is not None:
        return for_force(s, parse_force(force), say)
    if torque:
        return for_torques(s, quantities("--torque", torque, units.TORQUE), say)
    return None


def _forces(s: Setup, answer: EstimateAnswer | None) -> ForceSet | None:
    """The set of forces, where the target is one or there is none; said why where there is none."""
    if answer is not None and answer.demand.unit != "N":
        return None
    try:
        if answer is None:
            demand, at = force_basis(s)
            tension = s.capacity.least
        else:
            demand, at, tension = answer.demand, answer.estimate.at, answer.estimate.tension
        forces = force_set(demand, tension, at, s.bounds)
    except InputError as error:
        if answer is None:
            raise
        typer.echo(f"no picture of the feasible forces: {error}", err=True)
        return None
    if not s.case.hood.shares_fixed:
        typer.echo("feasible forces: linearised at the tensions in this posture", err=True)
    return forces


def _show(s: Setup, answer: EstimateAnswer) -> None:
    table = muscle_table(s.capacity, answer.estimate.tension)
    rows = [
        (
            str(r.muscle),
            *(f"{x:.4g}" for x in (r.tension_N, r.greatest_N, r.activation, r.stress_N_per_cm2)),
        )
        for r in table.itertuples()
    ]
    header = ("muscle", "tension, N", "greatest, N", "activation", "stress, N/cm2")
    print_table("Tensions", header, rows)
    result = answer.estimate
    typer.echo(forward_run_text(answer))
    typer.echo(
        f"{result.rounds} hood solves; equations missed by {result.gap:.1e}, optimality by "
        f"{result.optimum.miss:.1e} (relative)"
    )


def _show_motion(s: Setup, result: MotionEstimate) -> None:
    _show_range(s, result.tension)
    lacking = 1e3 * float(abs(result.torque - result.required_torque).max())
    typer.echo(
        f"{result.rounds} hood solves; conditions missed by at most {result.worst:.1e}, "
        f"torques lack at most {lacking:.3g} N mm"
    )


def _show_range(s: Setup, tension: Array) -> None:
    ends = zip(s.capacity.names, tension.min(axis=0), tension.max(axis=0), strict=True)
    rows = [(name, f"{low:.4g}", f"{high:.4g}") for name, low, high in ends]
    print_table("Tensions over the motion, N", ("muscle", "least", "most"), rows)


def _show_tracking(s: Setup, tracking: Tracking, folder: Path) -> None:
    _show_range(s, tracking.tension)
    off = np.degrees(np.abs(tracking.angle - tracking.wanted).max(axis=0))
    rows = [
        (joint, f"{rms:.3g}", f"{most:.3g}")
        for joint, rms, most in zip(
            s.models.finger.joints, np.degrees(tracking.error), off, strict=True
        )
    ]
    print_table("Run forward: the angles miss the motion by, deg", ("joint", "RMS", "most"), rows)
    typer.echo(
        f"torques miss their plans by at most {1e3 * tracking.lacking:.3g} N mm; run it with: "
        f"cosim run {shown_path(forward_path(folder))}"
    )
