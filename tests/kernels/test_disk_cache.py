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
    return _told(installation, before + CALL.format(times=times), environment)


def _told(
    installation: Path, program: str, environment: Mapping[str, str] = NOWHERE
) -> list[tuple[int, int, str]]:
    """What the program says of its kernels in a process of its own."""
    paths = os.pathsep.join([str(installation), str(ROOT)])
    given = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", program],
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


@pytest.mark.slow
def test_what_was_imported_before_its_file_was_changed_is_not_kept_as_the_file_s(installation):
    """The changed file once got the code of the text before it, in this process and all others."""
    # of another length: Python's own bytecode knows a file by its size and the second of its change
    changed = MODULE.replace("2.0 * x", "4.00 * x")
    edit = f"import loops\nopen({str(installation / 'loops.py')!r}, 'w').write({changed!r})\n"
    only = CALL.replace('    Kernel.made.clear()\n    sys.modules.pop("loops", None)\n', "")
    assert _told(installation, edit + only.format(times=1)) == [(1, 0, "None")]
    new = CALL.replace("6.0", "24.0").format(times=1)
    assert _told(installation, new) == [(1, 0, str(installation / "__pycache__"))]


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


@pytest.mark.slow
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


VARIOUS = """
import math
import numpy as np
from cosim.kernels.kernel import compile_kernel

@compile_kernel
def words(n):
    counts = {"one": 1}
    for i in range(n):
        counts["two" if i % 2 else "three"] = i
    return counts["two"]

@compile_kernel
def algebra(n):
    a = np.eye(n) * 2.0
    a[0, 1] = math.erf(0.5) ** 0.3
    return np.linalg.solve(a, np.ones(n)).sum()

@compile_kernel
def tuples(n):
    if n < 0:
        raise ValueError("negative")
    return np.arange(n), (np.full((n, 2), 1.5), "text")

@compile_kernel
def drawn(n):
    np.random.seed(n)
    return np.random.normal()
"""
CALL_VARIOUS = """
import sys
import numpy as np
import various
from cosim.kernels.kernel import compiled_kernels
heavy = "numba.np.linalg"
print(repr(various.tuples(2)).replace(chr(10), ""), heavy in sys.modules)
try:
    various.tuples(-1)
except ValueError as error:
    print(error)
print(various.algebra(3), various.drawn(3), various.words(4))
print([(k.compiled, k.loaded) for k in compiled_kernels()])
"""


@pytest.mark.slow
def test_a_loaded_kernel_finds_all_that_it_calls_and_loads_no_compiler(tmp_path):
    """Arrays, tuples, texts, exceptions, linear algebra and random numbers are other code each; a
    symbol that is missing would end the process."""
    pytest.importorskip("scipy")
    (tmp_path / "various.py").write_text(VARIOUS)
    paths = os.pathsep.join([str(tmp_path), str(ROOT)])
    env = {**os.environ, **NOWHERE, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    command = [sys.executable, "-c", CALL_VARIOUS]
    first, second = (
        subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert first.splitlines()[1:3] == second.splitlines()[1:3]
    assert first.splitlines()[3] == str([(1, 0)] * 4)
    assert second.splitlines()[3] == str([(0, 1)] * 4)
    assert [text.splitlines()[0].split()[-1] for text in (first, second)] == ["True", "False"]
    assert first.splitlines()[0].rpartition(" ")[0] == second.splitlines()[0].rpartition(" ")[0]


SLOWLY = """
import os, sys, time
from cosim.kernels import disk_cache
from numba.core.dispatcher import _FunctionCompiler
wait, compile_function = {wait}, _FunctionCompiler.compile
def slowly(self, *arguments):
    print("compiling", flush=True)
    time.sleep(wait)
    return compile_function(self, *arguments)
_FunctionCompiler.compile = slowly
"""


def begin(installation: Path, wait: float, before: str = "") -> subprocess.Popen[str]:
    """A process that calls the kernel, and compiles it in no less than `wait` s."""
    paths = os.pathsep.join([str(installation), str(ROOT)])
    given = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.Popen(
        [sys.executable, "-c", SLOWLY.format(wait=wait) + before + CALL.format(times=1)],
        env={**given, "PYTHONPATH": paths, **NOWHERE},
        stdout=subprocess.PIPE,
        text=True,
    )


def end(process: subprocess.Popen[str]) -> tuple[int, int]:
    """How often it compiled the kernel, and loaded it."""
    out = process.communicate()[0]
    assert process.returncode == 0
    compiled, loaded = out.splitlines()[-1].split()[:2]
    return int(compiled), int(loaded)


def test_of_processes_that_need_a_kernel_one_compiles_it(installation):
    at_work = [begin(installation, 2.0) for _ in range(3)]
    assert sorted(end(process) for process in at_work) == [(0, 1), (0, 1), (1, 0)]


def test_one_that_dies_while_it_compiles_stops_nobody(installation):
    killed = begin(installation, 600.0)
    assert killed.stdout.readline() == "compiling\n"
    waiting = begin(installation, 0.0)
    with pytest.raises(subprocess.TimeoutExpired):
        waiting.wait(2.0)
    killed.kill()
    killed.wait()
    killed.stdout.close()
    assert end(waiting) == (1, 0)


def test_one_that_fails_to_compile_stops_nobody(installation):
    (installation / "loops.py").write_text(MODULE.replace("double(double(x))", "double(x).none"))
    fails = """
from loops import quadruple
try:
    quadruple(1.5)
except Exception as error:
    assert "none" in str(error), error
from pathlib import Path
from cosim.kernels.disk_cache import FileLock
(path,) = Path({folder!r}).glob("*.lock")
print("released", subprocess.run([sys.executable, "-c", {take!r}, str(path)]).returncode)
raise SystemExit
"""
    take = (
        "import sys; from pathlib import Path; from cosim.kernels.disk_cache import FileLock\n"
        "raise SystemExit(not FileLock(Path(sys.argv[1])).acquire(0.0))"
    )
    before = "import subprocess\n" + fails.format(
        folder=str(installation / "__pycache__"), take=take
    )
    process = begin(installation, 0.0, before)
    assert process.communicate()[0].splitlines()[-1] == "released 0"


@pytest.mark.parametrize("fault", ["no locks", "not in time"])
def test_where_no_turn_can_be_had_each_compiles(installation, fault):
    if fault == "no locks":
        before = """
from cosim.kernels import disk_cache
def none(handle): raise OSError(37, "No locks available")
disk_cache._try_lock = none
"""
    else:
        before = """
from cosim.kernels import disk_cache
disk_cache._try_lock = lambda handle: False
disk_cache.FileLock.acquire.__defaults__ = (0.1,)
"""
    assert end(begin(installation, 0.0, before)) == (1, 0)
    assert call(installation) == [(0, 1, str(installation / "__pycache__"))]
