"""Small runs for the tests of the report."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np
import xarray

from cosim.case.file import load_case
from cosim.pipeline import run_case
from cosim.results.arrays import Arrays, Variable
from tests.helpers.folders import forget_digest

DATA = """\
# Numbers made for tests
name, quantity, unit, reference, sd, low, high, source, kind, case, geometry, fitted, note
"Force, distal", difference.fingertip_force_N.distal, N, 0.24, 0.05, , , "T, 1", experiment, , , ,
"Force, palmar", difference.fingertip_force_N.palmar, N, -0.09, 0.08, , , "T, 1", experiment, , , ,
Lateral strain, strain_percent.lateral.min, %, , , , -8, U, inferred, , mi29, yes, <b>held</b>
Slip, slip_force_N.terminal, N, 2, , 1, 3, U, published model, isometric_edc, , ,
"""


def run_into(folder: Path, case: str, *settings: str) -> Path:
    """The folder of a run in `folder`; all tests of a session that ask for the same run, in any
    process, share its solve."""
    session = next((p for p in folder.parents if re.fullmatch(r"pytest-\d+", p.name)), folder)
    name = hashlib.sha1("\n".join((case, *settings)).encode()).hexdigest()[:12]
    kept = session / f"shared-{name}"
    if not kept.is_dir():
        own = folder / f".{name}"
        run_case(load_case(case, settings)).save(own)
        with suppress(OSError):  # another process was first
            own.rename(kept)
        shutil.rmtree(own, ignore_errors=True)
    shutil.copytree(kept / case, folder / case)
    return folder / case


def write_motion_run(run: Path, folder: Path) -> Path:
    """A copy of a run with a hood as a motion of two moments would be left: without the hood's
    shapes over time."""
    shutil.copytree(run, folder)
    data = xarray.load_dataset(run / "results.nc", engine="h5netcdf")
    kept = data.drop_vars(["node", "strain", "stress", "pressure"])
    moved = kept.rename(state="time").assign_coords(time=[0.0, 0.25])
    _write_motion(moved, folder)
    return folder


def write_swinging_run(run: Path, folder: Path) -> Path:
    """A copy of a run as a motion of nine moments: in the second the finger is stretched out,
    farther than in the first, the middle and the last, and in the third it pushes hardest."""
    shutil.copytree(run, folder)
    data = xarray.load_dataset(run / "results.nc", engine="h5netcdf")
    still = data.drop_vars(["node", "strain", "stress", "pressure"]).isel(state=[1] * 9)
    moved = still.rename(state="time").assign_coords(time=np.linspace(0.0, 0.8, 9))
    moved.angle[1] = np.radians([-20.0, 15.0, 0.0, 0.0])
    moved.tip_force[1] = 0.0
    moved.tip_force[2] = [1.0, 1.0, 5.0]
    _write_motion(moved, folder)
    return folder


def arrays_of(data: xarray.Dataset) -> Arrays:
    """A data set as arrays."""

    def bare(given) -> dict[str, Variable]:
        return {k: Variable(tuple(v.dims), v.values, v.attrs) for k, v in given.items()}

    return Arrays(bare(data.data_vars), bare(data.coords), data.attrs)


def _write_motion(data: xarray.Dataset, folder: Path) -> None:
    """The arrays of a motion in place of those of the equilibrium that `folder` is a copy of."""
    arrays_of(data).write(folder / "results.nc")
    forget_digest(folder)
    ledger, times = folder / "ledger.csv", data.time.values
    text = ledger.read_text(encoding="utf-8")
    text = re.sub("^unloaded,", f"{times[0]:g} s,", text, flags=re.MULTILINE)
    text = re.sub("^loaded,", f"{times[-1]:g} s,", text, flags=re.MULTILINE)
    ledger.write_text(text, encoding="utf-8")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    for key in ("unloaded", "difference", "rest", "warnings"):
        del summary[key]
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
