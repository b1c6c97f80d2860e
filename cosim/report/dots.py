"""The points, gauges and grids of the user's on the hood: what the model says of them beside what
was measured."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cosim.results.compare import Comparison, number, numbers_of, unit_of, value_of
from cosim.results.quantities import meaning_of
from cosim.results.result import Result

DISPLACEMENT, GAUGE = "point_displacement_mm", "gauge_strain_percent"
KEYS = (DISPLACEMENT, GAUGE, "point_strain_percent", "grid_strain_percent")
PLACES = {"loaded": "", "at rest": "unloaded.", "change": "difference."}
"""The states of an equilibrium, and where the summary has them."""
AT_END = {"at the end": ""}
MEASURED = ("measured", "of", "SD", "model less measured")


Cell = str | float | None


def dots_table(run: Result) -> tuple[tuple[str, ...], tuple[tuple[Cell, ...], ...]]:
    """Columns and rows: a row for each number of a point, gauge or grid, with measured values where
    there are any."""
    places = PLACES if "unloaded" in run.summary else AT_END
    paths = [path for path in numbers_of(run.summary) if path.split(".")[0] in KEYS]
    rows: list[tuple[Cell, ...]] = []
    compared = any(_comparisons(run, path) for path in paths)
    for path in paths:
        values = [value_of(run.summary, where + path) for where in places.values()]
        first = (meaning_of(path, run.summary) or path, unit_of(path), *values)
        found = _comparisons(run, path) if compared else []
        rows += [(*first, *_measured(state, row)) for state, row in found]
        if not found:
            rows.append((*first, *((None, "", None, None) if compared else ())))
    columns = ("quantity", "unit", *places, *(MEASURED if compared else ()))
    return columns, tuple(rows)


def _comparisons(run: Result, path: str) -> list[tuple[str, Comparison]]:
    """What was measured of a number, with the state that it is of."""
    places = PLACES if "unloaded" in run.summary else AT_END
    return [
        (state, row)
        for state, where in places.items()
        for row in run.comparison
        if row.target.quantity == where + path and row.target.reference is not None
    ]


def _measured(state: str, row: Comparison) -> tuple[Cell, ...]:
    return row.target.reference, state, row.target.sd, row.difference


def dots_in_words(run: Result) -> dict[str, str]:
    """What there is to say of each point and gauge by its name: how far it moved, the strain along
    it, and what was measured."""
    moved = run.summary.get(DISPLACEMENT, {})
    out = {
        name: f"{_spoken(name)}: moved {_said(math.hypot(*by_axis.values()))} mm from where it lay"
        for name, by_axis in moved.items()
    }
    for name, strain in run.summary.get(GAUGE, {}).items():
        out[name] = f"gauge {_spoken(name)}: strain {_said(strain)} %"
    for key in KEYS:
        for name in run.summary.get(key, {}):
            compared = [c for path in _paths(run, f"{key}.{name}") for c in _comparisons(run, path)]
            first = out.get(name, _spoken(name))
            out[name] = "; ".join([first, *(_residual(state, row) for state, row in compared)])
    return out


def _residual(state: str, row: Comparison) -> str:
    t = row.target
    sd = "" if t.sd is None else f" ± {_said(t.sd)}"
    residual = "" if row.difference is None else f", model {row.difference:+.3g}"
    text = f"{t.name}, {state}: measured {_said(t.reference)}{sd} {t.unit}{residual}"
    return text.replace("-", "−")


def _paths(run: Result, start: str) -> Iterator[str]:
    return (p for p in numbers_of(run.summary) if p == start or p.startswith(f"{start}."))


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _said(value: float | None) -> str:
    return number(value, 3).replace("-", "−")
