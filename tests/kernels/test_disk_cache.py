"""Compiled kernels on disk: kept where that is allowed, and never the cause of a failure."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from cosim.kernels.kernel import compile_kernel
from tests.helpers.folders import ROOT

pytest.importorskip("numba")

MODULE = """
from cosim.kernels.kernel import compile_kernel

@compile_kernel
def double(x):
    return 2.0 * x

@compile_kernel
def quadruple(x):
    return double(double(x))
"""
CALL = """
import sys
from cosim.kernels.kernel import Kernel, compiled_kernels
for _ in range({times}):
    Kernel.made.clear()
    sys.modules.pop("loops", None)
    import loops
    assert loops.quadruple(1.5) == 6.0
    (kernel,) = compiled_kernels()
    assert kernel.name == "loops.quadruple"
    print(kernel.compiled, kernel.loaded, kernel.folder)
"""
NOWHERE = {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"}
WITHOUT_A_PLACE = {**NOWHERE, "NUMBA_CACHE_DIR": "/proc/nowhere"}


@pytest.fixture
def installation(tmp_path: Path) -> Path:
    """A folder with a module of kernels."""
    (tmp_path / "loops.py").write_text(MODULE)
    return tmp_path


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Such a folder with what its first call left, which the tests leave as it is."""
    folder = tmp_path_factory.mktemp("compiled")
    (folder / "loops.py").write_text(MODULE)
    assert call(folder) == [(1, 0, str(folder / "__pycache__"))]
    return folder


@pytest.fixture
def used(compiled: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    return shutil.copytree(compiled, tmp_path / "used")


def call(
    installation: Path, before: str = "", environment: Mapping[str, str] = NOWHERE, times: int = 1
) -> list[tuple[int, int, str]]:
    """How often a kernel was compiled and loaded in a new process, and where it is kept, each time
    that its module is imported there anew."""
    paths = os.pathsep.join([str(installation), str(ROOT)])
    given = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", before + CALL.format(times=times)],
        env={**given, "PYTHONPATH": paths, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    told = [line.split() for line in done.stdout.splitlines()]
    return [(int(compiled), int(loaded), folder) for compiled, loaded, folder in told]


def test_a_kernel_is_compiled_once_and_kept_beside_its_module(compiled):
    assert call(compiled) == [(0, 1, str(compiled / "__pycache__"))]


def test_a_kernel_that_another_calls_is_kept_as_a_part_of_it(compiled):
    (kept,) = (compiled / "__pycache__").glob("*.nbi")
    assert "quadruple" in kept.name


@compile_kernel
def _shifted(values):
    out = np.zeros(len(values))
    for i in range(len(values)):
        out[i] = values[i] + 1.0
    return out


@compile_kernel
def _shifted_twice(values):
    return _shifted(_shifted(values))


def test_parts_give_back_the_memory_that_they_take():
    from numba.core.runtime import _nrt_python, rtsys

    _nrt_python.memsys_enable_stats()
    values = np.arange(3.0)
    assert list(_shifted_twice(values)) == [2.0, 3.0, 4.0]
    assert list(_shifted(values)) == [1.0, 2.0, 3.0]  # called by Python as well
    before = rtsys.get_allocation_stats()
    for _ in range(10):
        _shifted_twice(values)
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free >= 20


def test_kernels_go_to_the_folder_that_the_user_names(installation, tmp_path):
    named = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    first, second = call(installation, environment=named, times=2)
    assert first[2].startswith(str(tmp_path / "kept"))
    assert second[:2] == (0, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="the folder is named another way")
def test_of_a_read_only_installation_they_go_to_the_user_s_cache(installation, tmp_path):
    (installation / "__pycache__").write_text("no folder can be made here")
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    first, second = call(installation, environment=home, times=2)
    assert first[2].startswith(str(tmp_path))
    assert second[:2] == (0, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="/proc/nowhere can be made")
def test_where_nothing_can_be_written_they_are_compiled_in_memory(installation):
    (installation / "__pycache__").write_text("no folder can be made here")
    assert call(installation) == [(1, 0, "None")]
    assert call(installation, environment=WITHOUT_A_PLACE) == [(1, 0, "None")]


def test_kernels_of_an_installation_that_became_read_only_are_used(compiled):
    """As in a container that was warmed while its image was built; numba alone would not look."""
    locked = """
import tempfile
def refuse(*args, **kwargs): raise PermissionError
tempfile.TemporaryFile = refuse
"""
    assert call(compiled, before=locked) == [(0, 1, str(compiled / "__pycache__"))]


class Renamed:
    """A class that the process that reads does not have."""


def _damage(file: Path, how: str) -> None:
    content = file.read_bytes()
    if how == "cut off":
        file.write_bytes(content[: len(content) // 2])
    elif how == "of a renamed class":
        named = pickle.dumps(Renamed())
        assert b"Renamed" in named
        version = pickle.dumps(pickle.loads(content)) if file.suffix == ".nbi" else b""
        file.write_bytes(version + named)
    else:
        file.unlink()


@pytest.mark.parametrize("how", ["cut off", "of a renamed class", "gone"])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_files_that_are_no_good_are_compiled_anew_and_replaced(used, kind, how):
    files = list((used / "__pycache__").glob(f"*.{kind}"))
    assert files
    for file in files:
        _damage(file, how)
    assert [found[:2] for found in call(used, times=2)] == [(1, 0), (0, 1)]


@pytest.mark.skipif(sys.platform == "win32", reason="/proc/nowhere can be made")
def test_a_run_needs_no_folder_but_that_of_its_results(tmp_path):
    words = ["run", "split_edc", "--quiet", "--out", str(tmp_path / "runs")]
    done = subprocess.run(
        [sys.executable, "-B", "-m", "cosim", *words],
        cwd=ROOT,
        env={**os.environ, **WITHOUT_A_PLACE},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "runs" / "split_edc" / "picture.png").is_file()
