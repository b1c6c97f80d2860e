"""What a run's folder holds, read and checked: reports, tables and sessions read it here alone."""

from __future__ import annotations

import csv
import hashlib
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cosim.errors import InputError
from cosim.hoods.view import HoodField
from cosim.port import AXES, Hand
from cosim.results.answer import answer, doubts
from cosim.results.arrays import ARRAYS, Arrays
from cosim.results.audit import Audit, describe_misses
from cosim.results.compare import Target, compare_with_targets, numbers_of, read_json
from cosim.results.frames import frames_of, read_hood, with_lines
from cosim.results.load_and_rest import describe_rest
from cosim.results.parts import LEDGER_HEADER, LedgerRow, Scene, hand_of
from cosim.results.quantities import check_quantities, misfit
from cosim.results.result import Result
from cosim.results.write import (
    DIGEST,
    LEDGER_DIGEST,
    SUMMARY_DIGEST,
    summary_digest,
    with_nan,
)
from cosim.text_tables import read_json_file

T = TypeVar("T")


def read_run(folder: Path, targets: tuple[Target, ...] = ()) -> Result:
    """A run, compared with `targets` and with what its own `comparison.json` holds.

    Raises InputError where the folder is no run or holds a file that cannot be read, and where a
    target's quantity is misspelt."""
    (run,) = read_runs([folder], targets)
    return run


def _read_run(folder: Path) -> Result:
    """A run, compared with what its own `comparison.json` holds."""
    _check_has(folder, "summary.json", "results.nc", "case.toml")
    summary = _read(folder / "summary.json", _summary)
    check_converged(summary, str(folder))
    comparison = folder / "comparison.json"
    arrays = read_arrays(folder)
    case = _read(folder / "case.toml", _case)
    hood, hand = None, hand_of(tomllib.loads(case))
    if (path := folder / "hood.vtu").is_file():
        hood = _read(path, lambda path: _hood(path, arrays, hand))
    return Result(
        summary,
        arrays,
        _read(folder / "ledger.csv", _ledger) if (folder / "ledger.csv").is_file() else (),
        Scene(hood, (), (), hand=hand),
        case,
        folder.resolve().name,
        folder,
        read_json(comparison) if comparison.is_file() else (),
    )


def read_arrays(folder: Path) -> Arrays:
    """The arrays of the run in a folder.  Raises InputError where it is none, where they are not
    what a run leaves, and where it did not converge."""
    _check_has(folder, "summary.json", "results.nc")
    check_converged(_read(folder / "summary.json", _table), str(folder))
    return _read(folder / "results.nc", _arrays)


def _check_has(folder: Path, *names: str) -> None:
    if lacking := [name for name in names if not (folder / name).is_file()]:
        raise InputError(
            f"{folder}: is not the folder of a run (it has no {', '.join(lacking)}); "
            "for example runs/isometric_edc"
        )


def check_converged(summary: Mapping[str, Any], place: str) -> None:
    """Refuse what a motion had reached when a step failed, which is no result.  Raises
    InputError."""
    if summary.get("converged") is False:
        raise InputError(
            f"{place}: is no result, only what a motion had reached when it failed "
            f"({summary.get('failure', '')}); its arrays (results.nc) and hood.pvd show it"
        )


def read_runs(folders: Sequence[Path], targets: tuple[Target, ...] = ()) -> list[Result]:
    """Runs whose names all differ: those of one name are named by their folders as well.

    Raises InputError."""
    runs = [_read_run(folder) for folder in folders]
    check_quantities(targets, [(run.case, run.summary) for run in runs])
    runs = [
        replace(
            run, comparison=(*run.comparison, *compare_with_targets(targets, run.summary, run.case))
        )
        for run in runs
    ]
    names = [run.name for run in runs]
    if len({folder.resolve() for folder in folders}) < len(runs):
        raise InputError("a run is named twice; name each once")
    return [
        run if names.count(run.name) == 1 else replace(run, name=_longer(run, runs)) for run in runs
    ]


def _longer(run: Result, runs: Sequence[Result]) -> str:
    """The end of a run's path, as long as tells it from the others of its name."""
    paths = [
        other.folder.resolve().parts for other in runs if other.folder and other.name == run.name
    ]
    assert run.folder is not None
    own = run.folder.resolve().parts
    count = next(n for n in range(2, len(own) + 1) if [p[-n:] for p in paths].count(own[-n:]) == 1)
    return "/".join(own[-count:])


def _read(path: Path, reader: Callable[[Path], T]) -> T:
    try:
        return reader(path)
    except MemoryError:
        raise
    except Exception as error:  # HDF5 and VTK raise anything of a spoilt file
        reason = " ".join(str(error).split())[:500]
        raise InputError(
            f"{path}: cannot be read as a part of a run ({reason or type(error).__name__}); "
            "run the case again"
        ) from error


