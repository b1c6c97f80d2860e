"""A result in a folder that is whole or not there."""

from __future__ import annotations

import csv
import hashlib
import itertools
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cosim.case.file import case_of, moved_toml
from cosim.errors import InputError
from cosim.files import FULL, beside, clear_leftovers, replace_folder, unwritable
from cosim.hoods.view import HoodField
from cosim.json_text import json_text, plain
from cosim.port import Array, Hand
from cosim.results.conventions import FRAME, LEFT_FRAME
from cosim.results.frames import frames_of
from cosim.results.parts import LEDGER_HEADER, CaseParts, LedgerRow, Scene
from cosim.results.picture import load_matplotlib, write_figure
from cosim.results.scene import decimate, scenes_of, tension_of
from cosim.stopwatch import timed

T = TypeVar("T")
BONE_TRIANGLES = 600
"""The most triangles of a bone for ParaView: it is written anew in every frame of a motion."""
OTHER = "choose another folder with --out"
NOT_FINITE = "not_finite"
"""The key of a written summary under which the keys stand whose numbers are none."""
DIGEST, LEDGER_DIGEST, SUMMARY_DIGEST = "results_sha256", "ledger_sha256", "summary_sha256"
"""The keys of a written summary under which the sha256 of results.nc, of ledger.csv and of itself
stand, as hexadecimal text."""
OF_ITS_FILE = (NOT_FINITE, DIGEST, LEDGER_DIGEST, SUMMARY_DIGEST)


def write_run(folder: str | Path, run: CaseParts) -> tuple[Path, tuple[str, ...]]:
    """Write a run to `folder`/<case name>; that path, and what could not be made beside summary,
    arrays and case, a line each.

    Raises InputError where the folder cannot be written, where something that is not a run stands
    in its place or where the summary was changed since the solve, and NoRoomError on a full
    disk."""
    run.check_unchanged()
    target = Path(folder) / run.case
    return _whole(folder, run.case, lambda part: write_files(part, run, target))


def copy_run(folder: str | Path, name: str, left: Path) -> Path:
    """Copy the folder of a run to `folder`/`name`; as `write_run`."""
    target, _ = _whole(folder, name, lambda part: shutil.copytree(left, part, dirs_exist_ok=True))
    return target


def _whole(folder: str | Path, name: str, fill: Callable[[Path], T]) -> tuple[Path, T]:
    """Filled beside its place and moved there once complete, so that an older run is replaced by a
    whole new one or not at all; its place, and what `fill` returned."""
    target = Path(folder) / name
    check_target(folder, name)
    part = beside(target)
    try:
        part.mkdir()
        filled = fill(part)
        replace_folder(target, part)
    except OSError as error:
        raise unwritable(target, error, OTHER) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return target, filled


def check_target(folder: str | Path, name: str) -> None:
    """Make the output folder, and see that a run called `name` can be written there.

    Raises InputError."""
    target = Path(folder) / name
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        clear_leftovers(target.parent)
        probe = beside(target, "probe")
        probe.mkdir()
        probe.rmdir()
        is_run = (target / "summary.json").exists() or (
            target.is_dir() and not any(target.iterdir())
        )
    except OSError as error:
        raise unwritable(target, error, OTHER) from error
    if target.exists() and not is_run:
        raise InputError(f"{target}: is in the way and is no earlier run; choose another --out")


