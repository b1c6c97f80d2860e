"""A case on several meshes of its hood's family: what the first numbers of its result owe to them.

The hood's rows and columns are whole multiples of the coarsest mesh's (`meshes.hood_lines`), so
that edges go by one factor everywhere; orders, limits and indices as of
`cosim.analyses.mesh_series`.

What is found is kept for when the same case runs again: of shipped cases in
`cases/data/mesh_error.json`, of a user's in the user's cache, each under a key of the case's
content.  Where the numbers are no longer those of which the errors were found, because the program
has changed since, none are known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from cosim.analyses.mesh_series import (
    MeshSeries,
    bound,
    mesh_factors,
    mesh_family,
    on_mesh,
    vector_sizes,
)
from cosim.array_cache import Kind, user_cache
from cosim.case.cache_key import address
from cosim.case.schema import Case
from cosim.errors import InputError, Progress, quiet
from cosim.files import output_file
from cosim.json_text import json_text
from cosim.pipeline import plain_summary, run_each
from cosim.results.audit import describe_misses
from cosim.results.compare import number, numbers_of, unit_of, value_of
from cosim.results.quantities import first_numbers
from cosim.results.table import ReportTable, csv_text
from cosim.text_tables import read_json_file

MOST_MESHES = 6
FORMAT = "cosim convergence 1"
UNTOUCHED = 1e-7
"""A number that changes by less of itself, or of one, is not touched by the mesh."""
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class MeshNumber:
    """One of the first numbers, on every mesh."""

    label: str
    path: str
    unit: str
    series: MeshSeries


@dataclass(frozen=True)
class MeshStudy:
    """A case on several meshes, the coarsest first."""

    case: Case
    own: int
    """The place of the case's own mesh."""
    quads: tuple[int | None, ...]
    """Elements of each mesh; None of one without a result."""
    numbers: tuple[MeshNumber, ...]
    reasons: Mapping[str, str]
    """Why meshes have no result, by their name."""
    missed: Mapping[str, list[str]]
    """What audits missed, by the name of the mesh."""


def meshes_of(case: Case, count: int) -> list[Case]:
    """The case on so many meshes, the coarsest first.

    Raises InputError for a motion, and for a case whose hood has no such meshes."""
    own = case.hood.mesh_fineness
    if own is None:
        raise InputError(
            f"{case.name}: its hood ({case.hood.kind}) has no mesh that can be refined by one "
            'factor everywhere, as a shell with hood.mesh.kind = "generated" has; of a mesh file '
            "of your own write a finer one and compare the runs"
        )
    if case.forward is not None:
        raise InputError(
            f"{case.name}: is a motion; converge compares equilibria. Leave out [forward]"
        )
    return [on_mesh(case, fineness) for fineness in mesh_family(count, own)]


def solve_meshes(
    case: Case, count: int = 3, workers: int = 1, progress: Progress = quiet
) -> MeshStudy:
    """The case on its own mesh and others, in so many processes; `progress` is called as each ends.

    Raises InputError as `meshes_of`, and the error of the case on its own mesh."""
    cases = meshes_of(case, count)
    names = [f"{each.hood.generated_quads} quads" for each in cases]
    outcomes = run_each(
        cases,
        plain_summary,
        workers,
        lambda _, i, outcome: progress(f"{names[i]}: {outcome.reason or 'done'}"),
    )
    summaries = {i: o.value for i, o in enumerate(outcomes) if o.value is not None}
    errors = {i: o.error for i, o in enumerate(outcomes) if o.error is not None}
    own = cases.index(case)
    if own in errors:
        raise type(errors[own])(f"{case.name}: {errors[own]}") from errors[own]
    return MeshStudy(
        case,
        own,
        tuple(summaries.get(i, {}).get("hood_quads") for i in range(count)),
        tuple(_numbers(case, [summaries.get(i, {}) for i in range(count)], own)),
        {names[i]: str(error) for i, error in errors.items()},
        {names[i]: list(describe_misses(summary)) for i, summary in summaries.items()},
    )


def _numbers(case: Case, summaries: Sequence[Summary], own: int) -> Iterator[MeshNumber]:
    """The first numbers that a mesh touches."""
    known, sizes = summaries[own], vector_sizes(numbers_of(summaries[own]))
    factors = mesh_factors(len(summaries), case.hood.mesh_fineness or 1)
    for label, path in first_numbers(known, case.solve.resting_tension):
        values = tuple(value_of(summary, path) for summary in summaries)
        of_own, unit = values[own], unit_of(path)
        found = [v for v in values if v is not None]
        if of_own is not None and max(found) - min(found) > UNTOUCHED * max(1.0, abs(of_own)):
            most = bound(path, of_own, unit, sizes)
            yield MeshNumber(
                label, path, unit, MeshSeries(factors=factors, values=values, bound=most)
            )


def table_of(study: MeshStudy) -> ReportTable:
    """The numbers for people; a star stands at the case's own mesh."""
    meshes = ("no result" if n is None else str(n) for n in study.quads)
    heads = [f"{name} *" if i == study.own else name for i, name in enumerate(meshes)]
    rows = []
    for n in study.numbers:
        values = (number(value) for value in n.series.values)
        of_own = (number(v, 2) for v in (n.series.error, n.series.index))
        limit = number(n.series.convergence.limit)
        words = (n.series.order_text, limit, *of_own, n.series.verdict)
        rows.append((f"{n.label}, {n.unit}", *values, *words))
    columns = ("on so many quads", *heads, "order", "limit", "error *", "GCI *", "verdict")
    return ReportTable("meshes", f"{study.case.name}: {study.case.title}", columns, rows)


