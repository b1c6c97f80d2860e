"""What the virtual testbed says of both models, beside what paper 000 reports of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.network_testbed import (
    INTERCONNECTED,
    MODELS,
    SEEDS,
    STATIC,
    VIRTUAL,
    error_table,
    seed_table,
)
from cosim.port import Array
from cosim.report.figures import Figure, style_axes
from rigid.papers.networks.testbed_runs import (
    ELSEWHERE,
    FRICTION,
    FRICTION_ELSEWHERE,
    POSTURE,
    REPORTED,
    TURNS,
    hysteresis,
    virtual_bed,
)
from rigid.papers.networks.testbed_study import REPORTED_ERRORS, errors, trials

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

OTHER_FRICTIONS, FEWER = (0.04, 0.08, FRICTION, 0.25), 4
BARS = {"interconnected": (INTERCONNECTED[0], ""), "static": (STATIC[0], "////")}


def error_figures() -> list[Figure]:
    """Figures of the errors, of the friction's size, and of the errors by friction."""
    return [_summary(), _hysteresis_figure(), _by_friction()]


def _summary() -> Figure:
    table = error_table(errors(trials(SEEDS)), REPORTED_ERRORS)

    def draw(sheet: Sheet) -> None:
        left, right = sheet.subplots(1, 2, width_ratios=(3, 2))
        at = np.arange(len(table))
        for shift, (model, (colour, hatch)) in zip((-0.2, 0.2), BARS.items(), strict=True):
            left.bar(
                at + shift, table[f"{model}_N"], 0.36, yerr=table[f"{model}_sd_N"], color=colour,
                hatch=hatch, edgecolor="white", capsize=3, label=f"{model}, virtual testbed",
            )  # fmt: skip
            left.plot(
                at + shift, table[f"paper_{model}_N"], "D", color="black", mfc="white", ms=6,
                label="the paper's" if shift > 0 else None,
            )  # fmt: skip
        right.bar(at, table.ratio_of_means, 0.5, yerr=table.ratio_sd, color="0.6", capsize=3)
        right.plot(at, table.paper_ratio, "D", color="black", mfc="white", ms=6)
        for axes, words in ((left, "RMSE, N"), (right, "interconnected over static")):
            axes.set_xticks(at, table.experiment)
            style_axes(axes, "", words)
        left.set_yscale("log")
        left.set_ylim(bottom=0.1)
        right.axhline(1.0, color="0.7", lw=0.8)
        sheet.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3,
                     frameon=False)  # fmt: skip

    verdict = "; ".join(
        f"{r.experiment} {r.ratio_of_means:.2f} (paper {r.paper_ratio:.2f}), "
        + ("MISSED" if r.ratio_of_means > r.paper_ratio else "reached")
        for r in table.itertuples()
    )
    caption = (
        f"RMSE over {SEEDS} seeds, mean and standard deviation; a seed draws noise, poses and "
        f"muscle forces, the same for both models. {VIRTUAL} Ratio: {verdict}." + _elsewhere()
    )
    tables = {"testbed_errors": table, "testbed_errors_by_seed": seed_table()}
    title = "Both models on the virtual testbed, beside the paper's testbed"
    return Figure("testbed_errors", title, caption, draw, tables, (9.0, 4.2))


def _elsewhere() -> str:
    mean = errors(trials(SEEDS, FRICTION_ELSEWHERE, ELSEWHERE))["circle"].mean(axis=0)
    off = hysteresis(virtual_bed(FRICTION_ELSEWHERE), ELSEWHERE).angle_from_x
    return (
        f" The paper prints no posture; in the one taken here ({_in_degrees(POSTURE)}) the "
        f"hysteresis lies along x, as the paper says. At {_in_degrees(ELSEWHERE)}, where it is off "
        f"x by {off:.0f} deg, the circle's ratio is {mean[0] / mean[1]:.2f}. With the static model "
        "some fingertip forces of the inverse runs take hundreds of newtons."
    )


