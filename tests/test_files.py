"""Writes are whole or not there, on a full disk too; what killed processes left is removed."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cosim.case.file import load_case
from cosim.commands.terminal import tell
from cosim.errors import InputError, NoRoomError
from cosim.files import (
    SLACK,
    beside,
    check_file,
    check_folder,
    clear_again,
    clear_leftovers,
    output_file,
    output_folder,
    temporary_folder,
)
from cosim.pipeline import run_case
from cosim.results.result import Result
from cosim.results.write import check_target
from cosim.study.store import Store
from tests.helpers.folders import ROOT

if sys.platform != "win32":
    import resource


@pytest.fixture(scope="module")
def result() -> Result:
    return run_case(load_case("pulley_edc", ["output.picture=false"]))


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Files of no more bytes: beyond it a write ends as it does on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.skipif(os.name == "nt", reason="there is no such limit")
def test_a_full_disk_is_one_message_and_leaves_nothing(result: Result, tmp_path: Path) -> None:
    whole = result.save(tmp_path / "whole") / "results.nc"
    for size in (*range(0, 2000, 500), *range(2000, whole.stat().st_size, 2500)):
        with largest_file(size), pytest.raises(NoRoomError) as known:
            result.save(tmp_path / "full")
        assert "there is no room for it" in str(known.value)
        assert " kB are needed" in str(known.value)
        assert tell(known.value) == 1
        assert list((tmp_path / "full").iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="there is no such limit")
def test_numbers_outlive_pictures_that_have_no_room(result: Result, tmp_path: Path) -> None:
    size = (result.save(tmp_path / "whole") / "results.nc").stat().st_size
    with largest_file(size), pytest.warns(UserWarning, match=r"no room for finger\.vtu; the num"):
        folder = result.save(tmp_path / "full")
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["case.toml", "ledger.csv", "results.nc", "summary.json"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no such file")
def test_a_full_disk_says_how_much_is_free(tmp_path: Path) -> None:
    with (
        pytest.raises(NoRoomError, match=r"a\.txt: there is no room.*left on device, \d+ .B are"),
        output_file(tmp_path / "a.txt"),
        open("/dev/full", "w") as full,
    ):
        full.write("1")
    assert list(tmp_path.iterdir()) == []


def leavings(folder: Path, process: int) -> list[Path]:
    """What a process leaves in a folder that is killed while it writes."""
    mine = [beside(folder / "run", ending) for ending in ("part", "old", "probe")]
    theirs = [
        path.with_name(path.name.replace(f".{os.getpid()}.", f".{process}.")) for path in mine
    ]
    for path in theirs[:2]:
        path.mkdir()
        (path / "results.nc").write_text("half")
    theirs[2].write_text("half")
    return theirs


def ended_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


WRITERS = {
    "run": lambda folder: check_target(folder, "run"),
    "file": lambda folder: check_file(folder / "page.html"),
    "folder": lambda folder: check_folder(folder / "tables", "page.html"),
    "store": lambda folder: Store(folder).open(),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_the_next_writer_removes_what_killed_ones_left(writer: str, tmp_path: Path) -> None:
    WRITERS[writer](tmp_path)
    left, kept = leavings(tmp_path, ended_process()), leavings(tmp_path, os.getpid())
    WRITERS[writer](tmp_path)
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in kept)


def test_a_store_clears_the_folders_of_its_rows_too(tmp_path: Path) -> None:
    Store(tmp_path).open()
    folders = [tmp_path / name for name in ("parts", "rows/ab", "arrays/cd")]
    for folder in folders:
        folder.mkdir(parents=True)
        leavings(folder, ended_process())
    Store(tmp_path).open()
    assert [path for folder in folders for path in folder.iterdir()] == []


def test_a_folder_that_was_cleared_is_cleared_again_at_the_end(tmp_path: Path) -> None:
    """When the processes of a command that is ended were killed while they wrote."""
    check_target(tmp_path, "run")
    leavings(tmp_path, ended_process())
    clear_again()
    assert list(tmp_path.iterdir()) == []


def test_a_number_that_is_used_again_keeps_nothing(tmp_path: Path) -> None:
    left = leavings(tmp_path, os.getpid())
    before = time.time() - 10 * 365 * 86400 - SLACK  # before this process began
    for path in left:
        os.utime(path, (before, before))
    clear_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_another_machine_writes_and_what_others_named_stays(tmp_path: Path) -> None:
    number = ended_process()
    own = leavings(tmp_path, number)[0].name
    machine = own.split(".")[-2][:4]
    foreign = own.replace(f".{machine}", ".0000" if machine != "0000" else ".1111")
    names = (foreign, f".run.{number}.part", "mine.part", ".git", f".a.{number}.{machine}.part")
    for name in names:
        (tmp_path / name).mkdir()
    clear_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(names)


def test_leftovers_of_the_same_number_stop_no_writer(result: Result, tmp_path: Path) -> None:
    for name in ("pulley_edc", "tables"):
        for ending in ("part", "old", "probe"):
            (tmp_path / f".{name}.{os.getpid()}.{ending}").mkdir()
    leavings(tmp_path, os.getpid())
    assert result.save(tmp_path).is_dir()
    with output_folder(tmp_path / "tables", "a.csv") as part:
        (part / "a.csv").write_text("1")
    assert (tmp_path / "tables" / "a.csv").is_file()


def test_a_folder_for_what_passes_goes_after_a_kill_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    script = """
import os, signal
from cosim.files import temporary_folder
room = temporary_folder("fmu")
os.kill(os.getpid(), signal.SIGTERM)
"""
    path = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path), "TEMP": str(tmp_path)}
    subprocess.run([sys.executable, "-c", script], env=path, check=False)
    (left,) = tmp_path.iterdir()
    with temporary_folder("fmu") as room:
        assert [str(path) for path in tmp_path.iterdir()] == [room]
    assert not left.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_summary_that_was_changed_is_not_saved(result: Result, tmp_path: Path) -> None:
    changed = copy.deepcopy(result)
    assert pickle.loads(pickle.dumps(changed)).save(tmp_path).is_dir()
    changed.summary["tension_N"]["EDC"] = 99.0
    with pytest.raises(InputError, match="the summary was changed after it was solved"):
        pickle.loads(pickle.dumps(changed)).save(tmp_path / "other")
    assert not (tmp_path / "other").exists()
