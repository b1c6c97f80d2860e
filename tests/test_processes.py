"""Processes of one's own: work side by side, its order, memory and end; and whatever a foreign
process does is one reason, and it ends with its parent."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from cosim import processes
from cosim.errors import InputError, StoppedError
from cosim.processes import (
    BLAS_THREADS,
    PRELOADED,
    ForeignError,
    ForeignProcess,
    Memory,
    OwnTime,
    ProcessEndedError,
    TimeLimitError,
    WorkerProcess,
    process_pool,
    tell_caller,
)
from tests.helpers.folders import ROOT
from tests.helpers.hang import HANG

posix = pytest.mark.skipif(os.name == "nt", reason="sends signals")


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
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(2 * HANG)
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
        ended = list(pool.as_completed(process_of, ["ab", "c"]))
        by_name = dict(ended)
        assert by_name.keys() == set("abc")
        assert by_name["a"] == by_name["b"]
        assert [x for x, _ in ended if x in "ab"] == ["a", "b"]


def test_a_process_without_work_takes_over_half_of_a_batch() -> None:
    with process_pool(2) as pool:
        ended = list(pool.as_completed(slow_process_of, ["abcdef"]))
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


@pytest.mark.skipif(sys.platform != "linux", reason="a server of processes has a socket there")
def test_a_folder_for_temporary_files_of_a_long_path_is_one_message(tmp_path: Path) -> None:
    room = tmp_path / ("a" * 100)
    room.mkdir()
    words = [sys.executable, "-m", "cosim", "run", "split_edc", "split_ei", "--workers", "2"]
    done = subprocess.run(
        [*words, "--out", "out"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(room)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "TMPDIR" in done.stderr
    assert "Traceback" not in done.stderr


@posix
def test_a_killed_process_ends_the_others_with_words() -> None:
    begun = time.monotonic()
    with (
        pytest.raises(InputError, match=r"ended from outside \(signal 9\).*one worker needs"),
        process_pool(2) as pool,
    ):
        list(pool.in_order(end_oneself, range(4)))
    assert time.monotonic() - begun < HANG


class UnportableError(Exception):
    """Which cannot be pickled back."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} and {second}")


def fail(kind: str) -> None:
    raise UnportableError(1, 2) if kind == "unportable" else ZeroDivisionError("of mine")


LATE = 20.0
"""s, of a call that is ended: it begins earlier on any machine."""


def test_a_call_over_its_time_ends_its_process_and_the_next_has_another() -> None:
    process = WorkerProcess()
    try:
        first = process.call(os.getpid, limit=60.0)
        with pytest.raises(TimeLimitError):
            process.call(time.sleep, LATE, limit=0.1)
        # of a process that sleeps on, the next call would get what the sleep returns
        assert process.call(abs, -3, limit=HANG) == 3
        begun = time.monotonic()
        with pytest.raises(TimeLimitError, match=r"took longer than 0\.1 s"):
            process.call(time.sleep, 2 * HANG, limit=0.1)
        assert time.monotonic() - begun < HANG
        assert process.call(os.getpid) != first
    finally:
        process.end()


def spin(seconds: float) -> str:
    """Work of a solver, which says first that it begins."""
    tell_caller("begun")
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sum(range(1000))
    return "done"


def test_a_call_tells_what_goes_on_and_is_interrupted_alone() -> None:
    process = WorkerProcess()
    try:
        heard: list[str] = []
        assert process.call(spin, 0.0, hear=heard.append) == "done"
        assert heard == ["begun"]
        process.interrupt()  # nothing runs: without effect on the next call
        assert process.call(spin, 0.0) == "done"
        first = process.call(os.getpid)
        with pytest.raises(StoppedError):
            process.call(spin, 60.0, hear=lambda text: process.interrupt())
        assert process.call(os.getpid) == first
        with pytest.raises(ProcessEndedError):
            process.call(spin, 60.0, hear=lambda text: process.end_call())
        assert process.call(os.getpid) != first
    finally:
        process.end()


def test_the_end_of_a_process_outlives_pickling() -> None:
    error = ProcessEndedError.of(-9)
    assert error.why == "signal 9"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_an_error_of_a_call_is_raised_here_with_its_place() -> None:
    process = WorkerProcess()
    try:
        with pytest.raises(ZeroDivisionError, match="of mine") as known:
            process.call(fail, "portable")
        assert "in fail" in "".join(known.value.__notes__)
        with pytest.raises(RuntimeError, match="UnportableError: 1 and 2"):
            process.call(fail, "unportable")
    finally:
        process.end()