@timed("files")
def write_files(folder: Path, run: CaseParts, target: Path | None = None) -> tuple[str, ...]:
    """Write a run's files: case, summary and arrays, then all that can be made of them; what could
    not be made, a line each.  `target`: the place to name in an error, where it is another.

    Raises InputError where the folder cannot be written, NoRoomError on a full disk."""
    case, arrays = moved_toml(run.case_text, folder), run.arrays.content()
    ledger = _ledger_text(run.rows).encode()
    summary = without_nan(run.summary) | {
        DIGEST: hashlib.sha256(arrays).hexdigest(),
        LEDGER_DIGEST: hashlib.sha256(ledger).hexdigest(),
    }
    summary[SUMMARY_DIGEST] = summary_digest(summary)
    contents = {
        "case.toml": case.encode(),
        "summary.json": f"{json_text(summary, 2, ensure_ascii=True)}\n".encode(),
        "results.nc": arrays,
    }
    try:
        for name, content in contents.items():
            (folder / name).write_bytes(content)
    except OSError as error:
        for name in contents:  # what is free is told without them
            (folder / name).unlink(missing_ok=True)
        needed = sum(map(len, contents.values()))
        raise unwritable(target or folder, error, OTHER, needed) from error
    lacking, no_room = [], []
    for name, write in _further_files(run):
        try:
            with timed(name):
                write(folder / name)
        except Exception as error:  # what is solved is not lost to a picture of it
            (folder / name).unlink(missing_ok=True)
            shutil.rmtree(folder / f"{Path(name).stem}_frames", ignore_errors=True)
            if getattr(error, "errno", None) in FULL:
                no_room.append(name)
            else:
                lacking.append(f"{name} could not be made ({type(error).__name__}: {error})")
    if no_room:
        lacking.append(f"there is no room for {', '.join(no_room)}; the numbers are whole")
    return tuple(lacking)


def _further_files(run: CaseParts) -> Iterator[tuple[str, Callable[[Path], object]]]:
    """What shows a run's numbers, by the file's name, and what writes it."""
    yield "ledger.csv", lambda path: path.write_bytes(_ledger_text(run.rows).encode())
    if (hood := run.hood) is not None:
        yield "hood.vtu", lambda path: _write_hood(path, hood, run.hand)
    if run.scene.frames:
        write_hood = partial(_write_hood, hand=run.hand)
        yield "hood.pvd", lambda path: _write_frames(path, run.scene.frames, write_hood)
    if run.scene.bones and run.scene.frames:
        yield "finger.pvd", lambda path: _write_frames(path, _scenes_over_time(run), _write_finger)
    elif run.scene.bones and run.axis == "state":
        yield "finger.vtu", lambda path: _write_finger(path, run.scene)
    if not run.case_table.get("output", {}).get("picture", True):
        return
    # where its own folder cannot be written to, matplotlib warns twice and works on
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with timed("matplotlib"):
        load_matplotlib()
    yield "picture.png", lambda path: _draw_scene(path, run)
    if run.rows:
        yield "ledger.png", lambda path: _draw_ledger(path, run)
    if run.has_history:
        yield "history.png", lambda path: _draw_history(path, run)


def _draw_scene(path: Path, run: CaseParts) -> None:
    from cosim.results.scene_plot import draw

    write_figure(draw(run.scene, run.title), path, 150)


def _draw_ledger(path: Path, run: CaseParts) -> None:
    from cosim.results.ledger_plot import draw_ledger

    write_figure(draw_ledger(run.rows, run.title, run.scene), path, 130)


def _draw_history(path: Path, run: CaseParts) -> None:
    from cosim.results.history_plot import draw_history

    write_figure(draw_history(run.data, run.title), path, 130)


