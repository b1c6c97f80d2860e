"""A process of its own: whatever its functions do is one reason, and it ends with its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from cosim import foreign_process
from cosim.foreign_process import ForeignError, ForeignProcess, OwnTime
from tests.helpers.folders import ROOT
from tests.helpers.hang import HANG

FAULTS = "tests.helpers.faults"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ends processes by signals")


@pytest.fixture
def process() -> Iterator[ForeignProcess]:
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


@pytest.mark.parametrize("function", ["time:sleep", "math:sqrt"])
def test_it_ends_with_its_parent_and_removes_what_that_left(tmp_path, function):
    """At work and idle, where the parent is killed."""
    room = tmp_path / "room"
    room.mkdir()
    script = (
        "from cosim.foreign_process import ForeignProcess\n"
        "from pathlib import Path\n"
        "process = ForeignProcess()\n"
        "remove = 'cosim.foreign_process:remove_at_orphaning'\n"
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
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.kill()
    end = time.monotonic() + HANG
    while _is_there(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _is_there(child)
    assert not room.exists()


def _is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


Reading = tuple[float, float] | None


def own_time(monkeypatch, clock: list[float], readings: list[Reading]) -> float:
    """The own time (s) at the last of the clock's times, of a process of these readings."""
    moments = iter([(t, of) for t, of in zip(clock, readings, strict=True)])
    now: list[tuple[float, Reading]] = []

    def tick() -> float:
        now[:] = [next(moments)]
        return now[0][0]

    monkeypatch.setattr(foreign_process, "time", SimpleNamespace(monotonic=tick))
    monkeypatch.setattr(foreign_process, "processor_time", lambda _: now[0][1])
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
    monkeypatch.setattr(
        foreign_process, "processor_time", lambda _: (0.0, time.monotonic() - begun)
    )
    assert process.call("time:sleep", 0.9, limit=0.3) is None


@pytest.mark.parametrize("call", [("builtins:sum", (range(10**12),)), (f"{FAULTS}:hang", ())])
def test_what_computes_or_sleeps_without_end_is_ended(process, call):
    process.call("math:sqrt", 4.0, limit=60.0)
    with pytest.raises(ForeignError, match=r"did not answer within 0\.3 s"):
        process.call(call[0], *call[1], limit=0.3)
    assert not process.is_alive


def test_a_system_that_does_not_say_it_ends_what_hangs_too(process, monkeypatch):
    process.call("math:sqrt", 4.0, limit=60.0)
    monkeypatch.setattr(foreign_process, "processor_time", lambda _: None)
    with pytest.raises(ForeignError, match=r"did not answer within 0\.03 s"):
        process.call(f"{FAULTS}:hang", limit=0.03)
