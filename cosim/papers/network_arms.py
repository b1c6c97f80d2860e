"""Figure 3 of paper 000: effective moment arms at the PIP, and how sharply they switch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.port import Array
from cosim.report.figures import Figure, style_axes
from rigid.hoods.network import Network
from rigid.hoods.two_band import coupled_dip, lateral_band, middle_band
from rigid.papers.networks.arm_switch import Switch, switch
from rigid.papers.networks.human_network import OPERATING_FORCE, human_finger

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

PIP, DIP_SECTION = 1, np.radians(45.0)
SHOWN = {"EDC": ("#0072b2", "-"), "LUM": ("#d55e00", "-"), "UI": ("black", ":")}
"""Colour and dash of the muscles over the extensor mechanism."""
FORCES = np.geomspace(0.01, 100.0, 33)
"""N, f_m0."""
STIFFER = (0.5, 1.0, 2.0)
GRID = np.linspace(0.0, 110.0, 221), np.linspace(0.0, 90.0, 181)
"""deg, of PIP and DIP."""
ARMS_OURS = (
    "The arms of the paper's tendons but the slip's (-5 mm) are not printed; ours are Buchner's "
    "(1988): r_LB = -5 mm + 2.42 mm/rad PIP, r_TE = -3.5 mm. Stiffnesses, connections and f_m0 = "
    "10 N are the paper's."
)


def arm_figures() -> list[Figure]:
    """Figures of the connecting tendons' moment arms."""
    network = human_finger()
    return [_contours(network), _sections(network), _widths(network)]


def _arms(network: Network, pip: Array, dip: Array, force: float) -> Array:
    """(..., 6) mm, effective arms at the PIP at angles in deg."""
    angle = np.stack(np.broadcast_arrays(0.0, np.radians(pip), np.radians(dip)), axis=-1)
    same = np.full((*angle.shape[:-1], len(network.muscles)), force)
    return 1e3 * network.effective_arms(angle, same)[..., PIP, :]


def _contours(network: Network) -> Figure:
    pip, dip = np.meshgrid(*GRID)
    arm = _arms(network, pip, dip, OPERATING_FORCE)[..., 0]
    curve = np.degrees(coupled_dip(np.radians(GRID[0])))

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        filled = axes.contourf(pip, dip, arm, np.arange(-5.25, 0.25, 0.25), cmap="cividis")
        axes.contour(pip, dip, arm, np.arange(-4.5, -0.5, 0.5), colors="white", linewidths=0.5)
        axes.plot(GRID[0], curve, color="#d55e00", lw=1.8, label="coupling curve, l_LB = l_ES")
        axes.axhline(45.0, color="black", lw=0.9, ls="--", label="section of the next figure")
        axes.text(10, 70, "lateral bands bear:\nr_LB(PIP)", color="white", fontsize=9)
        axes.text(78, 10, "slip bears:\nr_ES = -5 mm", color="white", fontsize=9)
        axes.set(xlabel="PIP, deg", ylabel="DIP, deg", xlim=(0, 110), ylim=(0, 90))
        sheet.colorbar(filled, label="effective arm of EDC at the PIP, mm")
        sheet.legend(loc="outside lower center", ncols=2, frameon=False)

    caption = (
        "Figure 3b: above the coupling curve all of EDC's force runs over the lateral bands, below "
        f"it all over the slip, and the arm switches along it. {ARMS_OURS}"
    )
    long = pd.DataFrame({"PIP_deg": pip[::5, ::5].ravel(), "DIP_deg": dip[::5, ::5].ravel()})
    long["EDC_arm_at_PIP_mm"] = arm[::5, ::5].ravel()
    on = pd.DataFrame({"PIP_deg": GRID[0][::5], "coupling_DIP_deg": curve[::5]})
    tables = {"figure_3_contours": long, "figure_3_coupling_curve": on}
    title = "Figure 3b: effective arm of EDC at the PIP"
    return Figure("figure_3_contours", title, caption, draw, tables, (7.0, 5.0))


