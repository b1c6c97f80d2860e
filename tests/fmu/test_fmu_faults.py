"""FMUs that crash, leave, hang or lack something: one message each, and the next one runs."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import CosimError, InputError
from cosim.fmu import unit as unit_module
from cosim.fmu.hood import FmuHood
from cosim.fmu.table import Loading
from cosim.fmu.unit import Unit
from cosim.fmu_export.write import write_fmu
from cosim.pipeline import run_case
from cosim.solve.session import Session
from tests.fmu.test_fmu_foreign import BODIES, NAMES, SOURCES, TENDONS, pose, write_spring
from tests.helpers.fmus import NEEDS_FMU, change_archive
from tests.helpers.folders import TEST_DATA
from tests.helpers.hang import HANG

pytestmark = [
    *NEEDS_FMU,
    pytest.mark.skipif(
        sys.platform != "linux" or shutil.which("cc") is None, reason="compiles for Linux"
    ),
]
CASE = load_case("pulley_edc", ["output.picture=false"])
SOURCES_OF_CASE = ("pulley", "insertion")
SHORT = Loading(time_limit=2.0)
ENDS = {
    "_exit(0)": "its process ended with exit code 0",
    "exit(0)": "its process ended with exit code 0",
    "exit(3)": "its process ended with exit code 3",
    "abort()": "its process ended by SIGABRT",
    "raise(SIGSEGV)": "its process ended by SIGSEGV",
    "sleep(600)": r"it did not answer within 2 s",
}


def faulty(folder: Path, where: str, fault: str) -> Path:
    """The spring of test_fmu_foreign with a fault in its constructor or in one of its functions."""
    head = ""
    if where == "constructor":
        tail = f"__attribute__((constructor)) static void start(void) {{ {fault}; }}"
    else:
        head = f"#define {where} inner_{where}"
        kind = "void *" if where == "fmi2Instantiate" else "int "
        tail = f"#undef {where}\nEXPORT {kind}{where}() {{ {fault}; return 0; }}"
    source = folder / "faulty.c"
    source.write_text(
        "#include <signal.h>\n#include <stdio.h>\n#include <unistd.h>\n"
        f'{head}\n#include "{TEST_DATA / "spring_hood.c"}"\n{tail}\n'
    )
    return write_spring(folder, source)


def step_once(path: Path, loading: Loading) -> None:
    hood = FmuHood(path, BODIES, TENDONS, SOURCES, NAMES, rest_step=0.1, loading=loading)
    hood.advance(hood.start(pose()), pose(), np.array([2.0]), 0.01)


@pytest.mark.parametrize("fault", ENDS)
@pytest.mark.parametrize(
    ("where", "what"),
    [
        ("constructor", "cannot be loaded"),
        ("fmi2Instantiate", "cannot be instantiated"),
        ("fmi2DoStep", r"could not step from 0 s by 0\.01 s"),
    ],
)
def test_a_library_that_ends_its_process_or_hangs_is_one_message(tmp_path, where, what, fault):
    path = faulty(tmp_path, where, fault)
    started = time.monotonic()
    with pytest.raises(InputError, match=rf"faulty\.fmu: {what}: {ENDS[fault]}") as error:
        step_once(path, SHORT if "sleep" in fault else Loading())
    assert len(str(error.value).splitlines()) == 1
    assert time.monotonic() - started < HANG


def test_a_token_that_the_library_refuses_is_one_message(tmp_path):
    """GUIDs are compared by the library, which makes no instance for another one."""
    path = faulty(tmp_path, "fmi2Instantiate", "")
    with pytest.raises(InputError, match=r"faulty\.fmu: cannot be instantiated: "):
        Unit(path)


def test_what_a_library_said_last_is_told(tmp_path):
    fault = 'puts("no licence is left"); exit(1)'
    path = faulty(tmp_path, "fmi2Instantiate", fault)
    with pytest.raises(InputError, match=r"exit code 1, after it said 'no licence is left'"):
        Unit(path)


@pytest.mark.parametrize("part", [0.2, 0.5])
def test_a_truncated_library_is_one_message(tmp_path, part):
    path = write_spring(tmp_path, TEST_DATA / "spring_hood.c")
    cut = change_archive(
        path,
        tmp_path / "cut.fmu",
        {"binaries/linux64/spring.so": lambda old: old[: int(part * len(old))]},
    )
    with pytest.raises(CosimError, match=r"cut\.fmu: cannot be loaded"):
        Unit(cut)


@pytest.fixture(scope="module")
def own(tmp_path_factory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("own")
    paths = {fmi: folder / f"hood{fmi}.fmu" for fmi in (2, 3)}
    for fmi, path in paths.items():
        write_fmu(CASE, "hood", fmi, path)
    return paths


@pytest.mark.parametrize("fmi", [2, 3])
def test_our_own_unit_without_resources_is_one_message(own, tmp_path, fmi):
    path = change_archive(own[fmi], tmp_path / "bare.fmu", without=("resources/",))
    with pytest.raises(InputError, match=r"bare\.fmu: cannot be (loaded|instantiated)"):
        Unit(path, SHORT)


@pytest.mark.parametrize(
    ("fmi", "content"),
    [
        *((2, content) for content in (b"", b"def (", b"import os; os.abort()", b"\x80\x00")),
        (3, b"import os; os.abort()"),
        (3, b"def ("),
    ],
)
def test_our_own_unit_with_a_broken_script_is_one_message(own, tmp_path, fmi, content):
    script = f"resources/cosim_fmu{fmi}.py"
    path = change_archive(own[fmi], tmp_path / "broken.fmu", {script: lambda _: content})
    with pytest.raises(InputError, match=r"broken\.fmu: cannot be instantiated"):
        Unit(path, Loading(time_limit=5.0))
    Unit(own[fmi]).step(0.01)


def with_hood(path: Path) -> Case:
    hood = CASE.hood
    names = {"sources": SOURCES_OF_CASE, "tendons": hood.tendon_names("index")}
    lists = ",".join(f"{key}={json.dumps(value)}" for key, value in names.items())
    table = f'hood={{kind="fmu",path="{path}",{lists}}}'
    return load_case("pulley_edc", ["output.picture=false", table])


def test_a_session_runs_on_when_the_process_of_its_unit_has_ended(own):
    session, case = Session(), with_hood(own[2])
    first = run_case(case, session)
    unit_module._SHARED[0].kill()
    assert first.data.equals(run_case(case, session).data)


def test_a_unit_in_the_programs_own_process_gives_the_same_bytes(own):
    apart = with_hood(own[3])
    hood = apart.hood.model_copy(update={"in_process": True})
    within = apart.model_copy(update={"hood": hood})
    a, b = run_case(apart), run_case(within)
    assert a.data.equals(b.data)


@pytest.mark.slow
def test_the_rest_of_a_batch_is_run(own, tmp_path):
    """Where the library of one leaves with 0, which ended the program with 0 and no result."""
    path = faulty(tmp_path, "constructor", "_exit(0)")
    bad = tmp_path / "bad.toml"
    with pytest.raises(InputError):
        run_case(with_hood(path))
    bad.write_text(
        'extends = "pulley_edc"\n[hood]\nkind = "fmu"\n'
        f'path = "{path}"\nsources = ["pulley"]\ntendons = ["EDC", "EI", "LUM", "FPI"]\n'
    )
    command = [sys.executable, "-m", "cosim", "run", str(bad), "pulley_edc", "--out"]
    done = subprocess.run(
        [*command, str(tmp_path / "runs")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "its process ended with exit code 0" in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "runs" / "pulley_edc" / "results.nc").is_file()
