"""Table 1 of paper 001 as it can be read, and the excursions that its entries make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.lines import MUSCLE_COLOURS
from cosim.report.figures import Figure, style_axes
from rigid.hoods.two_band import JOINTS, MUSCLES, TABLE_1, excursions

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

REACH = {"MCP": 90.0, "PIP": 110.0, "DIP": 73.0}
"""deg: of the IP joints what the paper flexes; of the MCP, which it holds still, a right angle."""
DASHES = {"certain": "-", "likely": "--", "uncertain": ":"}
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


def table_figures() -> list[Figure]:
    """Excursions over one joint at a time, drawn after the certainty of the entry."""
    rows = [
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
    caption = (
        "Excursion models over one joint at a time, the others straight: e = R phi of extensors "
        "(Landsmeer's model I), (R + R' phi) phi of flexors (model III), for the interphalangeal "
        "extensors the larger shift of either band (5). The scan is bad: solid lines rest on "
        "certain entries, dashed on likely, dotted on uncertain ones; the lumbrical's hold "
        "FDP's, which its origin moves with. The four-finger factor of 0.833 is in the entries "
        "already."
    )
    return [
        Figure(
            "table_1_excursions",
            "Table 1: excursion models and how certain their entries are",
            caption,
            _draw,
            {"table_1_entries": pd.DataFrame(rows), "table_1_excursions": _excursions()},
            (9.0, 4.0),
        )
    ]


def _excursions() -> pd.DataFrame:
    parts = []
    for joint, most in REACH.items():
        angle = np.linspace(0.0, most, 56)
        moved = 1e3 * excursions(np.radians(_alone(joint, angle)))
        columns = {f"{m}_mm": moved[:, k] for k, m in enumerate(MUSCLES)}
        parts.append(pd.DataFrame({"joint": joint, "angle_deg": angle, **columns}))
    return pd.concat(parts, ignore_index=True)


def _alone(joint: str, angle: np.ndarray) -> np.ndarray:
    """(n, 3) deg, with one joint turned."""
    return angle[:, None] * (np.array(JOINTS) == joint)


def _draw(sheet: Sheet) -> None:
    panels, data = sheet.subplots(1, 3, sharey=True), _excursions()
    for axes, joint in zip(panels, JOINTS, strict=True):
        part = data[data.joint == joint]
        for k, muscle in enumerate(MUSCLES):
            entry = TABLE_1.get((muscle, joint))
            if entry is None:
                continue
            axes.plot(
                part.angle_deg,
                part[f"{muscle}_mm"],
                DASHES[entry.certainty],
                color=MUSCLE_COLOURS[k],
                lw=2.4 if muscle == "ED" else 1.6,
                label=muscle,
            )
        style_axes(axes, f"{joint}, deg", "excursion, mm" if joint == "MCP" else "")
    handles, labels = panels[0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