def _in_degrees(posture: Array) -> str:
    return "/".join(f"{x:.2g}" for x in np.degrees(posture)) + " deg"


def _hysteresis_figure() -> Figure:
    found = hysteresis(virtual_bed())
    along = (found.force - found.force[0]) @ found.direction
    off = found.force - 0.5 * (found.force[along.argmin()] + found.force[along.argmax()])
    turn = np.linspace(0.0, 2 * np.pi, 100)

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        axes.plot(REPORTED * np.cos(turn), REPORTED * np.sin(turn), ":", color="0.5",
                  label=f"+-{REPORTED} N, reported")  # fmt: skip
        axes.plot(*off.T, "o", color="#0072b2", ms=5, label="at rest after a disturbance")
        axes.plot(*off[0], "s", color="#d55e00", ms=7, label="before any")
        axes.set_aspect("equal")
        style_axes(axes, "distal (x), N", "dorsal, N")
        sheet.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)

    degrees = ", ".join(f"{x:g}" for x in np.degrees(TURNS))
    caption = (
        f"Sizing of the friction. {VIRTUAL} EDC and LUM at 5 N; PIP and DIP are turned by "
        f"{degrees} deg either way and let go. With mu = {FRICTION} at all routing points the "
        f"fingertip forces at rest differ by +-{found.half:.3f} N (the paper: up to +-0.5 N), "
        f"along ({found.direction[0]:+.2f}, {found.direction[1]:+.2f}), mostly x as the paper "
        f"says. The posture ({_in_degrees(POSTURE)}), which the paper does not print, was chosen "
        "for it."
    )
    table = pd.DataFrame(found.force, columns=["distal_N", "dorsal_N"])
    title = "Hysteresis of the fingertip force (virtual testbed)"
    return Figure("testbed_hysteresis", title, caption, draw, {"hysteresis": table}, (5.5, 5.5))


def _by_friction() -> Figure:
    rows = []
    for friction in OTHER_FRICTIONS:
        found = error_table(errors(trials(FEWER, friction)), REPORTED_ERRORS)
        found.insert(0, "half_hysteresis_N", hysteresis(virtual_bed(friction)).half)
        found.insert(0, "mu", friction)
        rows.append(found)
    table = pd.concat(rows, ignore_index=True)

    def draw(sheet: Sheet) -> None:
        for axes, name in zip(sheet.subplots(1, 3), REPORTED_ERRORS, strict=True):
            _one_experiment(axes, table[table.experiment == name])
            axes.set_title(name, fontsize=10)
            style_axes(axes, "hysteresis, +-N", "RMSE, N")
        handles = axes.get_legend_handles_labels()
        sheet.legend(*handles, loc="outside lower center", ncols=4, frameon=False)

    caption = (
        f"The same over friction ({FEWER} seeds; the joints' friction stays). {VIRTUAL} With "
        "little friction the interconnected model is left with the noise of its identification, "
        "the static one with its shares; much friction adds to both and draws them together. "
        "(Without any, the open-loop circle leaves the coupling curve in some seeds: arms known to "
        "some 5 % do not keep the share between 0 and 1 on their own.)"
    )
    title = "Errors against friction (virtual testbed)"
    return Figure(
        "testbed_friction", title, caption, draw, {"errors_by_friction": table}, (9.0, 3.8)
    )


def _one_experiment(axes: Axes, table: pd.DataFrame) -> None:
    x = table.half_hysteresis_N
    for model, (colour, dash) in MODELS.items():
        mark = "o" if model == "interconnected" else "s"
        axes.plot(x, table[f"{model}_N"], dash, color=colour, marker=mark, label=model)
        axes.plot(REPORTED, table[f"paper_{model}_N"].iloc[0], "D", color=colour, mfc="white",
                  ms=8, label=f"the paper's, {model}")  # fmt: skip
    axes.set_ylim(bottom=0.0)
