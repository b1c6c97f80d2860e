"""The pictures of a study: band with measured values, influences, scatter, surface."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.port import Array
from cosim.results.compare import Target, reference_text
from cosim.results.picture import new_picture
from cosim.study.answers import Indices, ResponseSurface, Slopes
from cosim.study.results import StudyResults

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = "#0072b2", "#e69f00", "#009e73"
"""Colours of Okabe and Ito's palette for colour-blind readers; hatch and shape differ too."""
ACROSS = 4
MOST_POINTS = 4000
"""Most points of a scatter that are drawn; the band and the answers are of all."""
GRID = 60
BINS = 8


def axis_label(study: StudyResults, name: str) -> str:
    """A parameter or output with its unit, as an axis says it."""
    unit = study.units[name]
    return study.label(name) + ("" if unit == "1" else f" ({unit})")


def draw_band(study: StudyResults, output: str, targets: Sequence[Target]) -> Figure:
    """The distribution over the runs, its middle 50 and 95 %, and measured values on its scale."""
    figure = new_picture(8.4, 2.6 + 0.28 * len(targets))
    axes = figure.subplots()
    values = study.values(output)
    values = values[np.isfinite(values)]
    axes.hist(values, bins=min(40, max(8, len(values) // 12)), color=BLUE, alpha=0.75)
    if (band := study.band(output)) is not None:
        low, quarter, middle, upper, high = band.quantiles
        axes.axvspan(low, high, color="0.6", alpha=0.18, lw=0, label="95 % of the runs")
        axes.axvspan(quarter, upper, color="0.6", alpha=0.3, lw=0, label="50 % of the runs")
        axes.axvline(middle, color="black", lw=1.2, label="median")
    top = axes.get_ylim()[1]
    for i, target in enumerate(targets):
        _draw_target(axes, target, top * (1.1 + 0.16 * i))
    axes.set_ylim(0, top * (1.05 + 0.16 * len(targets)))
    axes.set_xlabel(axis_label(study, output))
    axes.set_ylabel("runs")
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return figure


def _draw_target(axes: Axes, target: Target, height: float) -> None:
    label = fill(f"{target.kind}: {target.name}, {reference_text(target)}", 42)
    look: Any = {"color": GREEN, "label": label}
    if target.reference is not None:
        spread = target.sd if target.sd is not None else None
        axes.errorbar(target.reference, height, xerr=spread, fmt="D", capsize=4, ms=5, **look)
        return
    ends = [e for e in (target.low, target.high) if e is not None]
    axes.plot(ends, [height] * len(ends), marker="|", ms=11, lw=2.5, **look)


def draw_influence(study: StudyResults, output: str) -> Figure | None:
    """Tornado of the slopes, and Sobol's indices with their intervals where there are any."""
    slopes, indices = study.slopes(output), study.sobol(output)
    if slopes is None and indices is None:
        return None
    names = strongest(study, output)
    panels = (slopes is not None) + (indices is not None)
    size = (4.6 * panels + 1.6, 1.3 + 0.34 * len(names))
    figure = new_picture(*size)
    every = list(np.atleast_1d(figure.subplots(1, panels, sharey=True)))
    every[0].set_yticks(range(len(names)), [fill(study.label(n), 30) for n in names], fontsize=9)
    every[0].set_ylim(len(names) - 0.4, -0.6)
    if slopes is not None:
        _draw_slopes(every[0], study, slopes, names)
    if indices is not None:
        _draw_indices(every[-1], study, indices, names)
    for axes in every:
        axes.grid(axis="x", alpha=0.3)
        axes.set_axisbelow(True)
    return figure


def draw_screening(study: StudyResults, output: str) -> Figure | None:
    """Morris' mean size of the effects and their SD, a mark for each parameter."""
    found = study.screening(output)
    if found is None:
        return None
    figure = new_picture(8.6, 4.6)
    axes = figure.subplots()
    across, up = found.mu_star, found.sigma
    top = 1.12 * float(max((across + found.mu_star_conf).max(), (up + found.sigma_conf).max()))
    top = top or 1.0
    axes.plot([0, top], [0, top], color="0.35", lw=1, ls="--", label="σ = μ*")
    order = sorted(range(len(across)), key=lambda i: -across[i])
    colours = (BLUE, ORANGE, GREEN, "#cc79a7", "#56b4e9", "#d55e00", "black")
    for place, i in enumerate(order):
        axes.errorbar(
            across[i], up[i], xerr=found.mu_star_conf[i], yerr=found.sigma_conf[i], capsize=2,
            fmt="osD^vP*X<>"[place % 10], color=colours[place % len(colours)], ms=6, lw=1,
            label=fill(study.label(study.parameters[i]), 34),
        )  # fmt: skip
    axes.set_xlim(-0.02 * top, top)
    axes.set_ylim(-0.02 * top, top)
    unit = study.units[output]
    of = "" if unit == "1" else f" ({unit})"
    axes.set_xlabel(f"μ*: mean size of the parameter's effect{of}")
    axes.set_ylabel(f"σ: SD of the effect{of}")
    lost = found.planned - found.trajectories
    missing = f"; {lost} of {found.planned} trajectories left out" if lost else ""
    title = f"Morris' screening of {study.label(output)}; bars: 95 % intervals{missing}"
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.25)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return figure


def strongest(study: StudyResults, output: str) -> list[str]:
    """The numeric parameters, the strongest first: by total index, by Morris' mean size of effect,
    else by slope."""
    indices, slopes, effects = study.sobol(output), study.slopes(output), study.screening(output)
    if effects is not None:
        weight = dict(zip(study.parameters, effects.mu_star, strict=True))
    elif indices is not None:
        weight = dict(zip(study.parameters, indices.total, strict=True))
    elif slopes is not None:
        weight = dict(zip(study.numeric, np.abs(slopes.slope), strict=True))
    else:
        weight = {}
    return sorted(study.numeric, key=lambda name: -weight.get(name, 0.0))


def _draw_slopes(axes: Axes, study: StudyResults, slopes: Slopes, names: Sequence[str]) -> None:
    for place, name in enumerate(names):
        i = study.numeric.index(name)
        value, colour = slopes.slope[i], BLUE if slopes.slope[i] >= 0 else ORANGE
        hatch = "" if value >= 0 else "////"
        axes.barh(place, value, 0.62, color=colour, hatch=hatch, edgecolor="white", lw=0)
        axes.errorbar(value, place, xerr=2 * slopes.error[i], color="black", lw=1, capsize=2)
    axes.axvline(0, color="black", lw=0.8)
    axes.set_xlabel(
        "SDs of the output for one SD of the parameter (±2 standard errors)", fontsize=8
    )
    axes.set_title(f"Tornado; a straight line explains {max(slopes.r2, 0):.0%}", fontsize=10)


def _draw_indices(axes: Axes, study: StudyResults, indices: Indices, names: Sequence[str]) -> None:
    at = [study.parameters.index(name) for name in names]
    places = np.arange(len(names))
    parts = (
        (indices.first, indices.first_conf, -0.17, BLUE, "", "first order"),
        (indices.total, indices.total_conf, 0.17, ORANGE, "////", "total"),
    )
    for value, width, shift, colour, hatch, label in parts:
        look: Any = {"color": colour, "hatch": hatch, "edgecolor": "white", "lw": 0}
        axes.barh(places + shift, value[at], 0.32, label=label, **look)
        axes.errorbar(
            value[at], places + shift, xerr=width[at], fmt="none", color="black", lw=1, capsize=2
        )
    axes.axvline(0, color="black", lw=0.8)
    axes.set_xlabel("share of the variance (95 % intervals)", fontsize=8)
    lost = indices.planned - indices.blocks
    missing = f"; {lost} of {indices.planned} blocks left out" if lost else ""
    axes.set_title(f"Sobol's indices{missing}", fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="lower right")


def draw_scatter(study: StudyResults, output: str) -> Figure | None:
    """The output against each numeric parameter, with the means of equal parts of the runs."""
    names = strongest(study, output)
    if not names:
        return None
    values = study.values(output)
    finite = np.flatnonzero(np.isfinite(values))
    shown = finite[:: max(1, -(-len(finite) // MOST_POINTS))]
    rows = -(-len(names) // ACROSS)
    width = min(len(names), ACROSS)
    figure = new_picture(2.75 * width + 0.7, 2.4 * rows)
    every = np.atleast_1d(figure.subplots(rows, width, sharey=True, squeeze=False)).ravel()
    for axes, name in zip(every, names, strict=False):
        x = study.table[name].to_numpy(float)
        axes.plot(x[shown], values[shown], ".", color=BLUE, ms=4, alpha=0.6, mew=0)
        axes.plot(*_means(x[finite], values[finite]), color="black", lw=1.4)
        axes.set_xlabel(fill(axis_label(study, name), 34), fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25)
    for axes in every[len(names) :]:
        axes.set_visible(False)
    figure.supylabel(axis_label(study, output), fontsize=9)
    return figure


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of x and y over bins with as many runs each, or at each value of x if few."""
    distinct = np.unique(x)
    if len(distinct) <= BINS:
        return distinct, np.array([y[x == value].mean() for value in distinct])
    parts = np.array_split(np.argsort(x, kind="stable"), min(BINS, len(x)))
    return np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])


def draw_surface(study: StudyResults, output: str, fit: ResponseSurface) -> Figure | None:
    """The quadratic over the two strongest parameters, the others at their means."""
    names = strongest(study, output)[:2]
    if len(names) < 2:
        return None
    figure = new_picture(5.6, 4.2)
    axes = figure.subplots()
    at = [study.numeric.index(name) for name in names]
    inputs = study.inputs
    ends = [np.linspace(inputs[:, i].min(), inputs[:, i].max(), GRID) for i in at]
    across, along = np.meshgrid(*ends)
    x = np.tile(fit.mean, (across.size, 1))
    x[:, at[0]], x[:, at[1]] = across.ravel(), along.ravel()
    drawn = axes.contourf(across, along, fit(x).reshape(across.shape), 14, cmap="viridis")
    lines = axes.contour(
        across, along, fit(x).reshape(across.shape), 7, colors="white", linewidths=0.6
    )
    axes.clabel(lines, fontsize=7)
    figure.colorbar(drawn, label=axis_label(study, output))
    axes.plot(inputs[:MOST_POINTS, at[0]], inputs[:MOST_POINTS, at[1]], ".", color="black", ms=1.5)
    axes.set_xlabel(axis_label(study, names[0]))
    axes.set_ylabel(axis_label(study, names[1]))
    return figure
