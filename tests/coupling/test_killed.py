"""A motion that is killed at any moment goes on to the same bytes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray

from cosim.case.file import load_case
from cosim.pipeline import run_case
from tests.helpers.folders import ROOT
from tests.helpers.hang import HANG
from tests.helpers.motions import RAMP

SHORT = RAMP.replace('duration = "0.3 s"', 'duration = "0.1 s"')
LONG = RAMP.replace("checkpoint = 7\n", "").replace('duration = "0.3 s"', 'duration = "30 s"')


def cosim(folder: Path, *words: str, stage: str = "") -> subprocess.Popen[bytes]:
    """The program at work, from when it has told of a stage that begins so."""
    command = [sys.executable, "-m", "cosim", *words, *([] if stage else ["--quiet"])]
    path = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, cwd=folder, env=path, stderr=subprocess.PIPE)
    assert process.stderr is not None
    while stage and stage not in process.stderr.readline().decode():
        assert process.poll() is None
    return process


def wait_for(process: subprocess.Popen[bytes]) -> None:
    told = process.communicate(timeout=2 * HANG)[1].decode()
    assert process.returncode == 3, told  # without damping of its own the finger strikes its limits


def check_same_bytes(whole: Path, cut: Path) -> None:
    one, other = (
        xarray.load_dataset(run / "ramp" / "results.nc", engine="h5netcdf") for run in (whole, cut)
    )
    for name in (*one.data_vars, "time"):
        assert one[name].values.tobytes() == other[name].values.tobytes(), name


def test_killed_in_its_motion_and_resumed_it_ends_in_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "ramp.toml").write_text(SHORT)
    process = cosim(tmp_path, "run", "ramp.toml", "--out", "cut", stage=": t = ")
    process.kill()
    process.communicate()
    assert (tmp_path / "cut" / "ramp.unfinished" / "checkpoint.npz").exists()
    wait_for(cosim(tmp_path, "run", "--resume", "cut/ramp"))
    run_case(load_case(tmp_path / "ramp.toml")).save(tmp_path / "whole")
    check_same_bytes(tmp_path / "whole", tmp_path / "cut")


@pytest.mark.slow
def test_killed_at_any_moment_and_resumed_it_ends_in_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "ramp.toml").write_text(RAMP)
    begun = time.perf_counter()
    wait_for(cosim(tmp_path, "run", "ramp.toml", "--out", "whole"))
    took = time.perf_counter() - begun
    rng, unfinished = random.Random(4), tmp_path / "cut" / "ramp.unfinished"
    words = ["run", "ramp.toml", "--out", "cut"]
    for _ in range(50):
        process = cosim(tmp_path, *words)
        time.sleep(rng.uniform(0.3, 1.0) * took)
        process.kill()
        process.communicate()
        if not (unfinished / "checkpoint.npz").exists():
            words = ["run", "ramp.toml", "--out", "cut"]  # killed before the first, or done
        else:
            words = ["run", "--resume", "cut/ramp"]
    if unfinished.exists() or not (tmp_path / "cut" / "ramp").exists():
        wait_for(cosim(tmp_path, *words))
    check_same_bytes(tmp_path / "whole", tmp_path / "cut")


@pytest.mark.skipif(os.name == "nt", reason="sends signals to another process")
@pytest.mark.usefixtures("hears_hangups")
@pytest.mark.parametrize(
    ("how", "code"),
    [
        ("SIGINT", 130),
        pytest.param("SIGTERM", 143, marks=pytest.mark.slow),
        pytest.param("SIGHUP", 129, marks=pytest.mark.slow),
    ],
)
def test_a_signal_keeps_a_motion_that_asked_for_nothing(
    how: str, code: int, tmp_path: Path
) -> None:
    (tmp_path / "ramp.toml").write_text(LONG)
    process = cosim(tmp_path, "run", "ramp.toml", stage=": t = ")
    for _ in range(1 if how == "SIGINT" else 2):  # shell and kernel both send SIGHUP
        process.send_signal(getattr(signal, how))
    said = process.communicate(timeout=2 * HANG)[1].decode()
    assert process.returncode == code, said
    assert "Traceback" not in said
    assert "s of 30 s; all up to there is kept. Go on with: cosim run --resume" in said
    assert (tmp_path / "runs" / "ramp.unfinished" / "checkpoint.npz").is_file()
