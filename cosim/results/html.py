"""A result as a notebook shows it: a few tables and a picture, without a style of its own."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

from cosim.results.summary_tables import rows_of

if TYPE_CHECKING:
    from cosim.results.result import Result

DPI = 72


def html_of(result: Result) -> str:
    """The title, the audit's verdict, the tables of the terminal and the picture."""
    parts = [f"<h4>{escape(result.title)}</h4><p>{escape(str(result.audit))}</p>"]
    for header, rows in rows_of(result.summary):
        head = "".join(f"<th>{escape(cell)}</th>" for cell in header) if any(header) else ""
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
        )
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    return "\n".join([*parts, _image(result)])


def _image(result: Result) -> str:
    png = result.picture("picture")
    if png is None:
        file = BytesIO()
        result.plot().savefig(file, format="png", dpi=DPI)
        png = file.getvalue()
    source = f"data:image/png;base64,{b64encode(png).decode()}"
    return f'<img alt="{escape(result.title, quote=True)}" src="{source}" style="max-width:100%">'
