"""The plot of a motion or of a load that is held: joint angles, fingertip force, tensions and slips
against time, and what cylinders do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.port import Array
from cosim.results.conventions import joint_words
from cosim.results.looks import look
from cosim.results.picture import new_picture

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLIPS = {"central_slip": "central slip", "terminal_slip": "terminal slip"}
"""The hood's sources that are slips, in words."""
PULLED = 0.05
"""Share of the least tension of all beyond which a tendon is pulled."""
MAGNITUDE = "magnitude"
Curves = Mapping[str, Array]
"""Values over time by name."""


def draw_history(data: xarray.Dataset, title: str) -> Figure:
    """Return panels against time, s: how far each joint has turned, deg; the force of the tip on
    the world, N, along the world's axes, of a finger that is not free; the tensions of the tendons
    that are pulled and the forces of the slips, N; of pneumatic cylinders command and pressure; of
    motors how far they have wound; of tendons with friction the energy lost and, last, the tensions
    against the shortening of their paths.  The time of a load that is held is logarithmic, and what
    there was at once stands at its left end."""
    is_held = "held_time" in data.dims
    if is_held:
        data = _held(data)
    panels, loops = list(_panels(data)), _loops(data)
    heights = [1.0] * len(panels) + [1.6] * bool(loops)
    figure = new_picture(8.5, 0.9 + 2.3 * sum(heights))
    every = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    if loops:
        _draw_loops(every[-1], loops)
        every = every[:-1]
    for axes in every[:-1]:
        axes.sharex(every[-1])
        axes.tick_params(labelbottom=False)
    for axes, (label, curves, finish) in zip(every, panels, strict=True):
        for i, (name, values) in enumerate(curves.items()):
            style = look(i).line if name != MAGNITUDE else {"color": "0.3", "ls": "--"}
            axes.plot(data.time, values, label=name, lw=1.2, **style)
        finish(axes)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    every[-1].set_xlabel("time, s")
    if is_held:
        every[-1].set_xscale("log")
        every[-1].set_xlabel("time under load, s (left end: at once)")
    figure.suptitle(title, fontsize=11)
    return figure


def _held(data: xarray.Dataset) -> xarray.Dataset:
    """What there was while a load was held, by the names of a motion's arrays."""
    held = [str(name) for name in data.data_vars if str(name).startswith("held_")]
    out = data[held].rename({name: name.removeprefix("held_") for name in (*held, "held_time")})
    time = out.time.values.copy()
    time[0] = time[1:].min(initial=np.inf, where=time[1:] > 0) / 2
    return out.assign_coords(time=time)


def _panels(data: xarray.Dataset) -> Iterator[tuple[str, Curves, Callable[[Any], object]]]:
    """Label, curves, and what is left to do to the axes of each panel."""
    angle = {str(j): np.rad2deg(data.angle.sel(joint=j).values) for j in data.joint.values}
    turned = {f"{joint_words(j)} (from {q[0]:.0f}°)": q - q[0] for j, q in angle.items()}
    yield "joints turned by, deg", turned, _no_more
    size = np.linalg.norm(data.tip_force.values, axis=1)
    if size.any():
        force = {str(axis): data.tip_force.sel(axis=axis).values for axis in data.axis.values}
        # what the first contacts do in a millisecond would hide all that follows
        most = size[len(size) // 10 :].max(initial=1e-3)

        def finish(axes: Axes) -> None:
            axes.set_ylim(-1.6 * most, 1.8 * most)

        yield "fingertip on the world, N", {**force, MAGNITUDE: size}, finish
    if "pressure" in data:
        cylinders = [str(name) for name in data.cylinder.values]
        volts = {name: data.command.sel(cylinder=name).values for name in cylinders}
        pressure = {name: 1e-3 * data.pressure.sel(cylinder=name).values for name in cylinders}
        yield "valve voltage, V", volts, _no_more
        yield "pressure, kPa", pressure, _no_more
    if "motor_position" in data:
        motors = [str(name) for name in data.motor.values]
        wound = {name: 1e3 * data.motor_position.sel(motor=name).values for name in motors}
        torque = {name: 1e3 * data.motor_torque.sel(motor=name).values for name in motors}
        yield "drawn by the motor, mm", wound, _no_more
        yield "torque of the motor, N mm", torque, _no_more
    if "guide_loss" in data:
        lost = {"all tendons": 1e3 * data.guide_loss.values}
        yield "energy lost to friction\nof tendons, mJ", lost, _from_zero
    if tensions := _pulled(data):
        yield "tension of the tendons\nthat are pulled, N", tensions, _from_zero
    if "repair_stretch" in data:
        each = {
            str(n): 1e3 * data.repair_stretch.sel(held_repair=n).values
            for n in data.held_repair.values
        }
        yield "repairs longer than\nat rest by, mm", each, _from_zero
    if "slip_force" in data:
        each = {f"{n} slip": data.slip_force.sel(held_slip=n).values for n in data.held_slip.values}
        yield "force in the slips, N", each, _from_zero
    if slips := slip_histories(data):
        yield "force in the slips, N", slips, _from_zero


def _loops(data: xarray.Dataset) -> dict[str, tuple[Array, Array, Array]]:
    """How far the path of each tendon with friction has shortened, mm, and its tension at the
    muscle and at the insertion, N."""
    if "insertion_tension" not in data:
        return {}
    out = {}
    for name in data.muscle.values:
        length, pulled, left = (
            data[array].sel(muscle=name).values
            for array in ("path_length", "own_tension", "insertion_tension")
        )
        if not np.allclose(pulled, left, rtol=1e-9, atol=0.0):
            out[str(name)] = 1e3 * (length[0] - length), pulled, left
    return out


def _draw_loops(axes: Axes, loops: Mapping[str, tuple[Array, Array, Array]]) -> None:
    for i, (name, (shortened, pulled, left)) in enumerate(loops.items()):
        colour = look(i).line["color"]
        axes.plot(shortened, pulled, color=colour, lw=1.4, label=f"{name}, at the muscle")
        axes.plot(shortened, left, color=colour, lw=1.2, ls=":", label=f"{name}, at the insertion")
    axes.set_xlabel("path shortened by, mm")
    axes.set_ylabel("tension, N")
    axes.set_title("hysteresis of tendons with friction", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _no_more(axes: Axes) -> None:
    """Leave the axes as they are."""


def _from_zero(axes: Axes) -> None:
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]), top=axes.get_ylim()[1])


def _pulled(data: xarray.Dataset) -> dict[str, Array]:
    """The tension (N) of each tendon that at some time bears more than the least of all; of all
    where none does."""
    every = {
        str(name): data[array].sel({dim: name}).values
        for array, dim in (("tension", "tendon"), ("own_tension", "muscle"))
        if array in data
        for name in data[dim].values
    }
    least = (1 + PULLED) * min((float(t.min()) for t in every.values()), default=0.0)
    pulled = {name: t for name, t in every.items() if t.max() > least}
    return pulled or every


def slip_histories(data: xarray.Dataset) -> dict[str, Array]:
    """The force (nt,) N that each slip of the hood exerts on its bone, with its suture, by its
    words."""
    if "source" not in data.coords or "hood_force" not in data:
        return {}
    force, known = data.hood_force.transpose("time", "source", "body", "axis"), data.source.values
    by = {words: [s for s in (n, f"suture_{n}") if s in known] for n, words in SLIPS.items()}
    return {
        words: np.linalg.norm(force.sel(source=names).values.sum(axis=(1, 2)), axis=1)
        for words, names in by.items()
        if names
    }
