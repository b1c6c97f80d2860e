"""A report of runs: its tables, or the page, one HTML file with its data, its script and plotly
inside."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cosim.errors import InputError, Progress, quiet
from cosim.files import write_text
from cosim.report import drawings, words
from cosim.report.histories import pack_charts
from cosim.report.tables import last_ledger, last_state, tables_of, tables_text
from cosim.report.templates import html_page, packed, packed_json, packed_picture, report_file
from cosim.report.views import View, difference_view, limits, pack_views, view_of
from cosim.results.compare import VERDICT_SHAPES, number, read_targets
from cosim.results.conventions import source_words
from cosim.results.looks import look
from cosim.results.picture import data_address
from cosim.results.read import read_runs
from cosim.results.result import Result
from cosim.results.table import ReportTable, cell_html

Form = Literal["html", "csv", "json", "md"]
MOST_BYTES = 8_000_000
CURVE = 1.8
"""Width of a curve over time, px."""
TELLING = 0.02
"""Share of a body's largest force: smaller ones are summed up in a line."""


@dataclass(frozen=True)
class Bar:
    """A force on a body: its size N, its share of the longest bar in per cent, and its direction as
    seen from the radial side, deg clockwise from the left (distal); None where it has none."""

    source: str
    size: float
    share: float
    angle: float | None


def write_report(
    folders: Sequence[Path],
    out: Path | None,
    form: Form,
    against: Path | None = None,
    data: Path | None = None,
    note: Progress = quiet,
) -> str:
    """Write the report and return what to tell: where it is, or without `out` the tables; `note`
    takes what there is to say beside it.  The run `against` may be one of the others.

    Raises InputError where a folder is no run, or the file cannot be written."""
    if not folders:
        raise InputError("a report needs one run or more")
    targets = read_targets(data) if data is not None else ()
    shown, places = list(folders), [folder.resolve() for folder in folders]
    at = None if against is None else against.resolve()
    if against is not None and at not in places:
        shown.append(against)
    every = read_runs(shown, targets)
    others = Counter(t.case for t in targets if t.case not in ("", *(run.case for run in every)))
    for case, count in others.items():
        note(f"{data}: rows for the case {case}, of which no run is reported: {count}")
    runs, reference = every[: len(folders)], None
    if at is not None:
        reference = every[places.index(at)] if at in places else every[-1]
    tables = tables_of(runs, reference)
    if form == "html":
        text = page(runs, reference, tables)
        out = Path("report.html") if out is None else out
    else:
        text = tables_text(form, every, tables)
    if out is None:
        return text
    write_text(out, text)
    return f"{out}: {len(text.encode('utf-8')) / 1e6:.1f} MB"


def page(runs: Sequence[Result], against: Result | None, tables: Sequence[ReportTable]) -> str:
    """The whole page.  Raises InputError where it would be too large to send around."""
    from plotly.offline import get_plotlyjs

    every = [*runs, against] if against is not None else [*runs]
    views, scales = _views(runs, against)
    arrows = drawings.arrows_of(every)
    pairs = zip(every, views, strict=False)  # views of differences stand last
    histories = [
        {"view": i, "name": run.name, "charts": charts}
        for i, (run, view) in enumerate(pairs)
        if (charts := pack_charts(run, view))
    ]
    text = html_page(
        "page.html.j2",
        "cosim.report",
        {"cell": cell_html, "spoken": source_words},
        words=words,
        drawings=drawings,
        shapes=VERDICT_SHAPES,
        runs=runs,
        every=every,
        against=against,
        tables={table.key: table for table in tables},
        views=views,
        moves=any(view.times for view in views),
        charts=bool(histories),
        sheets=any(view.sheet for view in views),
        dots=any(table.key.startswith("dots_") for table in tables),
        pictures=[(run, _picture(run, "picture")) for run in every],
        held=[(run, _picture(run, "history")) for run in every if "held_time" in run.arrays.dims],
        arrows=arrows,
        plane=drawings.plane(arrows) if arrows else "",
        bars={run.name: _bars(run) for run in every},
        last_state=last_state,
        cases=[(run, data_address(run.case_text.encode(), "text/plain")) for run in every],
        data=packed_json(
            {
                **pack_views(views, scales),
                "history": histories,
                "looks": _line_looks(histories),
            }
        ),
        script=report_file("scene.js") + report_file("page.js"),
        plotly=packed(get_plotlyjs()),
    )
    size = len(text.encode("utf-8"))
    if size > MOST_BYTES:
        raise InputError(
            f"the report of {len(every)} runs would have {size / 1e6:.1f} MB, more than the "
            f"{MOST_BYTES / 1e6:.0f} MB that can be sent around; report fewer runs at a time"
        )
    return text


def _views(runs: Sequence[Result], against: Result | None) -> tuple[list[View], list[Any]]:
    """Views with the colour scales of each: one for all runs, one for all differences."""
    views = [view_of(run) for run in ([*runs, against] if against is not None else runs)]
    gaps = []
    if against is not None:
        gaps = [g for v in views[:-1] if (g := difference_view(v, views[-1])) is not None]
    return [*views, *gaps], [limits(views)] * len(views) + [limits(gaps)] * len(gaps)


def _picture(run: Result, name: str) -> str | None:
    """A picture of the run as a data address: each pixel as it is, in the smallest lossless format
    that browsers know."""
    content = run.picture(name)
    if content is None:
        return None
    try:
        return packed_picture(content)
    except OSError as error:
        raise InputError(f"{run.folder}/{name}.png: is no picture ({error})") from error


def _bars(run: Result) -> list[tuple[str, list[Bar], str]]:
    """For each body its forces in the last state, the largest first, and what of them is small."""
    books = last_ledger(run)
    sizes = {
        body: {source: float(np.linalg.norm(w[:3])) for source, w in entries.items()}
        for body, entries in books.items()
    }
    longest = max((s for by_source in sizes.values() for s in by_source.values()), default=0.0)
    out = []
    for body, by_source in sizes.items():
        telling = TELLING * max(by_source.values())
        bars = [
            Bar(source, size, 100 * size / (longest or 1.0), _direction(books[body][source]))
            for source, size in sorted(by_source.items(), key=lambda item: -item[1])
            if size > telling
        ]
        small = len(by_source) - len(bars)
        out.append(
            (body, bars, f"{small} more, below {number(telling, 2)} N each" if small else "")
        )
    return out


def _direction(wrench: np.ndarray) -> float | None:
    distal, _, dorsal = wrench[:3]
    if np.hypot(distal, dorsal) < 1e-9:
        return None
    return float(np.rad2deg(np.arctan2(dorsal, distal)))


def _line_looks(histories: Sequence[Any]) -> list[Any]:
    """For plotly the look of each curve of a chart, of as many as the fullest has."""
    count = max((len(c["curves"]) for h in histories for c in h["charts"]), default=0)
    return [
        {
            "color": one.colour,
            "dash": ",".join(f"{CURVE * part:g}px" for part in one.dashes) or "solid",
            "width": CURVE,
        }
        for one in map(look, range(count))
    ]
