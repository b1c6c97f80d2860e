# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # Buchner, Hines and Hemami 1988: A dynamic model for finger interphalangeal coordination
#
# J Biomech 21:459. Table 1 and figures 3 and 5 to 14. Ours: the course in time (a polynomial of
# fifth order) and the feedback (10 rad/s), which the paper does not state; equal weights in the
# costs, whose coefficients it does not print.

# %%
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd

from cases.papers.models.buchner1988.coordination import ControlLoop, deviation, flex
from cases.papers.models.buchner1988.coordination_findings import (
    CHANGE,
    feasible,
    findings,
    flexion,
    table_sensitivity,
)
from cases.papers.models.buchner1988.flexion import cosine
from cases.papers.models.printed import printed_values, read_printed
from cosim.report.figures import legend_below, show, style_axes
from cosim.results.picture import new_picture
from rigid.hoods.two_band import JOINTS, MUSCLES, TABLE_1, coupled_dip, excursions

LONG_NAMES = {
    "ED": "extensor digitorum",
    "FDP": "flexor profundus",
    "FDS": "flexor superficialis",
    "Int": "interossei",
    "Lum": "lumbrical",
}
MUSCLE_COLOURS = ("#0b5394", "#b45309", "#2e7d4f", "#8e3b8a", "0.45")
ANGLE = np.radians(np.linspace(0.0, 110.0, 111))
PARABOLA = np.degrees(ANGLE), np.degrees(coupled_dip(ANGLE))

closed_loop = cache(flexion)


def line_chart(lines, x, y, size=(7.0, 4.5)):
    """Curves in one panel: by name the abscissa, the ordinate and matplotlib's style of each."""
    picture = new_picture(*size)
    axes = picture.subplots()
    for name, (at, value, style) in lines.items():
        axes.plot(at, value, label=name, **{"lw": 1.8, **style})
    style_axes(axes, x, y)
    low, high = axes.dataLim.y0, axes.dataLim.y1
    room = 0.06 * (high - low or 1.0)
    axes.set_ylim(low - room if low < 0 else min(0.0, low), high + room)
    if len(lines) > 1:
        legend_below(picture, min(3, len(lines)))
    return picture


def over_time(lines, unit):
    """Show a chart of lines that share their times, and its table."""
    time = closed_loop().motion.time
    columns = {f"{name}, {unit}": y for name, (y, _) in lines.items()}
    chart = line_chart({name: (time, *line) for name, line in lines.items()}, "time, s", unit)
    return show(chart, pd.DataFrame({"time_s": time, **columns}))


def muscle_lines(forces, shown):
    return {LONG_NAMES[MUSCLES[k]]: (forces[:, k], {"color": MUSCLE_COLOURS[k]}) for k in shown}


def band_lines(bands):
    return {
        "middle band": (bands[:, 0], {"color": "#0f7c8a"}),
        "lateral band": (bands[:, 1], {"color": "#c2410c", "ls": "--"}),
    }


def table(lines, x, y):
    """Lines that do not share their abscissa, one below the other."""
    parts = [pd.DataFrame({"line": name, x: line[0], y: line[1]}) for name, line in lines.items()]
    return pd.concat(parts, ignore_index=True)


# %% [markdown]
# ## table: table 1, its entries' certainty, and excursions joint by joint
# ### Table 1: excursion models and how certain their entries are
# Excursion models over one joint at a time, the others straight: e = R phi of extensors
# (Landsmeer's model I), (R + R' phi) phi of flexors (model III), for the interphalangeal extensors
# the larger shift of either band (5). The scan is bad: solid lines rest on certain entries, dashed
# on likely, dotted on uncertain ones; the lumbrical's hold FDP's, which its origin moves with. The
# four-finger factor of 0.833 is in the entries already.

