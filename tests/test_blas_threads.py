"""BLAS works in one thread, whatever the environment says: sums depend on how many share them."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from cosim.processes import BLAS_THREADS, one_blas_thread
from tests.helpers.folders import ROOT

SEEN = """
import json, sys
import scipy.linalg
from threadpoolctl import threadpool_info

def threads():
    return [i["num_threads"] for i in threadpool_info() if i["user_api"] == "blas"]

"""
DOORS = {
    "a case": """
from cosim.case.file import load_case
from cosim.pipeline import run_case
seen = []
run_case(load_case("pulley_edc"), progress=lambda stage: seen.extend(threads()))
""",
    "a model of the shell solver": """
import fe_solver.job.solve as door
seen = []
def job_model(*_):
    seen.extend(threads())
    raise InterruptedError
door.checked_phases = job_model
try:
    door.solve_job(None, times=[1.0])
except InterruptedError:
    pass
""",
    "a step of an FMU": """
import numpy as np
import cosim.fmu_export.run as door
seen = []
class Bare(door.UnitRun):
    part = type("", (), {"step": lambda *_: (seen.extend(threads()), {})})()
    quantities, _state, _values = (), None, np.zeros(0)
    def __init__(self):
        pass
Bare()._step(1.0)
""",
    "the program": """
import cosim.cli as door
seen = []
door.app = lambda **_: seen.extend(threads())
door.main()
import os
seen += [int(os.environ["OMP_NUM_THREADS"])]
""",
}


def with_two_threads(text: str) -> dict[str, list[int]]:
    """What a program prints that is started with two threads of BLAS."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", SEEN + text + "print(json.dumps([seen, threads()]))"],
        env=env | dict.fromkeys(BLAS_THREADS, "2"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    seen, after = json.loads(done.stdout.splitlines()[-1])
    return {"seen": seen, "after": after}


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core: BLAS takes no second thread")
@pytest.mark.parametrize("door", DOORS)
def test_what_solves_has_one_blas_thread_and_gives_the_others_back(door):
    found = with_two_threads(DOORS[door])
    assert set(found["seen"]) == {1}
    assert set(found["after"]) == ({1} if door == "the program" else {2})


def test_a_function_can_be_decorated():
    def threads() -> set[int]:
        return {i["num_threads"] for i in threadpool_info() if i["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        assert one_blas_thread()(threads)() == {1}
        assert 2 in threads()  # beside libraries that can use one thread alone
