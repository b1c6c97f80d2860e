"""The case file of a fit: the case that it extends, the settings found, and where they are from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from cosim.analyses.identify.cases import FitCase, StatedCase
from cosim.analyses.identify.fit import Fit, identifiability, interval
from cosim.case.file import Settings, load_case
from cosim.errors import InputError
from cosim.results.compare import Comparison, number, reference_text
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.text_tables import notes, toml_settings, toml_text


def case_text(
    fit: Fit,
    title: str,
    base: str | None,
    settings: Settings,
    targets: str,
    cases: Sequence[StatedCase] = (),
) -> str:
    """TOML that extends the case `base` (a path or name) with `settings` and those found; without a
    base the settings alone, for a case file of one's own.  `cases`: of a fit over several."""
    head = f"{schema_line(CASE_SCHEMA)}\n{notes(_provenance(fit, targets, cases))}"
    if base is None:
        head += '# Settings alone: write extends = "CASE" and a title above them.\n'
    else:
        head += toml_text({"extends": base, "title": title})
    return f"{head}\n{toml_settings((*settings, *fit.settings))}"


def check_same_settings(cases: Sequence[FitCase]) -> None:
    """Check that one file can hold what is fitted: that it sets the same keys in all cases.  Raises
    InputError."""
    first = cases[0].free
    start = {p.name: p.start for p in first.parameters}
    differing = [c.name for c in cases if c.free.settings(start) != first.settings(start)]
    if differing:
        raise InputError(
            f"--out: the parameters set other keys or values in {', '.join(differing)} than in "
            f"{cases[0].name}, so one file cannot state them; leave out --out, or give the "
            "parameters settings in --free"
        )


def _provenance(fit: Fit, targets: str, cases: Sequence[StatedCase]) -> Iterator[str]:
    yield f"Identified with `cosim identify` from {targets}; nothing else was fitted to."
    yield ""
    if len(cases) > 1:
        yield "Cases of the fit:"
        for case in cases:
            yield f"  {case.name}: {' '.join([case.source.name, *case.settings])}"
        yield ""
    yield "Fitted (95 % interval, linearised, of the rows that pull; bounds; start):"
    for p in fit.parameters:
        limits = "{:.3g} to {:.3g}; ".format(*interval(fit, p.name)) if p in fit.within else ""
        yield (
            f"  {p.name} = {p.format_value(fit.values[p.name])} ({limits}{p.low:g} to {p.high:g}; "
            f"{p.start:.4g}): {identifiability(fit, p.name)}"
        )
    yield ""
    yield from _correlations(fit)
    several = len(cases) > 1
    yield from _rows("Targets, the model before and after:", fit.start, fit.rows, several)
    title = "Held out, rows that did not pull, the model before and after:"
    yield from _rows(title, fit.held_out_start, fit.held_out, several)
    for part in fit.parts:
        yield (
            f"Rows {part.name}: {part.count}, RMS of their misses {part.start:.3g} SD before, "
            f"{part.end:.3g} after, {part.zero:.3g} if every number were 0."
        )
    for note in fit.notes:
        yield f"{note}."
        yield ""


def _correlations(fit: Fit) -> Iterator[str]:
    names = [p.name for p in fit.within]
    pairs = [
        f"{a} with {b} {fit.confidence.correlation[i, j]:+.2f}"
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
    ]
    if pairs:
        yield f"Correlations: {', '.join(pairs)}."
        yield ""


def _rows(
    title: str, start: Sequence[Comparison], rows: Sequence[Comparison], several: bool
) -> Iterator[str]:
    if not rows:
        return
    yield title
    for first, row in zip(start, rows, strict=True):
        yield f"  {f'{row.target.case}: ' if several else ''}{_row(first, row)}"
    yield ""


def _row(first: Comparison, row: Comparison) -> str:
    t = row.target
    return (
        f"{t.name}: {reference_text(t)} {t.unit} ({t.kind}; {t.source}); {number(first.model)}, "
        f"{number(row.model)}"
    )


def check_loads(path: Path) -> None:
    """Check that the file is a case.  Raises InputError."""
    try:
        load_case(path)
    except InputError as error:
        raise InputError(f"the settings found do not make a case file: {error}") from None