def records(study: MeshStudy) -> list[dict[str, Any]]:
    """The numbers with all that is said of them, for files and tables."""
    return [
        {
            "quantity": n.path,
            "meaning": n.label,
            "unit": n.unit,
            "values": list(n.series.values),
            "value": n.series.own,
            "range": n.series.range,
            "bound": n.series.bound,
            "order": n.series.convergence.order,
            "why_no_order": n.series.convergence.why,
            "limit": n.series.convergence.limit,
            "error": n.series.error,
            "gci": n.series.index,
            "verdict": n.series.verdict,
        }
        for n in study.numbers
    ]


def to_json(study: MeshStudy) -> str:
    """Everything."""
    content = {
        "format": FORMAT,
        "case": study.case.name,
        "quads": study.quads,
        "factors": mesh_factors(len(study.quads), study.case.hood.mesh_fineness or 1),
        "own": study.own,
        "reasons": study.reasons,
        "missed": study.missed,
        "numbers": records(study),
    }
    return json_text(content, 2, ensure_ascii=True) + "\n"


def to_csv(study: MeshStudy) -> str:
    """A row for each number, a column for each mesh."""
    meshes = [
        f"quads_{n if n is not None else f'of_mesh_{i + 1}'}" for i, n in enumerate(study.quads)
    ]
    names = [name for name in records(study)[0] if name != "values"] if study.numbers else []
    rows = [[*names[:3], *meshes, *names[3:]]]
    for record in records(study):
        values = record.pop("values")
        cells = [*record.values()]
        rows.append([*cells[:3], *values, *cells[3:]])
    return csv_text(rows)


SHIPPED = "mesh_error.json"
KIND: Kind = "mesh_errors"
ERRORS_FORMAT = "mesh errors 1"
SAME_NUMBER = 1e-3
"""A number that differs by more of itself, and by more than its error, is another one."""
Errors = dict[str, tuple[float, float]]
"""The number and its grid convergence index by its path."""


def known_errors(case: Case, summary: Mapping[str, Any]) -> dict[str, float]:
    """The grid convergence index of numbers of a run, by path; empty where none are known, or where
    one of the numbers is another now."""
    kept = {} if case.hood.mesh_fineness is None else _read(address(case, ERRORS_FORMAT))
    numbers = {path: value_of(summary, path) for path in kept}
    is_same = all(
        now is not None and abs(now - value) <= max(index, SAME_NUMBER * abs(value))
        for now, (value, index) in zip(numbers.values(), kept.values(), strict=True)
    )
    return {path: index for path, (_, index) in kept.items()} if is_same else {}


def errors_of(study: MeshStudy) -> Errors:
    """What is kept of a case on several meshes."""
    each = ((n.path, n.series.own, n.series.index) for n in study.numbers)
    return {path: (own, gci) for path, own, gci in each if own is not None and gci is not None}


def keep_errors(study: MeshStudy) -> None:
    """Keep the errors in the user's cache, where there is one."""
    if (cache := user_cache()) is not None:
        errors = errors_of(study)
        arrays = {"paths": np.array([*errors], dtype=str), "numbers": np.array([*errors.values()])}
        cache.write(KIND, address(study.case, ERRORS_FORMAT), arrays)


def add_errors(study: MeshStudy, file: Path) -> None:
    """Write the errors of the case into a JSON file, beside those of others.  Raises InputError."""
    before: Any = read_json_file(file) if file.exists() else {}
    if not hasattr(before, "items"):
        raise InputError(f"{file}: is no file of mesh errors; name a new one, or one of converge's")
    numbers = {path: [float(f"{x:.6g}") for x in pair] for path, pair in errors_of(study).items()}
    entry = {"key": address(study.case, ERRORS_FORMAT), "quads": study.quads, "numbers": numbers}
    with output_file(file) as part:
        content = dict(sorted({**before, study.case.name: entry}.items()))
        part.write_text(json_text(content, 1, ensure_ascii=True) + "\n", encoding="utf-8")


def shipped_errors() -> Mapping[str, Any]:
    """The entries of the shipped cases by their name."""
    file = Path(str(resources.files("cases") / "data" / SHIPPED))
    content: Mapping[str, Any] = read_json_file(file) if file.is_file() else {}
    return content


def _read(key: str) -> Errors:
    for entry in shipped_errors().values():
        if entry["key"] == key:
            return {path: (value, index) for path, (value, index) in entry["numbers"].items()}
    cache = user_cache()
    arrays = None if cache is None else cache.read(KIND, key)
    if cache is None or arrays is None:
        return {}
    try:
        pairs = zip(arrays["paths"].tolist(), arrays["numbers"].tolist(), strict=True)
        found = {str(path): (float(value), float(index)) for path, (value, index) in pairs}
    except (KeyError, TypeError, ValueError):
        found = {"": (nan, nan)}
    if all(isfinite(value) and isfinite(index) for value, index in found.values()):
        return found
    cache.drop(KIND, key)
    return {}
