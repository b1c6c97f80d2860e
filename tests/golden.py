"""Guard that a change of the structure changes no result.

    python -m tests.golden --against REV     every shipped case in REV's tree and in this one
    python -m tests.golden --write           keep the summaries' numbers in golden.json
    python -m tests.golden --check           compare this tree with golden.json

A case is run by its tree's command line, in a process of its own, with the settings that
golden.toml gives it (a coarse mesh, a short motion).  summary.json, results.nc and ledger.csv
become labelled arrays, and arrays of the same path are compared.  Exit codes: 0 nothing differs,
1 something does, 2 the revision or the arguments are at fault.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np

from tests.golden_arrays import (
    Comparison,
    Config,
    Leaf,
    Leaves,
    Verdict,
    compare,
    flatten,
    is_number,
    read_config,
    read_run,
    read_summary,
)
from tests.helpers.folders import ROOT

TREE = ROOT
CONFIG = Path(__file__).with_suffix(".toml")
GOLDEN = Path(__file__).with_suffix(".json")
DIGITS = 8  # significant, of a number in golden.json
AGAINST_TOLERANCE = 1e-9
CHECK_TOLERANCE = 1e-7
MOST_LINES = 12  # about one case
NO_CASES = {"base", "studies", "repairs", "data"}  # folders of cases/
CHILD = """
import sys
from pathlib import Path
import cosim
tree = Path(sys.argv.pop(1))
assert Path(cosim.__file__).resolve().is_relative_to(tree), f"imported {cosim.__file__}"
from cosim.cli import main
main()
"""
THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA")
ONE_THREAD = dict.fromkeys([*(f"{name}_NUM_THREADS" for name in THREADS), "FE_SOLVER_THREADS"], "1")


@dataclass(frozen=True)
class Outcome:
    """A case's arrays, or why it has none."""

    leaves: Leaves | None
    message: str = ""
    summary: Mapping[str, Any] = field(default_factory=dict)


def compare_outcomes(old: Outcome, new: Outcome, tolerance: float, config: Config) -> Comparison:
    """Compare two runs of a case; the same failure is the same."""
    if old.leaves is not None and new.leaves is not None:
        return compare(old.leaves, new.leaves, tolerance, config)
    if old.leaves is None and new.leaves is None and old.message == new.message:
        return Comparison("fails in both", [new.message])
    before, now = ("ran" if o.leaves is not None else f"failed: {o.message}" for o in (old, new))
    return Comparison("different", [f"before: {before}", f"now: {now}"])


class ChildProcesses:
    """Child processes, which can be ended from another thread."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock, self._stopped = Lock(), False

    def run(self, command: Sequence[str], folder: Path, env: Mapping[str, str]) -> tuple[int, str]:
        """The exit code, and what was written to stderr."""
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            child = subprocess.Popen(
                command,
                cwd=folder,
                env=env,
                text=True,
                errors="replace",
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            self._running.add(child)
        try:
            _, stderr = child.communicate()
            return child.returncode, stderr
        finally:
            with self._lock:
                self._running.discard(child)

    def stop(self) -> None:
        """End those that run, and start no other."""
        with self._lock:
            self._stopped = True
            for child in self._running:
                child.terminate()


def run_case(tree: Path, case: str, settings: Sequence[str], children: ChildProcesses) -> Outcome:
    """Run a case by a tree's command line, in a process and a folder of its own.

    Raises RuntimeError where the process was ended from outside.
    """
    options = [part for setting in settings for part in ("--set", setting)]
    path = {"PYTHONPATH": str(tree), "COLUMNS": "100000"}  # messages in one line
    with TemporaryDirectory(prefix="golden_") as scratch:
        folder = Path(scratch)
        command = [sys.executable, "-c", CHILD, str(tree), "run", case, "--quiet", "--out", "runs"]
        env = {**os.environ, **ONE_THREAD, **path}
        code, stderr = children.run([*command, *options], folder, env)
        if code < 0:
            raise RuntimeError(f"{case} was ended by signal {-code}")
        run = folder / "runs" / case
        if (run / "summary.json").exists():
            leaves = read_run(run) | {"exit code": Leaf(np.array(code), "exit code")}
            return Outcome(leaves, summary=read_summary(run))
        return Outcome(None, _message(code, stderr, {str(tree): "TREE", scratch: "FOLDER"}))


def _message(code: int, stderr: str, places: Mapping[str, str]) -> str:
    """Why a run failed, the same for every tree and folder; of a crash its last line."""
    if "Traceback (most recent call last)" in stderr:
        stderr = stderr.strip().splitlines()[-1]
    for place, word in places.items():
        stderr = stderr.replace(place, word)
    return f"exit code {code}: {' '.join(stderr.split())}"


def shipped_cases(tree: Path) -> list[str]:
    """The names of a tree's cases."""
    cases = tree / "cases"
    files = (path.relative_to(cases) for path in cases.rglob("*.toml"))
    return sorted(file.stem for file in files if NO_CASES.isdisjoint(file.parts))


