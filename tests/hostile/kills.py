"""Kill commands at random moments, and let them end: the same bytes, no process left, nothing half
written.

    python -m tests.hostile.kills 300        # so many kills and signals, and what failed

Each job is interrupted again and again in one folder, by KILL, TERM, INT or HUP, to the program
alone or to all of its processes; then it is done to its end, and compared with one that was left
alone.  Linux only: it finds processes by what stands in their environment.
"""

from __future__ import annotations

import csv
import hashlib
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from cosim.processes import OwnTime
from tests.helpers.folders import ROOT
from tests.helpers.motions import RAMP

SEED, MARK = 63, "COSIM_TESTS_MARK"
SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
CODES = {"SIGKILL": -9, "SIGTERM": 143, "SIGINT": 130, "SIGHUP": 129}
ORPHANS, END = 3.0, 20.0
"""Seconds of their own time in which processes end after their parent, and that at a signal."""
LOADED = 0.6
"""Seconds in which Python itself begins, whose end by a signal is its own."""
SAME = ("results.nc", "ledger.csv", "table.csv", "table.parquet", "ladder.csv")
"""Files that must be the same to the last byte, but for times that a clock took."""
TIMES = "wall s"
PASSING = (".part", ".old", ".probe")
GRID = """
case = "network_edc"
settings = ["finger.tip.kind=posture"]
[parameters."tendons.EDC.tension"]
from = "3 N"
to = "4 N"
count = 30
[outputs]
torque = "joint_torque_Nmm.hood.PIP"
"""
BATCH = "run network_edc split_edc pulley_edc ramp.toml --no-pictures --out out"
JOBS = {
    "run": "run split_edc pulley_edc split_fdp --no-pictures --out out",
    "motion": "run ramp.toml --out out",
    "batch": f"{BATCH} --workers 2",
    "study": "study grid.toml --workers 2 --out out",
    "validation": "validate --only 'qiu split FDP' --workers 2 --out out",
    "lesion": "lesion lesion_mallet --set hood.mesh.quads=200 --workers 2 --out out",
    "ladder": "ladder pulley_edc --workers 2 --out out",
}


class Kill(NamedTuple):
    """One interruption: of which job, how, and what was wrong after it."""

    job: str
    how: str
    was_running: bool
    faults: tuple[str, ...]


@dataclass
class Job:
    """A command in a folder of its own."""

    name: str
    folder: Path
    mark: str = field(default_factory=lambda: uuid4().hex)

    def start(self) -> subprocess.Popen[bytes]:
        """The command, or what goes on with the motion that was cut off."""
        words = shlex.split(JOBS[self.name])
        if self.name == "motion" and (self.folder / "out/ramp.unfinished/checkpoint.npz").exists():
            words = ["run", "--resume", "out/ramp"]
        elif self.name == "batch":
            words.append("--restart")
        room = self.folder / "tmp"
        room.mkdir(exist_ok=True)
        marked = {"PYTHONPATH": str(ROOT), MARK: self.mark, "TMPDIR": str(room)}
        with (self.folder / "said").open("wb") as said:
            return subprocess.Popen(
                [sys.executable, "-m", "cosim", *words],
                cwd=self.folder,
                env={**os.environ, **marked},
                stdout=said,
                stderr=said,
                start_new_session=True,
            )

    def finish(self) -> float:
        """Do it to its end; the seconds.  Raises AssertionError where it fails."""
        begun = time.monotonic()
        code = self.start().wait(600)
        assert code in (0, 3), f"{self.name} ends with {code}: {self.said()}"
        return time.monotonic() - begun

    def said(self) -> str:
        return (self.folder / "said").read_text(errors="replace")[-2000:]

    def processes(self) -> list[int]:
        """The numbers of all that live of it."""
        return list(_marked(f"{MARK}={self.mark}".encode()))

    def half_written(self) -> list[str]:
        out = (self.folder / "out").rglob("*")
        return [str(path.relative_to(self.folder)) for path in out if path.suffix in PASSING]

    def results(self) -> dict[str, str]:
        """The digests of its files by their paths."""
        files = [path for path in sorted((self.folder / "out").rglob("*")) if path.name in SAME]
        return {
            str(path.relative_to(self.folder)): _digest(path)
            for path in files
            if ".unfinished" not in str(path)
        }


def _digest(path: Path) -> str:
    """The sha256 of a file; of a table without its column of times."""
    content = path.read_bytes()
    if path.name == "ladder.csv":
        rows = list(csv.DictReader(content.decode().splitlines()))
        content = repr([{k: v for k, v in row.items() if k != TIMES} for row in rows]).encode()
    return hashlib.sha256(content).hexdigest()


