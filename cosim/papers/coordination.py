"""Paper 001, computed anew: table 1 and figures 3 and 5 to 14.

Buchner, Hines and Hemami 1988, A dynamic model for finger interphalangeal coordination, J Biomech
21:459."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pandas as pd

from cosim.papers.coordination_doubts import doubt_figures
from cosim.papers.coordination_table import table_figures
from cosim.papers.lines import BAND_COLOURS, MUSCLE_COLOURS, PlotLine, line_chart
from cosim.port import Array
from cosim.report.figures import Figure, FigureStudy
from rigid.hoods.two_band import LONG_NAMES, MUSCLES, coupled_dip, excursions
from rigid.papers.buchner1988.coordination import ControlLoop, deviation, flex
from rigid.papers.buchner1988.coordination_findings import Flexion, flexion

OURS = (
    "Ours: the course in time (a polynomial of fifth order) and the feedback (10 rad/s), which the "
    "paper does not state; equal weights in the costs, whose coefficients it does not print."
)
RANGE = np.radians(np.linspace(0.0, 110.0, 111))


@lru_cache(maxsize=1)
def closed_loop_flexion() -> Flexion:
    """The closed-loop flexion that every figure shows."""
    return flexion()


def coupling_figures() -> list[Figure]:
    """Figure 3."""
    dip = coupled_dip(RANGE)
    lines = [
        PlotLine("parabola, equation 6", np.degrees(RANGE), np.degrees(dip), "#0b5394"),
        PlotLine("line through its ends", np.degrees(RANGE[[0, -1]]), np.degrees(dip[[0, -1]]),
             "0.55", "--"),
    ]  # fmt: skip
    caption = (
        "The DIP angle at which middle and lateral band shift alike: phi3 = (R'12 / R13) phi2^2 "
        "with R'12 = 1.21 mm/rad and R13 = 3.5 mm, which takes PIP 110 deg to DIP 73.0 deg, as "
        "the paper's end posture says. The line is what the finger is asked for in figures 5 to "
        "14."
    )
    return [
        Figure(
            "figure_3_coupling",
            "Figure 3: DIP angle against PIP angle on the coupling curve",
            caption,
            line_chart(lines, "PIP, deg", "DIP, deg"),
            {"figure_3_coupling": table(lines[:1], "PIP_deg", "DIP_deg")},
            (6.0, 4.2),
        )
    ]


def motion_figures() -> list[Figure]:
    """Figures 5, 6 and 7."""
    f = closed_loop_flexion()
    t, links = f.motion.time, np.pi / 2 + np.cumsum(f.motion.angle, axis=1)
    names = ("proximal phalanx", "middle phalanx", "distal phalanx")
    colours = ("0.45", "#0b5394", "#b45309")
    position = [
        PlotLine(n, t, np.degrees(x), c) for n, x, c in zip(names, links.T, colours, strict=True)
    ]
    speed = np.cumsum(f.motion.rate, axis=1).T
    velocity = [PlotLine(n, t, x, c) for n, x, c in zip(names, speed, colours, strict=True)]
    end = np.degrees(links[-1])
    return [
        over_time(
            "figure_5_positions",
            "Figure 5: angles of the phalanges from the vertical",
            f"They end at {end[1]:.1f} and {end[2]:.1f} deg; the paper says about 200 and 273. "
            f"{OURS}",
            position,
            "angle from the vertical, deg",
        ),
        over_time(
            "figure_6_velocities",
            "Figure 6: angular velocities of the phalanges",
            "They begin and end at zero, as the paper's do; their course between is that of the "
            f"reference, which the paper does not state. {OURS}",
            velocity,
            "rad/s",
        ),
        _interphalangeal(f),
    ]


def _interphalangeal(f: Flexion) -> Figure:
    """Figure 7, with softer and stiffer bands, and with equation 17 read literally."""
    off = deviation(f.loop, f.motion)
    variants = {
        "K = 50 N/m": (ControlLoop(elasticity=50.0), "#7a9cc6"),
        "K = 5000 N/m": (ControlLoop(elasticity=5000.0), "#9aa5ad"),
        "equation 17 read literally": (ControlLoop(bands_answer=False), "#b45309"),
    }
    lines = [
        _path("K = 500 N/m, the paper's", f.motion.angle, "#0b5394", "-", 2.4),
        *(_path(name, flex(loop).angle, c, "-.") for name, (loop, c) in variants.items()),
        _path("reference: a line", f.motion.reference, "0.55", "--"),
        PlotLine(
            "parabola, equation 6", np.degrees(RANGE), np.degrees(coupled_dip(RANGE)), "0.1", ":"
        ),
    ]
    caption = (
        f"Asked for the line, the finger goes along the parabola: at most {off.curve:.2f} deg of "
        f"DIP from it, and {off.line:.1f} deg from the line. K = 500 N/m already does it, and the "
        "larger K the closer, as the paper says. That holds if the bands bear their difference "
        "beside what the muscles were chosen for. With the difference known to the programmes, "
        "as equation 17 literally says, muscles make the torque exactly and the finger stays on "
        f"the line for any K, which the paper's figure 7 does not show. {OURS}"
    )
    return Figure(
        "figure_7_interphalangeal",
        "Figure 7: DIP angle against PIP angle in closed loop",
        caption,
        line_chart(lines, "PIP, deg", "DIP, deg"),
        {"figure_7_interphalangeal": table(lines, "PIP_deg", "DIP_deg")},
        (7.0, 4.6),
    )


def _path(name: str, angle: Array, colour: str, dash: str, width: float = 1.8) -> PlotLine:
    """DIP over PIP, deg, of angles (n, 3) rad."""
    return PlotLine(name, np.degrees(angle[:, 1]), np.degrees(angle[:, 2]), colour, dash, width)


def linear_figures() -> list[Figure]:
    """Figures 8, 9 and 10."""
    f = closed_loop_flexion()
    t, muscles, bands = f.motion.time, f.linear.muscles, f.linear.bands
    change = "FDS is active at first and gives way to the interossei, as in the paper at 0.22 s"
    return [
        over_time(
            "figure_8_linear_muscles",
            "Figure 8: muscles by linear programming, alpha = 1/2",
            f"{change}; at the end FDP {muscles[-1, 1]:.2f} N (paper: about 9.5) and the "
            f"interossei {muscles[-1, 3]:.2f} N (about 18); the lumbrical is silent. {OURS}",
            [_muscle(f, muscles, k) for k in (1, 2, 3, 4)],
            "N",
        ),
        over_time(
            "figure_9_linear_extensor",
            "Figure 9: extensor and middle band by linear programming",
            f"At the end ED {muscles[-1, 0]:.2f} N (paper: 26.4) and the middle band "
            f"{bands[-1, 0]:.2f} N (13.2). {OURS}",
            [_muscle(f, muscles, 0), PlotLine("middle band", t, bands[:, 0], BAND_COLOURS[0])],
            "N",
        ),
        over_time(
            "figure_10_linear_bands",
            "Figure 10: middle and lateral band by linear programming",
            "Alike but for 2 K e, the difference of the shifts (at most "
            f"{1e3 * np.abs(bands[:, 0] - bands[:, 1]).max():.0f} mN); the lumbrical is silent, so "
            f"the lateral band's force is the terminal tendon's. {OURS}",
            _bands(f, bands),
            "N",
        ),
    ]


def quadratic_figures() -> list[Figure]:
    """Figures 11, 12 and 14."""
    f = closed_loop_flexion()
    t, muscles, bands = f.motion.time, f.quadratic.muscles, f.quadratic.bands
    fall = muscles[0] - muscles[-1]
    share = 100 * bands[-1] / bands[-1].sum()
    return [
        over_time(
            "figure_11_quadratic_muscles",
            "Figure 11: muscles by quadratic programming, alpha free",
            f"ED falls by {fall[0]:.2f} N (paper: about 7.5) and FDP by {fall[1]:.2f} N (3.5); "
            f"FDS, interossei and lumbrical bear at most {muscles[:, 2:].max():.1g} N (0). {OURS}",
            [_muscle(f, muscles, k) for k in (0, 1)],
            "N",
        ),
        over_time(
            "figure_12_quadratic_bands",
            "Figure 12: middle and lateral band by quadratic programming",
            "At first the lateral band bears more; they cross (paper: at about 0.22 s) and end at "
            f"{share[0]:.1f} and {share[1]:.1f} % of ED (72 and 28 %). {OURS}",
            _bands(f, bands),
            "N",
        ),
        over_time(
            "figure_14_alpha",
            "Figure 14: the coefficient alpha that the quadratic programme finds",
            "The lateral band's share of ED where both shifts agree, from "
            f"{f.quadratic.share[0]:.3f} to {f.quadratic.share[-1]:.3f} (paper: about 0.28). "
            f"{OURS}",
            [PlotLine("alpha", t, f.quadratic.share, "#0b5394")],
            "1",
        ),
    ]


def excursion_figures() -> list[Figure]:
    """Figure 13."""
    f = closed_loop_flexion()
    moved = 1e3 * excursions(f.motion.angle)
    lines = [
        PlotLine(
            LONG_NAMES[name], f.motion.time, moved[:, k], MUSCLE_COLOURS[k], "--" if k == 3 else "-"
        )
        for k, name in enumerate(MUSCLES)
    ]
    apart = np.abs(moved[:, 0] - moved[:, 3]).max()
    caption = (
        f"Positive where a muscle shortens. ED and interossei move alike (here to {apart:.2f} mm: "
        f"MCP and the bands' difference), as the paper says. FDP ends at {moved[-1, 1]:.1f} mm; "
        f"the lumbrical at {moved[-1, 4]:.1f} mm, slightly beyond the paper's axis of +-40 mm: "
        f"its row of table 1 is the least certain. {OURS}"
    )
    title = "Figure 13: excursions of the muscles"
    return [over_time("figure_13_excursions", title, caption, lines, "excursion, mm")]


def _muscle(f: Flexion, forces: Array, k: int) -> PlotLine:
    return PlotLine(LONG_NAMES[MUSCLES[k]], f.motion.time, forces[:, k], MUSCLE_COLOURS[k])


def _bands(f: Flexion, bands: Array) -> list[PlotLine]:
    names, dashes = ("middle band", "lateral band"), ("-", "--")
    return [
        PlotLine(n, f.motion.time, bands[:, k], BAND_COLOURS[k], dashes[k])
        for k, n in enumerate(names)
    ]


def over_time(name: str, title: str, caption: str, lines: list[PlotLine], unit: str) -> Figure:
    """Lines that share their times, with their table."""
    columns: Mapping[str, Array] = {f"{line.name}, {unit}": line.y for line in lines}
    data = pd.DataFrame({"time_s": lines[0].x, **columns})
    return Figure(name, title, caption, line_chart(lines, "time, s", unit), {name: data})


def table(lines: list[PlotLine], x: str, y: str) -> pd.DataFrame:
    """Lines that do not share their abscissa, one below the other."""
    parts = [pd.DataFrame({"line": line.name, x: line.x, y: line.y}) for line in lines]
    return pd.concat(parts, ignore_index=True)


STUDIES: tuple[FigureStudy, ...] = (
    FigureStudy(
        "table", "table 1, its entries' certainty, and excursions joint by joint", table_figures
    ),
    FigureStudy("coupling", "figure 3: the coupling curve", coupling_figures),
    FigureStudy("motion", "figures 5-7: flexion in closed loop, on the parabola", motion_figures),
    FigureStudy("linear", "figures 8-10: forces by linear programming", linear_figures),
    FigureStudy(
        "quadratic", "figures 11, 12, 14: forces by quadratic programming", quadratic_figures
    ),
    FigureStudy("excursions", "figure 13: excursions", excursion_figures),
    FigureStudy(
        "doubts",
        "the paper's numbers beside ours; feedback, elasticity, uncertain entries",
        lambda: doubt_figures(closed_loop_flexion()),
    ),
)
