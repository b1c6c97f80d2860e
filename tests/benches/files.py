"""The ratios of benches in files, and those of several commits side by side."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import typer

import cosim
from cosim.commands.info import facts
from cosim.commands.terminal import print_table
from cosim.errors import InputError
from cosim.files import output_file
from cosim.version import __version__

Ratios = Mapping[str, float]
"""Ratios and counts of a bench, by name: no times, which belong to a machine."""
CPUINFO = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class BenchRecord:
    """The ratios of benches, by the bench's name, with where and when they were measured."""

    source: str
    """The commit, or the version where there is none."""
    date: str
    """ISO 8601, UTC."""
    machine: Mapping[str, str]
    ratios: Mapping[str, Ratios]


def time_stamp() -> str:
    """The time now, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def describe_machine() -> dict[str, str]:
    """Processor, cores, and the program's libraries and linear solver in use."""
    return {"processor": _processor(), "cores": str(os.cpu_count()), **dict(facts())}


def _processor() -> str:
    if CPUINFO.exists():
        for line in CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def source_version() -> str:
    """The commit of the working tree, "-dirty" where it has changes, or the program's version."""
    root = Path(cosim.__file__).parents[1]
    if not (root / ".git").exists():
        return __version__
    call = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(call, capture_output=True, encoding="utf-8", check=True)
    except (OSError, subprocess.CalledProcessError):
        return __version__
    return done.stdout.strip()


def write_record(path: Path, record: BenchRecord) -> None:
    """Write a record as JSON.  Raises InputError where the file cannot be written."""
    with output_file(path) as part:
        part.write_text(json.dumps(asdict(record), indent=2) + "\n", encoding="utf-8")


def read_record(path: Path) -> BenchRecord:
    """The record of `write_record`.  Raises InputError for any other file."""
    try:
        record = BenchRecord(**json.loads(path.read_text(encoding="utf-8")))
        [float(value) for ratios in record.ratios.values() for value in ratios.values()]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is no file that --json of the benches wrote") from error
    return record


def print_side_by_side(records: Sequence[BenchRecord]) -> None:
    """Print the ratios of records side by side, and the last one's over the first one's."""
    names = dict.fromkeys(
        (bench, name) for r in records for bench, ratios in r.ratios.items() for name in ratios
    )
    rows = []
    for bench, name in names:
        values = [r.ratios.get(bench, {}).get(name) for r in records]
        first, last = values[0], values[-1]
        change = f"{last / first:.2f}" if first and last is not None else "-"
        shown = ("-" if value is None else f"{value:.4g}" for value in values)
        rows.append((f"{bench}: {name}", *shown, change))
    for r in records:
        typer.echo(f"{r.source}: {r.date}, {r.machine['processor']}, {r.machine['linear solver']}")
    print_table("", ("ratio", *(r.source for r in records), "last / first"), rows)
