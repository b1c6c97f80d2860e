"""The store: rows whole or not there, whoever writes, whatever breaks."""

from __future__ import annotations

import errno
import json
import os
import stat
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.study.store import Store, StoreError, StoreRow

ROW = StoreRow("ab" + 62 * "0", "converged", "", {"a": [1.5, {"b": 0.1}]}, "x", 2.0, "here", "code")


def row(i: int) -> StoreRow:
    return replace(ROW, key=f"{i:064x}", summary={"i": i})


def write_many(root: str, first: int) -> None:
    store = Store(Path(root))
    for i in range(first, first + 60):
        store.put(row(i))
        store.log("ended", row(i).key)
        if i % 25 == 0:
            store.pack()


def test_a_row_comes_back_as_it_was_loose_and_packed(tmp_path):
    store = Store(tmp_path).open()
    store.put(ROW)
    assert store.find(ROW.key) == ROW
    assert list(store.rows([ROW.key])) == [ROW]
    assert store.pack() == 1
    assert list(store.rows([ROW.key])) == [ROW]
    assert list(Store(tmp_path).rows([ROW.key, "no"])) == [ROW]
    assert not list(tmp_path.glob("rows/*/*.json"))
    found = store.find(ROW.key)
    assert found is not None
    assert found.status == "converged"
    assert store.find("cd") is None


def test_only_what_converged_is_packed_and_a_retry_has_the_last_word(tmp_path):
    store = Store(tmp_path).open()
    store.put(replace(ROW, status="failed", reason="no"))
    assert store.pack() == 0
    store.put(ROW)
    assert store.pack() == 1
    assert list(store.rows([ROW.key])) == [ROW]


def test_writers_at_once_lose_nothing(tmp_path):
    """Two that write the same rows and one that writes others, each packing as it goes."""
    Store(tmp_path).open()
    context = get_context("spawn")
    parts = [
        context.Process(target=write_many, args=(str(tmp_path), first)) for first in (0, 30, 200)
    ]
    for part in parts:
        part.start()
    for part in parts:
        part.join()
    assert [part.exitcode for part in parts] == [0, 0, 0]
    expected = {row(i).key: i for i in (*range(90), *range(200, 260))}
    found = list(Store(tmp_path).rows(expected))
    assert {r.key: r.summary["i"] for r in found} == expected
    assert len(found) == len(expected)
    assert len((tmp_path / "executions.log").read_text().splitlines()) == 180
    assert not list(tmp_path.rglob("*.part"))


def test_a_store_sees_what_another_packed_since(tmp_path):
    first, second = Store(tmp_path).open(), Store(tmp_path).open()
    assert not first.is_packed(ROW.key)
    second.put(ROW)
    second.pack()
    assert first.find(ROW.key) is not None


@pytest.mark.parametrize("where", ["fsync", "replace"])
def test_a_full_disk_is_told_and_what_had_finished_stays(tmp_path, monkeypatch, where):
    store = Store(tmp_path).open()
    store.put(row(1))

    def full(*args: object, **more: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os if where == "fsync" else Path, where, full)
        with pytest.raises(StoreError, match=r"No space left.*give the same command again"):
            store.put(row(2))
        with pytest.raises(StoreError):
            store.pack()
    assert [r.key for r in Store(tmp_path).rows([row(1).key, row(2).key])] == [row(1).key]
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.skipif(os.name == "nt", reason="asks POSIX how a file is open")
def test_what_is_synced_may_be_written_to(tmp_path, monkeypatch):
    """Windows syncs nothing else; folders it does not sync at all."""
    import fcntl

    real, files = os.fsync, []

    def seen(handle: int) -> None:
        if not stat.S_ISDIR(os.fstat(handle).st_mode):
            files.append(fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE)
        real(handle)

    store = Store(tmp_path).open()
    monkeypatch.setattr(os, "fsync", seen)
    store.put(ROW)
    assert store.pack() == 1
    assert len(files) == 2
    assert os.O_RDONLY not in files


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.doc").write_text("mine")
    with pytest.raises(InputError, match="is no store of studies"):
        Store(tmp_path).open()
    (tmp_path / "format.json").write_text(json.dumps({"format": "other"}))
    with pytest.raises(InputError, match="expected"):
        Store(tmp_path).open()


def test_a_row_that_is_torn_is_named(tmp_path):
    store = Store(tmp_path).open()
    store.put(ROW)
    (file,) = tmp_path.glob("rows/*/*.json")
    file.write_text("{")
    with pytest.raises(InputError, match=ROW.key):
        store.find(ROW.key)
