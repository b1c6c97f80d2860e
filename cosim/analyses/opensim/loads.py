"""Reactions of rigid bodies in FEBio as external loads for OpenSim (Jadelis, thesis, 2.1.3).

One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.febio.log import RigidReactions, read_reactions
from rigid.opensim.components import components
from rigid.opensim.external_loads import BodyLoad, write_external_loads
from rigid.opensim.layout import read_model
from rigid.opensim.skeleton import read_skeleton

THESIS_AXES = "-x -z -y"  # OpenSim's x, y, z in FEBio's axes (thesis, table 1)
THESIS_DURATION = 2.0  # s (thesis, 2.1.3)
MOST_DURATION = 1e4  # s
STEPS = 200  # rows of a mean's table, less one
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}


@dataclass(frozen=True)
class Handover:
    """What of a log goes to OpenSim, and how."""

    bodies: Mapping[int, str]
    """OpenSim's names of FEBio's rigid bodies."""
    points: Mapping[str, Array]
    """(3,) m of each, in OpenSim's frame of the body: where the force acts."""
    axes: str = THESIS_AXES
    sign: float = 1.0
    """-1.0: the load on the bone, which is the opposite of FEBio's reaction."""
    mean: tuple[float, float] | None = None
    """Times of FEBio between which the mean is taken; None: the loads over time."""
    duration: float = THESIS_DURATION
    """s, for which a mean is repeated."""
    force_unit: str = "N"
    length_unit: str = "mm"
    moments: bool = True
    """False: forces alone, as in the thesis."""
    columns: tuple[str, ...] = ()


def write_loads(
    logs: Sequence[Path], handover: Handover, mot: Path
) -> tuple[list[Path], list[str]]:
    """Write the .mot and the .xml; their paths, and what there is to know of them, a line each.

    Raises InputError."""
    if not (handover.mean is None or 0 < handover.duration <= MOST_DURATION):
        raise InputError(f"--duration {handover.duration:g}: expected up to {MOST_DURATION:g} s")
    reactions = read_reactions(logs, handover.columns)
    time, loads = loads_of(reactions, handover, ", ".join(map(str, logs)))
    paths = write_external_loads(mot, time, loads)
    notes = [f"{len(reactions.time)} times, {reactions.time[0]:g} to {reactions.time[-1]:g}"]
    if left_out := sorted(set(reactions.bodies) - set(handover.bodies)):
        notes.append(f"left out: body {', '.join(map(str, left_out))}, for which there is no name")
    if reactions.moment is None:
        notes.append("the log holds no moments: forces alone are handed over")
    elif not handover.moments:
        notes.append("the log's moments are left out")
    else:
        notes.append(
            "the moments are about FEBio's centres of mass; they are right only if the points "
            "given are these places of the bones"
        )
    notes.append(
        "the loads are the opposite of FEBio's reactions: what tissue and contact do to the bodies"
        if handover.sign < 0
        else "the loads are FEBio's reactions as they stand: what holds the bodies. What tissue "
        "and contact do to them is the opposite (--opposite)"
    )
    return list(paths), notes


def loads_of(
    reactions: RigidReactions, handover: Handover, where: str = "the log"
) -> tuple[Array, list[BodyLoad]]:
    """Times (n,) s and the loads in OpenSim's axes and SI units.  Raises InputError."""
    if missing := sorted(set(handover.bodies) - set(reactions.bodies)):
        raise InputError(
            f"{where}: has no body {', '.join(map(str, missing))}; it has "
            f"{', '.join(map(str, reactions.bodies))}"
        )
    force = FORCE_UNITS[handover.force_unit] * handover.sign
    moment = force * LENGTH_UNITS[handover.length_unit]
    turn = axes_of(handover.axes)
    time, out = reactions.time, []
    for number, body in handover.bodies.items():
        k = reactions.bodies.index(number)
        parts = [force * reactions.force[:, k] @ turn.T]
        if reactions.moment is not None and handover.moments:
            parts.append(moment * reactions.moment[:, k] @ turn.T)
        if handover.mean is not None:
            parts = [np.tile(mean(reactions.time, p, handover.mean), (STEPS + 1, 1)) for p in parts]
            time = np.linspace(0.0, handover.duration, STEPS + 1)
        out.append(BodyLoad(body, parts[0], handover.points[body], *parts[1:]))
    return time, out


def mean(time: Array, values: Array, window: tuple[float, float]) -> Array:
    """Means (m,) over time of (n, m) values, linear between times (n,), within the window.

    Raises InputError for a window that is empty or not within the times."""
    first, last = window
    if not time[0] <= first <= last <= time[-1]:
        raise InputError(
            f"--mean {first:g} {last:g}: expected two times that rise, from {time[0]:g} to "
            f"{time[-1]:g}, which the log spans"
        )
    inside = time[(time > first) & (time < last)]
    at = np.array([first, *inside, last])
    course = np.column_stack([np.interp(at, time, column) for column in values.T])
    if first == last:
        return course[0]
    middle = (course[1:] + course[:-1]) / 2
    return np.asarray(np.diff(at) @ middle / (last - first))


def axes_of(text: str) -> Array:
    """The matrix (3, 3) whose rows are OpenSim's x, y, z in FEBio's axes, of a text like "-x -z
    -y".

    Raises InputError for axes that do not name each of x, y, z once, or that mirror: a moment has
    no image in a mirror that a force's rule would give."""
    words = text.split()
    if len(words) != 3 or sorted(word.lstrip("+-") for word in words) != ["x", "y", "z"]:
        raise InputError(
            f"--axes {text!r}: write OpenSim's x, y and z in FEBio's axes, each of x, y, z once, "
            f'for example "{THESIS_AXES}"'
        )
    out = np.zeros((3, 3))
    for i, word in enumerate(words):
        out[i, "xyz".index(word[-1])] = -1.0 if word.startswith("-") else 1.0
    if np.linalg.det(out) < 0:
        raise InputError(
            f"--axes {text!r}: these axes mirror the hand (left for right); change one sign, or "
            "two of the axes"
        )
    return out


def mass_centres(model: Path) -> dict[str, Array]:
    """The centre of mass (3,) m of each body of an .osim by its name, in the body's frame.  Raises
    InputError."""
    tag, _, _ = read_model(model)
    bodies = read_skeleton(components(tag)).bodies
    return {path.rpartition("/")[2]: body.centre for path, body in bodies.items()}