def _case(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    tomllib.loads(text)
    return text


def _table(path: Path) -> dict[str, Any]:
    content = read_json_file(path)
    if not isinstance(content, dict):
        raise ValueError("it is no table of numbers")
    if (stated := content.get(SUMMARY_DIGEST)) is not None and stated != summary_digest(content):
        raise ValueError("its numbers are not those that the run wrote, by its own digest")
    return content


def _summary(path: Path) -> Mapping[str, Any]:
    content = _table(path)
    if isinstance(content.get("fingertip_force_N"), list):
        raise ValueError(
            "an earlier version wrote it, with forces by place as distal, palmar, radial; now they "
            "go by the axes distal, radial, dorsal: run the case again"
        )
    summary = with_nan(content)
    if fault := misfit(summary):
        raise ValueError(fault)
    _ = Audit.read(summary), numbers_of(summary)
    for words in (answer, doubts, describe_rest, describe_misses):
        list(words(summary))  # what is lacking for a sentence is lacking here, not in a page
    return summary


def _check_digest(path: Path, key: str) -> None:
    """Check a file's digest: of a spoilt one HDF5 may read other numbers, or never end.  Raises
    ValueError where its bytes are not those whose digest the summary beside it holds under `key`,
    and InputError."""
    summary = path.with_name("summary.json")
    content = read_json_file(summary) if summary.is_file() else None
    stated = content.get(key) if isinstance(content, dict) else None
    if stated is not None and stated != hashlib.sha256(path.read_bytes()).hexdigest():
        raise ValueError(
            "its bytes are not those that the run wrote, by the digest in summary.json"
        )


def _arrays(path: Path) -> Arrays:
    _check_digest(path, DIGEST)
    arrays = Arrays.read(path)
    if not {"time", "state"} & arrays.dims:
        raise ValueError("its arrays have neither an axis state nor time")
    if not {"angle", "tip_force"} <= set(arrays.variables):
        raise ValueError("it has no angle or no tip_force")
    _check_arrays(arrays)
    return arrays


OF_HOODS = {"point", "quad", "cell"}
"""Axes of the arrays that a hood's view names, some as others that a run has."""
UNNAMED = ("frame", "line_point", "state", "time")
"""Axes of arrays along which nothing has a name, or which are checked on their own."""


def _check_arrays(arrays: Arrays) -> None:
    """Check types, axes and names of arrays.  Raises ValueError."""
    along = "time" if "time" in arrays.dims else "state"
    needed = {along: "numbers" if along == "time" else "names"}
    for name, (dims, values, _) in arrays.variables.items():
        if values.dtype.kind not in "fiu":
            raise ValueError(f"its {name} holds no numbers")
        if name in ARRAYS and not OF_HOODS & set(dims):
            expected = ARRAYS[name].dims
            if dims[1:] != expected or dims[0] not in (along, "frame", "event"):
                raise ValueError(f"its {name} has the axes {dims}, not {(along, *expected)}")
            needed |= dict.fromkeys((d for d in expected if d not in UNNAMED), "names")
    for dim, content in needed.items():
        if dim not in arrays.coordinates:
            raise ValueError(f"its axis {dim} has no {content}")
        values = arrays.coordinates[dim].values
        names = [str(value) for value in values]
        wrong = values.dtype.kind not in ("f" if content == "numbers" else "UO")
        if not names and dim != along:
            continue
        if not names or wrong or len(set(names)) < len(names):
            raise ValueError(f"its axis {dim} has no {content} that all differ")
        if dim == "axis" and tuple(names) != AXES:
            raise ValueError(f"its axis {dim} is not {', '.join(AXES)}")


def _hood(path: Path, arrays: Arrays, hand: Hand) -> HoodField:
    """The hood at the end.  Raises ValueError and others where it is not that of the arrays."""
    hood = with_lines(read_hood(path, hand), arrays, -1)
    if "time" not in arrays.dims:
        frames_of(arrays, hood, ())
    return hood


def _ledger(path: Path) -> tuple[LedgerRow, ...]:
    _check_digest(path, LEDGER_DIGEST)
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if tuple(header) != LEDGER_HEADER:
        raise ValueError(f"its first line is not {','.join(LEDGER_HEADER)}")
    for number, row in enumerate(rows, 2):
        if len(row) != len(LEDGER_HEADER):
            raise ValueError(f"row {number} has {len(row)} cells, the first {len(LEDGER_HEADER)}")
    return tuple(
        LedgerRow(state, body, source, wrench[:3], 1e-3 * wrench[3:])
        for (state, body, source, *numbers, _frame) in rows
        for wrench in [np.array(numbers, dtype=float)]
    )
