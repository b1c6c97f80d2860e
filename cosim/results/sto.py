"""A run's motions and forces as tables that OpenSim plots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.results.read import read_arrays

if TYPE_CHECKING:
    import xarray

TENSION = "_tension"
"""What follows a tendon's name in the label of its column."""


def write_tables(run: Path, out: Path) -> list[Path]:
    """Write tables of the run in the folder `run`; their paths: of `out` NAME.sto
    `NAME_motion.sto` (joint angles, degrees) and `NAME_forces.sto` (tensions and fingertip force in
    N, joint torques by source in N m; world axes x distal, y radial, z dorsal).

    A run in time has its own times; the states of a static one (unloaded, loaded) are one second
    apart.  Raises InputError where `run` is none or `out` cannot be written."""
    from rigid.opensim.sto import StoTable, write_sto

    data = read_arrays(run).to_dataset()
    axis, time = _times(data)
    angles = tuple(str(j) for j in data.joint.values)
    motion = StoTable(
        run.name, angles, time, data.angle.transpose(axis, "joint").values, True, angles
    )
    forces = dict(_forces(data, axis))
    columns = tuple(forces)
    table = StoTable(run.name, columns, time, np.column_stack(list(forces.values())))
    paths = [out.with_stem(f"{out.stem}_{what}") for what in ("motion", "forces")]
    for path, one in zip(paths, (motion, table), strict=True):
        write_sto(path, one)
    return paths


def _times(data: xarray.Dataset) -> tuple[str, Any]:
    if "time" in data.dims:
        return "time", data.time.values
    return "state", np.arange(len(data.state), dtype=float)


def _forces(data: xarray.Dataset, axis: str) -> Iterator[tuple[str, Any]]:
    for name, label in (("tension", "tendon"), ("own_tension", "muscle")):
        if name in data and data.sizes[label]:
            for key in data[label].values:
                yield f"{key}{TENSION}", data[name].sel({label: key}).values
    for letter, axis in zip("xyz", data.axis.values, strict=True):
        yield f"fingertip_force_v{letter}", data.tip_force.sel(axis=axis).values
    if "torque" in data:
        for source in data.torque_source.values:
            for joint in data.joint.values:
                values = data.torque.sel(torque_source=source, joint=joint).values
                yield f"{joint}_torque_{str(source).replace(' ', '_')}", values
