"""Paper 001's numbers beside ours, and what is not certain about them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.report.figures import Figure, style_axes
from rigid.papers.buchner1988.coordination import ControlLoop, deviation, flex
from rigid.papers.buchner1988.coordination_findings import (
    CHANGE,
    Finding,
    Flexion,
    feasible,
    findings,
    flexion,
    table_sensitivity,
)
from rigid.papers.buchner1988.flexion import cosine

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

ELASTICITIES = (50.0, 150.0, 500.0, 1500.0, 5000.0)
BANDWIDTHS = (5.0, 10.0, 20.0, 40.0)
SHARES = (0.5, 0.6, 0.7, 0.8, 1.0)
SHOWN = (
    "linear: FDS gives way to Int",
    "linear: ED at the end",
    "linear: Int at the end",
    "linear: FDP at the end",
    "quadratic: ED falls by",
    "quadratic: FDP falls by",
    "quadratic: bands cross",
    "quadratic: middle band's share",
)


def doubt_figures(f: Flexion) -> list[Figure]:
    """Figures of what the paper leaves open: the printed numbers, the loops, and the entries."""
    return [_beside(f), _loops(), _entries(flexion(f.loop, samples=51))]


def _beside(f: Flexion) -> Figure:
    found = findings(f)
    other = {x.what: x.ours for x in findings(_on_cosine(f))}
    rows = pd.DataFrame(
        [
            {
                "what": x.what,
                "unit": x.unit,
                "paper": x.paper,
                "ours": x.ours,
                "ours, cosine in time": other[x.what],
                "paper says about": "yes" if x.about else "no",
                "figure": x.where,
            }
            for x in found
        ]
    )
    shares = pd.DataFrame(
        [
            {
                "alpha": share,
                "samples with a solution, %": 100
                * feasible(replace(f.loop, lateral_share=share), f.motion),
            }
            for share in SHARES
        ]
    )
    caption = (
        "Every number that the paper states of this flexion, as ours over the paper's. The two "
        "times depend on the reference's course in time, which the paper does not state "
        "(circles: a polynomial of fifth order; crosses: half a cosine). Also in the tables: "
        "with alpha fixed at 1/2 the linear programme finds forces throughout, with alpha = 1 at "
        "no time, both as the paper says."
    )
    shown = [x for x in found if x.paper]

    def draw(sheet: Sheet) -> None:
        axes, rank = sheet.subplots(), np.arange(len(shown))[::-1]
        axes.axvline(1.0, color="0.4", lw=1)
        crosses = [other[x.what] / x.paper for x in shown]
        axes.plot(crosses, rank, "x", color="0.5", label="half a cosine in time")
        axes.plot(
            [x.ours / x.paper for x in shown], rank, "o", color="#0b5394", label="fifth order"
        )
        names = [f"{x.what} ({x.ours:.3g}; paper {x.paper:.3g} {x.unit})" for x in shown]
        axes.set_yticks(rank, names)
        style_axes(axes, "ours / the paper's", "")
        axes.set_xlim(0.6, 1.2)
        sheet.legend(loc="outside lower center", ncols=2, frameon=False)

    return Figure(
        "beside_the_paper",
        "The paper's numbers beside ours",
        caption,
        draw,
        {"beside_the_paper": rows, "alpha_and_feasibility": shares},
        (8.5, 5.0),
    )


def _on_cosine(f: Flexion) -> Flexion:
    return flexion(replace(f.loop, course=cosine))


def _loops() -> Figure:
    rows = []
    for bandwidth in BANDWIDTHS:
        for elasticity in ELASTICITIES:
            loop = ControlLoop(bandwidth, elasticity)
            off = deviation(loop, flex(loop))
            rows.append((bandwidth, elasticity, off.curve, off.line))
    columns = ["bandwidth_rad_per_s", "K_N_per_m", "from_parabola_deg", "from_line_deg"]
    data = pd.DataFrame(rows, columns=columns)
    caption = (
        "The paper states neither gains nor how the torque is computed. The largest distance of "
        "the DIP angle from the parabola, by the bands' elasticity K (the paper's: 500 N/m) and "
        "the feedback's bandwidth: the spring draws to the parabola, feedback to the line, which "
        "is 18 deg away. Below some 20 rad/s the paper's figure 7 follows whatever was chosen."
    )

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        for k, (bandwidth, part) in enumerate(data.groupby("bandwidth_rad_per_s")):
            colour = ("#9ec5e8", "#0b5394", "#b45309", "#7a2e0e")[k]
            axes.loglog(
                part.K_N_per_m, part.from_parabola_deg, "o-", color=colour, label=f"{bandwidth:g}"
            )
        style_axes(axes, "K, N/m", "from the parabola at most, deg")
        sheet.legend(
            loc="outside lower center", ncols=4, frameon=False, title="bandwidth of feedback, rad/s"
        )

    return Figure(
        "feedback_and_elasticity",
        "What feedback and elasticity change",
        caption,
        draw,
        {"feedback_and_elasticity": data},
        (6.5, 4.6),
    )


def _entries(f: Flexion) -> Figure:
    base = {x.what: x for x in findings(f)}
    rows = [
        {
            "entry": f"{muscle} at {joint}",
            "certainty": f.loop.table[muscle, joint].certainty,
            "what": what,
            "unit": base[what].unit,
            "paper": base[what].paper,
            "as_read": base[what].ours,
            f"{100 * CHANGE:.0f} % smaller": _our_value(smaller, what),
            f"{100 * CHANGE:.0f} % larger": _our_value(larger, what),
        }
        for (muscle, joint), (smaller, larger) in table_sensitivity(f).items()
        for what in SHOWN
    ]
    data = pd.DataFrame(rows)
    caption = (
        f"Each entry of table 1 that is not certain, R and R' {100 * CHANGE:.0f} % smaller and "
        "larger: what the paper's numbers become (dot: as read; line: the paper's; no bar: no "
        "effect, or none that is defined, where FDS stays silent). ED and FDP at the MCP and FDP "
        "at PIP and DIP decide nearly everything, and 20 % of any of them would be seen; as read "
        "they return the paper's end forces together. The two times hang on FDP at the MCP (and "
        "on the course in time): 0.22 s would take an arm some 15 % larger, with which ED ends "
        "near 34 N instead of 26.4. No number of the paper tests the lumbrical's row; FDS at the "
        "PIP would show if its arm were larger, at the MCP if smaller."
    )

    def draw(sheet: Sheet) -> None:
        panels = sheet.subplots(2, 4, sharey=True).ravel()
        for axes, what in zip(panels, SHOWN, strict=True):
            part = data[data["what"] == what]
            rank = np.arange(len(part))[::-1]
            ends = part[["as_read", *part.columns[-2:]]].to_numpy(dtype=float)
            low, high = np.nanmin(ends, axis=1), np.nanmax(ends, axis=1)
            axes.hlines(rank, low, high, color="#7a9cc6", lw=6)
            axes.axvline(base[what].paper, color="#b45309", lw=1.2)
            axes.plot(part.as_read, rank, "o", color="#0b5394", ms=4)
            axes.set_yticks(rank, part.entry)
            style_axes(axes, base[what].unit, "")
            axes.set_title(what.replace(": ", ":\n"), fontsize=9)
            nearest = np.nanmax(np.abs(ends - base[what].paper), initial=0.0)
            if nearest > 2 * base[what].paper:  # one entry would flatten the others
                axes.set_xlim(0.0, 3 * base[what].paper)

    return Figure(
        "uncertain_entries",
        "What the uncertain entries of table 1 change",
        caption,
        draw,
        {"uncertain_entries": data},
        (11.0, 6.0),
    )


def _our_value(found: tuple[Finding, ...], what: str) -> float:
    return next(x.ours for x in found if x.what == what)
