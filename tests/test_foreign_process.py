"""A process of its own: whatever its functions do is one reason, and it ends with its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from cosim.foreign_process import ForeignError, ForeignProcess
from tests.helpers.folders import ROOT

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
    end = time.monotonic() + 20.0
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
