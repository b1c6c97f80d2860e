"""What a user sees of a command that takes long: stages, n of m, time left."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.commands import terminal
from cosim.commands.terminal import Stages


def stderr_of(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == code, done.output
    return done.stderr


def test_counted_stages_say_n_of_m_and_the_time_left(monkeypatch):
    clock = iter([0.0, 0.0, 20.0, 130.0])
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: next(clock))
    lines: list[str] = []
    told = Stages("case", 3, lines.append)
    told.begin("one")
    told.begin("two")
    told.end("three")
    assert lines == ["case: 1/3 one", "case: 2/3 two, about 40 s left", "case: 3/3 three"]


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        (("run", "pulley_edc", "--no-pictures"), ["building the models", "writing the results"]),
        (("moment-arms", "split_edc", "--steps", "2"), ["building the models"]),
        (("ladder", "split_edc", "--set", "hood.zzz=1"), []),
        (("estimate", "split_edc", "--force", "-1 N free -2 N"), ["building the models"]),
        (
            ("export", "isometric_edc", "--set", "hood.mesh.quads=150", "-o", "hood.inp"),
            ["laying out the hood"],
        ),
    ],
    ids=lambda value: value[0] if value else "",
)
def test_a_command_tells_its_stages_in_plain_lines(words, lines, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = stderr_of(*words, code=0 if lines else 2)
    for line in lines:
        assert line in told
    assert "\x1b" not in told


def test_the_moment_arms_of_a_hood_are_counted_by_posture(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = stderr_of("moment-arms", "pulley_edc", "--steps", "3")
    assert re.search(r"PIP \d+ deg, 3/3", told)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminal here")
def test_on_a_terminal_the_stages_stand_in_a_line_that_moves():
    program = (
        "import time\nfrom cosim.commands.terminal import stages\n"
        "with stages('case', 2) as told:\n    told.begin('one')\n    time.sleep(0.4)\n"
        "    told.begin('two')\n    time.sleep(0.4)\n"
    )
    leader, follower = os.openpty()
    with subprocess.Popen([sys.executable, "-c", program], stderr=follower) as child:
        os.close(follower)
        seen = b""
        while True:
            try:
                seen += os.read(leader, 4096)
            except OSError:  # the other end is closed
                break
            if child.poll() is not None and b"2/2" in seen:
                break
    os.close(leader)
    text = seen.decode("utf-8", errors="replace")
    assert "case: 1/2 one" in text
    assert "case: 2/2 two, about" in text
    assert "\x1b[2K" in text  # the line is written anew


@pytest.mark.parametrize(
    "words",
    [
        (".fmu", "export", "pulley_edc", "--out"),
        (".feb", "export", "isometric_edc", "--out"),
        (".json", "export", "isometric_edc", "--out"),
        ("ladder", "split_edc", "--out"),
        ("moment-arms", "split_edc", "--out"),
        ("estimate", "split_edc", "--force", "-1 N free -2 N", "--out"),
        ("validate", "--only", "lengths", "--out"),
        ("reproduce", "networks", "--out"),
        ("run", "split_edc", "--out"),
    ],
    ids=lambda words: words[0],
)
def test_a_place_that_cannot_be_written_is_told_before_the_work(words, tmp_path):
    """A file stands where a folder would have to be made."""
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    ending, *words = words if words[0].startswith(".") else ("", *words)
    told = stderr_of(*words, str(tmp_path / "file" / f"inner{ending}"), code=2)
    assert "cannot be written" in told or "Not a directory" in told
    assert told.count("\n") == 1  # and nothing else


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no such folder here")
def test_a_place_that_not_even_root_can_write_to_is_told_before_the_work():
    told = stderr_of("ladder", "split_edc", "--out", "/proc/ladder", code=2)
    assert "cannot be written" in told
    assert told.count("\n") == 1
