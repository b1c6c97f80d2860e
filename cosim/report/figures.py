"""Figures computed anew, as files and as one page that needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from cosim.errors import InputError, Progress
from cosim.files import output_folder
from cosim.report.templates import html_page
from cosim.results.picture import as_png, data_address, picture_address
from cosim.results.table import Cell, ReportTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

MARK = "index.html"
DPI = 150
MOST_ROWS, MOST_COLUMNS = 16, 8
"""A table that is no larger is shown on the page too."""


@dataclass(frozen=True)
class Figure:
    """One picture with the tables behind it."""

    name: str
    """Its file's name without the ending: "figure_3_contours"."""
    title: str
    caption: str
    """What is seen, what the paper says of it, and what is ours: assumptions, labels, misses."""
    picture: Picture | None
    """None: tables alone."""
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    """By file name every number that is drawn, with units in the headings."""


@dataclass(frozen=True)
class FigureStudy:
    """What figures are known by before they are computed."""

    name: str
    about: str
    figures: Callable[[], list[Figure]]


@dataclass(frozen=True)
class FigurePage:
    """What a page of figures says of itself."""

    name: str
    """As in `cosim reproduce NAME`."""
    title: str
    studies: tuple[FigureStudy, ...]
    kind: str = "Published figures and tables, computed anew"
    """What the page is, in a line above its title."""
    made_by: str = ""
    """The command, where it is not `cosim reproduce NAME`."""
    notes: tuple[str, ...] = ()
    """Paragraphs under the title."""

    @property
    def command(self) -> str:
        """The command that makes the page."""
        return self.made_by or f"cosim reproduce {self.name}"


@dataclass(frozen=True)
class Shown:
    """What a cell of a script shows."""

    picture: Picture | None
    table: pd.DataFrame | None
    """Written under the cell's name, as the picture is."""
    tables: Mapping[str, pd.DataFrame]
    """Others, by the names that they are written under."""

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        parts = []
        if self.picture is not None:
            parts.append(f'<img src="{picture_address(self.picture, DPI)}">')
        first = [] if self.table is None else [self.table]
        return "".join([*parts, *map(_html, [*first, *self.tables.values()])])


def show(
    picture: Picture | None = None, table: pd.DataFrame | None = None, /, **tables: pd.DataFrame
) -> Shown:
    """Show a picture and a table, written under the cell's name, and tables under their own.

    One of these whose `attrs` hold a "title" begins a figure."""
    return Shown(picture, table, tables)


def choose_studies(page: FigurePage, only: Sequence[str]) -> list[FigureStudy]:
    """The studies named, all without a name.  Raises InputError for one that there is not."""
    known = [study.name for study in page.studies]
    strange = [name for name in only if name not in known]
    if strange:
        raise InputError(
            f"--only {', '.join(strange)}: {page.name} has no such study; it has "
            + ", ".join(f"{s.name} ({s.about})" for s in page.studies)
        )
    return [study for study in page.studies if not only or study.name in only]


def write_figures(
    page: FigurePage, studies: Sequence[FigureStudy], folder: Path, progress: Progress
) -> int:
    """Compute the studies' figures; write each one's picture and tables, and the page; how many.

    Raises InputError where the folder cannot be written, and what a study raises."""
    with output_folder(folder, MARK) as part:
        shown = []
        for k, study in enumerate(studies, 1):
            progress(f"{k}/{len(studies)} {study.name}: {study.about}")
            for figure in study.figures():
                shown.append(_write_and_show(part, page, study, figure))
        (part / MARK).write_text(_page(page, studies, shown), encoding="utf-8")
    return len(shown)


def _write_and_show(
    folder: Path, page: FigurePage, study: FigureStudy, figure: Figure
) -> dict[str, object]:
    """Write a figure's files; what the page shows of it."""
    picture = b"" if figure.picture is None else as_png(figure.picture, DPI)
    if picture:
        (folder / f"{figure.name}.png").write_bytes(picture)
    for name, table in figure.tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.9g")
    return {
        "figure": figure,
        "image": data_address(picture) if picture else "",
        "width": 0 if figure.picture is None else int(96 * figure.picture.get_size_inches()[0]),
        "small": [
            _html(table)
            for table in figure.tables.values()
            if table.shape[0] <= MOST_ROWS and table.shape[1] <= MOST_COLUMNS
        ],
        "command": f"{page.command} --only {study.name}",
    }


def _code(text: str) -> str:
    """A paragraph as HTML: what stands between backticks as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _html(frame: pd.DataFrame) -> str:
    rows = [tuple(map(_cell, cells)) for cells in frame.itertuples(index=False)]
    return ReportTable("", "", tuple(map(str, frame.columns)), rows).html("")


def _cell(value: Any) -> Cell:
    """A number as such, anything else in words."""
    match value:
        case bool() | np.bool_():
            return str(value)
        case float() | int() | np.number():
            return float(value)
    return str(value)


def _page(
    page: FigurePage, studies: Sequence[FigureStudy], shown: Sequence[dict[str, object]]
) -> str:
    whole = len(studies) == len(page.studies)
    return html_page(
        "figures.html.j2",
        "cosim.report",
        {"code": _code},
        page=page,
        shown=shown,
        command=page.command + ("" if whole else "".join(f" --only {s.name}" for s in studies)),
        left_out=[s for s in page.studies if s not in studies],
    )


def style_axes(axes: Axes, x: str, y: str) -> None:
    """Labels, a quiet grid, no box."""
    axes.set(xlabel=x, ylabel=y)
    axes.grid(color="0.9", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend_below(picture: Picture, columns: int, axes: Axes | None = None, **style: Any) -> None:
    """One legend under all panels, of the curves of `axes` alone where they are given."""
    handles = () if axes is None else axes.get_legend_handles_labels()
    picture.legend(*handles, loc="outside lower center", ncols=columns, frameon=False, **style)