def without_nan(summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary for JSON, which has no numbers that are not finite: null in their places, and under
    `NOT_FINITE` for each its keys and its value as text."""
    lost: list[tuple[str | int, ...]] = []
    out: dict[str, Any] = plain(summary, lost)
    return {**out, NOT_FINITE: lost} if lost else out


def with_nan(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The summary of which `without_nan` made one for JSON, without what is of its file alone."""
    out = {key: value for key, value in summary.items() if key not in OF_ITS_FILE}
    for *way, last, value in summary.get(NOT_FINITE, ()):
        place: Any = out
        for key in way:
            place = place[key]
        place[last] = float(value)
    return out


def summary_digest(summary: Mapping[str, Any]) -> str:
    """The sha256 of a summary as its file has it, without its own and the seconds of the run."""
    others = {key: value for key, value in summary.items() if key not in (SUMMARY_DIGEST, "wall_s")}
    return hashlib.sha256(json_text(others, 2, ensure_ascii=True).encode()).hexdigest()


def _ledger_text(ledger: tuple[LedgerRow, ...]) -> str:
    text = StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(LEDGER_HEADER)
    for row in ledger:
        numbers = [*row.force, *(1e3 * np.asarray(row.moment))]
        writer.writerow([row.state, row.body, row.source, *(f"{x:.9g}" for x in numbers), "world"])
    return text.getvalue()


def _scenes_over_time(run: CaseParts) -> list[tuple[float, Scene]]:
    """What there is to see at the stored times (s) of a motion."""
    frames = frames_of(run.arrays, run.hood, run.scene.frames)
    scenes = scenes_of(frames, run.arrays, case_of(run.case_table, run.case))
    return [(f.time, s) for f, s in zip(frames, scenes, strict=True) if f.time is not None]


def _write_frames(
    path: Path, frames: Sequence[tuple[float, T]], write: Callable[[Path, T], object]
) -> None:
    """NAME.pvd, which ParaView opens, with a .vtu for each frame in NAME_frames."""
    folder = path.with_name(f"{path.stem}_frames")
    folder.mkdir(exist_ok=True)
    sets = []
    for i, (time, shown) in enumerate(frames):
        name = f"{folder.name}/{i:04d}.vtu"
        write(path.with_name(folder.name) / f"{i:04d}.vtu", shown)
        sets.append(f'<DataSet timestep="{time!r}" part="0" file="{name}"/>\n')
    text = f"""<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1">
<!--Time: s-->
<Collection>
{"".join(sets)}</Collection>
</VTKFile>
"""
    path.write_text(text, encoding="utf-8")


def _write_finger(path: Path, scene: Scene) -> None:
    """Bones as triangles and tendons as lines, with the number of each and N of a tendon that is
    pulled; a comment says which number is which."""
    bones = tuple((name, *decimate(v, faces, BONE_TRIANGLES)) for name, v, faces in scene.bones)
    hand, scene = scene.hand, replace(scene, bones=bones).in_own_frame()
    points = [*(v for _, v, _ in scene.bones), *(p for _, p in scene.tendons)]
    starts = np.cumsum([0, *map(len, points)])
    triangles = [faces + a for (_, _, faces), a in zip(scene.bones, starts, strict=False)]
    lines = [
        np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1)
        for a, b in itertools.pairwise(starts[len(bones) :])
    ]
    pulled = [tension_of(scene, name) for name, _ in scene.tendons]
    numbers = [
        np.concatenate([np.full(len(cells), i, dtype=np.int32) for i, cells in enumerate(part)])
        for part in (triangles, lines)
        if part
    ]
    tension = [np.zeros(len(numbers[0])), np.repeat(pulled, [len(cells) for cells in lines])]
    blocks = [
        (kind, np.concatenate(part).astype(np.int32))
        for kind, part in (("triangle", triangles), ("line", lines))
        if part
    ]
    names = "; ".join(
        f"{kind}: " + ", ".join(f"{i} {name}" for i, (name, *_) in enumerate(part))
        for kind, part in (("bones (triangles)", scene.bones), ("tendons (lines)", scene.tendons))
    )
    data = {"number": numbers, "pull_N": tension[: len(blocks)]}
    # single precision shows a micrometre
    _write_vtu(path, np.concatenate(points).astype(np.float32), blocks, {}, data, names, hand)


def _write_hood(path: Path, hood: HoodField, hand: Hand) -> None:
    hood = hood.of(hand)
    cell_data = {name: [np.asarray(values)] for name, values in hood.cell_data.items()}
    point_data = {name: np.asarray(values) for name, values in hood.point_data.items()}
    kind = {4: "quad", 2: "line"}[hood.quads.shape[1]]
    _write_vtu(path, hood.points, [(kind, hood.quads)], point_data, cell_data, hand=hand)


def _write_vtu(
    path: Path,
    points: Array,
    cells: list[tuple[str, np.ndarray]],
    point_data: dict[str, Array],
    cell_data: dict[str, list[np.ndarray]],
    note: str = "",
    hand: Hand = "right",
) -> None:
    """Write a .vtu with the frame, and a note, in a comment."""
    import meshio

    mesh = meshio.Mesh(points, cells, point_data, cell_data)
    mesh.write(path, file_format="vtu")
    # a comment: meshio, which users read it with, ends on a text among the data
    grid, text = "<UnstructuredGrid>", path.read_text(encoding="utf-8")
    frame = FRAME if hand == "right" else LEFT_FRAME
    words = f"Frame: {frame}; m" + f"; {note}".replace("--", "- -") * bool(note)
    path.write_text(text.replace(grid, f"<!--{words}-->\n{grid}", 1), encoding="utf-8")