# %% table_1_excursions
REACH = {"MCP": 90.0, "PIP": 110.0, "DIP": 73.0}
"""deg: of the IP joints what the paper flexes; of the MCP, which it holds still, a right angle."""
DASHES = {"certain": "-", "likely": "--", "uncertain": ":"}
parts = []
for joint, most in REACH.items():
    angle = np.linspace(0.0, most, 56)
    alone = np.radians(angle[:, None] * (np.array(JOINTS) == joint))
    moved = {f"{m}_mm": x for m, x in zip(MUSCLES, 1e3 * excursions(alone).T, strict=True)}
    parts.append(pd.DataFrame({"joint": joint, "angle_deg": angle, **moved}))
figure = new_picture(9.0, 4.0)
panels = figure.subplots(1, 3, sharey=True)
for axes, joint, part in zip(panels, JOINTS, parts, strict=True):
    for muscle, colour in zip(MUSCLES, MUSCLE_COLOURS, strict=True):
        if (muscle, joint) in TABLE_1:
            dash, width = DASHES[TABLE_1[muscle, joint].certainty], 2.4 if muscle == "ED" else 1.6
            moved = part[f"{muscle}_mm"]
            axes.plot(part.angle_deg, moved, dash, color=colour, lw=width, label=muscle)
    style_axes(axes, f"{joint}, deg", "excursion, mm" if joint == "MCP" else "")
legend_below(figure, 5, panels[0])
WHY = {
    ("ED", "PIP"): "R' follows from the end posture PIP 110, DIP 73 deg",
    ("ED", "DIP"): "with R' it makes the coupling curve",
    ("Int", "PIP"): "ED and Int move alike in IP flexion, says the text",
    ("FDP", "PIP"): "scan 9.6li2.23; reproduces the paper's end forces",
    ("FDP", "DIP"): "scan 45510.261; reproduces the paper's end forces",
    ("FDS", "PIP"): "scan I/",
    ("Lum", "MCP"): "scan 1IS/-",
    ("Lum", "PIP"): "scan 5l434' - 0:4Sb",
    ("Lum", "DIP"): "R53 = R13, after the note under the table",
}
entries = [
    {
        "muscle": muscle,
        "joint": joint,
        "R_mm": 1e3 * entry.radius,
        "R'_mm_per_rad": 1e3 * entry.slope,
        "certainty": entry.certainty,
        "why": WHY.get((muscle, joint), "legible but for a digit"),
    }
    for (muscle, joint), entry in TABLE_1.items()
]
show(figure, table_1_entries=pd.DataFrame(entries), table_1_excursions=pd.concat(parts))

# %% [markdown]
# ## coupling: figure 3: the coupling curve
# ### Figure 3: DIP angle against PIP angle on the coupling curve
# The DIP angle at which middle and lateral band shift alike: phi3 = (R'12 / R13) phi2^2 with R'12 =
# 1.21 mm/rad and R13 = 3.5 mm, which takes PIP 110 deg to DIP 73.0 deg, as the paper's end posture
# says. The line is what the finger is asked for in figures 5 to 14.

# %% figure_3_coupling
curve = {"parabola, equation 6": (*PARABOLA, {"color": "#0b5394"})}
ends = {"line through its ends": (*(x[[0, -1]] for x in PARABOLA), {"color": "0.55", "ls": "--"})}
show(
    line_chart(curve | ends, "PIP, deg", "DIP, deg", (6.0, 4.2)), table(curve, "PIP_deg", "DIP_deg")
)

# %% [markdown]
# ## motion: figures 5-7: flexion in closed loop, on the parabola
# ### Figure 5: angles of the phalanges from the vertical

# %% figure_5_positions
f = closed_loop()
links = np.degrees(np.pi / 2 + np.cumsum(f.motion.angle, axis=1))
speed = np.cumsum(f.motion.rate, axis=1)
names = ("proximal phalanx", "middle phalanx", "distal phalanx")
colours = [{"color": colour} for colour in ("0.45", "#0b5394", "#b45309")]
over_time(
    dict(zip(names, zip(links.T, colours, strict=True), strict=True)),
    "angle from the vertical, deg",
)

