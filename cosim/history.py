"""The plot of a motion: joint angles and fingertip force against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

AXES = (("x", 1.0, "distal"), ("z", -1.0, "palmar"), ("y", 1.0, "radial"))


def draw_history(data: xarray.Dataset, title: str) -> Figure:
    """Change of each joint's angle from the start, deg, and the force of the tip on the world, N,
    in the metacarpal's axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    angles, force = figure.subplots(2, 1, sharex=True)
    for joint in data.joint.values:
        angle = np.rad2deg(data.angle.sel(joint=joint).values)
        angles.plot(data.time, angle - angle[0], label=f"{joint} (from {angle[0]:.0f})", lw=1.2)
    angles.set_ylabel("turned, deg")
    for axis, sign, name in AXES:
        force.plot(data.time, sign * data.tip_force.sel(axis=axis), label=name, lw=1.2)
    size = np.linalg.norm(data.tip_force.values, axis=1)
    force.plot(data.time, size, color="0.3", ls="--", label="magnitude", lw=1.2)
    force.set(xlabel="time, s", ylabel="fingertip force, N")
    for axes in (angles, force):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    # what the first contacts do in a millisecond would hide all that follows
    settled = size[len(size) // 10 :].max(initial=1e-3)
    force.set_ylim(-1.6 * settled, 1.8 * settled)
    figure.suptitle(title, fontsize=11)
    return figure
