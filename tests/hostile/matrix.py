"""Every kind of hood with every finger, tip, scheme and edge of a range: a result that closes, or a
reason.

    python -m tests.hostile.matrix 150        # so many combinations, and what failed

A combination is drawn at random (the seed is fixed) and solved in this process.  It fails where it
ends in another error than the program's own, where a force or moment on a bone does not close,
where a number is not finite, or where what is read back is not what was solved.
"""

from __future__ import annotations

import itertools
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.case.file import load_case
from cosim.errors import CosimError
from cosim.pipeline import run_case
from cosim.results.audit import missed_bounds
from cosim.results.read import read_run
from tests.helpers.shells import COARSE_NET

SEED = 63
CLOSED, CLOSED_TO = ("hood_force_balance", "hood_moment_balance"), 1e-6
SHEET = ("hood.mesh.quads=250",)
HOODS: dict[str, tuple[str, tuple[str, ...]]] = {
    "pulleys": ("pulley_edc", ()),
    "split": ("split_edc", ()),
    "network": ("network_edc", ()),
    "two bands": ("two_band_edc", ()),
    "cables": ("cable_edc", (COARSE_NET,)),
    "sheet": ("isometric_edc", SHEET),
    "neo-Hookean sheet": ("isometric_edc_neo_hookean", SHEET),
    "middle finger": ("middle_minorflex_edc", ()),
    "robot's pulleys": ("robot_pulleys_extensor", ()),
    "robot's network": ("robot_network_extensor", ()),
    "robot's cables": ("robot_cable_extensor", (COARSE_NET,)),
    "planar": ("planar_edc", ()),
    "muscle": ("muscle_edc", SHEET),
}
TIPS = ("point", "clamped", "free", "posture")
SCHEMES = {
    "as the case": (),
    "newton": ("coupling.scheme=newton",),
    "fixed point": ("coupling.scheme=implicit",),
    "fixed point, IQN-ILS": ("coupling.scheme=implicit", "coupling.accelerator=iqn_ils"),
    "one way": ("coupling.scheme=one_way",),
}


def _posture(*degrees: int) -> tuple[str, ...]:
    joints = zip(("MCP", "PIP", "DIP"), degrees, strict=True)
    return tuple(f"finger.posture.{joint}={angle} deg" for joint, angle in joints)


EDGES: dict[str, tuple[str, ...]] = {
    "none": (),
    "no tension": ('tendons.EDC={tension="0 N"}',),
    "a thread's tension": ('tendons.EDC={tension="1e-6 N"}',),
    "40 N": ('tendons.EDC={tension="40 N"}',),
    "bent": ("finger.posture.MCP=80 deg", "finger.posture.PIP=90 deg", "finger.posture.DIP=60 deg"),
    "straight": (
        "finger.posture.MCP=0 deg",
        "finger.posture.PIP=0 deg",
        "finger.posture.DIP=0 deg",
    ),
    "no gravity": ('finger.gravity=["0 m/s**2", "0 m/s**2", "0 m/s**2"]',),
    "friction": ("hood.contact.friction=0.1",),
    "coarse tolerance": ("solve.tolerance=1e-4",),
    "one round": ("solve.max_iterations=1",),
}


class Combination(NamedTuple):
    """A case by its hood, and what is set in it."""

    hood: str
    tip: str
    scheme: str
    edge: str

    def settings(self) -> list[str]:
        """What is set in the hood's case."""
        return [
            *HOODS[self.hood][1],
            f"finger.tip.kind={self.tip}",
            "output.picture=false",
            *SCHEMES[self.scheme],
            *(text.replace("tendons.EDC", f"tendons.{self.tendon}") for text in EDGES[self.edge]),
        ]

    @property
    def tendon(self) -> str:
        """The tendon that the hood's case pulls."""
        return "extensor" if self.hood.startswith("robot") else "EDC"


class Ended(NamedTuple):
    """How a combination ended: "result", "missed" (its audit), "refused" or "failed"; and why."""

    combination: Combination
    how: str
    why: str
    seconds: float


def combinations(count: int) -> list[Combination]:
    """As many combinations as asked for, each hood, tip, scheme and edge among them."""
    rng = random.Random(SEED)
    every = [Combination(*c) for c in itertools.product(HOODS, TIPS, SCHEMES, EDGES)]
    rng.shuffle(every)
    first, seen = [], set[str]()
    for each in every:
        if not {f"{k}{name}" for k, name in enumerate(each)} <= seen:
            first.append(each)
            seen |= {f"{k}{name}" for k, name in enumerate(each)}
    rest = [each for each in every if each not in first]
    return [*first, *rest][:count]


def end_of(combination: Combination, folder: Path) -> Ended:
    """Solve a combination, and say how it ended."""
    began = time.perf_counter()
    try:
        how, why = _solved(combination, folder)
    except CosimError as error:
        how, why = "refused", f"{type(error).__name__}: {error}"
        if not str(error).strip():
            how, why = "failed", "an error without a reason"
    except Exception:
        how, why = "failed", traceback.format_exc()
    return Ended(combination, how, why, time.perf_counter() - began)


def _solved(combination: Combination, folder: Path) -> tuple[str, str]:
    case = load_case(HOODS[combination.hood][0], combination.settings())
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        result = run_case(case)
    faults = list(_faults(result.summary))
    run = result.save(folder / "run")
    if read_run(run).summary != result.summary:
        faults.append("the summary that is read back is another")
    if faults:
        return "failed", "; ".join(faults)
    missed = missed_bounds(result.summary)
    return ("missed", ", ".join(missed)) if missed else ("result", "")


def _faults(summary: object, place: str = "") -> Iterator[str]:
    """Numbers of a summary that are not finite, and a ledger that does not close."""
    if isinstance(summary, dict):
        for key, value in summary.items():
            if key in CLOSED and value is not None and not value < CLOSED_TO:
                yield f"{key} is {value}"
            yield from _faults(value, f"{place}.{key}")
    elif isinstance(summary, (list, tuple)):
        for value in summary:
            yield from _faults(value, place)
    elif isinstance(summary, float) and not np.isfinite(summary):
        yield f"{place} is {summary}"


def main(count: int) -> int:
    """Try so many combinations; how many failed."""
    ends = []
    for k, combination in enumerate(combinations(count)):
        with tempfile.TemporaryDirectory() as folder:
            ended = end_of(combination, Path(folder))
        ends.append(ended)
        if ended.how != "result":
            last = ended.why.strip().splitlines()[-1][:300]
            print(f"{k + 1}. {' / '.join(combination)}: {ended.how}: {last}", flush=True)
        if ended.how == "failed":
            print(ended.why, flush=True)
    counts = Counter(ended.how for ended in ends)
    print(", ".join(f"{counts[how]} {how}" for how in ("result", "missed", "refused", "failed")))
    slowest = max(ends, key=lambda ended: ended.seconds)
    print(f"slowest: {' / '.join(slowest.combination)}, {slowest.seconds:.0f} s")
    return counts["failed"]


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])) > 0)
