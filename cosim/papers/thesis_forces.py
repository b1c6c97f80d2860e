"""Figures 3.1, 3.2, 3.6 and 3.7 of the thesis, its run times, and forces by their source."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.thesis_models import (
    DEVICES,
    EXCESS,
    INTEGRATED,
    MUSCLES,
    ONE_WAY,
    OURS,
    OVER_ALONE,
    POINT,
    SAME,
    device_run,
    force_run,
    time_numbers,
    tip_force,
)
from cosim.port import Array
from cosim.report.figures import Figure, style_axes
from cosim.results.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

COMPONENTS = ("distal", "palmar", "radial")
MODELS = (POINT, ONE_WAY, SAME, OURS)
SHORT = ("alone", "one_way", "two_way_sheet", "two_way_ours")
COLOURS = ("0.6", "#c2410c", "#7a9cc6", "#0b5394")
BONES = ("proximal", "middle", "distal")
MOST_SOURCES = 7  # bars: the largest forces; the table has all
WIDTHS = (3.4, 1.8, 2.4, 1.2)  # of arrows, so that one does not hide another


def device_figures() -> list[Figure]:
    """Figures 3.1 and 3.2, of our finger."""
    force = {(m, d): tip_force(device_run(m, d)) for m in MUSCLES for d in DEVICES}
    size = pd.DataFrame(
        {
            "muscle": MUSCLES,
            **{f"{d}_N": [float(np.linalg.norm(force[m, d])) for m in MUSCLES] for d in DEVICES},
        }
    )
    size["apart_N"] = (size.cage_N - size.shell_N).abs()
    size["turned_deg"] = [_angle(force[m, "cage"], force[m, "shell"]) for m in MUSCLES]
    vectors = _vectors(force, "device")

    def draw(sheet: Sheet) -> None:
        left, right = sheet.subplots(2, 1, height_ratios=(1.6, 1.0))
        _bars(left, MUSCLES, [size.cage_N, size.shell_N], ("#0b5394", "#b45309"), DEVICES)
        left.set_ylabel("fingertip force, N")
        _arrows(right, force, ("#0b5394", "#b45309"), DEVICES)
        handles, names = left.get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)

    above = ", ".join(
        f"{r.muscle} {r.apart_N:.3f} N" for r in size.itertuples() if r.apart_N > 0.02
    )
    caption = (
        "The dynamic model alone after 2 s, the fingertip a sphere in a cage of six walls "
        "(Hunt-Crossley) and in a hollow sphere (elastic foundation), one muscle at 10 % (FDI at "
        "5 %). Thesis: the devices differ by less than 0.02 N for each muscle, and little in "
        f"direction. Ours: {f'{above}, the others' if above else 'all'} below. The finger is ours: "
        "An's tendon paths, bones of our lengths, linear passive joints. The thesis draws the "
        "magnitudes and vectors and prints none."
    )
    title = "Figures 3.1 and 3.2: two fingertip devices"
    tables = {"figure_3_1_devices": size, "figure_3_2_vectors": vectors}
    return [Figure("figure_3_1_devices", title, caption, draw, tables, (8.0, 4.8))]


def force_figures() -> list[Figure]:
    """Figures 3.6 and 3.7."""
    force = {(m, k): tip_force(force_run(m, k)) for m in INTEGRATED for k in MODELS}
    size = {key: float(np.linalg.norm(f)) for key, f in force.items()}
    table = pd.DataFrame(
        [
            {
                "muscle": m,
                **{f"{column}_N": size[m, k] for k, column in zip(MODELS, SHORT, strict=True)},
                "excess_ours_N": size[m, ONE_WAY] - size[m, SAME],
                "excess_thesis_N": EXCESS[m],
            }
            for m in INTEGRATED
        ]
    )
    vectors = _vectors(force, "model")
    alone = pd.DataFrame(
        [
            {
                "muscle": m,
                "ours_N": size[m, ONE_WAY] - size[m, POINT],
                "thesis_least_N": OVER_ALONE[m][0],
                "thesis_most_N": OVER_ALONE[m][1],
            }
            for m in INTEGRATED
        ]
    )

    def draw(sheet: Sheet) -> None:
        left, right = sheet.subplots(1, 2, width_ratios=(1.0, 1.3))
        heights = [[size[m, k] for m in INTEGRATED] for k in MODELS]
        _bars(left, INTEGRATED, heights, COLOURS, MODELS)
        left.set_ylabel("fingertip force, N")
        _arrows(right, force, COLOURS, MODELS)
        handles, names = left.get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)

    caption = (
        "One way: the sheet solved once, its forces and those that the joints pass on lumped at "
        "the phalanges' centres of mass, without moments, muscles and passive forces off, as the "
        "thesis did. Two-way: the coupled equilibrium of the same sheet, and of our hood of "
        "anatomical parts with fibres. The thesis prints how far its forces lie over the "
        "experiment's means, which it does not print: so no force of its own is known, and its "
        "excess stands beside ours over the coupled equilibrium, another quantity. What can be "
        "compared is how far the one-way pass lies over the dynamic model alone, for section 3.2 "
        "has the latter within 0.53 N of the same experiment, and FPI's 0.51 to 0.53 N over it "
        "(last table): for FPI its one-way force is the smaller one, ours the larger. Its figure "
        "3.7 draws the vectors and its text gives none. Fingertip held at a point."
    )
    title = "Figures 3.6 and 3.7: the integrated model's forces"
    tables = {
        "figure_3_6_forces": table,
        "figure_3_7_vectors": vectors,
        "one_way_less_dynamic_model": alone,
    }
    return [Figure("figure_3_6_forces", title, caption, draw, tables, (9.5, 4.4))]


def ledger_figures() -> list[Figure]:
    """Table 7: what is one net force there, by source, one way and two-way."""
    runs = {"one way": force_run("EDC", ONE_WAY), "two-way": force_run("EDC", SAME)}
    table = pd.concat([_sources(run).assign(model=k) for k, run in runs.items()])
    table = table[["model", "body", "source", "force_N", "moment_Nmm"]]
    largest = table.groupby("source").force_N.max().sort_values(ascending=False)
    named = list(largest.index[:MOST_SOURCES])

    def draw(sheet: Sheet) -> None:
        every = sheet.subplots(1, 2, sharey=True)
        for axes, kind in zip(every, runs, strict=True):
            of = table[table.model == kind]
            heights = [
                [float(of[(of.body == b) & (of.source == s)].force_N.sum()) for b in BONES]
                for s in named
            ]
            colours = ["#c2410c", "#0b5394", "#2e7d4f", "#8e3b8a", "#b45309", "0.55", "#0f7c8a"]
            _bars(axes, BONES, heights, colours[: len(named)], named)
            axes.set_title(kind, fontsize=10)
        every[0].set_ylabel("force on the bone, N")
        handles, names = every[0].get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)

    caption = (
        "EDC at 10 %, forces on each phalanx by source, of the same sheet: handed over once as in "
        "the thesis, and in the coupled equilibrium. FEBio's reaction force is one net force of "
        "all of them (table 7), in which the thesis supposes forces that OpenSim applies too. "
        "Here the part under 'hood joint_contact' is handed over by the one-way pass and borne by "
        "the finger's joints a second time; in the two-way equilibrium there is no such part. "
        "Forces of one bone with their moments add up to zero; the table holds their magnitudes."
    )
    title = "Forces by source (table 7): EDC, one way and two-way"
    return [Figure("table_7_sources", title, caption, draw, {"table_7_sources": table}, (9.5, 4.2))]


def time_figures() -> list[Figure]:
    """Section 3.1: run times."""
    ours = time_numbers()
    rows = (
        ("2 s of the dynamic model, cage", 50.0, ours["time.cage"][0]),
        ("2 s of the dynamic model, hollow sphere", 5.0, ours["time.shell"][0]),
        ("finite elements, one muscle", 290.0, ours["time.pass"][0]),
        ("integrated, one muscle", 315.0, ours["time.pass"][0]),
    )
    table = pd.DataFrame(rows, columns=["what", "thesis_s", "ours_s"])

    def draw(sheet: Sheet) -> None:
        axes = sheet.subplots()
        place = np.arange(len(table))
        axes.barh(place - 0.2, table.thesis_s, 0.38, color="0.6", label="thesis")
        axes.barh(place + 0.2, table.ours_s, 0.38, color="#0b5394", label="ours, here")
        axes.set_yticks(place, list(table.what))
        axes.set_xscale("log")
        axes.invert_yaxis()
        style_axes(axes, "s", "")
        sheet.legend(loc="outside lower center", ncols=2, frameon=False)

    caption = (
        "Wall time, on whatever computer made this page; the thesis does not name its own. Ours: "
        "medians over the muscles. A one-way pass of ours, with hood and finger together, stands "
        "beside both of the thesis's last rows, of which it gives 4 min 40 s to 5 min for the "
        "finite elements (290 s: the middle) and at most 5 min 15 s for all."
    )
    title = "Run times (section 3.1): the thesis's and ours"
    return [Figure("section_3_1_times", title, caption, draw, {"run_times": table}, (8.0, 3.0))]


def _sources(run: Result) -> pd.DataFrame:
    """N and N mm by phalanx and source, in the loaded state."""
    return pd.DataFrame(
        [
            {
                "body": row.body,
                "source": row.source,
                "force_N": float(np.linalg.norm(row.force)),
                "moment_Nmm": 1e3 * float(np.linalg.norm(row.moment)),
            }
            for row in run.rows
            if row.state == "loaded" and row.body in BONES
        ]
    )


def _vectors(force: dict[tuple[str, str], Array], what: str) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {"muscle": muscle, what: kind, **dict(zip(COMPONENTS, f, strict=True))}
            for (muscle, kind), f in force.items()
        ]
    ).rename(columns={c: f"{c}_N" for c in COMPONENTS})


def _bars(
    axes: Axes,
    groups: tuple[str, ...],
    heights: list[pd.Series] | list[list[float]],
    colours: tuple[str, ...] | list[str],
    names: tuple[str, ...] | list[str],
) -> None:
    """A bar for each name in each group."""
    place, width = np.arange(len(groups)), 0.8 / len(names)
    for k, (height, colour, name) in enumerate(zip(heights, colours, names, strict=True)):
        axes.bar(place + (k - (len(names) - 1) / 2) * width, height, width, color=colour,
                 label=name)  # fmt: skip
    axes.set_xticks(place, groups)
    style_axes(axes, "", "")


def _arrows(
    axes: Axes,
    force: dict[tuple[str, str], Array],
    colours: tuple[str, ...],
    names: tuple[str, ...],
) -> None:
    """The forces in the finger's plane, distal to the right and dorsal up, muscle by muscle."""
    muscles = list(dict.fromkeys(muscle for muscle, _ in force))
    reach = max(float(np.linalg.norm(f[:2])) for f in force.values())
    step = 2.0 * max(max(abs(float(f[0])) for f in force.values()), 0.5 * reach)
    for k, muscle in enumerate(muscles):
        for i, (colour, name) in enumerate(zip(colours, names, strict=True)):
            distal, palmar, _ = force[muscle, name]
            tail, head = (step * k, 0.0), (step * k + distal, -palmar)
            style = {
                "arrowstyle": "-|>",
                "lw": WIDTHS[i],
                "color": colour,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axes.annotate("", head, tail, arrowprops=style)
        axes.text(step * k, 1.12 * reach, muscle, ha="center", fontsize=9)
    axes.set_xlim(-0.6 * step, (len(muscles) - 0.4) * step)
    axes.set_ylim(-1.15 * reach, 1.35 * reach)
    axes.set_aspect("equal")
    axes.set_xticks([])
    style_axes(axes, "distal, to scale", "dorsal, N")


def _angle(a: Array, b: Array) -> float:
    """deg."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
