"""Figures computed anew, as files and as one page that needs nothing else."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from cosim.errors import InputError, Progress
from cosim.files import output_folder
from cosim.report.templates import own_file, template
from cosim.results.picture import write_figure
from cosim.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Sheet

MARK = "index.html"
DPI = 150
MOST_ROWS, MOST_COLUMNS = 16, 8
"""A table that is no larger is shown on the page too."""
WIDE = 40  # characters of a cell beyond which its column's lines are broken
DIGITS = "{:.4g}".format


@dataclass(frozen=True)
class Figure:
    """One picture with the table behind it.  `draw` fills a fresh matplotlib figure of `size`
    inches; `tables` by file name hold every number that is drawn, with units in their headings."""

    name: str
    """A file's name without its ending: "figure_3_contours"."""
    title: str
    caption: str
    """What is seen, what the paper says of it, and what is ours: assumptions, labels, misses."""
    draw: Callable[[Sheet], None] | None
    """None: a table alone."""
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    size: tuple[float, float] = (7.0, 4.5)


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
    kind: str = "A paper's figures, computed anew"
    """What the page is, in a line above its title."""
    made_by: str = ""
    """The command, where it is not `cosim reproduce NAME`."""

    @property
    def command(self) -> str:
        """The command that makes the page."""
        return self.made_by or f"cosim reproduce {self.name}"


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
    picture = b"" if figure.draw is None else _picture(figure.draw, figure.size)
    if picture:
        (folder / f"{figure.name}.png").write_bytes(picture)
    for name, table in figure.tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.9g")
    return {
        "figure": figure,
        "picture": b64encode(picture).decode("ascii"),
        "small": list(_small(figure)),
        "files": [f"{name}.csv" for name in figure.tables],
        "command": f"{page.command} --only {study.name}",
    }


def _picture(draw: Callable[[Sheet], None], size: tuple[float, float]) -> bytes:
    from matplotlib.figure import Figure as Blank

    sheet, out = Blank(figsize=size, layout="constrained"), BytesIO()
    draw(sheet)
    write_figure(sheet, out, DPI)
    return out.getvalue()


def _small(figure: Figure) -> Iterator[tuple[str, str]]:
    """File name and HTML of the tables that a page has room for."""
    for name, table in figure.tables.items():
        if table.shape[0] <= MOST_ROWS and table.shape[1] <= MOST_COLUMNS:
            yield f"{name}.csv", _html(table)


def _html(table: pd.DataFrame) -> str:
    kinds = [_kind(table[name]) for name in table]

    def row(tag: str, cells: Sequence[object]) -> str:
        parts = (
            f"<{tag} {kind}>{escape(DIGITS(c) if isinstance(c, float) else str(c))}</{tag}>"
            for kind, c in zip(kinds, cells, strict=True)
        )
        return "<tr>" + "".join(parts) + "</tr>"

    head = row("th", list(table.columns))
    body = "".join(row("td", cells) for cells in table.itertuples(index=False))
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _kind(column: pd.Series) -> str:
    """How a column's cells are set."""
    if pd.api.types.is_numeric_dtype(column.dtype):
        return 'class="n"'
    return 'class="w"' if column.astype(str).str.len().max() > WIDE else ""


def _page(
    page: FigurePage, studies: Sequence[FigureStudy], shown: Sequence[dict[str, object]]
) -> str:
    whole = len(studies) == len(page.studies)
    return template("cosim.report", "figures.html.j2").render(
        page=page,
        shown=shown,
        style=own_file("page.css"),
        version=__version__,
        command=page.command + ("" if whole else "".join(f" --only {s.name}" for s in studies)),
        left_out=[s for s in page.studies if s not in studies],
    )


def style_axes(axes: Axes, x: str, y: str) -> None:
    """Labels, a quiet grid, no box."""
    axes.set(xlabel=x, ylabel=y)
    axes.grid(color="0.9", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
