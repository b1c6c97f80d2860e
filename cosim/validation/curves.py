"""The board of curves: how rough forces and moment arms are over posture, beside aims.

A user who draws a force over posture asks for a curve, and an audit of one posture does not see
whether it is one.  Each posture of a sweep is a case of its own, run like any other.  What has no
equilibrium, or misses its audit, is a gap in the curve, and a sweep with a gap is not within its
aims.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from cosim.errors import Progress, quiet
from cosim.files import write_text
from cosim.outcome import Outcome
from cosim.pipeline import run_cases
from cosim.port import AXES, Array
from cosim.results.compare import number, value_of
from cosim.results.table import csv_text
from cosim.roughness import WINDOW, pool, windows
from cosim.text_tables import read_json_file
from cosim.validation.records import Record, check_record, six_digits
from cosim.validation.run import collect_outcomes
from cosim.validation.sweeps import JOINTS, PostureSweep
from cosim.validation.versions import audited_summary
from cosim.version import __version__

FILE = "curves.json"
Part = Literal["to PIP 60", "beyond"]
PARTS: tuple[Part, ...] = get_args(Part)
"""The parts of a sweep, by the PIP angle in the middle of a window."""
BORDER = 60.0
"""deg, between the parts."""


class Kind(NamedTuple):
    """What a sweep's numbers are."""

    name: str
    unit: str
    """The unit of rms, largest and step."""
    aims: tuple[float, float]
    """The largest rms, to PIP 60 and beyond."""
    floor: float = 0.0
    """The least size that a number is relative to, as a share of what the tendons are pulled with
    together: a slip that idles has no force to be relative to."""


TIP = Kind("fingertip force", "%", (1.0, 2.0), 0.01)
"""Its components, relative to the mean size of the whole force over the window."""
SLIP = Kind("slip force", "%", (1.5, 3.0), 0.1)
"""Relative to its own mean size over the window."""
ARM = Kind("moment arm", "mm", (0.05, 0.2))
"""The moment arms of the pulled tendons, in mm."""
KINDS = {kind.name: kind for kind in (TIP, SLIP, ARM)}
FORCES = {f"fingertip_force_N.{axis}": TIP for axis in AXES}
SLIPS = {f"slip_force_N.{slip}": SLIP for slip in ("central", "terminal")}


class CurveRow(Record):
    """How rough one number of a sweep is in one part."""

    sweep: str
    part: Part
    quantity: str
    kind: str
    unit: str
    size: float
    """Mean size over the windows, in N or mm."""
    rms: float
    largest: float
    step: float
    aim: float
    windows: int

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is of."""
        return self.sweep, self.part, self.quantity

    @property
    def ratio(self) -> float:
        """The rms over its aim."""
        return self.rms / self.aim


@dataclass(frozen=True)
class Curve:
    """A sweep with what its runs say: numbers (n,) by quantity, NaN in a gap, and why there is one,
    by the angle."""

    sweep: PostureSweep
    values: Mapping[str, Array]
    gaps: Mapping[float, str]

    @cached_property
    def rows(self) -> tuple[CurveRow, ...]:
        """The roughness of every number in each part that has a window."""
        return tuple(self._rows())

    @property
    def is_within(self) -> bool:
        """Whether there is no gap, and every number is within its aim."""
        return bool(self.rows) and not self.gaps and all(row.ratio <= 1 for row in self.rows)

    @property
    def worst(self) -> CurveRow | None:
        """The number that is roughest beside its aim."""
        return max(self.rows, key=lambda row: row.ratio, default=None)

    def _rows(self) -> Iterator[CurveRow]:
        angles, pip = self.sweep.angles, self.sweep.postures["PIP"]
        for name, kind in quantities(self.sweep.pulled).items():
            floor, sizes = kind.floor * sum(self.sweep.pulled.values()), self._sizes(name, kind)
            every = windows(angles, self.values[name], sizes=sizes, floor=floor)
            judged = [w for w in every if w.residuals.size]
            for part, aim in zip(PARTS, kind.aims, strict=True):
                beyond = part == "beyond"
                mine = [w for w in judged if (np.interp(w.middle, angles, pip) > BORDER) == beyond]
                if not mine:
                    continue
                found = pool(mine)
                yield CurveRow(
                    sweep=self.sweep.name,
                    part=part,
                    quantity=name,
                    kind=kind.name,
                    unit=kind.unit,
                    size=float(np.mean([w.size for w in mine])),
                    rms=found.rms,
                    largest=found.largest,
                    step=found.step,
                    aim=aim,
                    windows=len(mine),
                )

    def _sizes(self, name: str, kind: Kind) -> Array | None:
        if kind is ARM:
            return None
        if kind is SLIP:
            return self.values[name]
        return np.linalg.norm([self.values[force] for force in FORCES], axis=0)


class CurvesFile(Record):
    """The roughness of all sweeps, as `curves.json` holds it."""

    format: Literal["cosim curves 1"] = "cosim curves 1"
    version: str = __version__
    headline: str = ""
    window_deg: float = WINDOW
    runs: Mapping[str, int] = {}
    """By sweep."""
    gaps_deg: Mapping[str, tuple[float, ...]] = {}
    """Angles without a result, by sweep."""
    rows: tuple[CurveRow, ...] = ()

    def by_key(self) -> dict[tuple[str, str, str], CurveRow]:
        """Its rows by what they are of."""
        return {row.key: row for row in self.rows}


def quantities(pulled: Sequence[str] | Mapping[str, float]) -> dict[str, Kind]:
    """The numbers of a sweep whose tendons are `pulled`, by the path in a run's summary."""
    arms = {f"moment_arm_mm.{tendon}.{joint}": ARM for tendon in pulled for joint in JOINTS}
    return {**FORCES, **SLIPS, **arms}


