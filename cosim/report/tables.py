"""Every table of a report, as data: the page, CSV, JSON and Markdown show the same numbers.

Those of the user's points, gauges and grids on the hood say what was measured beside them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.json_text import json_text
from cosim.port import AXES
from cosim.results.audit import BOUNDS, audit_figures
from cosim.results.compare import (
    COLUMNS,
    Comparison,
    as_dict,
    number,
    numbers_of,
    unit_of,
    value_of,
)
from cosim.results.conventions import source_words
from cosim.results.quantities import key_quantities, meaning_of
from cosim.results.result import Result
from cosim.results.table import SUM, Cell, ReportTable, csv_text

FORMAT = "cosim report 1"
LEDGER = (
    *(f"F {axis} N" for axis in AXES),
    "|F| N",
    *(f"M {axis} N mm" for axis in AXES),
)
OF_EFFORT = ("hood_quads", "hood_cells", "wall_s")
AT_REST = "at rest"
OF_THE_HOOD = (
    *("fingertip_force_N", "fingertip_magnitude_N", "slip_force_N"),
    *("joint_torque_Nmm", "glide_mm", "lateral_band_height_mm"),
)
"""Quantities of which runs side by side also show the unloaded state."""
NOT_OUTCOMES = ("wall_s", "version", "case")


def tables_of(runs: Sequence[Result], against: Result | None) -> list[ReportTable]:
    """All tables, those without rows left out."""
    every = [*runs, against] if against is not None else [*runs]
    tables = [_outcome(runs[0]) if len(every) == 1 else _side_by_side(runs, against)]
    tables.append(_differences(runs, against))
    for i, run in enumerate(every):
        tables += [_tendons(run, i), _dots(run, i), _comparison(run, i)]
        tables += [_ledger(run, i), _audit(run, i), _counts(run, i)]
    tables.append(_numbers(runs, against))
    return [table for table in tables if table.rows]


def _outcome(run: Result) -> ReportTable:
    """One run: its loaded state beside the unloaded one."""
    places = {"loaded": "", AT_REST: "unloaded."}
    if "unloaded" not in run.summary:
        places = {"at the end": ""}
    rows: list[tuple[Cell, ...]] = []
    for label, quantity in key_quantities(run.summary):
        values = [value_of(run.summary, place + quantity) for place in places.values()]
        rows.append((label, unit_of(quantity), *values))
    return ReportTable("outcome", "What came out", ("quantity", "unit", *places), tuple(rows))


def _side_by_side(runs: Sequence[Result], against: Result | None) -> ReportTable:
    """Several runs: a column each; against another the differences too.  Below the loaded state of
    what the hood does stands the unloaded one."""
    labels = dict(pair for run in (*runs, against) if run for pair in key_quantities(run.summary))
    by_quantity = {quantity: label for label, quantity in labels.items()}
    rows = []
    for quantity, label in by_quantity.items():
        rows.append((label, unit_of(quantity), *_values(runs, against, quantity)))
        if quantity.split(".")[0] in OF_THE_HOOD:
            values = _values(runs, against, f"unloaded.{quantity}")
            if any(value is not None for value in values):
                rows.append((f"{label}, {AT_REST}", unit_of(quantity), *values))
    return ReportTable("outcome", "Side by side", _columns(runs, against), tuple(rows))


def _differences(runs: Sequence[Result], against: Result | None) -> ReportTable:
    """The loaded state less the unloaded one, a column for each run."""
    labels = dict(pair for run in (*runs, against) if run for pair in key_quantities(run.summary))
    by_quantity = {quantity: label for label, quantity in labels.items()}
    rows = (
        (label, unit_of(quantity), *_values(runs, against, f"difference.{quantity}"))
        for quantity, label in by_quantity.items()
    )
    kept = tuple(row for row in rows if any(value is not None for value in row[2:]))
    return ReportTable("difference", "Loaded less unloaded", _columns(runs, against), kept)


def _columns(runs: Sequence[Result], against: Result | None) -> tuple[str, ...]:
    names = [run.name for run in runs]
    if against is not None:
        names += [against.name, *(f"{run.name} less {against.name}" for run in runs)]
    return ("quantity", "unit", *names)


def _values(runs: Sequence[Result], against: Result | None, quantity: str) -> list[Cell]:
    values = [value_of(run.summary, quantity) for run in runs]
    if against is None:
        return [*values]
    base = value_of(against.summary, quantity)
    gaps = [None if v is None or base is None else v - base for v in values]
    return [*values, base, *gaps]


def _tendons(run: Result, place: int) -> ReportTable:
    """Tension, excursion and moment arms of each tendon, at the end."""
    arms = run.summary.get("moment_arm_mm", {})
    joints = tuple(dict.fromkeys(joint for by_joint in arms.values() for joint in by_joint))
    names = dict.fromkeys([*run.summary.get("tension_N", ()), *arms])
    columns = {"tension N": "tension_N", "excursion mm": "excursion_mm"}
    kept = {head: key for head, key in columns.items() if key in run.summary}
    rows = tuple(
        (
            name,
            *(value_of(run.summary, f"{key}.{name}") for key in kept.values()),
            *(value_of(run.summary, f"moment_arm_mm.{name}.{joint}") for joint in joints),
        )
        for name in names
    )
    heads = (f"arm {joint.replace('_', ' ')} mm" for joint in joints)
    return ReportTable(
        f"tendons_{place}", f"Tendons of {run.name}", ("tendon", *kept, *heads), rows
    )


def _comparison(run: Result, place: int) -> ReportTable:
    rows = tuple(tuple(as_dict(row).values()) for row in run.comparison)
    return ReportTable(f"comparison_{place}", f"{run.name} beside data", COLUMNS, rows)


def _ledger(run: Result, place: int) -> ReportTable:
    """Each body's forces by source in the last state, world axes, and their sum."""
    columns = ("body", "source", *LEDGER)
    rows: list[tuple[Cell, ...]] = []
    for body, entries in last_ledger(run).items():
        for source, wrench in {**entries, SUM: sum(entries.values(), np.zeros(6))}.items():
            force, moment = wrench[:3], 1e3 * wrench[3:]
            size = float(np.linalg.norm(force))
            rows.append((body, source_words(source), *map(float, force), size, *map(float, moment)))
    return ReportTable(
        f"ledger_{place}", f"Ledger of {run.name}, {last_state(run)}", columns, tuple(rows)
    )


