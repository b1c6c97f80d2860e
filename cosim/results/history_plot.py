"""The plot of a motion: joint angles and fingertip force against time, and what cylinders do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cosim.results.looks import look

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_history(data: xarray.Dataset, title: str) -> Figure:
    """Change of each joint's angle from the start, deg, and the force of the tip on the world, N,
    along the world's axes; of pneumatic cylinders command, pressure and tension."""
    from matplotlib.figure import Figure

    rows = 5 if "pressure" in data else 2
    figure = Figure(figsize=(8, 2 + 2 * rows), layout="constrained")
    angles, force, *air = figure.subplots(rows, 1, sharex=True)
    for i, joint in enumerate(data.joint.values):
        angle = np.rad2deg(data.angle.sel(joint=joint).values)
        label = f"{joint} (from {angle[0]:.0f})"
        angles.plot(data.time, angle - angle[0], label=label, lw=1.2, **look(i).line)
    angles.set_ylabel("turned, deg")
    for i, axis in enumerate(data.axis.values):
        force.plot(data.time, data.tip_force.sel(axis=axis), label=axis, lw=1.2, **look(i).line)
    size = np.linalg.norm(data.tip_force.values, axis=1)
    force.plot(data.time, size, color="0.3", ls="--", label="magnitude", lw=1.2)
    force.set_ylabel("fingertip force, N")
    if air:
        _draw_air(data, air)
    (angles, force, *air)[-1].set_xlabel("time, s")
    for axes in (angles, force, *air):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    # what the first contacts do in a millisecond would hide all that follows
    settled = size[len(size) // 10 :].max(initial=1e-3)
    force.set_ylim(-1.6 * settled, 1.8 * settled)
    figure.suptitle(title, fontsize=11)
    return figure


def _draw_air(data: xarray.Dataset, axes: list[Axes]) -> None:
    """Command, pressure and tension of each cylinder."""
    command, pressure, tension = axes
    for i, name in enumerate(data.cylinder.values):
        kilopascals = 1e-3 * data.pressure.sel(cylinder=name)
        command.plot(data.time, data.command.sel(cylinder=name), label=name, lw=1.2, **look(i).line)
        pressure.plot(data.time, kilopascals, label=name, lw=1.2, **look(i).line)
        tension.plot(data.time, _tension(data, str(name)), label=name, lw=1.2, **look(i).line)
    command.set_ylabel("valve voltage, V")
    pressure.set_ylabel("pressure, kPa")
    tension.set_ylabel("tension, N")


def _tension(data: xarray.Dataset, name: str) -> xarray.DataArray:
    """The tension (N) of the hood's tendon or the finger's own of that name."""
    if "tendon" in data.coords and name in data.tendon.values:
        return data.tension.sel(tendon=name)
    return data.own_tension.sel(muscle=name)
