"""The thesis, computed anew: tables 1 to 7 and figures 2.1 to 3.7 as far as its text gives numbers.

C. T. Jadelis, Index Finger Extensor Hood Mechanics Using Finite Element and Rigid Body Dynamic
Modeling, thesis, North Carolina State University."""

from __future__ import annotations

from pathlib import Path

from cosim.papers.thesis_forces import device_figures, force_figures, ledger_figures, time_figures
from cosim.papers.thesis_models import all_numbers
from cosim.papers.thesis_published import published_figures, published_numbers
from cosim.papers.thesis_rows import row_figures
from cosim.papers.thesis_strains import slip_figures, strain_figures
from cosim.papers.thesis_unprinted import unprinted_figures
from cosim.report.figures import Figure, FigureStudy


def studies(mesh: Path | None = None) -> tuple[FigureStudy, ...]:
    """The page's studies; `mesh`: the user's file of the hood that the thesis started from."""

    def rows() -> list[Figure]:
        return row_figures(all_numbers(), None if mesh is None else published_numbers(mesh))

    return (
        FigureStudy(
            "rows", "every row of its tables and sections, and whether ours is the same", rows
        ),
        FigureStudy(
            "published",
            "table 5 on the mesh that the thesis started from",
            lambda: published_figures(mesh),
        ),
        FigureStudy("devices", "figures 3.1 and 3.2: two fingertip devices", device_figures),
        FigureStudy("strains", "figure 3.4 and table 5: six strain maps", strain_figures),
        FigureStudy(
            "unprinted", "what the thesis does not print, and what it changes", unprinted_figures
        ),
        FigureStudy("slips", "figure 3.5: strains of the slips", slip_figures),
        FigureStudy("forces", "figures 3.6 and 3.7: forces one way and two-way", force_figures),
        FigureStudy("ledger", "table 7: forces by source", ledger_figures),
        FigureStudy("times", "section 3.1: run times", time_figures),
    )