def _sections(network: Network) -> Figure:
    pip = np.unique(np.concatenate([GRID[0], np.linspace(80.0, 92.0, 241)]))
    arms = _arms(network, pip, np.degrees(DIP_SECTION), OPERATING_FORCE)
    of = {name: arms[:, network.muscles.index(name)] for name in SHOWN}
    bounds = list(zip(_bands(pip).items(), ("--", "-."), strict=True))

    def draw(sheet: Sheet) -> None:
        whole, near = sheet.subplots(1, 2, width_ratios=(3, 2))
        for axes in (whole, near):
            for (name, arm), (colour, dash) in zip(of.items(), SHOWN.values(), strict=True):
                axes.plot(pip, arm, dash, color=colour, lw=1.8, label=name)
            for (words, band), dash in bounds:
                axes.plot(pip, band, dash, color="0.5", lw=0.9, zorder=0, label=words)
            style_axes(axes, "PIP, deg", "effective arm at the PIP, mm")
        near.set(xlim=(81, 91), ylim=(-5.2, -1.0), title="at the switch (d)")
        whole.set(xlim=(0, 110), ylim=(-5.2, 0.0), title="DIP 45 deg (c)")
        handles = whole.get_legend_handles_labels()
        sheet.legend(*handles, loc="outside lower center", ncols=5, frameon=False)

    ends = {name: switch(network, network.muscles.index(name), DIP_SECTION, 10.0) for name in SHOWN}
    words = "; ".join(
        f"{name} {np.degrees(s.begin):.2f} to {np.degrees(s.end):.2f} deg"
        for name, s in ends.items()
    )
    caption = (
        f"Figure 3c and d. Both ways bear (f_m0 = 10 N): {words}. LUM and UI, on softer tendons "
        "(75 and 43 N/mm beside 126 and 2 x 40), switch less sharply than EDC, as in the paper; "
        f"theirs are the same numbers and one line. {ARMS_OURS}"
    )
    table = pd.DataFrame({"PIP_deg": pip, **{f"{n}_mm": a for n, a in of.items()}})
    title = "Figure 3c, d: effective arms at the PIP for DIP 45 deg"
    return Figure(
        "figure_3_sections", title, caption, draw, {"figure_3_sections": table}, (8.5, 4.2)
    )


def _bands(pip: Array) -> dict[str, Array]:
    """mm, the arms of one way alone."""
    ways = {"r_LB": lateral_band()["PIP"], "r_ES": middle_band()["PIP"]}
    return {name: 1e3 * (c + s * np.radians(pip)) for name, (c, s) in ways.items()}


def _widths(network: Network) -> Figure:
    stiffer = {factor: replace(network, stiffness=factor * network.stiffness) for factor in STIFFER}
    width = {("EDC", factor): _width(made, 0, FORCES) for factor, made in stiffer.items()} | {
        ("LUM, UI", 1.0): _width(network, 1, FORCES)
    }

    def draw(sheet: Sheet) -> None:
        axes: Axes = sheet.subplots()
        looks = zip(width, ("#56b4e9", "#0072b2", "#003a5c", "#d55e00"), strict=True)
        for ((muscle, factor), colour), mark in zip(looks, "v^so", strict=True):
            label = muscle if factor == 1.0 else f"{muscle}, stiffness x {factor:g}"
            y = width[muscle, factor]
            axes.loglog(
                FORCES, y, color=colour, marker=mark, ms=4, markevery=4, lw=1.4, label=label
            )
        axes.loglog(
            FORCES, _slope(network) * FORCES, color="0.5", ls="--", lw=0.9, label="limit: f_m0 -> 0"
        )
        axes.axvline(OPERATING_FORCE, color="0.7", lw=0.9, zorder=0)
        axes.text(1.1 * OPERATING_FORCE, 2e-3, "f_m0 of the paper", fontsize=8)
        style_axes(axes, "operating force f_m0, N", "width of the switch, PIP deg")
        axes.legend(frameon=False, fontsize=8)

    caption = (
        "PIP angles over which both ways of a muscle bear at DIP 45 deg. The width vanishes in "
        f"proportion to f_m0 (EDC {_slope(network):.4f} deg/N) and to the tendons' compliance: for "
        "f_m0 -> 0 the switch is instantaneous, as the paper says without a number."
    )
    table = pd.DataFrame({"f_m0_N": FORCES})
    for (muscle, factor), y in width.items():
        table[f"{muscle.replace(', ', '_')}_stiffness_x{factor:g}_deg"] = y
    title = "Width of the switch against the operating force"
    return Figure("figure_3_width", title, caption, draw, {"figure_3_width": table}, (6.5, 4.5))


def _width(network: Network, muscle: int, forces: Array) -> Array:
    """deg."""
    found: list[Switch] = [switch(network, muscle, DIP_SECTION, float(f)) for f in forces]
    return np.degrees([s.width for s in found])


def _slope(network: Network) -> float:
    """deg/N of EDC, as f_m0 -> 0."""
    least = 1e-3
    return float(_width(network, 0, np.array([least]))[0] / least)
