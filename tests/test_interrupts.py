"""Signals that ask the program to end: one line, an exit code, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from tests.helpers.folders import ROOT

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="sends signals"),
    pytest.mark.usefixtures("hears_hangups"),
]
LOADING = """
import os, signal
from cosim.interrupts import exit_on_request
exit_on_request()
os.kill(os.getpid(), signal.{name})
print("went on")
"""
WORKING = """
import os, signal, sys, time
from cosim.interrupts import exit_code, ignore_requests, interrupt_on_request
interrupt_on_request()
try:
    {work}
    time.sleep(20)
except KeyboardInterrupt:
    ignore_requests()
    os.kill(os.getpid(), signal.SIGTERM)
    sys.exit(exit_code(130))
print("went on")
"""
IN_VAIN = """
    class Lost:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.1)
    Lost()
"""
"""Python drops the errors of such a function."""


def run(script: str, **options: object) -> tuple[int, str, str]:
    path = {**os.environ, "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, env=path, capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_request_ends_the_program(name: str, code: int) -> None:
    """While it loads, and while it works."""
    assert run(LOADING.format(name=name)) == (code, "", "cosim: stopped before it began\n")
    send = f"os.kill(os.getpid(), signal.{name})"
    assert run(WORKING.format(work=send)) == (code, "", "")


def test_a_request_that_nobody_may_hear_is_ignored() -> None:
    """As nohup has it."""
    ignore = signal.SIGHUP, signal.SIG_IGN
    found = run(LOADING.format(name="SIGHUP"), preexec_fn=lambda: signal.signal(*ignore))
    assert found == (0, "went on\n", "")


def test_a_request_where_python_drops_errors_is_made_again() -> None:
    assert run(WORKING.format(work=IN_VAIN.strip())) == (143, "", "")


def test_the_program_hears_from_its_first_line() -> None:
    """Before it loads its libraries."""
    script = """
import sys
class Ask:
    def find_spec(self, name, *_):
        if name == "cosim.cli":
            import os, signal
            os.kill(os.getpid(), signal.SIGTERM)
sys.meta_path.insert(0, Ask())
import cosim.__main__
"""
    assert run(script) == (143, "", "cosim: stopped before it began\n")


LATE = """
import os, signal
class Last:
    def __init__(self):
        self.kill, self.number, self.pid = os.kill, signal.SIGTERM, os.getpid()
    def __del__(self):
        self.kill(self.pid, self.number)
from cosim.interrupts import interrupt_on_request
interrupt_on_request()
os.last = Last()
print("done")
"""
"""The last is forgotten after Python has taken back what signals do."""


def test_a_request_to_a_program_that_has_done_its_work_is_too_late() -> None:
    assert run(LATE) == (0, "done\n", "")


CONVERTED = """
import sys, types, cosim.commands
module = types.ModuleType("cosim.commands.version_of")
def stop():
    import os, signal
    try:
        exec("os.kill(os.getpid(), signal.SIGTERM)", {"os": os, "signal": signal})
    except KeyboardInterrupt as error:
        raise RuntimeError("of a library") from error
module.stop = stop
sys.modules["cosim.commands.version_of"] = module
from cosim import cli
cli.COMMANDS["Run cases"]["stop"] = cli.Command("version_of.stop", "", "")
sys.argv = ["cosim", "stop"]
cli.main()
"""
"""Code that is made as a text has Python end by SIGINT."""


def test_an_error_that_a_library_makes_of_a_request_is_none() -> None:
    assert run(CONVERTED) == (143, "", "")


@pytest.mark.parametrize("place", ["prepare_process", "app"])
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_request_before_the_command_begins_is_no_traceback(
    name: str, code: int, place: str
) -> None:
    script = f"""
import os, signal
import cosim.cli as cli
cli.{place} = lambda **_: os.kill(os.getpid(), signal.{name})
cli.main()
print("went on")
"""
    ended, out, told = run(script)
    assert (ended, out) == (code, "")
    assert "Traceback" not in told