# %% [markdown]
# They end at {links[-1, 1]:.1f} and {links[-1, 2]:.1f} deg; the paper says about 200 and 273.
# ### Figure 6: angular velocities of the phalanges
# They begin and end at zero, as the paper's do; their course between is that of the reference,
# which the paper does not state.

# %% figure_6_velocities
over_time(dict(zip(names, zip(speed.T, colours, strict=True), strict=True)), "rad/s")

# %% [markdown]
# ### Figure 7: DIP angle against PIP angle in closed loop

# %% figure_7_interphalangeal
off = deviation(f.loop, f.motion)
variants = {
    "K = 50 N/m": (ControlLoop(elasticity=50.0), "#7a9cc6"),
    "K = 5000 N/m": (ControlLoop(elasticity=5000.0), "#9aa5ad"),
    "equation 17 read literally": (ControlLoop(bands_answer=False), "#b45309"),
}
paths = {
    "K = 500 N/m, the paper's": (f.motion.angle, {"color": "#0b5394", "lw": 2.4}),
    **{n: (flex(loop).angle, {"color": c, "ls": "-."}) for n, (loop, c) in variants.items()},
    "reference: a line": (f.motion.reference, {"color": "0.55", "ls": "--"}),
}
lines = {
    **{name: (*np.degrees(angle[:, 1:]).T, style) for name, (angle, style) in paths.items()},
    "parabola, equation 6": (*PARABOLA, {"color": "0.1", "ls": ":"}),
}
show(line_chart(lines, "PIP, deg", "DIP, deg", (7.0, 4.6)), table(lines, "PIP_deg", "DIP_deg"))

# %% [markdown]
# Asked for the line, the finger goes along the parabola: at most {off.curve:.2f} deg of DIP from
# it, and {off.line:.1f} deg from the line. K = 500 N/m already does it, and the larger K the
# closer, as the paper says. That holds if the bands bear their difference beside what the muscles
# were chosen for. With the difference known to the programmes, as equation 17 literally says,
# muscles make the torque exactly and the finger stays on the line for any K, which the paper's
# figure 7 does not show.

# %% [markdown]
# ## linear: figures 8-10: forces by linear programming
# ### Figure 8: muscles by linear programming, alpha = 1/2

# %% figure_8_linear_muscles
forces, bands = closed_loop().linear.muscles, closed_loop().linear.bands
apart = 1e3 * np.abs(bands[:, 0] - bands[:, 1]).max()
over_time(muscle_lines(forces, (1, 2, 3, 4)), "N")

# %% [markdown]
# FDS is active at first and gives way to the interossei, as in the paper at 0.22 s; at the end FDP
# {forces[-1, 1]:.2f} N (paper: about 9.5) and the interossei {forces[-1, 3]:.2f} N (about 18); the
# lumbrical is silent.
# ### Figure 9: extensor and middle band by linear programming

# %% figure_9_linear_extensor
middle = {"middle band": band_lines(bands)["middle band"]}
over_time(muscle_lines(forces, (0,)) | middle, "N")

# %% [markdown]
# At the end ED {forces[-1, 0]:.2f} N (paper: 26.4) and the middle band {bands[-1, 0]:.2f} N (13.2).
# ### Figure 10: middle and lateral band by linear programming

# %% figure_10_linear_bands
over_time(band_lines(bands), "N")

# %% [markdown]
# Alike but for 2 K e, the difference of the shifts (at most {apart:.0f} mN); the lumbrical is
# silent, so the lateral band's force is the terminal tendon's.

# %% [markdown]
# ## quadratic: figures 11, 12, 14: forces by quadratic programming
# ### Figure 11: muscles by quadratic programming, alpha free

# %% figure_11_quadratic_muscles
forces, bands = closed_loop().quadratic.muscles, closed_loop().quadratic.bands
fall, most = forces[0] - forces[-1], forces[:, 2:].max()
share, alpha = 100 * bands[-1] / bands[-1].sum(), closed_loop().quadratic.share
over_time(muscle_lines(forces, (0, 1)), "N")