def test_a_pool_ends_no_process_of_a_pool_in_another_thread() -> None:
    def work(seconds: float) -> int:
        with process_pool(2) as pool:
            return len(list(pool.in_order(time.sleep, [seconds] * 4)))

    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(work, [0.5, 0.0, 0.01])) == [4, 4, 4]


UNGUARDED = """
import sys
from cosim.processes import process_pool
with process_pool(2) as pool:
    print(*pool.in_order(abs, [-1, -2]), sys.modules["__main__"].process_pool.__name__)
"""


@pytest.mark.parametrize("how", ["file", "standard input", "-c"])
def test_a_script_needs_no_guard(tmp_path: Path, how: str) -> None:
    """Its processes do not run it again."""
    (tmp_path / "script.py").write_text(UNGUARDED)
    words = {"file": ["script.py"], "standard input": ["-"], "-c": ["-c", UNGUARDED]}[how]
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        input=UNGUARDED,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("1 2 process_pool\n", "")


WAITING = """
import os, time
from cosim.processes import process_pool
if __name__ == "__main__":
    with process_pool(2) as pool:
        print(*pool.in_order(eval, 2 * ["__import__('os').getpid()"]), flush=True)
        list(pool.in_order(time.sleep, [600, 600]))
"""


@pytest.fixture
def waiting(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A script whose processes are at work."""
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    yield process
    process.kill()
    process.communicate()


@posix
def test_ctrl_c_ends_all_at_once_and_the_processes_say_nothing(
    waiting: subprocess.Popen[str],
) -> None:
    assert waiting.stdout is not None
    assert waiting.stdout.readline()
    os.killpg(waiting.pid, signal.SIGINT)
    _, said = waiting.communicate(timeout=HANG)
    assert said.count("Traceback") == 1, said


@posix
@pytest.mark.parametrize("how", ["SIGTERM", "SIGKILL"])
def test_processes_end_with_the_one_that_began_them(
    waiting: subprocess.Popen[str], how: str
) -> None:
    """However it ends, and though they are at work."""
    assert waiting.stdout is not None
    children = [psutil.Process(int(pid)) for pid in waiting.stdout.readline().split()]
    assert len(children) == 2
    os.kill(waiting.pid, getattr(signal, how))
    assert not psutil.wait_procs(children, timeout=HANG)[1]


FAULTS = "tests.helpers.faults"


@pytest.fixture
def process() -> Iterator[ForeignProcess]:
    if os.name == "nt":
        pytest.skip("sends signals")
    process = ForeignProcess()
    yield process
    process.kill()


@pytest.mark.parametrize(
    ("function", "args", "reason"),
    [
        (f"{FAULTS}:abort", (), "its process ended by SIGABRT"),
        (f"{FAULTS}:leave", (0,), "its process ended with exit code 0"),
        (f"{FAULTS}:leave", (7,), "its process ended with exit code 7"),
        (f"{FAULTS}:say_and_leave", ("no licence",), "code 0, after it said 'no licence'"),
        (f"{FAULTS}:hang", (), r"it did not answer within 0\.5 s"),
        ("os:kill", (0, signal.SIGKILL), "its process ended by SIGKILL"),
        ("ctypes:string_at", (0,), "its process ended by SIGSEGV"),
    ],
)
def test_the_end_of_a_process_is_one_reason(process, function, args, reason):
    process.call("math:sqrt", 4.0, limit=60.0)
    with pytest.raises(ForeignError, match=reason):
        process.call(function, *args, limit=0.5 if function.endswith("hang") else 60.0)
    assert not process.is_alive
    with pytest.raises(ForeignError, match="its process ended"):
        process.call("math:sqrt", 4.0, limit=60.0)


def test_a_call_that_fails_leaves_the_process(process):
    for function, args, reason in (
        ("math:sqrt", (-1.0,), "math domain error"),
        ("sys:exit", ("enough",), "enough"),
        ("nowhere:at_all", (), "No module named"),
    ):
        with pytest.raises(ForeignError, match=reason):
            process.call(function, *args, limit=60.0)
    assert process.call("math:sqrt", 4.0, limit=60.0) == 2.0


def test_what_is_printed_is_no_answer(process, capfd):
    assert process.call("builtins:print", "x" * 200_000, limit=60.0) is None
    assert process.call("math:sqrt", 4.0, limit=60.0) == 2.0
    assert capfd.readouterr() == ("", "")


def test_a_call_that_was_interrupted_does_not_answer_the_next_one(process):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    process.call("math:sqrt", 4.0, limit=60.0)
    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(KeyboardInterrupt):
            process.call("time:sleep", 0.6, limit=60.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert process.call("math:sqrt", 4.0, limit=60.0) == 2.0


@posix
@pytest.mark.parametrize("function", ["time:sleep", "math:sqrt"])
def test_it_ends_with_its_parent_and_removes_what_that_left(tmp_path, function):
    """At work and idle, where the parent is killed."""
    room = tmp_path / "room"
    room.mkdir()
    script = (
        "from cosim.processes import ForeignProcess\n"
        "from pathlib import Path\n"
        "process = ForeignProcess()\n"
        "remove = 'cosim.processes:remove_at_orphaning'\n"
        f"process.call(remove, Path({str(room)!r}), limit=60)\n"
        "print(process.call('os:getpid', limit=60), flush=True)\n"
        f"process.call({function!r}, 600, limit=900)\n"
        "import time; time.sleep(600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, env=environment
    ) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    assert not psutil.wait_procs([child], timeout=HANG)[1]
    assert not room.exists()


Reading = tuple[float, float] | None


def own_time(monkeypatch, clock: list[float], readings: list[Reading]) -> float:
    """The own time (s) at the last of the clock's times, of a process of these readings."""
    moments = iter([(t, of) for t, of in zip(clock, readings, strict=True)])
    now: list[tuple[float, Reading]] = []

    def tick() -> float:
        now[:] = [next(moments)]
        return now[0][0]

    monkeypatch.setattr(processes, "time", SimpleNamespace(monotonic=tick))
    monkeypatch.setattr(processes, "processor_time", lambda _: now[0][1])
    spent = OwnTime(0)
    return [spent.seconds() for _ in clock[1:]][-1]


def test_own_time_is_what_a_process_computes_or_sleeps(monkeypatch):
    """Not the wait for a processor that others have."""
    alone = own_time(monkeypatch, [0, 1, 2], [(5, 1), (6, 1), (7, 1)])
    crowded = own_time(monkeypatch, [0, 50, 100], [(0, 0), (1, 49), (2, 98)])
    starved = own_time(monkeypatch, [0, 50, 100], [(0, 0), (0, 50), (0.01, 99.99)])
    asleep = own_time(monkeypatch, [0, 3, 10], [(2, 1), (2, 1), (2.001, 1)])
    unknown = own_time(monkeypatch, [0, 100], [None, None])
    many_threads = own_time(monkeypatch, [0, 1], [(0, 0), (8, 4)])
    found = [alone, crowded, starved, asleep, unknown, many_threads]
    assert found == pytest.approx([2, 2, 0, 10, 10, 1], abs=0.02)


def test_a_process_that_gets_no_processor_is_waited_for(process, monkeypatch):
    """A call that takes three times its limit, since it waits for its turn."""
    process.call("math:sqrt", 4.0, limit=60.0)
    begun = time.monotonic()
    monkeypatch.setattr(processes, "processor_time", lambda _: (0.0, time.monotonic() - begun))
    assert process.call("time:sleep", 0.9, limit=0.3) is None


@pytest.mark.parametrize("call", [("builtins:sum", (range(10**12),)), (f"{FAULTS}:hang", ())])
def test_what_computes_or_sleeps_without_end_is_ended(process, call):
    process.call("math:sqrt", 4.0, limit=60.0)
    with pytest.raises(ForeignError, match=r"did not answer within 0\.3 s"):
        process.call(call[0], *call[1], limit=0.3)
    assert not process.is_alive


def test_a_system_that_does_not_say_it_ends_what_hangs_too(process, monkeypatch):
    process.call("math:sqrt", 4.0, limit=60.0)
    monkeypatch.setattr(processes, "processor_time", lambda _: None)
    with pytest.raises(ForeignError, match=r"did not answer within 0\.03 s"):
        process.call(f"{FAULTS}:hang", limit=0.03)
