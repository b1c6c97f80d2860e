"""The plot of a ledger: how strongly each source acts on each body, at rest or over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.results.looks import Look, look
from cosim.results.parts import LedgerRow

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEW = 3
"""States that are drawn as bars; more are times."""
TELLING = 0.02
"""Share of the largest force: a source that nowhere reaches it is left out."""


def draw_ledger(rows: Sequence[LedgerRow], title: str) -> Figure:
    """A panel for each body: the size of the force of each source, N; of few states the last one as
    bars, of a motion all as lines against time."""
    import pandas
    from matplotlib.figure import Figure

    table = pandas.DataFrame(
        [(r.state, r.body, r.source, float(np.linalg.norm(r.force))) for r in rows],
        columns=["state", "body", "source", "force"],
    )
    table = table[table.groupby("source").force.transform("max") >= TELLING * table.force.max()]
    bodies, states = list(dict.fromkeys(table.body)), list(dict.fromkeys(table.state))
    sources = list(dict.fromkeys(table.source))
    looks = {source: look(i) for i, source in enumerate(sources)}
    figure = Figure(figsize=(3.6 * max(len(bodies), 1), 4.2), layout="constrained")
    panels = figure.subplots(1, max(len(bodies), 1), sharey=True, squeeze=False).ravel()
    for axes, body in zip(panels, bodies, strict=False):
        here = table[table.body == body]
        if len(states) <= FEW:
            _bars(axes, here[here.state == states[-1]], looks)
        else:
            _lines(axes, here, looks)
        axes.set_title(body)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("force on the body, N")
    if len(states) > FEW:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center", fontsize=8, handlelength=3)
    figure.suptitle(f"{title}: forces by source", fontsize=11)
    return figure


def _bars(axes: Axes, here: pandas.DataFrame, looks: dict[str, Look]) -> None:
    for source, force in zip(here.source, here.force, strict=True):
        axes.bar(source, force, **looks[source].bar)
    axes.tick_params(axis="x", rotation=90, labelsize=8)


def _lines(axes: Axes, here: pandas.DataFrame, looks: dict[str, Look]) -> None:
    """All sources, those that do not act too, so that each panel's legend is the figure's."""
    wide = here.assign(time=here.state.str.removesuffix(" s").astype(float)).pivot(
        index="time", columns="source", values="force"
    )
    for source, one in looks.items():
        force = wide[source].fillna(0.0) if source in wide else 0.0 * wide.index
        axes.plot(wide.index, force, lw=1.0, label=source, **one.line)
    axes.set_xlabel("time, s")
