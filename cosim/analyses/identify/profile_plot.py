"""Profile likelihoods as curves, as a table and in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.analyses.identify.fit import NORMAL, Fit
from cosim.analyses.identify.parameters import FitParameter
from cosim.analyses.identify.profile import Profile
from cosim.results.compare import number
from cosim.results.picture import new_picture
from cosim.results.table import csv_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = "#0072b2", "#e69f00", "#009e73"
"""Okabe and Ito's palette for colour-blind readers; lines and marks differ too."""
ACROSS = 3
TOP = 2.5
"""Height of a chart over that of the limit."""


def profile_interval(parameter: FitParameter, profile: Profile) -> str:
    """The 95 % interval of a profile, in words; of a side left open, how far it looked."""
    ends = parameter.value(profile.coordinates[0]), parameter.value(profile.coordinates[-1])
    found = [None if z is None else parameter.value(z) for z in profile.interval]
    words = []
    for value, end, bound, side in zip(
        found, ends, (parameter.low, parameter.high), ("below", "above"), strict=True
    ):
        at = "its bound" if end == bound else "what was tried"
        words.append(number(value) if value is not None else f"{side} {at} {number(end)}")
    return " to ".join(words)


def profiles_csv(fit: Fit) -> str:
    """A line for each point of each profile: the parameter held, the sum of squared misses, and
    the values of all parameters."""
    names = [f"{p.name} ({p.unit})" if p.unit else p.name for p in fit.parameters]
    rows = [["held", "squared_misses", "above_least", "limit_95", *names]]
    for profile in fit.profiles:
        for x, squares in zip(profile.points, profile.squares, strict=True):
            values = [repr(p.value(z)) for p, z in zip(fit.parameters, x, strict=True)]
            sizes = [f"{v:.6g}" for v in (squares, squares - profile.least, profile.limit)]
            rows.append([profile.name, *sizes, *values])
    return csv_text(rows)


def draw_profiles(fit: Fit) -> Figure:
    """A chart for each parameter: its profile, the parabola of the linearised interval, the limit
    of the 95 % interval, and the interval."""
    count = len(fit.profiles)
    width = min(count, ACROSS)
    rows = -(-count // width)
    figure = new_picture(3.7 * width + 0.6, 3.1 * rows + 0.9)
    every = figure.subplots(rows, width, squeeze=False).ravel()
    for axes, parameter, profile in zip(every, fit.parameters, fit.profiles, strict=False):
        _draw(axes, fit, parameter, profile)
    for axes in every[count:]:
        axes.set_visible(False)
    labels: dict[str, Any] = {}
    for axes in every[:count]:
        handles, words = axes.get_legend_handles_labels()
        labels |= dict(zip(words, handles, strict=True))
    figure.legend(
        labels.values(), labels.keys(), loc="outside upper center", ncols=3, fontsize=8,
        frameon=False,
    )  # fmt: skip
    figure.supylabel("sum of squared misses above the least (SD²)", fontsize=9)
    return figure


def _draw(axes: Axes, fit: Fit, parameter: FitParameter, profile: Profile) -> None:
    x = np.array([parameter.value(z) for z in profile.coordinates])
    axes.plot(
        x, profile.squares - profile.least, "o-", color=BLUE, ms=4, lw=1.6,
        label="profile: the others fitted again",
    )  # fmt: skip
    names = [p.name for p in fit.within]
    best = parameter.coordinate(fit.values[parameter.name])
    if parameter.name in names:
        deviation = fit.confidence.deviation[names.index(parameter.name)]
        if np.isfinite(deviation):
            z = np.linspace(profile.coordinates[0], profile.coordinates[-1], 80)
            height = profile.limit * ((z - best) / (NORMAL * deviation)) ** 2
            at = [parameter.value(v) for v in z]
            axes.plot(at, height, "--", color=ORANGE, lw=1.4, label="linearised")
    axes.axhline(profile.limit, color="0.35", lw=1, ls=":", label="limit of the 95 % interval")
    low, high = (
        x[end] if z is None else parameter.value(z)
        for z, end in zip(profile.interval, (0, -1), strict=True)
    )
    axes.axvspan(low, high, color="0.6", alpha=0.2, lw=0, label="95 % interval of the profile")
    axes.plot(fit.values[parameter.name], 0, "D", color=GREEN, ms=7, zorder=4, label="fitted")
    for bound in (parameter.low, parameter.high):
        if bound in (x[0], x[-1]):
            axes.axvline(bound, color="black", lw=1.2, ls="-.", label="bound")
    if parameter.scale == "logarithmic" and x[-1] > 10 * x[0]:
        axes.set_xscale("log")
    axes.set_ylim(-0.06 * TOP * profile.limit, TOP * profile.limit)
    axes.set_xlabel(f"{parameter.name} ({parameter.unit})" if parameter.unit else parameter.name)
    axes.grid(alpha=0.25)