def last_state(run: Result) -> str:
    """The last state of the ledger."""
    return run.rows[-1].state if run.rows else ""


def last_ledger(run: Result) -> dict[str, dict[str, Any]]:
    """The wrenches (6,) N and N m in the last state by body and source, world axes."""
    out: dict[str, dict[str, Any]] = {}
    for row in run.rows:
        if row.state == last_state(run):
            out.setdefault(row.body, {})[row.source] = np.concatenate([row.force, row.moment])
    return out


def _audit(run: Result, place: int) -> ReportTable:
    """Each check with the bound that the program holds it to."""
    missed = set(run.summary.get("audit_missed", ()))
    checks = audit_figures(run.summary)
    rows: list[tuple[Cell, ...]] = []
    for name in [*checks, *sorted(missed - set(checks))]:
        value, bound = checks.get(name), BOUNDS[name].most if name in BOUNDS else None
        word = "missed" if name in missed else "kept" if bound is not None else "no bound"
        named = name if unit_of(name) == "1" else f"{name.rpartition('_')[0]}, {unit_of(name)}"
        value = None if value is None else float(value)
        rows.append((named.replace("_", " "), value, bound, word))
    for name, reason in run.summary.get("audit_not_judged", {}).items():
        rows.append((name.replace("_", " "), None, None, f"not judged: {reason}"))
    columns = ("check", "value", "bound", "verdict")
    return ReportTable(f"audit_{place}", f"Audit of {run.name}", columns, tuple(rows))


def _counts(run: Result, place: int) -> ReportTable:
    """What the run took: iterations, the size of the mesh, time."""
    paths = [f"iterations.{name}" for name in run.summary.get("iterations", {})]
    paths += [name for name in OF_EFFORT if name in run.summary]
    rows = tuple(
        (meaning_of(path, run.summary) or path.replace("_", " "), value_of(run.summary, path))
        for path in paths
    )
    return ReportTable(f"counts_{place}", f"What {run.name} took", ("what", "number"), rows)