# %% [markdown]
# ED falls by {fall[0]:.2f} N (paper: about 7.5) and FDP by {fall[1]:.2f} N (3.5); FDS, interossei
# and lumbrical bear at most {most:.1g} N (0).
# ### Figure 12: middle and lateral band by quadratic programming

# %% figure_12_quadratic_bands
over_time(band_lines(bands), "N")

# %% [markdown]
# At first the lateral band bears more; they cross (paper: at about 0.22 s) and end at
# {share[0]:.1f} and {share[1]:.1f} % of ED (72 and 28 %).
# ### Figure 14: the coefficient alpha that the quadratic programme finds

# %% figure_14_alpha
over_time({"alpha": (alpha, {"color": "#0b5394"})}, "1")

# %% [markdown]
# The lateral band's share of ED where both shifts agree, from {alpha[0]:.3f} to {alpha[-1]:.3f}
# (paper: about 0.28).

# %% [markdown]
# ## excursions: figure 13: excursions
# ### Figure 13: excursions of the muscles

# %% figure_13_excursions
moved = 1e3 * excursions(closed_loop().motion.angle)
apart, end = np.abs(moved[:, 0] - moved[:, 3]).max(), moved[-1]
lines = muscle_lines(moved, range(5))
lines[LONG_NAMES["Int"]][1]["ls"] = "--"
over_time(lines, "excursion, mm")

# %% [markdown]
# Positive where a muscle shortens. ED and interossei move alike (here to {apart:.2f} mm: MCP and
# the bands' difference), as the paper says. FDP ends at {end[1]:.1f} mm; the lumbrical at
# {end[4]:.1f} mm, slightly beyond the paper's axis of +-40 mm: its row of table 1 is the least
# certain.

# %% [markdown]
# ## doubts: the paper's numbers beside ours; feedback, elasticity, uncertain entries
# ### The paper's numbers beside ours
# Every number that the paper states of this flexion, as ours over the paper's. The two times depend
# on the reference's course in time, which the paper does not state (circles: a polynomial of fifth
# order; crosses: half a cosine). Also in the tables: with alpha fixed at 1/2 the linear programme
# finds forces throughout, with alpha = 1 at no time, both as the paper says.

# %% beside_the_paper
f = closed_loop()
ours, with_cosine = findings(f), findings(flexion(replace(f.loop, course=cosine)))
shown = [x for x in read_printed("buchner1988") if x.values[0]]
figure, rank = new_picture(8.5, 5.0), np.arange(len(shown))[::-1]
axes = figure.subplots()
axes.axvline(1.0, color="0.4", lw=1)
crosses, circles = ([n[x.ours] / x.values[0] for x in shown] for n in (with_cosine, ours))
axes.plot(crosses, rank, "x", color="0.5", label="half a cosine in time")
axes.plot(circles, rank, "o", color="#0b5394", label="fifth order")
axes.set_yticks(
    rank, [f"{x.item} ({ours[x.ours]:.3g}; paper {x.values[0]:.3g} {x.unit})" for x in shown]
)
style_axes(axes, "ours / the paper's", "")
axes.set_xlim(0.6, 1.2)
legend_below(figure, 2)
rows = [
    {
        "what": x.item,
        "unit": x.unit,
        "paper": x.values[0],
        "ours": ours[x.ours],
        "ours, cosine in time": with_cosine[x.ours],
        "paper says about": "yes" if x.about else "no",
        "figure": x.place.removeprefix("figure "),
    }
    for x in read_printed("buchner1988")
]
shares = np.array([0.5, 0.6, 0.7, 0.8, 1.0])
solved = [100 * feasible(replace(f.loop, lateral_share=share), f.motion) for share in shares]
show(
    figure,
    pd.DataFrame(rows),
    alpha_and_feasibility=pd.DataFrame({"alpha": shares, "samples with a solution, %": solved}),
)

