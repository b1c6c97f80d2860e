"""The plot of a ledger: how strongly each source acts on each body, at rest or over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.results.looks import Look, look
from cosim.results.parts import LedgerRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEW = 3
"""States that are drawn as bars; more are times."""
TELLING = 0.02
"""Share of the largest force: a source that nowhere reaches it is left out."""


def draw_ledger(rows: Sequence[LedgerRow], title: str) -> Figure:
    """A panel for each body: the size of the force of each source, N; of few states the last one as
    bars, of a motion all as lines against time."""
    from matplotlib.figure import Figure

    sized = [(row, float(np.linalg.norm(row.force))) for row in rows]
    largest: dict[str, float] = {}
    for row, size in sized:
        largest[row.source] = max(size, largest.get(row.source, 0.0))
    least = TELLING * max(largest.values(), default=0.0)
    sized = [(row, size) for row, size in sized if largest[row.source] >= least]
    states = list(dict.fromkeys(row.state for row, _ in sized))
    bodies = list(dict.fromkeys(row.body for row, _ in sized))
    sources = list(dict.fromkeys(row.source for row, _ in sized))
    looks = {source: look(i) for i, source in enumerate(sources)}
    count, height, as_bars = max(len(bodies), 1), 4.2, len(states) <= FEW
    figure = Figure(figsize=(3.6 * count, height), layout=None if as_bars else "constrained")
    panels = figure.subplots(1, count, sharey=True, squeeze=False).ravel()
    if as_bars:  # places of our own: constrained layout takes longer than to draw
        longest = max(map(len, sources), default=0)
        bottom = (0.2 + 0.056 * longest) / height
        figure.subplots_adjust(0.6 / (3.6 * count), bottom, 0.995, 0.88, wspace=0.05)
    for axes, body in zip(panels, bodies, strict=False):
        of_body = {(r.state, r.source): size for r, size in sized if r.body == body}
        if as_bars:
            _bars(axes, {s: size for (at, s), size in of_body.items() if at == states[-1]}, looks)
        else:
            _lines(axes, of_body, states, looks)
        axes.set_title(body)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("force on the body, N")
    if not as_bars:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center", fontsize=8, handlelength=3)
    figure.suptitle(f"{title}: forces by source", fontsize=11)
    return figure


def _bars(axes: Axes, force: Mapping[str, float], looks: Mapping[str, Look]) -> None:
    """The force (N) of each source."""
    for source, size in force.items():
        axes.bar(source, size, **looks[source].bar)
    axes.tick_params(axis="x", rotation=90, labelsize=8)


def _lines(
    axes: Axes,
    force: Mapping[tuple[str, str], float],
    states: Sequence[str],
    looks: Mapping[str, Look],
) -> None:
    """The force (N) by state and source.  All sources, those that do not act too, so that each
    panel's legend is the figure's."""
    acting = {state for state, _ in force}
    at = {float(s.removesuffix(" s")): s for s in states if s in acting}
    times = sorted(at)
    for source, one in looks.items():
        over_time = [force.get((at[time], source), 0.0) for time in times]
        axes.plot(times, over_time, lw=1.0, label=source, **one.line)
    axes.set_xlabel("time, s")
