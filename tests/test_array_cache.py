"""The cache of arrays: what was written or nothing, never too much, and never a failure."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim import array_cache
from cosim.array_cache import FOLDERS, VARIABLE, ArrayCache, Contents, user_cache
from cosim.cli import app
from tests.helpers.folders import ROOT

KEY, OTHER = 64 * "a", 64 * "b"
ARRAYS = {
    "x": np.linspace(0, 1, 60).reshape(20, 3),
    "columns": np.asfortranarray(np.eye(3)[:2]),
    "count": np.array(7),
    "words": np.array("at once"),
    "none": np.zeros((0, 3)),
}


@pytest.fixture
def cache(tmp_path: Path) -> ArrayCache:
    return ArrayCache(tmp_path / "cache")


def only_file(cache: ArrayCache) -> Path:
    (file,) = (cache.folder / "equilibria").iterdir()
    return file


def test_arrays_come_back_as_they_were(cache):
    assert cache.read("equilibria", KEY) is None
    cache.write("equilibria", KEY, ARRAYS)
    again = cache.read("equilibria", KEY)
    assert list(again) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert again[name].dtype == array.dtype
        assert again[name].tobytes("A") == array.tobytes("A")
        assert again[name].flags.c_contiguous == array.flags.c_contiguous
    assert cache.read("equilibria", OTHER) is None
    assert cache.read("distances", KEY) is None


def test_a_file_is_used_whole_or_not_at_all(cache):
    """Each byte of it decides: changed it is found out, or changes nothing that is read."""
    cache.write("equilibria", KEY, {"x": ARRAYS["x"][:2]})
    file = only_file(cache)
    whole = file.read_bytes()
    used = 0
    for place in range(len(whole)):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        again = cache.read("equilibria", KEY)
        used += again is not None
        assert again is None or again["x"].tobytes() == ARRAYS["x"][:2].tobytes()
    assert used < len(whole) / 4  # dates and the like of the archive
    for length in range(0, len(whole), 7):
        file.write_bytes(whole[:length])
        assert cache.read("equilibria", KEY) is None
    cache.write("equilibria", KEY, {"x": ARRAYS["x"][:2]})
    assert cache.read("equilibria", KEY) is not None


@pytest.mark.parametrize("content", ["pickled", "no digest", "another name", "another kind"])
def test_what_was_not_written_under_the_key_is_not_used(cache, content):
    cache.write("equilibria", KEY, ARRAYS)
    file = only_file(cache)
    if content == "pickled":
        np.savez(file, x=np.array([{"a": 1}], dtype=object), digest=np.array(64 * "0"))
    elif content == "no digest":
        np.savez(file, **ARRAYS)
    elif content == "another name":
        cache.write("equilibria", OTHER, ARRAYS)
        shutil.copy(file.with_name(f"{OTHER}.npz"), file)
    else:
        cache.write("distances", KEY, ARRAYS)
        shutil.copy(cache.folder / "distances" / file.name, file)
    assert cache.read("equilibria", KEY) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes in the file system")
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(cache):
    cache.write("equilibria", KEY, ARRAYS)
    file = only_file(cache)
    file.unlink()
    os.mkfifo(file)
    assert cache.read("equilibria", KEY) is None


@pytest.mark.parametrize("head", [b"1000000000000000,", b"(99999999999,)", b"<O8"])
def test_a_head_that_lies_is_not_used(cache, head):
    cache.write("equilibria", KEY, {"x": np.zeros(3)})
    file = only_file(cache)
    whole = file.read_bytes()
    start = whole.index(b"(3,)")
    file.write_bytes(whole[:start] + head + whole[start + len(head) :])
    assert cache.read("equilibria", KEY) is None


def test_what_unpacks_to_more_than_it_is_is_not_read(cache):
    """A megabyte that holds a gigabyte of zeros costs neither time nor memory."""
    cache.write("equilibria", KEY, {"x": np.zeros(3)})
    bomb = {"x": np.zeros(4_000_000), "digest": np.array(64 * "0")}
    np.savez_compressed(only_file(cache), **bomb)
    tracemalloc.start()
    assert cache.read("equilibria", KEY) is None
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()
    cache.write("equilibria", KEY, {"x": np.zeros(3)})
    assert ArrayCache(cache.folder, most_bytes=500).read("equilibria", KEY) is None
    assert cache.read("equilibria", KEY) is not None


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owner here")
def test_what_says_that_it_is_larger_than_its_file_is_not_read(cache, tmp_path):
    """Its directory is trusted with no memory, whatever the bound."""
    path = tmp_path / "arrays.npz"
    np.savez(path, x=np.zeros(4))
    text = bytearray(path.read_bytes())
    entry = text.rindex(b"PK\x01\x02")  # of the directory: the size lies 24 bytes further on
    text[entry + 24 : entry + 28] = (1 << 20).to_bytes(4, "little")
    path.write_bytes(text)
    with pytest.raises(ValueError, match="larger than it is"):
        array_cache.read_arrays(path, "here", 1 << 30)
    np.savez(path, x=np.zeros(4))
    with pytest.raises(ValueError, match="larger than it is"):
        array_cache.read_arrays(path, "here", 100)
    with pytest.raises(ValueError, match="was changed"):
        array_cache.read_arrays(path, "here", 1 << 30)


def test_what_another_user_wrote_is_not_read_and_written_over(cache, monkeypatch):
    cache.write("equilibria", KEY, ARRAYS)
    another = os.geteuid() + 1
    monkeypatch.setattr(array_cache.os, "geteuid", lambda: another)
    assert cache.read("equilibria", KEY) is None
    cache.write("equilibria", KEY, ARRAYS)
    monkeypatch.undo()
    assert cache.read("equilibria", KEY) is not None


def test_what_was_used_longest_ago_goes_first(tmp_path):
    keys = [digit * 64 for digit in "0123"]
    one = ArrayCache(tmp_path)
    one.write("equilibria", keys[0], ARRAYS)
    size = only_file(one).stat().st_size
    small = ArrayCache(tmp_path, most_bytes=3 * size)
    for age, key in enumerate(keys[:3]):
        small.write("equilibria", key, ARRAYS)
        file = tmp_path / "equilibria" / f"{key}.npz"
        os.utime(file, ns=(age, age))
    assert small.read("equilibria", keys[0]) is not None  # it is the youngest now
    small.write("distances", keys[3], ARRAYS)
    assert small.read("equilibria", keys[1]) is None
    assert [small.read("equilibria", keys[i]) is None for i in (0, 2)] == [False, False]
    assert sum(n.bytes for n in small.contents().values()) <= small.most_bytes
    ArrayCache(tmp_path, most_bytes=1).write("equilibria", keys[1], ARRAYS)
    assert small.contents()["equilibria"].files == 1  # what has just been written stays
    assert small.read("equilibria", keys[1]) is not None


def test_it_counts_and_removes_its_own_files_alone(cache):
    cache.write("equilibria", KEY, ARRAYS)
    cache.write("distances", KEY, ARRAYS)
    own = only_file(cache)
    killed = own.with_name(f".{KEY[:40]}.1234.0123abcd.part")
    shutil.copy(own, killed)
    old = cache.folder / own.name
    shutil.copy(own, old)
    others = [folder / name for folder in (own.parent, old.parent) for name in ("x.npz", "mine")]
    for other in others:
        other.write_text("a user's")
    size = own.stat().st_size
    assert cache.contents() == {
        "distances": Contents(1, size),
        "equilibria": Contents(2, 2 * size),
        "mesh_errors": Contents(0, 0),
        "": Contents(1, size),
    }
    assert cache.clear() == Contents(4, 4 * size)
    assert all(other.read_text() == "a user's" for other in others)
    assert cache.contents() == dict.fromkeys(FOLDERS[:-1], Contents(0, 0))
    assert FOLDERS[-1] == ""


@pytest.mark.parametrize("folder", ["in the way", "in the way/below"])
def test_a_folder_that_cannot_be_made_is_no_failure(tmp_path, folder):
    (tmp_path / "in the way").write_text("a file")
    cache = ArrayCache(tmp_path / folder)
    cache.write("equilibria", KEY, ARRAYS)
    assert cache.read("equilibria", KEY) is None
    assert cache.clear() == Contents(0, 0)


WRITE_AND_READ = """
import sys
from pathlib import Path
import numpy as np
from cosim.array_cache import ArrayCache
cache = ArrayCache(Path(sys.argv[1]), most_bytes=20_000)
found = 0
for i in range(300):
    key = f"{i % 7:064x}"
    kept = cache.read("equilibria", key)
    assert kept is None or kept["x"].tobytes() == np.full(500, i % 7.0).tobytes()
    found += kept is not None
    if kept is None:
        cache.write("equilibria", key, {"x": np.full(500, i % 7.0)})
    if i % 100 == 99:
        cache.clear()
