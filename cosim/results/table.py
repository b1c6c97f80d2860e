"""A table that shows itself: in the terminal, as CSV, as Markdown and as HTML."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.results.compare import number

if TYPE_CHECKING:
    from markupsafe import Markup
    from rich.table import Table

Cell = str | float | bool | None
"""A text is escaped in HTML, unless it is that already (`Markup`)."""
SUM = "sum"
MISS = "▲"
"""What a cell begins with that tells of a miss."""


@dataclass(frozen=True)
class ReportTable:
    """Rows of words and numbers; a number is None where a run does not have it."""

    key: str
    title: str
    columns: Sequence[str]
    """With the unit where it is the same for the whole column."""
    rows: Sequence[Sequence[Cell]]
    digits: int = 4
    """Shown of a number; CSV and JSON have more."""

    def words(self) -> list[list[str]]:
        """The rows as people read them."""
        return [[cell_text(cell, self.digits) for cell in row] for row in self.rows]

    def only(self, *columns: str) -> ReportTable:
        """These columns alone."""
        at = [list(self.columns).index(name) for name in columns]
        rows = [[row[i] for i in at] for row in self.rows]
        return ReportTable(self.key, self.title, columns, rows, self.digits)

    def in_terminal(self, of_words: bool = False) -> Table:
        """The table for a terminal, the first column to the left; of words all."""
        from rich import box
        from rich.table import Table

        heads = any(self.columns)
        table = Table(box=box.SIMPLE, show_header=heads, pad_edge=False)
        for i, name in enumerate(self.columns):
            left = i == 0 or of_words or not heads
            table.add_column(name, justify="left" if left else "right", overflow="fold")
        for row in self.words():
            table.add_row(*row)
        return table

    def csv(self) -> str:
        """A line for each row, a number to nine digits, empty where there is none."""
        rows = ([f"{c:.9g}" if isinstance(c, float) else c for c in row] for row in self.rows)
        return csv_text([self.columns, *rows])

    def markdown(self) -> str:
        """The table alone."""
        rows = (self.columns, ["---"] * len(self.columns), *self.words())
        return "\n".join(
            f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in rows
        )

    def html(self, kind: str = "numbers") -> Markup:
        """The table for a page, with a class of its style sheet: "numbers" begins with words and
        units, "figures" with words, "words" has any columns; without a class for a notebook."""
        from markupsafe import Markup

        kinds = [Markup("")] * len(self.columns)
        if not kind.startswith("numbers"):
            of_words = [
                any(isinstance(c, str) for c in cells) for cells in zip(*self.rows, strict=True)
            ]
            kinds = [Markup("" if words else ' class="n"') for words in of_words] or kinds
        pairs = zip(kinds, self.columns, strict=True)
        heads = Markup("").join(Markup('<th scope="col"{}>{}</th>').format(*pair) for pair in pairs)
        rows = Markup("").join(map(self._row, self.rows))
        pattern = "<thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody></table>"
        inner = Markup(pattern).format(heads, rows)
        if not kind:
            return Markup("<table>") + inner
        opening = '<div class="scroll"><table class="{}" data-save="{}" data-table="{}">\n{}</div>'
        return Markup(opening).format(kind, self.title, self.key, inner)

    def _row(self, row: Sequence[Cell]) -> Markup:
        from markupsafe import Markup

        cells = [_td(cell, self.digits) for cell in row]
        if self.key == "numbers":
            cells[0] = Markup("<td><code>{}</code></td>").format(row[0])
        mark = Markup(' class="sum"' if SUM in row[1:2] else "")
        return Markup("<tr{}>{}</tr>\n").format(mark, Markup("").join(cells))


def _td(cell: Cell, digits: int) -> Markup:
    from markupsafe import Markup

    shown = cell_html(cell, digits)
    match cell:
        case None:
            return Markup('<td class="n none">{}</td>').format(shown)
        case str() | bool():
            mark = Markup(' class="miss"' if shown.startswith(MISS) else "")
            return Markup("<td{}>{}</td>").format(mark, shown)
    return Markup('<td class="n" data-value="{}">{}</td>').format(cell, shown)


def cell_text(cell: Cell, digits: int = 4) -> str:
    """A cell in words: numbers to so many digits, a dash where there is none."""
    match cell:
        case bool():
            return "yes" if cell else "no"
        case str():
            return cell
    return number(cell, digits)


def cell_html(cell: Cell, digits: int = 4) -> str:
    """The same for a page, where a number has a minus and no hyphen."""
    match cell:
        case str():
            return cell
    return cell_text(cell, digits).replace("-", "−")


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows as CSV, None as an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