def _numbers(runs: Sequence[Result], against: Result | None) -> ReportTable:
    """Every number of the summaries, by the path that a target's `quantity` names it by."""
    every = [*runs, against] if against is not None else [*runs]
    paths = dict.fromkeys(p for run in every for p in numbers_of(run.summary))
    rows = tuple(
        (path, unit_of(path), *_values(runs, against, path))
        for path in paths
        if path.split(".")[0] not in NOT_OUTCOMES
    )
    return ReportTable("numbers", "Every number of the summary", _columns(runs, against), rows)


def as_json(runs: Sequence[Result], tables: Sequence[ReportTable]) -> str:
    """All tables, numbers in full."""
    content = {
        "format": FORMAT,
        "runs": [{"name": run.name, "case": run.case, "title": run.title} for run in runs],
        "tables": {t.key: {"title": t.title, "columns": t.columns, "rows": t.rows} for t in tables},
    }
    return json_text(content) + "\n"


def tables_text(form: str, runs: Sequence[Result], tables: Sequence[ReportTable]) -> str:
    """The tables as CSV, JSON (with the runs' summaries) or Markdown; `form`: csv, json, md."""
    if form == "json":
        return as_json(runs, tables)
    return as_csv(tables) if form == "csv" else as_markdown(tables)


def as_csv(tables: Sequence[ReportTable]) -> str:
    """A line for each cell: table, row (counted from 1), what the row is of, column, value."""
    return csv_text(
        [
            ("table", "row", "of", "column", "value"),
            *(
                (table.key, n, row[0], column, cell)
                for table in tables
                for n, row in enumerate(table.rows, 1)
                for column, cell in zip(table.columns[1:], row[1:], strict=True)
            ),
        ]
    )


def as_markdown(tables: Sequence[ReportTable]) -> str:
    """Every table under its title, numbers to four digits."""
    return "\n\n".join(f"## {table.title}\n\n{table.markdown()}" for table in tables) + "\n"


DISPLACEMENT, GAUGE = "point_displacement_mm", "gauge_strain_percent"
KEYS = (DISPLACEMENT, GAUGE, "point_strain_percent", "grid_strain_percent")
PLACES = {"loaded": "", "at rest": "unloaded.", "change": "difference."}
"""The states of an equilibrium, and where the summary has them."""
AT_END = {"at the end": ""}
MEASURED = ("measured", "of", "SD", "model less measured")


def _dots(run: Result, place: int) -> ReportTable:
    """A row for each number of a point, gauge or grid, with measured values where there are any."""
    places = PLACES if "unloaded" in run.summary else AT_END
    paths = [path for path in numbers_of(run.summary) if path.split(".")[0] in KEYS]
    rows: list[tuple[Cell, ...]] = []
    compared = any(_comparisons(run, path) for path in paths)
    for path in paths:
        values = [value_of(run.summary, where + path) for where in places.values()]
        first = (meaning_of(path, run.summary) or path, unit_of(path), *values)
        found = _comparisons(run, path) if compared else []
        rows += [(*first, c.target.reference, at, c.target.sd, c.difference) for at, c in found]
        if not found:
            rows.append((*first, *((None, "", None, None) if compared else ())))
    columns = ("quantity", "unit", *places, *(MEASURED if compared else ()))
    return ReportTable(f"dots_{place}", f"Points and gauges of {run.name}", columns, tuple(rows))


def _comparisons(run: Result, path: str) -> list[tuple[str, Comparison]]:
    """What was measured of a number, with the state that it is of."""
    places = PLACES if "unloaded" in run.summary else AT_END
    return [
        (state, row)
        for state, where in places.items()
        for row in run.comparison
        if row.target.quantity == where + path and row.target.reference is not None
    ]


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
            start = f"{key}.{name}"
            paths = [p for p in numbers_of(run.summary) if p == start or p.startswith(f"{start}.")]
            compared = [c for path in paths for c in _comparisons(run, path)]
            first = out.get(name, _spoken(name))
            out[name] = "; ".join([first, *(_residual(state, row) for state, row in compared)])
    return out


def _residual(state: str, row: Comparison) -> str:
    t = row.target
    sd = "" if t.sd is None else f" ± {_said(t.sd)}"
    residual = "" if row.difference is None else f", model {row.difference:+.3g}"
    text = f"{t.name}, {state}: measured {_said(t.reference)}{sd} {t.unit}{residual}"
    return text.replace("-", "−")


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _said(value: float | None) -> str:
    return number(value, 3).replace("-", "−")
