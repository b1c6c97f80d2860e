"""What a run's folder holds, read for the report."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cosim.errors import InputError
from cosim.results.arrays import Arrays
from cosim.results.compare import Target, compare_with_targets, read_json
from cosim.results.frames import read_hood, with_lines
from cosim.results.parts import LEDGER_HEADER, LedgerRow, Scene
from cosim.results.quantities import check_quantities
from cosim.results.result import Result
from cosim.results.write import with_nan

T = TypeVar("T")


def read_run(folder: Path, targets: tuple[Target, ...] = ()) -> Result:
    """A run, compared with `targets` and with what its own `comparison.json` holds.

    Raises InputError where the folder is no run or holds a file that cannot be read, and where a
    target's quantity is misspelt."""
    (run,) = read_runs([folder], targets)
    return run


def _read_run(folder: Path) -> Result:
    """A run, compared with what its own `comparison.json` holds."""
    lacking = [f for f in ("summary.json", "results.nc", "case.toml") if not (folder / f).is_file()]
    if lacking:
        raise InputError(
            f"{folder}: is not the folder of a run (it has no {', '.join(lacking)}); "
            "for example runs/isometric_edc"
        )
    summary = _read(folder / "summary.json", _summary)
    check_converged(summary, str(folder))
    comparison = folder / "comparison.json"
    arrays = _read(folder / "results.nc", _arrays)
    hood = _read(folder / "hood.vtu", read_hood) if (folder / "hood.vtu").is_file() else None
    return Result(
        summary,
        arrays,
        _read(folder / "ledger.csv", _ledger) if (folder / "ledger.csv").is_file() else (),
        Scene(None if hood is None else with_lines(hood, arrays, -1), (), ()),
        _read(folder / "case.toml", _case),
        folder.resolve().name,
        folder,
        read_json(comparison) if comparison.is_file() else (),
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
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"{path}: cannot be read as a part of a run ({error})") from error


def _case(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    tomllib.loads(text)
    return text


def _summary(path: Path) -> Mapping[str, Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError("it is no table of numbers")
    if isinstance(content.get("fingertip_force_N"), list):
        raise ValueError(
            "an earlier version wrote it, with forces by place as distal, palmar, radial; now they "
            "go by the axes distal, radial, dorsal: run the case again"
        )
    return with_nan(content)


def _arrays(path: Path) -> Arrays:
    import xarray

    data = xarray.load_dataset(path, engine="h5netcdf")
    if not {"time", "state"} & set(data.dims):
        raise ValueError("its arrays have neither an axis state nor time")
    if not {"angle", "tip_force"} <= set(data):
        raise ValueError("it has no angle or no tip_force")
    return Arrays.from_dataset(data)


def _ledger(path: Path) -> tuple[LedgerRow, ...]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if tuple(header) != LEDGER_HEADER:
        raise ValueError(f"its first line is not {','.join(LEDGER_HEADER)}")
    return tuple(
        LedgerRow(state, body, source, wrench[:3], 1e-3 * wrench[3:])
        for (state, body, source, *numbers, _frame) in rows
        for wrench in [np.array(numbers, dtype=float)]
    )
