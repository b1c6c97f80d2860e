"""Pictures of estimates: tensions beside their bounds, the feasible forces, a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cosim.analyses.estimate.capacity import Capacity
from cosim.analyses.estimate.feasible import ForceSet
from cosim.analyses.estimate.of_case import MotionEstimate
from cosim.analyses.estimate.tracking import Tracking
from cosim.port import Array
from cosim.results.conventions import joint_words
from cosim.results.looks import look
from cosim.results.picture import new_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INK, PALE, TARGET = "#0b5394", "#c9d9ea", "#b45309"


def draw_estimate(
    capacity: Capacity,
    tension: Array | None,
    forces: ForceSet | None,
    wanted: Array | None,
    title: str,
    exact: bool,
) -> Figure:
    """Tensions as bars over their greatest force, and the feasible forces in the sagittal plane
    with the wanted one; either may lack."""
    panels = [p for p in (tension is not None, forces is not None) if p]
    sheet = new_picture(5.2 * len(panels), 4.4)
    axes = list(np.atleast_1d(sheet.subplots(1, len(panels))))
    if tension is not None:
        _bars(axes.pop(0), capacity, tension)
    if forces is not None:
        _set(axes.pop(0), forces, wanted, exact)
    sheet.suptitle(title, fontsize=11)
    return sheet


def _bars(axes: Axes, capacity: Capacity, tension: Array) -> None:
    rank = np.arange(len(tension))[::-1]
    axes.barh(rank, capacity.most, color=PALE, label="greatest force")
    axes.barh(rank, tension, color=INK, height=0.5, label="estimated")
    for at, value in zip(rank, tension, strict=True):
        axes.text(value, at, f" {value:.2f}", va="center", fontsize=8)
    axes.set_yticks(rank, capacity.names)
    axes.set(xlabel="tension, N", title="Tensions")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def _set(axes: Axes, forces: ForceSet, wanted: Array | None, exact: bool) -> None:
    names = forces.names
    first, second = 0, len(names) - 1
    shadow, section = forces.outline(first, second), forces.section(first, second)
    if len(names) == 3:
        axes.fill(*shadow.T, color=PALE, alpha=0.6, lw=0, label="with any radial force")
    if len(section):
        axes.fill(*section.T, facecolor="#7a9cc6", edgecolor=INK, lw=1.2, alpha=0.8,
                  label="in the sagittal plane")  # fmt: skip
    if wanted is not None and len(wanted) == len(names):
        axes.plot(wanted[first], wanted[second], "o", color=TARGET, label="asked for")
    axes.axhline(0, color="0.5", lw=0.7)
    axes.axvline(0, color="0.5", lw=0.7)
    axes.set_aspect("equal", "datalim")
    how = "" if exact else ", linearised"
    axes.set(xlabel=f"{names[first]}, N", ylabel=f"{names[second]}, N")
    axes.set_title(f"Feasible force of the fingertip{how}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def draw_motion(
    names: tuple[str, ...], joints: tuple[str, ...], result: MotionEstimate, title: str
) -> Figure:
    """Joint angles, needed torques and tensions over time."""
    time, words = result.motion.time, tuple(map(joint_words, joints))
    return _draw_courses(
        title,
        ("angle, deg", time, np.degrees(result.motion.angle), words),
        ("torque of muscles, N mm", time, 1e3 * result.required_torque, words),
        ("tension, N", time, result.tension, names),
    )


def draw_tracking(
    names: tuple[str, ...], joints: tuple[str, ...], tracking: Tracking, title: str
) -> Figure:
    """Joint angles, by how much they miss those wanted, and tensions over time."""
    off, words = tracking.angle - tracking.wanted, tuple(map(joint_words, joints))
    return _draw_courses(
        title,
        ("angle, deg", tracking.step_time, np.degrees(tracking.angle), words),
        ("angle less wanted, deg", tracking.step_time, np.degrees(off), words),
        ("tension, N", tracking.time, tracking.tension, names),
    )


def _draw_courses(title: str, *shown: tuple[str, Array, Array, tuple[str, ...]]) -> Figure:
    """Panels over one time: what stands at the axis, times (n,) s, values (n, k), their names."""
    sheet = new_picture(7.5, 8.0)
    panels = sheet.subplots(len(shown), 1, sharex=True)
    for axes, (unit, time, values, labels) in zip(panels, shown, strict=True):
        for k, label in enumerate(labels):
            axes.plot(time, values[:, k], label=label, lw=1.5, **look(k).line)
        axes.set_ylabel(unit)
        axes.grid(color="0.9")
        axes.legend(
            fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=3
        )
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time, s")
    sheet.suptitle(title, fontsize=11)
    return sheet
