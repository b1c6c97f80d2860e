"""Section IV-B of paper 000: parameters from excursions, with and without the coupling curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.report.figures import Figure, style_axes
from rigid.papers.networks.excursion_fit import EXTENSOR, Identified, dip_of_pip, identify
from rigid.papers.networks.excursion_fit_check import (
    NORMAL_95,
    Draws,
    draw_samples,
    repeat,
    true_parameters,
)
from rigid.papers.networks.robotic_finger import robotic_finger

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

DRAWS = 200
LOOKS = {"excursions alone": ("#d55e00", "s"), "with the coupling curve": ("#0072b2", "o")}


def identification_figures() -> list[Figure]:
    """The figure of what is identified from postures, and from postures and a curve."""
    poses, curve = draw_samples(0)
    fits = dict(zip(LOOKS, (identify(poses), identify(poses, curve)), strict=True))
    draws = dict(zip(LOOKS, repeat(DRAWS), strict=True))
    truth = true_parameters(robotic_finger())

    def draw(sheet: Sheet) -> None:
        left, right = sheet.subplots(1, 2, width_ratios=(3, 4))
        _curves(left, fits, truth)
        _intervals(right, fits, truth)
        sheet.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3,
                     frameon=False)  # fmt: skip

    return [
        Figure(
            "figure_6_identification",
            "Section IV-B: identified from 700 poses with 1.5 mm of noise",
            _caption(fits, draws),
            draw,
            {
                "identified": _table(fits, truth),
                "identified_coverage": _coverage(draws),
            },
            (9.0, 4.4),
        )
    ]


def _curves(axes: Axes, fits: dict[str, Identified], truth: dict[str, float]) -> None:
    _, curve = draw_samples(0)
    axes.plot(*np.degrees(curve.angle[:, 1:].T), ".", color="0.6", ms=4, label="observed")
    pip = np.linspace(0.0, 1.75, 100)
    for fit, (colour, _) in zip(fits.values(), LOOKS.values(), strict=True):
        found = fit.value[[fit.names.index(n) for n in EXTENSOR]]
        axes.plot(np.degrees(pip), np.degrees(dip_of_pip(found, pip)), color=colour, lw=1.6)
    true = np.array([truth[n] for n in EXTENSOR])
    axes.plot(np.degrees(pip), np.degrees(dip_of_pip(true, pip)), "--", color="black", lw=1.0)
    style_axes(axes, "PIP, deg", "DIP on the coupling curve, deg")


def _intervals(axes: Axes, fits: dict[str, Identified], truth: dict[str, float]) -> None:
    for shift, (name, fit) in zip((0.15, -0.15), fits.items(), strict=True):
        rows = [fit.names.index(n) for n in EXTENSOR]
        off = 1e3 * (fit.value[rows] - [truth[n] for n in EXTENSOR])
        colour, mark = LOOKS[name]
        half = 1e3 * NORMAL_95 * fit.deviation[rows]
        at = np.arange(len(EXTENSOR)) + shift
        axes.errorbar(off, at, xerr=half, fmt=mark, color=colour, capsize=3, label=name)
    axes.axvline(0.0, color="black", ls="--", lw=1.0, label="truth")
    axes.set_yticks(range(len(EXTENSOR)), EXTENSOR)
    style_axes(axes, "estimate less truth with 95 % interval, mm (slope: mm/rad)", "")


def _caption(fits: dict[str, Identified], draws: dict[str, Draws]) -> str:
    alone, joined = draws.values()
    rows = [alone.names.index(n) for n in EXTENSOR]
    narrower = (joined.deviation / alone.deviation).mean(axis=0)[rows]
    ratios = ", ".join(f"{n} x {r:.3g}" for n, r in zip(EXTENSOR, narrower, strict=True))
    return (
        "Second-order excursions of FDP and FDS by linear least squares, EDC and LUM over slip and "
        f"bands by Gauss and Newton. Over {DRAWS} draws of the noise the 95 % intervals hold the "
        f"truth in {100 * alone.coverage:.1f} % of all cases without and "
        f"{100 * joined.coverage:.1f} % with the constraint l_LB = l_ES on the observed curve, and "
        f"the constraint narrows them: {ratios}. Excursions' residual "
        f"{1e3 * fits['with the coupling curve'].rms:.2f} mm RMS; the paper has 1.54 mm and prints "
        "no parameter. Ours: a finger without friction (robotic_finger.py), poses spread evenly, "
        "100 points on the curve with 0.1 deg of noise."
    )


def _table(fits: dict[str, Identified], truth: dict[str, float]) -> pd.DataFrame:
    alone, joined = fits.values()
    return pd.DataFrame(
        {
            "parameter": alone.names,
            "truth_mm_or_mm_per_rad": [1e3 * truth[n] for n in alone.names],
            "excursions_alone": 1e3 * alone.value,
            "excursions_alone_95": 1e3 * NORMAL_95 * alone.deviation,
            "with_coupling": 1e3 * joined.value,
            "with_coupling_95": 1e3 * NORMAL_95 * joined.deviation,
        }
    )


def _coverage(draws: dict[str, Draws]) -> pd.DataFrame:
    alone, joined = draws.values()
    covered = [(np.abs(d.miss) < NORMAL_95).mean(axis=0) for d in (alone, joined)]
    return pd.DataFrame(
        {
            "parameter": alone.names,
            "covered_excursions_alone": covered[0],
            "covered_with_coupling": covered[1],
            "width_with_over_without": (joined.deviation / alone.deviation).mean(axis=0),
        }
    )