# %% [markdown]
# ### What feedback and elasticity change
# The paper states neither gains nor how the torque is computed. The largest distance of the DIP
# angle from the parabola, by the bands' elasticity K (the paper's: 500 N/m) and the feedback's
# bandwidth: the spring draws to the parabola, feedback to the line, which is 18 deg away. Below
# some 20 rad/s the paper's figure 7 follows whatever was chosen.

# %% feedback_and_elasticity
rows = []
for bandwidth in (5.0, 10.0, 20.0, 40.0):
    for elasticity in (50.0, 150.0, 500.0, 1500.0, 5000.0):
        loop = ControlLoop(bandwidth, elasticity)
        off = deviation(loop, flex(loop))
        rows.append((bandwidth, elasticity, off.curve, off.line))
columns = ["bandwidth_rad_per_s", "K_N_per_m", "from_parabola_deg", "from_line_deg"]
data = pd.DataFrame(rows, columns=columns)
figure = new_picture(6.5, 4.6)
axes = figure.subplots()
colours = ("#9ec5e8", "#0b5394", "#b45309", "#7a2e0e")
for colour, (bandwidth, part) in zip(colours, data.groupby("bandwidth_rad_per_s"), strict=True):
    distance = part.from_parabola_deg
    axes.loglog(part.K_N_per_m, distance, "o-", color=colour, label=f"{bandwidth:g}")
style_axes(axes, "K, N/m", "from the parabola at most, deg")
legend_below(figure, 4, title="bandwidth of feedback, rad/s")
show(figure, data)

# %% [markdown]
# ### What the uncertain entries of table 1 change

# %% uncertain_entries
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
f = flexion(f.loop, samples=51)
as_read, paper = findings(f), printed_values("buchner1988")
unit = {x.ours: x.unit for x in read_printed("buchner1988")}
data = pd.DataFrame(
    [
        {
            "entry": f"{muscle} at {joint}",
            "certainty": f.loop.table[muscle, joint].certainty,
            "what": what,
            "unit": unit[what],
            "paper": paper[what][0],
            "as_read": as_read[what],
            f"{100 * CHANGE:.0f} % smaller": smaller[what],
            f"{100 * CHANGE:.0f} % larger": larger[what],
        }
        for (muscle, joint), (smaller, larger) in table_sensitivity(f).items()
        for what in SHOWN
    ]
)
figure = new_picture(11.0, 6.0)
for axes, what in zip(figure.subplots(2, 4, sharey=True).ravel(), SHOWN, strict=True):
    part, printed = data[data["what"] == what], paper[what][0]
    rank = np.arange(len(part))[::-1]
    ends = part[["as_read", *part.columns[-2:]]].to_numpy(dtype=float)
    axes.hlines(rank, np.nanmin(ends, axis=1), np.nanmax(ends, axis=1), color="#7a9cc6", lw=6)
    axes.axvline(printed, color="#b45309", lw=1.2)
    axes.plot(part.as_read, rank, "o", color="#0b5394", ms=4)
    axes.set_yticks(rank, part.entry)
    style_axes(axes, unit[what], "")
    axes.set_title(what.replace(": ", ":\n"), fontsize=9)
    if np.nanmax(np.abs(ends - printed), initial=0.0) > 2 * printed:
        axes.set_xlim(0.0, 3 * printed)  # one entry would flatten the others
show(figure, data)

# %% [markdown]
# Each entry of table 1 that is not certain, R and R' {100 * CHANGE:.0f} % smaller and larger: what
# the paper's numbers become (dot: as read; line: the paper's; no bar: no effect, or none that is
# defined, where FDS stays silent). ED and FDP at the MCP and FDP at PIP and DIP decide nearly
# everything, and 20 % of any of them would be seen; as read they return the paper's end forces
# together. The two times hang on FDP at the MCP (and on the course in time): 0.22 s would take an
# arm some 15 % larger, with which ED ends near 34 N instead of 26.4. No number of the paper tests
# the lumbrical's row; FDS at the PIP would show if its arm were larger, at the MCP if smaller.