def select(names: Sequence[str], only: Sequence[str]) -> list[str]:
    """The names that fit one of the patterns, all of them where there is none."""
    return [name for name in names if not only or any(fnmatchcase(name, p) for p in only)]


def _git(*arguments: str | Path) -> None:
    subprocess.run(["git", "-C", TREE, *arguments], check=True, capture_output=True, text=True)


@contextmanager
def worktree(revision: str) -> Iterator[Path]:
    """A worktree of the revision in a temporary folder, there for as long as the context."""
    with TemporaryDirectory(prefix="golden_", ignore_cleanup_errors=True) as scratch:
        tree = Path(scratch).resolve() / "tree"
        try:
            _git("worktree", "add", "--detach", tree, revision)
            yield tree
        finally:
            if tree.exists():
                _git("worktree", "remove", "--force", tree)


def _run_parallel(
    names: Sequence[str], task: Callable[[str, ChildProcesses], Any], workers: int
) -> Generator[tuple[str, Any], None, None]:
    """What the task returns for each name, as they end; Ctrl-C ends the children."""
    children = ChildProcesses()
    with ThreadPoolExecutor(workers) as pool:
        futures: dict[Future[Any], str] = {pool.submit(task, n, children): n for n in names}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            children.stop()


def compare_trees(
    revision: str, tolerance: float, only: Sequence[str], workers: int, config: Config
) -> int:
    """Compare this tree with another revision's; the exit code."""
    with worktree(revision) as tree:
        names = {config.new_name("cases", name): name for name in shipped_cases(tree)}

        def task(case: str, children: ChildProcesses) -> Comparison:
            settings = config.settings_of(case)
            before = [config.old_setting(setting) for setting in settings]
            old = run_case(tree, names[case], before, children)
            new = run_case(TREE, case, settings, children)
            return compare_outcomes(old, new, tolerance, config)

        return _compare_all(list(names), revision, task, tolerance, only, workers)


def check_golden(tolerance: float, only: Sequence[str], workers: int, config: Config) -> int:
    """Compare this tree's summaries with golden.json; the exit code."""
    kept = read_golden()
    golden = {config.new_name("cases", name): entry for name, entry in kept.items()}

    def task(case: str, children: ChildProcesses) -> Comparison:
        outcome = run_case(TREE, case, config.settings_of(case), children)
        return compare_with_golden(case, golden[case], outcome, tolerance, config)

    return _compare_all(list(golden), GOLDEN.name, task, tolerance, only, workers)


def compare_with_golden(
    case: str, entry: Mapping[str, Any], outcome: Outcome, tolerance: float, config: Config
) -> Comparison:
    """Compare a case's run with what golden.json holds of it."""
    settings = config.settings_of(case)
    if entry["settings"] not in (settings, [config.old_setting(s) for s in settings]):
        return Comparison("different", [f"{CONFIG.name} has other settings now: --write"])
    now = golden_entry(settings, outcome, config)
    return compare_outcomes(_golden_outcome(entry), _golden_outcome(now), tolerance, config)


def write_golden(only: Sequence[str], workers: int, config: Config) -> int:
    """Write the summaries' numbers of this tree to golden.json, a case a line; the exit code.

    With patterns in `only` the other cases stay as they are.
    """
    entries = read_golden() if only and GOLDEN.exists() else {}

    def task(case: str, children: ChildProcesses) -> dict[str, Any]:
        settings = config.settings_of(case)
        return golden_entry(settings, run_case(TREE, case, settings, children), config)

    with closing(_run_parallel(select(shipped_cases(TREE), only), task, workers)) as ended:
        for name, entry in ended:
            print(f"{name}: {entry.get('failed', 'ran')}", flush=True)
            entries[name] = entry
    lines = [f"{json.dumps(name)}: {_compact(entries[name])}" for name in sorted(entries)]
    GOLDEN.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(f"{GOLDEN.name}: {len(entries)} cases, {GOLDEN.stat().st_size / 1e3:.0f} kB")
    return 0


def read_golden() -> dict[str, Any]:
    """What golden.json holds of each case."""
    entries: dict[str, Any] = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return entries


