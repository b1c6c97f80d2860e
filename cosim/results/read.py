"""What a run's folder holds, read for the report."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cosim.mesh_file import read_mesh_file
from cosim.port import InputError
from cosim.results.compare import Comparison, Target, compared, read_json
from cosim.results.data import LEDGER_HEADER, STRAIN, HoodField, LedgerRow
from cosim.results.quantities import check_quantities

if TYPE_CHECKING:
    import xarray

T = TypeVar("T")


@dataclass(frozen=True)
class Run:
    """A run as its folder tells it."""

    name: str
    """The folder's, made unlike those of other runs in the report."""
    case: str
    folder: Path
    stated: Mapping[str, Any]
    """The case, as its file says it."""
    summary: Mapping[str, Any]
    dataset: xarray.Dataset
    ledger: tuple[LedgerRow, ...]
    hood: HoodField | None
    """As it was left at the end."""
    case_text: str
    comparison: tuple[Comparison, ...]

    @property
    def title(self) -> str:
        return str(self.stated.get("title", self.case))

    @property
    def axis(self) -> str:
        """What the arrays run along: `time`, s, of a motion, else `state`."""
        return "time" if "time" in self.dataset.dims else "state"

    def picture(self, name: str) -> bytes | None:
        """A picture that the run left, PNG."""
        path = self.folder / f"{name}.png"
        return path.read_bytes() if path.is_file() else None


def read_run(folder: Path, targets: tuple[Target, ...] = ()) -> Run:
    """A run, compared with `targets` and with what its own `comparison.json` holds.

    Raises InputError where the folder is no run or holds a file that cannot be read, and where a
    target's quantity is misspelt."""
    (run,) = read_runs([folder], targets)
    return run


def _read_run(folder: Path) -> Run:
    """A run, compared with what its own `comparison.json` holds."""
    lacking = [f for f in ("summary.json", "results.nc", "case.toml") if not (folder / f).is_file()]
    if lacking:
        raise InputError(
            f"{folder}: is not the folder of a run (it has no {', '.join(lacking)}); "
            "for example runs/isometric_edc"
        )
    summary = _read(folder / "summary.json", _summary)
    case = str(summary.get("case", folder.name))
    stated = _read(folder / "case.toml", lambda path: tomllib.loads(path.read_text("utf-8")))
    own = folder / "comparison.json"
    return Run(
        folder.resolve().name,
        case,
        folder,
        stated,
        summary,
        _read(folder / "results.nc", _dataset),
        _read(folder / "ledger.csv", _ledger) if (folder / "ledger.csv").is_file() else (),
        _read(folder / "hood.vtu", _hood) if (folder / "hood.vtu").is_file() else None,
        (folder / "case.toml").read_text(encoding="utf-8"),
        read_json(own) if own.is_file() else (),
    )


def read_runs(folders: Sequence[Path], targets: tuple[Target, ...] = ()) -> list[Run]:
    """Runs whose names all differ: those of one name are told apart by the folders they lie in.

    Raises InputError."""
    runs = [_read_run(folder) for folder in folders]
    check_quantities(targets, [(run.case, run.summary) for run in runs])
    runs = [
        replace(run, comparison=(*run.comparison, *compared(targets, run.summary, run.case)))
        for run in runs
    ]
    names = [run.name for run in runs]
    if len({run.folder.resolve() for run in runs}) < len(runs):
        raise InputError("a run is named twice; name each once")
    return [run if names.count(run.name) == 1 else replace(run, name=_longer(run)) for run in runs]


def _longer(run: Run) -> str:
    return f"{run.folder.resolve().parent.name}/{run.name}"


def _read(path: Path, reader: Callable[[Path], T]) -> T:
    try:
        return reader(path)
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"{path}: cannot be read as a part of a run ({error})") from error


def _summary(path: Path) -> Mapping[str, Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError("it is no table of numbers")
    return content


def _dataset(path: Path) -> xarray.Dataset:
    import xarray

    data = xarray.load_dataset(path, engine="h5netcdf")
    if not {"time", "state"} & set(data.dims):
        raise ValueError("its arrays run along neither state nor time")
    if not {"angle", "tip_force"} <= set(data):
        raise ValueError("it has no angle or no tip_force")
    return data


def _ledger(path: Path) -> tuple[LedgerRow, ...]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if tuple(header) != LEDGER_HEADER:
        raise ValueError(f"its first line is not {','.join(LEDGER_HEADER)}")
    return tuple(
        LedgerRow(state, body, source, wrench[:3], 1e-3 * wrench[3:])
        for (state, body, source, *numbers) in rows
        for wrench in [np.array(numbers, dtype=float)]
    )


def _hood(path: Path) -> HoodField:
    mesh = read_mesh_file(path)
    data = {name: np.asarray(blocks[0]) for name, blocks in mesh.cell_data.items()}
    if STRAIN not in data or "displacement" not in mesh.point_data:
        raise ValueError("it is no hood of a run")
    cells = mesh.cells_dict.get("quad", mesh.cells_dict.get("line"))
    if cells is None:
        raise ValueError("it has neither quads nor line cells")
    return HoodField(mesh.points, cells, mesh.point_data, data)