def run_curves(
    sweeps: Sequence[PostureSweep], workers: int = 2, progress: Progress = quiet
) -> list[Curve]:
    """Run every posture of the sweeps, and read the curves.  Raises InputError where a case is
    refused, or a process is ended from outside."""
    cases = [case for sweep in sweeps for case in sweep.cases]
    ended = ((cases[i].name, o) for i, o in run_cases(cases, audited_summary, workers))
    outcomes = collect_outcomes(ended, len(cases), progress)
    return [_curve(sweep, [outcomes[case.name] for case in sweep.cases]) for sweep in sweeps]


def _curve(sweep: PostureSweep, outcomes: Sequence[Outcome[Mapping[str, Any]]]) -> Curve:
    summaries = [outcome.value or {} for outcome in outcomes]
    values = {
        name: np.array([value_of(s, name) for s in summaries], dtype=float)
        for name in quantities(sweep.pulled)
    }
    ended = zip(sweep.angles, outcomes, strict=True)
    return Curve(sweep, values, {float(angle): o.reason for angle, o in ended if o.error})


class Line(NamedTuple):
    """A sweep in one part, with the roughest number of each kind beside its aim."""

    sweep: str
    part: str
    worst: Mapping[str, CurveRow]
    """By the kind's name; empty where gaps leave no window."""
    gaps: int
    """How many there are in the whole sweep."""

    @property
    def ratio(self) -> float:
        """The largest rms over its aim; infinite without a window."""
        return max((row.ratio for row in self.worst.values()), default=np.inf)

    @property
    def verdict(self) -> str:
        """Whether all is within the aims."""
        within = self.ratio <= 1 and not self.gaps
        return "within" if within else "gaps" if self.ratio <= 1 else "misses"


def lines(curves: Sequence[Curve]) -> list[Line]:
    """Each sweep in each part that has a window, or once where it has none, misses first."""
    found = []
    for curve in curves:
        by_part: dict[str, dict[str, CurveRow]] = {}
        for row in sorted(curve.rows, key=lambda row: (PARTS.index(row.part), row.ratio)):
            by_part.setdefault(row.part, {})[row.kind] = row
        for part, worst in (by_part or {"no window": {}}).items():
            found.append(Line(curve.sweep.name, part, worst, len(curve.gaps)))
    return sorted(found, key=lambda line: (line.verdict == "within", -line.ratio))


def headline(curves: Sequence[Curve]) -> str:
    """How many sweeps are within their aims, which number is worst, and how many runs are gaps."""
    within = sum(curve.is_within for curve in curves)
    text = f"{within} of {len(curves)} sweeps within their aims"
    worst = max((c.worst for c in curves if c.worst), key=lambda row: row.ratio, default=None)
    if worst is not None:
        times = f"{number(worst.ratio, 2)} times its aim"
        text += f"; worst {worst.sweep}, {worst.part}: {worst.quantity}, {times}"
    gaps, runs = sum(len(c.gaps) for c in curves), sum(len(c.sweep.cases) for c in curves)
    return f"{text}; {gaps} of {runs} runs without a result"


def curves_file(curves: Sequence[Curve]) -> CurvesFile:
    """What the curves leave, to six digits."""
    return CurvesFile(
        headline=headline(curves),
        runs={c.sweep.name: len(c.sweep.cases) for c in curves},
        gaps_deg={c.sweep.name: tuple(c.gaps) for c in curves if c.gaps},
        rows=tuple(CurveRow(**six_digits(r.model_dump())) for c in curves for r in c.rows),
    )


def read_curves(path: Path) -> CurvesFile:
    """Read a board of curves.  Raises InputError."""
    return check_record(CurvesFile, read_json_file(path), f"{path}: is no board of curves")


def read_committed() -> CurvesFile:
    """What stands in `cases/curves.json`; nothing where there is none.  Raises InputError."""
    path = Path(str(resources.files("cases") / FILE))
    return read_curves(path) if path.is_file() else CurvesFile()


def write_points(path: Path, curves: Sequence[Curve]) -> None:
    """Write every point of the curves as CSV, to eight digits, empty where a sweep has no such
    number or the run no result.  Raises InputError where the file cannot be written."""
    names = list(dict.fromkeys(name for curve in curves for name in curve.values))
    rows = [["sweep", *(f"{joint}_deg" for joint in JOINTS), *names, "no_result"]]
    for curve in curves:
        for i, angle in enumerate(curve.sweep.angles):
            posture = [f"{curve.sweep.postures[joint][i]:g}" for joint in JOINTS]
            values = (curve.values[n][i] if n in curve.values else np.nan for n in names)
            cells = [f"{x:.8g}" if np.isfinite(x) else "" for x in values]
            rows.append([curve.sweep.name, *posture, *cells, curve.gaps.get(angle, "")])
    write_text(path, csv_text(rows))
