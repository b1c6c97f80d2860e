"""Table 5 of the thesis on the mesh that it started from, which the user gives."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.thesis_models import DIRECTIONS, MODULI, STATISTICS, Numbers, hood_run
from cosim.papers.thesis_rows import printed_numbers
from cosim.report.figures import Figure, style_axes
from fe_solver.febio.published_hood import PublishedHood, qian_moduli, solve_published_hood

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

PULL = 11.8
"""N in EDC (thesis, section 2.3.3)."""
OFF = dict(zip(MODULI, (-1.0, 0.0, 1.0), strict=True))
"""SD from the moduli's means."""
INFERRED = "between_bands"
"""The region that is read beside the thesis's central region."""
REGIONS = {
    INFERRED: "its mesh: within 7 mm, MCP to where the bands meet",
    "between_bands_to_pip": "its mesh: within 7 mm, MCP to PIP",
    "central_tendon": "its mesh: within 3 mm, MCP to PIP",
}
THESIS, OURS = "thesis", "our sheet: central tendon, MCP to PIP"
COLOURS = ("0.2", "#0b5394", "#7fb069", "#c2410c", "#7a9cc6")
TITLE = "Table 5 on the mesh that the thesis started from"
CHOSEN = (
    "The thesis reads a 'central region' and does not say where it lies. Here it is taken to be "
    "the hood between the lateral bands: within 7 mm of the middle line, from the MCP to where the "
    "bands meet. This is inferred: it was chosen after some fifteen regions had been tried beside "
    "table 5, so it is no blind hit, and two other regions stand beside it. "
)
GIVEN = (
    "The thesis started from a finger hood of FEBio's test suite (Verify/mi29.feb). "
    "cosim reproduce thesis --mi29 FILE runs it: moduli of table 4, 11.8 N in EDC, the file's "
    "posture, adhesions to the proximal phalanx as springs of 1000 N/mm. "
)


@lru_cache(maxsize=8)
def published_hood(path: Path, moduli: str) -> PublishedHood:
    """The hood of the user's file under EDC.  Raises InputError and ConvergenceError."""
    return solve_published_hood(path, qian_moduli(OFF[moduli]), PULL)


def published_numbers(path: Path) -> Numbers:
    """%: strains on the user's mesh by the names of ours (`thesis_models.strain_numbers`), over the
    inferred region and as means over the slips."""
    out: Numbers = {}
    slips: dict[tuple[str, str], float] = {}
    for moduli in MODULI:
        hood = published_hood(path, moduli)
        for direction, values in hood.strain_ranges(INFERRED).items():
            for statistic, value in values.items():
                out[f"strain.{moduli}.{direction}.{statistic}"] = (value,)
        for slip in ("central", "terminal"):
            ranges = hood.strain_ranges(f"{slip}_slip")
            slips[slip, moduli] = ranges["longitudinal"]["mean"]
    for (slip, moduli), value in slips.items():
        out[f"slip.{slip}.{moduli}_less_soft"] = (value - slips[slip, "soft"],)
    return out


def published_figures(path: Path | None) -> list[Figure]:
    """Strains by region and moduli beside the thesis's; without the file what they would be."""
    if path is None:
        return [Figure("published", TITLE, _without(), None)]
    table = _table(path)

    def draw(sheet: Sheet) -> None:
        every = sheet.subplots(1, 2, sharey=True)
        regions = list(dict.fromkeys(table.region))
        for axes, direction in zip(every, DIRECTIONS, strict=True):
            for k, region in enumerate(regions):
                own = table[(table.region == region) & (table.direction == direction)]
                place = 5 * np.arange(len(own)) + 0.8 * k
                axes.hlines(place, own["min"], own["max"], color=COLOURS[k], lw=3, label=region)
                axes.plot(own["mean"], place, "o", color=COLOURS[k], mfc="white", mew=1.8)
                for end in ("min", "max"):
                    axes.plot(own[end], place, "|", color=COLOURS[k], mew=2)
            axes.axvline(0.0, color="0.8", lw=0.8)
            style_axes(axes, f"{direction} strain, %", "")
        every[0].set_yticks(5 * np.arange(len(MODULI)) + 1.6, MODULI)
        every[0].invert_yaxis()
        handles, names = every[0].get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)

    note = (
        "Line from the least to the largest strain, circle: mean by area; dark blue: the inferred "
        "region. The thesis prints no largest strain with average and stiff moduli and no lateral "
        "one. In the table: least / mean / largest."
    )
    tables = {"published": table, "published_by_region": _by_region(table)}
    return [Figure("published", TITLE, GIVEN + CHOSEN + note, draw, tables, (9, 4.6))]


def _by_region(table: pd.DataFrame) -> pd.DataFrame:
    """A line for each region and direction, for the page."""
    cells = table.assign(
        strain=[
            " / ".join("-" if np.isnan(row[s]) else f"{row[s]:.2f}" for s in STATISTICS)
            for _, row in table.iterrows()
        ]
    )
    wide = cells.pivot(index=["direction", "region"], columns="moduli", values="strain")
    order = list(dict.fromkeys(zip(table.direction, table.region, strict=True)))
    columns = wide[list(MODULI)].loc[sorted(order, key=lambda pair: DIRECTIONS.index(pair[0]))]
    return columns.rename(columns=lambda name: f"{name}, %").reset_index()


def _without() -> str:
    return (
        "Not run: no mesh was given. " + GIVEN + "The file has no licence and is not shipped. With "
        "it this place shows the strains of three regions of that mesh beside table 5 and beside "
        "our sheet, and the rows get two columns more: what its mesh says, and whether that "
        "reproduces the thesis. " + CHOSEN + "cosim/papers/README.md says what came of it."
    )


def _table(path: Path) -> pd.DataFrame:
    """%, one line a region, moduli and direction."""
    printed = printed_numbers()
    out = []
    for moduli in MODULI:
        hood, sheet = published_hood(path, moduli), hood_run(f"thesis_strain_{moduli}").summary
        for direction in DIRECTIONS:
            theirs = {
                s: printed.get(f"strain.{moduli}.{direction}.{s}", np.nan) for s in STATISTICS
            }
            found = {name: hood.strain_ranges(key)[direction] for key, name in REGIONS.items()}
            models = {THESIS: theirs, **found, OURS: sheet["strain_percent"][direction]}
            for region, values in models.items():
                out.append({"region": region, "moduli": moduli, "direction": direction, **values})
    return pd.DataFrame(out)