def _is_before(said: str) -> bool:
    """Whether Python had not come to the program's first line."""
    return "cosim/cli.py" not in said and ("frozen" in said or not said)


def _marked(mark: bytes) -> Iterator[int]:
    for path in Path("/proc").iterdir():
        with suppress(OSError, ValueError):
            number = int(path.name)
            alive = (path / "stat").read_text().rpartition(") ")[2][0] != "Z"
            if alive and mark in (path / "environ").read_bytes():
                yield number


def interrupt(job: Job, seconds: float, name: str, whole_group: bool) -> Kill:
    """Let a job begin, send it a signal after so many seconds, and look at what stays."""
    before = job.half_written()
    process, number, faults = job.start(), getattr(signal, name), []
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    was_running = process.poll() is None
    if was_running:
        (os.killpg if whole_group else os.kill)(process.pid, number)
    spent = OwnTime(process.pid)
    while (code := process.poll()) is None and spent.seconds() < END:
        time.sleep(0.05)
    allowed = [0, 3] + [CODES[name]] * was_running
    is_early = seconds < LOADED and _is_before(job.said())
    if is_early:
        allowed += [-number, 1]
    if code not in allowed:
        faults.append(f"exit code {code}: {job.said()}")
    left_behind = {number: OwnTime(number) for number in job.processes()}
    while any(left_behind[n].seconds() < ORPHANS for n in job.processes() if n in left_behind):
        time.sleep(0.05)
    for left in job.processes():
        faults.append(f"a process is left: {Path(f'/proc/{left}/cmdline').read_bytes()!r}")
        with suppress(OSError):
            os.kill(left, signal.SIGKILL)
    words = ("Traceback", "Exception ignored")
    if not is_early and any(word in job.said() for word in words):
        faults.append(f"a traceback: {job.said()}")
    if name != "SIGKILL" and (half := set(job.half_written()).difference(before)):
        faults.append(f"half written: {half}")
    how = f"{name} to {'all' if whole_group else 'one'} after {seconds:.2f} s"
    return Kill(job.name, how, was_running, tuple(faults))


def kill_jobs(folder: Path, count: int, names: list[str], seed: int = SEED) -> list[Kill]:
    """So many interruptions, the same number for each job."""
    rng, kills = random.Random(seed), list[Kill]()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell has it so in the background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup has it ignored, by what it starts too
    for i, name in enumerate(names):
        share = count // len(names) + (i < count % len(names))
        whole, cut = (Job(name, folder / f"{name}-{kind}") for kind in ("whole", "cut"))
        for job in (whole, cut):
            job.folder.mkdir(parents=True)
            (job.folder / "ramp.toml").write_text(RAMP)
            (job.folder / "grid.toml").write_text(GRID)
        whole.finish()
        span = whole.finish() if name in ("run", "lesion", "ladder", "validation") else 6.0
        for _ in range(share):
            moment = rng.choice((rng.uniform(0.0, LOADED), rng.uniform(0.0, span)))
            one = interrupt(cut, moment, rng.choice(SIGNALS), rng.random() < 0.3)
            kills.append(one)
            for fault in one.faults:
                print(f"{one.job}: {one.how}: {fault}", flush=True)
        kills.append(_end(cut, whole))
        done = [kill for kill in kills if kill.job == name]
        print(
            f"{name}: {len(done) - 1} signals, {sum(kill.was_running for kill in done)} before its "
            f"end, {sum(bool(kill.faults) for kill in done)} failed",
            flush=True,
        )
    return kills


def _end(cut: Job, whole: Job) -> Kill:
    """Do the job that was cut off to its end, and compare it with the one that was not."""
    cut.finish()
    one, other = cut.results(), whole.results()
    faults = [f"other bytes: {k}" for k in one.keys() | other.keys() if one.get(k) != other.get(k)]
    if not one:
        faults.append("no results to compare")
    if half := cut.half_written():
        faults.append(f"half written: {half}")
    for fault in faults:
        print(f"{cut.name}: {fault}", flush=True)
    return Kill(cut.name, "its end", False, tuple(faults))


def main() -> None:
    """Say how many failed; exit code 1 where one did."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2 * len(JOBS)
    names = sys.argv[2].split(",") if len(sys.argv) > 2 else list(JOBS)
    with tempfile.TemporaryDirectory() as folder:
        kills = kill_jobs(Path(folder), count, names)
    failed = [kill for kill in kills if kill.faults]
    hows = Counter(kill.how.split()[0] for kill in kills if kill.was_running)
    print(f"{count} signals: {dict(hows)} before the end; {len(failed)} failed")
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()
