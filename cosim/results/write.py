"""A result in a folder that is whole or not there."""

from __future__ import annotations

import csv
import json
import logging
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.case.file import moved_toml
from cosim.errors import InputError
from cosim.files import replace_folder
from cosim.hoods.view import HoodField
from cosim.results.conventions import FRAME
from cosim.results.parts import LEDGER_HEADER, CaseParts, LedgerRow

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_run(folder: str | Path, run: CaseParts) -> Path:
    """Write a run to `folder`/<case name> and return that path.

    Raises InputError where the folder cannot be written, or where something that is not a run
    stands in its place."""
    return _whole(folder, run.case, lambda part: _write_files(part, run))


def copy_run(folder: str | Path, name: str, left: Path) -> Path:
    """Copy the folder of a run to `folder`/`name`; as `write_run`."""
    return _whole(folder, name, lambda part: shutil.copytree(left, part, dirs_exist_ok=True))


def _whole(folder: str | Path, name: str, fill: Callable[[Path], object]) -> Path:
    """Filled beside its place and moved there once complete, so that an older run is replaced by a
    whole new one or not at all."""
    target = Path(folder) / name
    check_target(folder, name)
    part = target.with_name(f".{name}.{os.getpid()}.part")
    try:
        part.mkdir()
        fill(part)
        replace_folder(target, part)
    except OSError as error:
        raise _unwritable(target, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return target


def check_target(folder: str | Path, name: str) -> None:
    """Make the output folder, and see that a run called `name` can be written there.

    Raises InputError."""
    target = Path(folder) / name
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        probe = target.with_name(f".{name}.{os.getpid()}.probe")
        probe.mkdir()
        probe.rmdir()
        is_run = (target / "summary.json").exists() or (
            target.is_dir() and not any(target.iterdir())
        )
    except OSError as error:
        raise _unwritable(target, error) from error
    if target.exists() and not is_run:
        raise InputError(f"{target}: is in the way and is no earlier run; choose another --out")


def _unwritable(target: Path, error: OSError) -> InputError:
    reason = error.strerror or str(error)
    return InputError(f"{target}: cannot be written ({reason}); choose another folder with --out")


def _write_files(folder: Path, run: CaseParts) -> None:
    summary = json.dumps(run.summary, indent=2, default=plain, allow_nan=False)
    (folder / "summary.json").write_text(summary + "\n", encoding="utf-8")
    (folder / "case.toml").write_text(moved_toml(run.case_text, folder), encoding="utf-8")
    run.arrays.write(folder / "results.nc")
    _write_ledger(folder / "ledger.csv", run.rows)
    if run.hood is not None:
        _write_hood(folder / "hood.vtu", run.hood)
    if run.scene.frames:
        _write_frames(folder, run.scene.frames)
    if run.case_table.get("output", {}).get("picture", True):
        _draw(folder, run)


def _draw(folder: Path, run: CaseParts) -> None:
    # where its own folder cannot be written to, matplotlib warns twice and works on
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from cosim.results.scene_plot import draw

    _write_png(draw(run.scene, run.title), folder / "picture.png", dpi=150)
    if run.rows:
        from cosim.results.ledger_plot import draw_ledger

        _write_png(draw_ledger(run.rows, run.title), folder / "ledger.png", dpi=130)
    if run.axis == "time":
        from cosim.results.history_plot import draw_history

        _write_png(draw_history(run.data, run.title), folder / "history.png", dpi=130)


def _write_png(figure: Figure, path: Path, dpi: int) -> None:
    """Draw once; `Figure.savefig` draws twice, first to nowhere."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(dpi)
    # of 1 to 9: half of the time of 6, which is usual, for a file a tenth larger
    FigureCanvasAgg(figure).print_png(path, pil_kwargs={"compress_level": 3})


def plain(value: Any) -> Any:
    """numpy's scalars and arrays for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"summary holds a {type(value).__name__}")


def _write_ledger(path: Path, ledger: tuple[LedgerRow, ...]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(LEDGER_HEADER)
        for row in ledger:
            numbers = [*row.force, *(1e3 * np.asarray(row.moment))]
            writer.writerow(
                [row.state, row.body, row.source, *(f"{x:.9g}" for x in numbers), "world"]
            )


def _write_frames(folder: Path, frames: Sequence[tuple[float, HoodField]]) -> None:
    """`hood.pvd`, which ParaView opens, with a .vtu for each frame in `hood_frames`."""
    (folder / "hood_frames").mkdir()
    sets = []
    for i, (time, hood) in enumerate(frames):
        name = f"hood_frames/{i:04d}.vtu"
        _write_hood(folder / name, hood)
        sets.append(f'<DataSet timestep="{time!r}" part="0" file="{name}"/>\n')
    text = f"""<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1">
<!--Time: s-->
<Collection>
{"".join(sets)}</Collection>
</VTKFile>
"""
    (folder / "hood.pvd").write_text(text, encoding="utf-8")


def _write_hood(path: Path, hood: HoodField) -> None:
    import meshio

    cell_data = {name: [np.asarray(values)] for name, values in hood.cell_data.items()}
    point_data = {name: np.asarray(values) for name, values in hood.point_data.items()}
    kind = {4: "quad", 2: "line"}[hood.quads.shape[1]]
    mesh = meshio.Mesh(hood.points, [(kind, hood.quads)], point_data, cell_data)
    mesh.write(path, file_format="vtu")
    # a comment: meshio, which users read it with, ends on a text among the data
    grid, text = "<UnstructuredGrid>", path.read_text(encoding="utf-8")
    path.write_text(text.replace(grid, f"<!--Frame: {FRAME}; m-->\n{grid}", 1), encoding="utf-8")