def golden_entry(settings: Sequence[str], outcome: Outcome, config: Config) -> dict[str, Any]:
    """What golden.json holds of a case: its settings, and its numbers or why it failed."""
    if outcome.leaves is None:
        return {"settings": list(settings), "failed": outcome.message}
    return {
        "settings": list(settings),
        "summary": numbers_of(outcome.summary, "summary.json", config),
    }


def numbers_of(value: Any, path: str, config: Config) -> Any:
    """The numbers of nested tables and lists that golden.json holds, rounded.

    None where there are none.
    """
    if isinstance(value, Mapping):
        items = {key: numbers_of(item, f"{path}/{key}", config) for key, item in value.items()}
        return {key: item for key, item in items.items() if item is not None} or None
    if isinstance(value, list):
        kept = [numbers_of(item, f"{path}/{i}", config) for i, item in enumerate(value)]
        return [item for item in kept if item is not None] or None
    if not is_number(value) or not config.is_kept(path):
        return None
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _golden_outcome(entry: Mapping[str, Any]) -> Outcome:
    if "failed" in entry:
        return Outcome(None, entry["failed"])
    return Outcome(flatten(entry["summary"], "summary.json"))


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def _compare_all(
    before: Sequence[str],
    where: str,
    task: Callable[[str, ChildProcesses], Comparison],
    tolerance: float,
    only: Sequence[str],
    workers: int,
) -> int:
    """Compare the cases that are both here and `before`, and print what comes out; the exit code.

    A case that is gone counts as a difference; one that is new, or fails in both, does not.
    """
    present, known = select(shipped_cases(TREE), only), select(sorted(before), only)
    verdicts: Counter[Verdict] = Counter()
    both = [name for name in present if name in known]
    with closing(_run_parallel(both, task, workers)) as ended:
        for name, comparison in ended:
            verdicts[comparison.verdict] += 1
            print("\n".join(report(name, comparison, tolerance)), flush=True)
    new, gone = sorted({*present} - {*known}), sorted({*known} - {*present})
    for name in new:
        print(f"{name}: here alone")
    for name in gone:
        print(f"{name}: in {where} alone")
    print(
        f"{len(both)} cases: {verdicts['identical']} identical, {verdicts['within']} within "
        f"{tolerance:g}, {verdicts['fails in both']} failing in both, "
        f"{verdicts['different']} different; {len(new)} here alone, {len(gone)} gone"
    )
    if verdicts["fails in both"] == len(both):
        print("no case ran, so nothing is compared", file=sys.stderr)
        return 1
    return 1 if verdicts["different"] or gone else 0


def report(name: str, comparison: Comparison, tolerance: float) -> list[str]:
    """The lines that say how a case compares."""
    words = {"within": f"within {tolerance:g}", "different": "DIFFERENT"}
    verdict, lines = comparison.verdict, comparison.lines
    more = [f"and {len(lines) - MOST_LINES} more"] if len(lines) > MOST_LINES else []
    indented = [f"    {line}" for line in (*lines[:MOST_LINES], *more)]
    return [f"{name}: {words.get(verdict, verdict)}", *indented]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; its exit code."""
    parser = argparse.ArgumentParser("python -m tests.golden", description=__doc__.split("\n")[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--against", metavar="REV", help="a git revision to compare this tree with")
    what.add_argument("--check", action="store_true", help="compare with golden.json")
    what.add_argument("--write", action="store_true", help="write golden.json")
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="T",
        help="relative to the largest of an array "
        f"({AGAINST_TOLERANCE:g} with --against, {CHECK_TOLERANCE:g} with --check)",
    )
    parser.add_argument(
        "--only", metavar="NAME", action="append", help="cases; * allowed", default=[]
    )
    parser.add_argument("--workers", type=int, metavar="N", default=os.cpu_count() or 1)
    asked = parser.parse_args(arguments)
    config, only, workers = read_config(CONFIG), asked.only, max(1, asked.workers)
    tolerance = asked.tolerance
    if asked.write:
        return write_golden(only, workers, config)
    if asked.check and not GOLDEN.exists():
        print(f"there is no {GOLDEN.name}: --write it first", file=sys.stderr)
        return 2
    if asked.check:
        tolerance = CHECK_TOLERANCE if tolerance is None else tolerance
        return check_golden(tolerance, only, workers, config)
    tolerance = AGAINST_TOLERANCE if tolerance is None else tolerance
    try:
        return compare_trees(asked.against, tolerance, only, workers, config)
    except subprocess.CalledProcessError as error:  # git's
        print(error.stderr.strip(), file=sys.stderr)
        return 2


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the worktree goes then too
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
