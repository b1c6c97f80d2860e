"""Work in processes side by side: its order, its memory, and its end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.processes import BLAS_THREADS, PRELOADED, Memory, process_pool


def slow_process_of(name: str) -> tuple[str, int]:
    time.sleep(0.2)
    return process_of(name)


def slow_square(x: float) -> float:
    time.sleep(0.2 * (x == 0))
    return x * x


def process_of(x: str) -> tuple[str, int]:
    return x, os.getpid()


def end_oneself(x: int) -> int:
    if x == 1:
        os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(30)
    return x


def loaded_modules(name: str) -> list[str]:
    return [module for module in PRELOADED if module in sys.modules]


def tasks_of_parent(x: int) -> list[str]:
    return os.listdir(f"/proc/{os.getppid()}/task")


def setting(name: str) -> str | None:
    return os.environ.get(name)


def count(memory: Memory, step: int) -> int:
    memory["count"] = memory.get("count", 0) + step
    return int(memory["count"])


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order_and_a_batch_stays_in_one_process(workers: int) -> None:
    with process_pool(workers) as pool:
        assert list(pool.in_order(slow_square, range(4))) == [0, 1, 4, 9]
        ended = list(pool.as_ended(process_of, ["ab", "c"]))
        by_name = dict(ended)
        assert by_name.keys() == set("abc")
        assert by_name["a"] == by_name["b"]
        assert [x for x, _ in ended if x in "ab"] == ["a", "b"]


def test_a_process_without_work_takes_over_half_of_a_batch() -> None:
    with process_pool(2) as pool:
        ended = list(pool.as_ended(slow_process_of, ["abcdef"]))
    assert sorted(name for name, _ in ended) == list("abcdef")
    assert len({process for _, process in ended}) == 2


@pytest.mark.parametrize("workers", [1, 2])
def test_a_process_remembers_as_long_as_its_pool(workers: int) -> None:
    for _ in range(2):
        with process_pool(workers) as pool:
            assert [pool.submit(0, count, 2).result() for _ in range(2)] == [2, 4]


@pytest.mark.skipif(sys.platform != "linux", reason="processes begin anew")
def test_processes_are_forked_where_their_imports_are_done_and_no_thread_runs() -> None:
    with process_pool(2) as pool:
        assert list(pool.in_order(loaded_modules, ["all"])) == [list(PRELOADED)]
        (threads,) = pool.in_order(tasks_of_parent, [0])
    assert len(threads) == 1


def test_processes_have_the_environment_of_their_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["A_SETTING", "PYTHONPATH", "PYTHONSAFEPATH", *BLAS_THREADS]
    for value in ("one", "two"):
        monkeypatch.setenv("A_SETTING", value)
        monkeypatch.setenv(BLAS_THREADS[0], "2")
        with process_pool(2) as pool:
            assert list(pool.in_order(setting, names)) == [os.environ.get(name) for name in names]
        assert os.environ["A_SETTING"] == value


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_killed_process_ends_the_others_with_words() -> None:
    begun = time.monotonic()
    with (
        pytest.raises(InputError, match=r"ended from outside.*--workers 1 needs"),
        process_pool(2, "--workers") as pool,
    ):
        list(pool.in_order(end_oneself, range(4)))
    assert time.monotonic() - begun < 20


WAITING = """
import time
from cosim.processes import process_pool
if __name__ == "__main__":
    with process_pool(2) as pool:
        list(pool.in_order(abs, [-1, -2]))
        print("ready", flush=True)
        list(pool.in_order(time.sleep, [60, 60]))
"""


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT to a group of processes")
def test_ctrl_c_ends_all_at_once_and_the_processes_say_nothing(tmp_path: Path) -> None:
    (tmp_path / "wait.py").write_text(WAITING)
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "wait.py"],
        cwd=tmp_path,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert said.count("Traceback") == 1, said
