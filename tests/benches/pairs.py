"""Two versions of the program, measured in turn on one machine."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from statistics import median

import cosim
from cosim.errors import InputError, Progress
from tests.benches.files import BenchRecord, read_record

ROOT = Path(cosim.__file__).parents[1]
PAIR, CPU = "pair", "CPU time of the command / the other version's"
"""The bench and the name of the ratio that only a pair has."""


@contextmanager
def source_folder(name: str) -> Iterator[Path]:
    """The folder of a version: one that holds the sources, or a commit of this checkout, whose
    files are there until the end.  Raises InputError."""
    if (Path(name) / "cosim" / "cli.py").is_file():
        yield Path(name).resolve()
        return
    call = ["git", "-C", str(ROOT), "archive", "--format=tar", name, "--"]
    try:
        done = subprocess.run(call, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError(
            f"--against {name}: is no file that --json wrote, no folder of sources, and no commit "
            f"of {ROOT}"
        ) from error
    with (
        tempfile.TemporaryDirectory() as folder,
        tarfile.TarFile(fileobj=BytesIO(done.stdout)) as tar,
    ):
        tar.extractall(folder, filter="data")
        yield Path(folder)


def measure_pair(
    words: Sequence[str], other: Path, name: str, repeats: int, progress: Progress
) -> tuple[BenchRecord, BenchRecord]:
    """Records of the other version and of this one by `python -m tests.benches WORDS`, each
    `repeats` times and in turn, so that what else the machine does falls on both.

    A ratio is the median of the repeats, the CPU time the least, since the first run of a version
    compiles.  Raises InputError where a command fails."""
    runs: tuple[list[BenchRecord], list[BenchRecord]] = ([], [])
    seconds: tuple[list[float], list[float]] = ([], [])
    for k in range(repeats):
        for i, (root, shown) in enumerate(((other, name), (ROOT, "this version"))):
            progress(f"{shown}, {k + 1} of {repeats}")
            record, cpu = _measure(words, root, shown)
            runs[i].append(record)
            seconds[i].append(cpu)
    least = [min(s) for s in seconds]
    theirs, ours = (_median(records) for records in runs)
    theirs = replace(theirs, source=name, ratios={**theirs.ratios, PAIR: {CPU: 1.0}})
    return theirs, replace(ours, ratios={**ours.ratios, PAIR: {CPU: least[1] / least[0]}})


def _measure(words: Sequence[str], root: Path, name: str) -> tuple[BenchRecord, float]:
    """The record of a version's bench in a process of its own, and the process's CPU time (s)."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bench.json"
        call = [sys.executable, "-P", "-m", "tests.benches", *words, "--json", str(file)]
        before = os.times()
        done = subprocess.run(
            call,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(root)},
            capture_output=True,
            encoding="utf-8",
            errors="replace",
        )
        after = os.times()
        if done.returncode:
            said = done.stderr.strip().splitlines() or ["it said nothing"]
            raise InputError(f"{name}: python -m tests.benches {' '.join(words)}: {said[-1]}")
        user, system = (
            after.children_user - before.children_user,
            after.children_system - before.children_system,
        )
        return read_record(file), user + system


def _median(records: Sequence[BenchRecord]) -> BenchRecord:
    """The last of the records with the median of each ratio that all of them have."""
    last = records[-1]
    return replace(
        last,
        ratios={
            bench: {
                name: median(r.ratios[bench][name] for r in records)
                for name in ratios
                if all(name in r.ratios.get(bench, {}) for r in records)
            }
            for bench, ratios in last.ratios.items()
        },
    )
