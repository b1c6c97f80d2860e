"""Figure 4 of paper 000, and what its section IV-C says of settled states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.network_motion import SETTLED, ContactRun, contact
from cosim.report.figures import Figure, style_axes
from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.two_band import coupled_dip
from rigid.papers.networks.human_network import MUSCLES, human_finger
from rigid.papers.networks.point_contact import settle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

CASES = {
    "network_contact": "index finger (flexors: An 1979)",
    "network_contact_planar": "planar finger (section III)",
}
MUSCLE_LOOKS = {
    "EDC": ("#0072b2", "-"),
    "LUM": ("#56b4e9", "-"),
    "FPI": ("black", ":"),
    "FDP": ("#d55e00", "-"),
    "FDS": ("#e69f00", "--"),
}
TENDON_LOOKS = {
    "edc_slip": ("#0072b2", "-", "EDC slip"),
    "edc_radial": ("#0072b2", "--", "EDC lateral (each of 2)"),
    "lum_slip": ("#d55e00", "-", "LUM, UI slip"),
    "lum_lateral": ("#d55e00", "--", "LUM, UI lateral"),
}
FORCES = (
    "EDC 10 N, LUM and UI 5 N each from 0.2 s on, FDP 6 N from 1.2 s, FDS 6 N from 2.2 s: ours, "
    "the paper's are in its figure alone."
)
ON_THE_WORLD = {"distal": (0, 1.0), "palmar": (2, -1.0)}


def contact_figures() -> list[Figure]:
    """Figures of the contact with each muscle: the history and its end."""
    runs = {name: contact(name) for name in CASES}
    return [_history(runs), _ends(runs)]


def _history(runs: dict[str, ContactRun]) -> Figure:
    def draw(sheet: Sheet) -> None:
        grid = sheet.subplots(4, 2, sharex=True, sharey="row")
        for column, (name, run) in zip(grid.T, runs.items(), strict=True):
            for axes, panel in zip(column, (_forces, _angles, _tendons, _tip), strict=True):
                panel(axes, run)
                style_axes(axes, "", "")
            column[0].set_title(CASES[name], fontsize=10)
            column[-1].set_xlabel("time, s")
        words = (
            "(a) muscle force, N",
            "(b) turned from start, deg",
            "(c) tendon tension, N",
            "(d) tip force, N",
        )
        for axes, label in zip(grid[:, 0], words, strict=True):
            axes.set_ylabel(label)
        for axes in grid[:, 1]:
            axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))

    caption = (
        "Figure 4, by `cosim run network_contact` and `network_contact_planar` (MuJoCo and the "
        "network, 5 ms a step), the tip held at a point and free to turn there. Extensors bring "
        "PIP and DIP onto the coupling curve (b: DIP, and dashed what the curve asks of it at that "
        "PIP); each flexor moves them along it a little, the tensions in slip and bands shift (c), "
        "and so does what EDC, LUM and UI alone make at the tip (d, solid) though they pull as "
        f"before. {FORCES} On the index finger FDP and FDS run over An's points, where FDP has "
        "hardly a moment along the one motion that the held tip leaves, and shifts little; with "
        "section III's moment arms (Buchner's) it does."
    )
    tables = {f"figure_4_{name}": _table(run) for name, run in runs.items()}
    title = "Figure 4: hard point contact, muscles in turn"
    return Figure("figure_4_contact", title, caption, draw, tables, (10.0, 9.0))


def _forces(axes: Axes, run: ContactRun) -> None:
    for muscle, (colour, dash) in MUSCLE_LOOKS.items():
        label = "UI (FPI)" if muscle == "FPI" else muscle
        axes.plot(run.time, run.force[muscle], dash, color=colour, lw=1.6, label=label)


def _angles(axes: Axes, run: ContactRun) -> None:
    turned = np.degrees(run.angle - run.angle[0])
    looks = zip(("MCP", "PIP", "DIP"), ("0.5", "#009e73", "#cc79a7"), strict=True)
    for k, (joint, colour) in enumerate(looks):
        axes.plot(run.time, turned[:, k], color=colour, lw=1.6, label=joint)
    on_curve = np.degrees(coupled_dip(run.angle[:, 1]) - run.angle[0, 2])
    axes.plot(run.time, on_curve, "--", color="black", lw=1.0, label="DIP on the curve")


def _tendons(axes: Axes, run: ContactRun) -> None:
    for name, (colour, dash, label) in TENDON_LOOKS.items():
        axes.plot(
            run.time, run.tendon[:, run.names.index(name)], dash, color=colour, lw=1.6, label=label
        )


def _tip(axes: Axes, run: ContactRun) -> None:
    for (name, (axis, sign)), colour in zip(
        ON_THE_WORLD.items(), ("#0072b2", "#d55e00"), strict=True
    ):
        whole, part = sign * run.tip_force[:, axis], sign * run.extensors[:, axis]
        axes.plot(run.time, part, color=colour, lw=1.8, label=f"{name}, extensors alone")
        axes.plot(run.time, whole, ":", color=colour, lw=1.2, label=f"{name}, all muscles")
    axes.axhline(0.0, color="0.7", lw=0.8, zorder=0)


def _table(run: ContactRun) -> pd.DataFrame:
    table = pd.DataFrame({"time_s": run.time})
    for muscle, force in run.force.items():
        table[f"{muscle}_N"] = force
    for k, joint in enumerate(("MCP", "PIP", "DIP")):
        table[f"{joint}_deg"] = np.degrees(run.angle[:, k])
    table["DIP_on_the_curve_deg"] = np.degrees(coupled_dip(run.angle[:, 1]))
    for k, name in enumerate(run.names):
        table[f"{name}_N"] = run.tendon[:, k]
    for name, (axis, sign) in ON_THE_WORLD.items():
        table[f"tip_{name}_N"] = sign * run.tip_force[:, axis]
        table[f"extensors_{name}_N"] = sign * run.extensors[:, axis]
    table["EDC_share_of_slip"] = run.share
    table["EDC_optimal_share"] = run.optimum
    return table


def end_states(run: ContactRun, planar: bool) -> pd.DataFrame:
    """Settled states of a run; of the planar one beside `point_contact`, which knows no
    orchestrator."""
    rows = []
    for time in SETTLED:
        k = run.at(time)
        row = {
            "time_s": float(run.time[k]),
            "PIP_deg": float(np.degrees(run.angle[k, 1])),
            "DIP_deg": float(np.degrees(run.angle[k, 2])),
            "DIP_off_curve_deg": float(np.degrees(run.angle[k, 2] - coupled_dip(run.angle[k, 1]))),
            "EDC_slip_share": float(run.share[k]),
            "optimum_less_settled_share": float(run.optimum[k] - run.share[k]),
        }
        if planar:
            names = {"UI": "FPI"}
            force = [float(run.force[names.get(m, m)][k]) if m != "RI" else 0.0 for m in MUSCLES]
            alone = settle(BUCHNER.length, human_finger(), np.array(force), run.angle[0], 50.0)
            row["largest_angle_apart_rad"] = float(np.abs(alone - run.angle[k]).max())
        rows.append(row)
    return pd.DataFrame(rows)


def _ends(runs: dict[str, ContactRun]) -> Figure:
    tables = {
        f"settled_{name}": end_states(run, name.endswith("planar")) for name, run in runs.items()
    }
    apart = float(tables["settled_network_contact_planar"].largest_angle_apart_rad.max())
    worst = max(float(t.optimum_less_settled_share.abs().max()) for t in tables.values())

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        for (name, run), (colour, mark) in zip(
            runs.items(), (("#0072b2", "o"), ("#d55e00", "s")), strict=True
        ):
            axes.plot(run.time, run.share, color=colour, lw=2.2, label=f"run, {CASES[name]}")
            times = [run.at(t) for t in SETTLED]
            axes.plot(
                run.time[times], run.optimum[times], mark, color="white", mec=colour, mew=1.6,
                label="least |tau_dist| there",
            )  # fmt: skip
        style_axes(axes, "time, s", "share of EDC that the slip bears")
        axes.set_ylim(0.0, 1.0)
        axes.legend(frameon=False, fontsize=8)

    caption = (
        "Section IV-C: the share that minimises |tau_dist| in a settled posture is the one that "
        f"the simulation settled at (largest difference {worst:.0e}; the paper: identical). The "
        f"planar run ends within {apart:.0e} rad of `rigid/papers/networks/point_contact.py`, the "
        "same finger without inertia and orchestrator; the index finger differs from both by its "
        "flexors' paths, its lengths and its abduction (0.1 deg)."
    )
    title = "Forward prediction: optimal share and settled simulation"
    return Figure("forward_optimum", title, caption, draw, tables, (7.0, 4.2))
