"""The pictures of `cosim hood`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.hood_gallery.literature import (
    COUPLINGS,
    LEAST_SHARE,
    LEE_BAND,
    LEE_RATIO,
    REST_SLIP,
    REST_TORQUE,
    YOUNG_RAYAN,
    buchner_height,
    dip_on_coupling,
)
from cases.hood_gallery.poses import JOINTS, Posture, SolvedPose, posture_name
from cosim.report.figures import legend_below, style_axes
from cosim.results.looks import look
from cosim.results.picture import new_picture

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

CENTRAL, TERMINAL = "#0b5394", "#b45309"
SHADE: dict[str, Any] = {"color": "0.92", "zorder": 0, "lw": 0}
SAGITTAL_LINES = {
    "tendon": "to the tendon, from the metacarpal's square",
    "tendon_local": "to the tendon, from the tendon's own square",
    "edge": "to the sheet's edge, from the metacarpal's square",
    "edge_local": "to the sheet's edge, from the tendon's own square",
}
LINES = ("#88ccee", "#0b5394", "#b45309", "#ddaa66")
"""Colours of the couplings' lines, in their order."""


def _mark_failures(axes: Axes, x: Sequence[float]) -> None:
    """A cross at the bottom of a panel for each pose without equilibrium."""
    if len(x):
        bottom = axes.get_xaxis_transform()
        axes.plot(x, np.full(len(x), 0.04), "x", color="black", ms=6, mew=1.6, transform=bottom)


def draw_rest(
    known: Mapping[Posture, SolvedPose], mcps: Sequence[float], pips: Sequence[float]
) -> Sheet:
    """A row of panels for each joint's torque and each slip, a column for each MCP angle."""
    sheet = new_picture(8.0, 9.5)
    rows = [(f"torque_{j}_Nmm", f"{j} torque, N mm", REST_TORQUE) for j in JOINTS]
    rows += [(f"{s}_slip_N", f"{s} slip, N", REST_SLIP) for s in ("central", "terminal")]
    panels = sheet.subplots(len(rows), len(mcps), sharex=True, sharey="row", squeeze=False)
    for line, (name, label, bound) in zip(panels, rows, strict=True):
        for axes, mcp in zip(line, mcps, strict=True):
            axes.axhspan(0.0 if "slip" in name else -bound, bound, **SHADE)
            axes.axhline(0.0, color="0.6", lw=0.7)
            _draw_couplings(axes, known, mcp, pips, name)
            style_axes(axes, "", "")
        line[0].set_ylabel(label, fontsize=9)
    for axes, mcp in zip(panels[0], mcps, strict=True):
        axes.set_title(f"MCP {mcp:g} deg", fontsize=10)
    for axes in panels[-1]:
        axes.set(xlabel="PIP, deg", xticks=list(pips))
    legend_below(sheet, 4, panels[0, 0], fontsize=9)
    return sheet


def _draw_couplings(
    axes: Axes, known: Mapping[Posture, SolvedPose], mcp: float, pips: Sequence[float], name: str
) -> None:
    lost: set[float] = set()
    for coupling, colour in zip(COUPLINGS, LINES, strict=True):
        poses = [known[mcp, pip, dip_on_coupling(coupling, pip)] for pip in pips]
        values = [pose.numbers.get(name, np.nan) for pose in poses]
        dash = "-" if coupling in ("Buchner", "0.7 PIP") else ":"
        axes.plot(pips, values, "o" + dash, color=colour, ms=3.5, lw=1.5, label=f"DIP: {coupling}")
        lost |= {pip for pip, pose in zip(pips, poses, strict=True) if not pose.converged}
    _mark_failures(axes, sorted(lost))


