"""Figures 3.4 and 3.5 and table 5 of the thesis: strains of the hood by its moduli."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.hoods.view import HoodField
from cosim.papers.thesis_models import DIRECTIONS, MODULI, STATISTICS, hood_run
from cosim.papers.thesis_rows import printed_numbers
from cosim.report.figures import Figure, style_axes
from cosim.results.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure as Sheet

SHEET, FIBRES = "thesis_strain_{}", "strain_lee2008_{}_ti"
FIELDS = {"longitudinal": "longitudinal_strain", "lateral": "transverse_strain"}
SLIPS = ("central", "terminal")
INK = "#222222"
LEAST_SCALE = 1.0  # %


def strain_figures() -> list[Figure]:
    """Figure 3.4 with table 5, of the sheet and of our hood."""
    why = (
        "The thesis's hood is one isotropic sheet with the moduli of table 4, so the maps are of "
        "such a sheet; its thickness (0.65 mm, as a published hood has it) and the posture in "
        "which it is free of stress (straight) are ours, for the thesis prints neither. Free of "
        "stress in a bent finger it has other strains: see the figure after next. Nothing is "
        "fitted to the thesis's strains. "
        "Green-Lagrange strains of the loaded sheet; means over the area of the central region, "
        "extremes over gauges of 2 mm in it. "
    )
    fibres = (
        "The same experiment with our hood of anatomical parts, fibres in a matrix, whose moduli "
        "along the fibres are those of table 4. It is not the thesis's model; Lee's experiment is "
        "what both are of: longitudinal -5 to 5 %, lateral from below -15 to 5 %. Strains along "
        "and across the fibres in the maps, along and across the finger in the table. "
    )
    ours = "Beside figure 3.4: strains of our hood with fibres"
    theirs = "Figure 3.4 and table 5: strains of one isotropic sheet"
    return [
        _map_figure("figure_3_4_strains", theirs, SHEET, why),
        _map_figure("figure_3_4_fibres", ours, FIBRES, fibres),
    ]


def slip_figures() -> list[Figure]:
    """Figure 3.5."""
    table = pd.DataFrame(
        [
            {
                "model": model,
                "moduli": moduli,
                **{f"{slip}_slip_percent": _slip(hood_run(case.format(moduli)), slip)
                   for slip in SLIPS},
            }
            for model, case in (("one sheet", SHEET), ("fibres", FIBRES))
            for moduli in MODULI
        ]
    )  # fmt: skip

    def draw(sheet: Sheet) -> None:
        every = sheet.subplots(1, 2, sharey=True)
        for axes, slip in zip(every, SLIPS, strict=True):
            place = np.arange(len(MODULI))
            for k, (model, colour) in enumerate((("one sheet", "#7a9cc6"), ("fibres", "#0b5394"))):
                height = table[table.model == model][f"{slip}_slip_percent"]
                axes.bar(place + 0.38 * (k - 0.5), height, 0.38, color=colour, label=model)
            axes.set_xticks(place, MODULI)
            axes.set_title(f"{slip} slip", fontsize=10)
            style_axes(axes, "", "")
        every[0].set_ylabel("mean longitudinal strain, %")
        handles, names = every[0].get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)

    caption = (
        "Mean over the slip's area. The thesis prints no strain of a slip, only how far its means "
        "lie from the experiment's, which it does not print either: central slip -0.94, -2.74 and "
        "-3.28 points, terminal slip -0.41, +0.12 and +0.10 with soft, average and stiff moduli. "
        "What is comparable is by how much the moduli change the strain (table of section 3.3)."
    )
    title = "Figure 3.5: strains of the slips"
    return [Figure("figure_3_5_slips", title, caption, draw, {"figure_3_5_slips": table}, (8, 3.4))]


def _map_figure(name: str, title: str, case: str, caption: str) -> Figure:
    runs = {moduli: hood_run(case.format(moduli)) for moduli in MODULI}
    table = _table(runs)

    def draw(sheet: Sheet) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        every = sheet.subplots(3, 2, sharex=True, sharey=True)
        letters = iter("ABCDEF")
        for column, direction in zip(every.T, reversed(DIRECTIONS), strict=True):
            most = max(_scale(run, FIELDS[direction]) for run in runs.values())
            norm = Normalize(-most, most)
            for axes, (moduli, run) in zip(column, runs.items(), strict=True):
                _draw_map(axes, run, FIELDS[direction], norm)
                axes.set_title(f"{next(letters)}: {direction}, {moduli}", fontsize=10)
            column[-1].set_xlabel("distal, mm")
            shown = ScalarMappable(norm, "RdBu_r")
            bar = sheet.colorbar(shown, ax=column, extend="both", location="bottom", aspect=40)
            bar.set_label(f"{direction} strain, %")
        for axes in every[:, 0]:
            axes.set_ylabel("radial, mm")

    note = "Seen from the dorsal side; outlined: the central region. Letters as in the thesis."
    return Figure(name, title, caption + note, draw, {f"{name}_table": table}, (10.0, 6.4))


def _table(runs: dict[str, Result]) -> pd.DataFrame:
    """% over the central region, beside what the thesis prints."""
    printed = printed_numbers()
    out = []
    for direction in DIRECTIONS:
        for statistic in STATISTICS:
            line: dict[str, object] = {"direction": direction, "strain_percent": statistic}
            for moduli, run in runs.items():
                theirs = printed.get(f"strain.{moduli}.{direction}.{statistic}")
                line[f"thesis, {moduli}"] = "-" if theirs is None else f"{theirs:g}"
                line[f"ours, {moduli}"] = float(run.summary["strain_percent"][direction][statistic])
            out.append(line)
    return pd.DataFrame(out)


def _scale(run: Result, field: str) -> float:
    """%, that all but a few cells stay below."""
    values = np.abs(100 * np.asarray(_hood(run).cell_data[field]))
    return max(float(np.percentile(values, 97)), LEAST_SCALE)


def _draw_map(axes: Axes, run: Result, field: str, norm: Normalize) -> None:
    """The deformed sheet from the dorsal side, distal to the right, coloured by a strain."""
    from matplotlib.collections import LineCollection, PolyCollection

    hood = _hood(run)
    corners = 1e3 * hood.points[hood.quads]
    order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
    faces = PolyCollection(list(corners[order][..., :2]), cmap="RdBu_r", norm=norm, lw=0.1)
    faces.set_array(100 * np.asarray(hood.cell_data[field])[order])
    faces.set_edgecolor("0.6")
    axes.add_collection(faces)
    axes.add_collection(LineCollection(_outline(hood), colors=INK, linewidths=1.1))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.spines[["top", "right"]].set_visible(False)


def _outline(hood: HoodField) -> list[np.ndarray]:
    """(2, 2) mm each: edges that only one cell of the central region has."""
    from cosim.hoods.shell.view import CENTRAL
    from meshes.hood_mesh import REGIONS

    within = np.isin(hood.cell_data["region"], [REGIONS.index(name) for name in CENTRAL])
    quads = hood.quads[within]
    edges = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    _, first, times = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    return list(1e3 * hood.points[edges[first[times == 1]]][..., :2])


def _slip(run: Result, slip: str) -> float:
    """%."""
    return float(run.summary["region_strain_percent"][f"{slip}_slip"]["longitudinal"]["mean"])


def _hood(run: Result) -> HoodField:
    assert run.scene.hood is not None
    return run.scene.hood
