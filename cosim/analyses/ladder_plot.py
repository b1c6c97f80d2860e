"""The picture of a ladder: tip forces in the sagittal plane, and slips and arms as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.analyses.ladder import Rung
from cosim.analyses.ladder_tables import EXTENSOR, JOINTS, figures, heading
from cosim.results.looks import Look, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLIPS = ("central slip N", "terminal slip N")
ARMS = tuple(f"arm {EXTENSOR} {joint} mm" for joint in JOINTS)


def draw_ladder(rungs: Sequence[Rung], title: str) -> Figure:
    """Of the rungs that have numbers; the case's own is marked by a star."""
    from matplotlib.figure import Figure

    shown = [rung for rung in rungs if rung.status == "converged"]
    looks = {rung.name: look(i) for i, rung in enumerate(rungs)}
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    force, slips, arms = figure.subplots(1, 3)
    _vectors(force, shown, looks)
    _bars(slips, shown, looks, SLIPS, "force of the loaded slips, N")
    _bars(arms, shown, looks, ARMS, f"moment arm of {EXTENSOR}, mm")
    handles, labels = force.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right center")
    figure.suptitle(f"{title}: ladder of hoods (*: the case's own)", fontsize=11)
    return figure


def _vectors(axes: Axes, rungs: Sequence[Rung], looks: dict[str, Look]) -> None:
    """Distal to the right, palmar down; a line from the force at rest to that under load."""
    for rung in rungs:
        states = (rung.summary["unloaded"], rung.summary)
        distal, palmar, _ = np.transpose([state["fingertip_force_N"] for state in states])
        axes.plot(distal, palmar, lw=1.5, label=heading(rung), **looks[rung.name].line)
        axes.plot(distal[0], palmar[0], "x", color=looks[rung.name].colour, ms=5)
        axes.plot(distal[1], palmar[1], "o", color=looks[rung.name].colour, ms=5)
    axes.axhline(0, color="0.7", lw=0.8, zorder=0)
    axes.axvline(0, color="0.7", lw=0.8, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set(title="tip force on the world (x: at rest)", xlabel="distal, N", ylabel="palmar, N")
    axes.grid(alpha=0.3)


def _bars(
    axes: Axes, rungs: Sequence[Rung], looks: dict[str, Look], names: Sequence[str], title: str
) -> None:
    """A group for each name, a bar in it for each rung; none where a hood does not say."""
    width = 0.8 / max(len(rungs), 1)
    for i, rung in enumerate(rungs):
        values = [told if (told := figures(rung).get(n)) is not None else np.nan for n in names]
        place = np.arange(len(names)) + (i - (len(rungs) - 1) / 2) * width
        axes.bar(place, values, width, **looks[rung.name].bar)
    axes.axhline(0, color="0.7", lw=0.8)
    axes.set_xticks(range(len(names)), [n.rsplit(" ", 1)[0] for n in names])
    axes.set_title(title)
    axes.grid(axis="y", alpha=0.3)
