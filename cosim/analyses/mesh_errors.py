"""The errors by the mesh that `cosim converge` found, kept for when the same case runs again.

Those of shipped cases are in `cases/data/mesh_error.json`, those of a user's in the user's cache,
each under a key of the case's content.  Where the numbers are no longer those of which the errors
were found, because the program has changed since, none are known.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from cosim.analyses.converge import MeshStudy
from cosim.array_cache import Kind, user_cache
from cosim.case.cache_key import address
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.files import output_file
from cosim.json_text import json_text
from cosim.results.compare import value_of
from cosim.text_tables import read_json_file

SHIPPED = "mesh_error.json"
KIND: Kind = "mesh_errors"
FORMAT = "mesh errors 1"
SAME_NUMBER = 1e-3
"""A number that differs by more of itself, and by more than its error, is another one."""
Errors = dict[str, tuple[float, float]]
"""The number and its grid convergence index by its path."""


def known_errors(case: Case, summary: Mapping[str, Any]) -> dict[str, float]:
    """The grid convergence index of numbers of a run, by path; empty where none are known, or where
    one of the numbers is another now."""
    kept = {} if case.hood.mesh_fineness is None else _read(address(case, FORMAT))
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
        cache.write(KIND, address(study.case, FORMAT), arrays)


def add_errors(study: MeshStudy, file: Path) -> None:
    """Write the errors of the case into a JSON file, beside those of others.  Raises InputError."""
    before: Any = read_json_file(file) if file.exists() else {}
    if not hasattr(before, "items"):
        raise InputError(f"{file}: is no file of mesh errors; name a new one, or one of converge's")
    numbers = {path: [float(f"{x:.6g}") for x in pair] for path, pair in errors_of(study).items()}
    entry = {"key": address(study.case, FORMAT), "quads": study.quads, "numbers": numbers}
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