print(found)
"""


def test_many_processes_share_one(cache):
    command = [sys.executable, "-c", WRITE_AND_READ, str(cache.folder)]
    at_work = [
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    outputs = [process.communicate()[0] for process in at_work]
    assert [process.returncode for process in at_work] == [0, 0, 0]
    assert any(int(found) for found in outputs)
    assert all(p.suffix == ".npz" for p in (cache.folder / "equilibria").iterdir())


def test_the_user_says_where_it_lies_or_turns_it_off(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert user_cache() == ArrayCache(tmp_path)
    monkeypatch.setenv(VARIABLE, "off")
    assert user_cache() is None
    monkeypatch.delenv(VARIABLE)
    assert user_cache().folder.name == "cosim" or sys.platform == "win32"


def test_info_says_how_much_is_kept_and_clears_it(monkeypatch, tmp_path):
    def info(*options: str) -> str:
        done = CliRunner().invoke(app, ["info", *options])
        assert done.exit_code == 0
        return done.output

    monkeypatch.setenv(VARIABLE, str(tmp_path))
    user_cache().write("equilibria", KEY, {"x": np.zeros(100_000)})
    assert "equilibria 0.8 MB in 1 files" in info()
    assert "freed 0.8 MB in 1 files" in info("--clear-cache")
    assert "equilibria 0.0 MB in 0 files" in info()
    monkeypatch.setenv(VARIABLE, "off")
    assert f"turned off ({VARIABLE}=off)" in info()
    assert "nothing was removed" in info("--clear-cache")
