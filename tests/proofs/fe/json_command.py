"""Work in a process of its own: with its own number of threads, and free to crash."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from cosim.errors import CosimError
from fe_solver.elements import kernels

LIBRARIES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Variables that say how many threads the libraries under this solver take."""
NT_ERROR = 0xC0000000
"""Exit codes from here on are those of Windows for a process that crashed."""


def python(*words: str) -> list[str]:
    """A command of this interpreter."""
    return [sys.executable, *words]


def threads(own: int, libraries: int) -> dict[str, str]:
    """Variables for so many threads of this solver, and of the libraries under it."""
    return {kernels.THREADS: str(own)} | dict.fromkeys(LIBRARIES, str(libraries))


def run_json_command(call: Sequence[str], settings: Mapping[str, str]) -> Any:
    """What a command run with these variables set prints as JSON, on the last of its lines that
    begin with a brace.

    Raises CosimError with the reason where it fails or crashes."""
    path = {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        call,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        env={**os.environ, **path, **settings},
    )
    if done.returncode < 0:
        raise CosimError(f"crashed: {signal.Signals(-done.returncode).name}")
    if done.returncode >= NT_ERROR:
        raise CosimError(f"crashed: {done.returncode:#x}")
    answers = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or not answers:
        raise CosimError(f"failed: {_reason(done.stderr)}")
    return json.loads(answers[-1])


def _reason(complaint: str) -> str:
    """The two lines from where an error is first named; before them is Python's trace, after them
    may be a library's own."""
    lines = [line.strip() for line in complaint.splitlines() if line.strip()]
    first = next((i for i, line in enumerate(lines) if "Error" in line), max(len(lines) - 1, 0))
    return " ".join(lines[first : first + 2]) or "no reason given"


def peak_mb() -> float:
    """Largest memory of this process so far, MB (1e6 bytes)."""
    if sys.platform == "win32":
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 1e6
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