def draw_slips(by_posture: Sequence[SolvedPose], by_load: Sequence[SolvedPose]) -> Sheet:
    """Forces (above) and ratio (below), by posture (left) and by load (right)."""
    sheet = new_picture(8.0, 6.4)
    panels = sheet.subplots(2, 2, width_ratios=(3, 2))
    (forces, shares), (ratios, levels) = panels
    x = np.arange(len(by_posture))
    slips = [(s, c) for s, c in (("central", CENTRAL), ("terminal", TERMINAL))]
    for shift, (slip, colour) in zip((-0.2, 0.2), slips, strict=True):
        values = [pose.numbers.get(f"{slip}_slip_N", np.nan) for pose in by_posture]
        forces.bar(x + shift, values, 0.38, color=colour, label=f"{slip} slip")
    least = [LEAST_SHARE * dict(pose.pull)["EDC"] for pose in by_posture]
    forces.plot(x, least, ":", color="black", lw=1.2, label="a tenth of EDC")
    ratios.plot(x, [p.numbers.get("slip_ratio", np.nan) for p in by_posture], "o", color="0.15")
    for axes in (forces, ratios):
        axes.set_xticks(x, [posture_name(p.posture) for p in by_posture], rotation=45, fontsize=8)
        axes.set_xlim(-0.6, len(x) - 0.4)
        _mark_failures(axes, [i for i, p in enumerate(by_posture) if not p.converged])
    for k, posture in enumerate(dict.fromkeys(pose.posture for pose in by_load)):
        poses = [pose for pose in by_load if pose.posture == posture]
        tension = [dict(pose.pull)["EDC"] for pose in poses]
        mark, name = ("o-", "s--")[k % 2], posture_name(posture)
        for slip, colour in slips:
            share = [p.numbers.get(f"{slip}_slip_N", np.nan) for p in poses]
            shares.plot(tension, np.divide(share, tension), mark, color=colour, ms=4, lw=1.4)
        ratio = [pose.numbers.get("slip_ratio", np.nan) for pose in poses]
        levels.plot(tension, ratio, mark, color="0.15", ms=4, lw=1.4, label=name)
        for axes in (shares, levels):
            _mark_failures(
                axes, [t for t, p in zip(tension, poses, strict=True) if not p.converged]
            )
    shares.axhline(LEAST_SHARE, color="black", ls=":", lw=1.2)
    for axes in (ratios, levels):
        axes.axhspan(*LEE_BAND, **SHADE)
        axes.axhline(LEE_RATIO, color="0.4", ls="--", lw=1.0, zorder=1)
    style_axes(forces, "", "force, N")
    style_axes(ratios, "MCP/PIP/DIP, deg", "terminal over central slip")
    style_axes(shares, "", "slip force over EDC tension")
    style_axes(levels, "EDC tension, N", "terminal over central slip")
    for axes in (forces, shares, ratios, levels):
        axes.set_ylim(0.0, max(1.08 * axes.dataLim.y1, 0.1))
    levels.set(yscale="log", ylim=(0.5, 30.0))
    levels.set_yticks([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
    levels.minorticks_off()
    for axes in (shares, levels):
        axes.set_xticks(tension, [f"{t:g}" for t in tension])
    levels.legend(frameon=False, fontsize=8, title="MCP/PIP/DIP", title_fontsize=8)
    ratios.text(len(x) - 0.5, LEE_RATIO + 0.03, "Lee 2008", fontsize=8, color="0.35", ha="right")
    legend_below(sheet, 3, forces, fontsize=9)
    return sheet


def draw_arms(table: pd.DataFrame, known: pd.DataFrame, tendons: Sequence[str]) -> Sheet:
    """Arms above, excursions below; a column for each joint."""
    sheet = new_picture(9.0, 6.4)
    from matplotlib.lines import Line2D

    panels = sheet.subplots(2, len(JOINTS), sharex="col", sharey="row")
    looks = {tendon: look(i) for i, tendon in enumerate(tendons)}
    for (above, below), joint in zip(panels.T, JOINTS, strict=True):
        swept = table[table.joint == joint]
        for tendon, part in swept.groupby("tendon", sort=False):
            style: dict[str, Any] = {**looks[str(tendon)].line, "marker": "o", "ms": 3, "lw": 1.6}
            above.plot(part.angle_deg, part.arm_mm, **style)
            below.plot(part.angle_deg, part.excursion_mm, **style)
        for row in known[known.joint == joint].itertuples():
            mark = "D" if str(row.source).startswith("An") else "x"
            colour = looks[str(row.tendon)].colour
            above.plot(0.0, row.arm_mm, mark, color=colour, ms=6, mew=1.6, mfc="white", zorder=4)
        gone = swept[swept.arm_mm.isna()].angle_deg.unique()
        for axes in (above, below):
            axes.axhline(0.0, color="0.6", lw=0.7)
            style_axes(axes, "", "")
            _mark_failures(axes, list(gone))
        above.set_title(f"{joint} alone", fontsize=10)
        below.set_xlabel(f"{joint}, deg")
    panels[0, 0].set_ylabel("arm about the joint that moves, mm")
    panels[1, 0].set_ylabel("excursion from straight, mm")
    handles = [Line2D([], [], label=tendon, **looks[tendon].line) for tendon in tendons]
    plain: dict[str, Any] = {"color": "0.3", "ls": "", "mfc": "white", "mew": 1.6}
    if len(known):
        handles.append(Line2D([], [], marker="D", label="EDC's height, An 1979", **plain))
        handles.append(Line2D([], [], marker="x", label="MyoHand", **plain))
    sheet.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return sheet


def draw_bands(heights: pd.DataFrame, glides: pd.DataFrame) -> Sheet:
    """Heights of the lateral bands (left), glide of terminal slip and lateral bands (right)."""
    sheet = new_picture(11.0, 4.6)
    left, middle, right = sheet.subplots(1, 3)
    fine = np.linspace(0.0, 90.0, 91)
    left.plot(fine, buchner_height(fine), color="0.65", lw=3, label="Buchner (assumption)")
    for (load, way), part in heights.groupby(["load", "way"], sort=False):
        dash, back = ("--" if load == "rest" else "-"), way == "extension"
        for side, colour in (("radial", CENTRAL), ("ulnar", TERMINAL)):
            style: dict[str, Any] = {
                "color": colour,
                "ms": 5 if back else 3.5,
                "mfc": "white" if back else colour,
            }
            label = f"{side}, {load}" if not back else None
            mark = "o" if back else f"o{dash}"
            left.plot(part.PIP_deg, part[f"{side}_mm"], mark, lw=1.5, label=label, **style)
    _mark_failures(left, list(heights[heights.mean_mm.isna()].PIP_deg.unique()))
    left.axhline(0.0, color="0.6", lw=0.7)
    style_axes(left, "PIP, deg", "lateral bands over the PIP's axis, mm dorsal")
    for axes, (name, words) in zip((middle, right), GLIDES.items(), strict=True):
        _draw_glide(axes, glides, name)
        style_axes(axes, "angle of the joint that moves, deg", f"glide of the {words}, mm distal")
    for axes in (left, middle, right):
        handles, names = axes.get_legend_handles_labels()
        low, high = axes.get_ylim()
        axes.set_ylim(low - 0.06 * (high - low), high + 0.34 * (high - low))
        form: dict[str, Any] = {"ncols": 2, "frameon": False, "fontsize": 7.5, "handlelength": 2.8}
        axes.legend(handles, names, loc="upper left", columnspacing=0.8, **form)
    return sheet


GLIDES = {"terminal_slip_mm": "terminal slip", "lateral_bands_mm": "lateral bands at the PIP"}


def _draw_glide(axes: Axes, glides: pd.DataFrame, name: str) -> None:
    """Draw the glide of one part of the hood, a line for each joint and load."""
    for i, joint in enumerate(JOINTS):
        for load, part in glides[glides.joint == joint].groupby("load", sort=False):
            dash = "--" if load == "rest" else "-"
            line: dict[str, Any] = {"color": look(i).colour, "ls": dash, "ms": 3.5, "lw": 1.5}
            label = f"{joint}, {load}"
            axes.plot(part.angle_deg, part[name], marker="o", label=label, **line)
    _mark_failures(axes, list(glides[glides[name].isna()].angle_deg.unique()))
    axes.axhline(0.0, color="0.6", lw=0.7)


def draw_sagittal(table: pd.DataFrame) -> Sheet:
    """Angle of the bands to the square against the MCP."""
    sheet = new_picture(7.4, 4.8)
    axes = sheet.subplots()
    for i, (line, words) in enumerate(SAGITTAL_LINES.items()):
        for load, part in table.groupby("load", sort=False):
            dash = "--" if load == "rest" else "-"
            style: dict[str, Any] = {
                "color": look(i).colour,
                "ls": dash,
                "marker": "o",
                "ms": 3.5,
                "lw": 1.5,
            }
            label = words if load != "rest" else None
            axes.plot(part.MCP_deg, part[f"{line}_deg"], label=label, **style)
    axes.plot(list(YOUNG_RAYAN), list(YOUNG_RAYAN.values()), "D", color="black", mfc="white", ms=7,
              mew=1.6, label="Young and Rayan 2000", zorder=5)  # fmt: skip
    _mark_failures(axes, list(table[table.tendon_deg.isna()].MCP_deg.unique()))
    axes.axhline(0.0, color="0.6", lw=0.7)
    style_axes(axes, "MCP, deg", "sagittal bands from the square, deg distal")
    axes.plot([], [], "-", color="0.4", label="EDC 3 N")
    axes.plot([], [], "--", color="0.4", label="rest")
    legend_below(sheet, 2, axes, fontsize=9)
    return sheet
