"""A run at each of its stored states or times, of a fresh result and of one that was read alike."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.hoods.kinds import COLOURS
from cosim.hoods.view import FAMILIES, STRAIN, HoodField
from cosim.mesh_file import read_mesh_file
from cosim.port import Array, Hand
from cosim.results.arrays import Arrays
from cosim.results.strokes import carry

MOST_FRAMES = 51
"""Frames of a motion that stored no shapes of its hood."""
DATA_SET = re.compile(r'<DataSet timestep="([^"]+)" part="0" file="(hood_frames/\d+\.vtu)"/>')
"""A line of hood.pvd, as the program writes it."""


@dataclass(frozen=True)
class Frame:
    """A run at one of its stored states or times."""

    label: str
    """The time with its unit, or the state's name."""
    step: int
    """Its place along the axis `state` or `time` of the arrays."""
    time: float | None
    """s; None of a state at rest."""
    angles: Array
    """(nq,) rad."""
    force: Array
    """(3,) N of the fingertip on the world."""
    hood: HoodField | None
    """The hood with its fields; None of a hood without a shape, or where it was not stored."""


def frames_of(
    arrays: Arrays, hood: HoodField | None, shapes: Sequence[tuple[float, HoodField]]
) -> tuple[Frame, ...]:
    """Return the frames of a run from its arrays, its hood at the end, and the hood at the stored
    times of a motion: every state at rest, the stored times of a motion, else MOST_FRAMES times
    evenly spread over its steps."""
    angles, force = (arrays.variables[name].values for name in ("angle", "tip_force"))
    if "time" not in arrays.dims:
        names = [str(name) for name in arrays.coordinates["state"].values]
        last = len(names) - 1
        hoods = [hood if k == last else _hood_of_state(arrays, hood, k) for k in range(last + 1)]
        every = zip(names, angles, force, hoods, strict=True)
        return tuple(Frame(name, k, None, *rest) for k, (name, *rest) in enumerate(every))
    times = arrays.coordinates["time"].values
    if shapes:
        steps = [int(np.abs(times - time).argmin()) for time, _ in shapes]
        stored: list[HoodField | None] = [shape for _, shape in shapes]
    else:
        count = min(len(times), MOST_FRAMES)
        steps = np.unique(np.linspace(0, len(times) - 1, count).round().astype(int)).tolist()
        stored = [*[None] * (len(steps) - 1), hood]
    return tuple(
        Frame(_label(arrays, float(times[k])), k, float(times[k]), angles[k], force[k], shape)
        for k, shape in zip(steps, stored, strict=True)
    )


def _label(arrays: Arrays, time: float) -> str:
    """The time, and what gave way or began last before it."""
    if "event_time" not in arrays.variables:
        return f"{time:.4g} s"
    events = zip(
        arrays.coordinates["event"].values, arrays.variables["event_time"].values, strict=True
    )
    past = [f" ({what} at {at:.4g} s)" for what, at in events if at <= time]
    return f"{time:.4g} s{''.join(past[-1:])}"


def read_hood(path: Path, hand: Hand) -> HoodField:
    """Read a hood from a file that a run of a finger of that hand wrote.  Raises ValueError for
    another file."""
    mesh = read_mesh_file(path)
    data = {name: np.asarray(blocks[0]) for name, blocks in mesh.cell_data.items()}
    if STRAIN not in data or "displacement" not in mesh.point_data:
        raise ValueError("it is no hood of a run")
    cells = mesh.cells_dict.get("quad", mesh.cells_dict.get("line"))
    if cells is None:
        raise ValueError("it has neither quads nor line cells")
    return HoodField(mesh.points, cells, mesh.point_data, data).of(hand)


def read_shapes(folder: Path, arrays: Arrays, hand: Hand) -> tuple[tuple[float, HoodField], ...]:
    """Read the hood of a motion at its stored times (s), none where none were stored; `hand` as of
    `read_hood`.

    Raises InputError where a file cannot be read."""
    index = folder / "hood.pvd"
    if not index.is_file():
        return ()
    out = []
    try:
        found = DATA_SET.findall(index.read_text(encoding="utf-8"))
        for k, (time, name) in enumerate(found):
            out.append((float(time), with_lines(read_hood(folder / name, hand), arrays, k)))
    except (OSError, ValueError, InputError, LookupError) as error:
        raise InputError(f"{index}: the shapes of the hood cannot be read ({error})") from error
    return tuple(out)


def with_lines(hood: HoodField, arrays: Arrays, k: int) -> HoodField:
    """Return the hood with its tendons beyond the mesh, as the arrays have them at the k-th stored
    state or time; as it is where they have none."""
    if "tendon_line" not in arrays.variables:
        return hood
    names = map(str, arrays.coordinates["line_tendon"].values)
    lines = arrays.variables["tendon_line"].values[k]
    return replace(hood, lines=dict(zip(names, lines, strict=True)))


def _hood_of_state(arrays: Arrays, last: HoodField | None, k: int) -> HoodField | None:
    """The hood at the k-th state, with those fields that the arrays have, from the hood at the
    end."""
    if last is None or "node" not in arrays.variables:
        return None
    points = np.asarray(arrays.variables["node"].values[k])
    reference = last.points - last.point_data["displacement"]
    point_data = {"displacement": points - reference}
    cell_data = {n: last.cell_data[n] for n in ("region", "strand") if n in last.cell_data}
    for colour in COLOURS:
        name, component = colour.in_results
        of_points = colour.on_mesh in last.point_data
        if name not in arrays.variables or not (of_points or colour.on_mesh in last.cell_data):
            continue
        values = arrays.variables[name].values[k]
        values = values if component is None else values[:, component]
        values = colour.factor / colour.mesh_factor * values
        if of_points:
            point_data[colour.on_mesh] = values
        else:
            cell_data[colour.on_mesh] = np.repeat(values, len(last.quads) // len(values))
    for name in (name for name in FAMILIES if name in last.cell_data):
        cell_data[name] = carry(last.quads, last.points, points, last.cell_data[name])
    return with_lines(HoodField(points, last.quads, point_data, cell_data), arrays, k)
