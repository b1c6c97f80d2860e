"""A result as a notebook shows it: a few tables and a picture, without a style of its own."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from cosim.results.answer import answer, doubts, trust
from cosim.results.picture import data_address
from cosim.results.summary_tables import rows_of
from cosim.results.table import ReportTable


def html_of(title: str, summary: Mapping[str, Any], png: bytes) -> str:
    """The title, the answer with its doubts and warnings, the tables of the terminal and the
    picture."""
    said = " ".join([*answer(summary), trust(summary)])
    parts = [f"<h4>{escape(title)}</h4><p>{escape(said)}</p>"]
    for doubt in (*doubts(summary), *summary.get("warnings", ())):
        parts.append(f"<p><b>▲ {escape(doubt)}</b></p>")
    for header, rows in rows_of(summary):
        parts.append(ReportTable("", "", header, rows).html(""))
    alt = escape(title, quote=True)
    return "\n".join(
        [*parts, f'<img alt="{alt}" src="{data_address(png)}" style="max-width:100%">']
    )
