"""How every compared quantity depends on a case's assumptions, changed one at a time.

No derivative is used: contacts come and go and springs slacken, so a change of 50 % has not fifty
times the effect of 1 %.

Ranges are those of the literature where there are any, else assumptions: moduli and joint stiffness
+-50 %, cross-sections 0.3 to 1.8 mm2 (what network models of the hood take for its parts: Dogadov
et al., arXiv:2507.15389), rest lengths +-0.2 mm, contact offsets +-0.3 mm, postures +-5 deg, meshes
of 2 and 4 times the quads; bending, springs, limits, friction and fibres by factors of 2, slack by
1 mm.  A hood that slides without friction gets a coefficient of 0.1 and of 0.3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from cosim.analyses.trials.workers import Trial
from cosim.case.file import Settings, load_case
from cosim.case.schema import Case
from cosim.errors import ConvergenceError, InputError
from cosim.hoods.kinds import KINDS
from cosim.hoods.variation import Side, Variation, no_variation, scale, shift
from cosim.json_text import json_text
from cosim.outcome import Status
from cosim.pipeline import plain_summary, run_each
from cosim.results.compare import unit_of, value_of
from cosim.results.table import csv_text
from cosim.schema import units

FORMAT = "cosim sensitivity 1"
RATIO = "difference.slip_force_N.terminal/difference.slip_force_N.central"
QUANTITIES = (
    "difference.fingertip_magnitude_N",
    "difference.fingertip_force_N.distal",
    "difference.fingertip_force_N.dorsal",
    "difference.slip_force_N.central",
    "difference.slip_force_N.terminal",
    RATIO,
    "difference.marker_strain_percent.longitudinal.min",
    "difference.marker_strain_percent.longitudinal.mean",
    "difference.marker_strain_percent.longitudinal.max",
    "difference.marker_strain_percent.lateral.min",
    "difference.marker_strain_percent.lateral.mean",
    "difference.marker_strain_percent.lateral.max",
    "difference.region_engineering_strain_percent.central_slip.longitudinal.mean",
    "difference.region_engineering_strain_percent.terminal_slip.longitudinal.mean",
)
"""Quantities by default, as far as the run has them, beside the pulled tendon's moment arms."""
COLUMNS = ("variation", "side", "set_to", "settings", "status", "reason")
"""The table's first columns, before one for each quantity."""
End = Literal["low", "high"]
Progress = Callable[[int, int, str], None]
"""Runs done, runs in all, what is next."""


@dataclass(frozen=True)
class Run:
    """One side of a variation, and what came of it; `values` by quantity."""

    variation: str
    side: End
    set_to: str
    settings: Settings
    status: Status | Literal["does not apply"]
    reason: str
    values: Mapping[str, float | None]


@dataclass(frozen=True)
class Sensitivity:
    """The quantities of a case with its own settings, and what they become with each variation."""

    case: str
    settings: Settings
    base: Mapping[str, float]
    """The value of each quantity."""
    runs: tuple[Run, ...]
    """Low and high of each variation, in their order."""


@dataclass(frozen=True)
class SensitivityBar:
    """A quantity's answer to one variation."""

    variation: str
    low: Run
    high: Run
    quantity: str
    base: float

    @property
    def changes(self) -> tuple[float | None, float | None]:
        """Value less base, at the low and the high side; None where there is no value."""
        both = [run.values.get(self.quantity) for run in (self.low, self.high)]
        low, high = (None if value is None else value - self.base for value in both)
        return low, high

    @property
    def swing(self) -> float:
        """The largest change, 0 where no side has a value."""
        return max(abs(change or 0.0) for change in self.changes)


def study(
    source: Path,
    settings: Settings,
    varied: Sequence[Variation],
    quantities: Sequence[str] = (),
    also: Sequence[str] = (),
    workers: int = 1,
    progress: Progress = lambda done, total, name: None,
) -> Sensitivity:
    """The case at `source` with `settings`, and with each side of every variation on top;
    `quantities`: paths in the summary, or A/B; none: those that one looks at; and `also` others.

    Raises ConvergenceError or InputError where the case itself has no answer, InputError for a
    quantity that it does not have."""
    sides = [side for v in varied for side in _sides(v)]
    asked = [(v, name, side) for v, name, side in sides if side.settings]
    total = 1 + len(asked)
    progress(0, total, "the case as it is")
    every = [settings, *(settings + side.settings for _, _, side in asked)]
    labels = ["the case as it is", *(f"{v.name}, {name}" for v, name, _ in asked)]

    def ended(done: int, i: int, outcome: Trial) -> None:
        progress(done, total, labels[i])
        if i == 0:
            _check(outcome)

    makers = [partial(load_case, source, each) for each in every]
    outcomes = run_each(makers, plain_summary, workers, ended)
    base = _base(outcomes[0].result(), quantities, also)
    trials = {(v.name, name): outcomes[i] for i, (v, name, _) in enumerate(asked, 1)}
    runs = tuple(_run(v, name, side, trials.get((v.name, name)), base) for v, name, side in sides)
    return Sensitivity(source.stem, settings, base, runs)


def _sides(v: Variation) -> tuple[tuple[Variation, End, Side], ...]:
    return (v, "low", v.low), (v, "high", v.high)


def _check(first: Trial) -> None:
    """Raises InputError or ConvergenceError where the case itself has no answer."""
    if first.status == "refused":
        raise InputError(first.reason)
    if first.status == "failed":
        raise ConvergenceError(f"the case as it is: {first.reason}")


def _base(
    summary: Mapping[str, Any], quantities: Sequence[str], also: Sequence[str]
) -> dict[str, float]:
    usual = () if quantities else (*QUANTITIES, *_arms(summary))
    values = {q: value_of(summary, q) for q in (*quantities, *usual, *also)}
    absent = [q for q in (*quantities, *also) if values[q] is None]
    if absent:
        raise InputError(
            f"the run has no number at {', '.join(absent)}; write a path of keys of its "
            "summary.json, for example slip_force_N.central, or a ratio of two, A/B"
        )
    present = {q: value for q, value in values.items() if value is not None}
    if not present:
        raise InputError("this run has none of the usual quantities; name some with --quantity")
    return present


def _arms(summary: Mapping[str, Any]) -> Iterator[str]:
    for tendon, arms in summary.get("difference", {}).get("moment_arm_mm", {}).items():
        yield from (f"difference.moment_arm_mm.{tendon}.{joint}" for joint in arms)


def _run(v: Variation, name: End, side: Side, trial: Trial | None, base: Mapping) -> Run:
    if trial is None:
        return Run(v.name, name, side.label, (), "does not apply", side.why_not, {})
    summary = trial.value or {}
    values = {q: value_of(summary, q) for q in base}
    missed = ", ".join(summary.get("audit_missed", ()))
    reason = f"audit missed: {missed}" if missed else trial.reason
    return Run(v.name, name, side.label, side.settings, trial.status, reason, values)


def bars(result: Sensitivity, quantity: str) -> list[SensitivityBar]:
    """The bars of one quantity, the strongest first."""
    pairs = zip(result.runs[::2], result.runs[1::2], strict=True)
    base = result.base[quantity]
    every = [SensitivityBar(low.variation, low, high, quantity, base) for low, high in pairs]
    return sorted(every, key=lambda bar: -bar.swing)


def to_csv(result: Sensitivity) -> str:
    """A line for each run, the case as it is first; numbers in full; missing numbers empty."""
    settings = " ".join(result.settings)
    rows: list[list[Any]] = [
        [*COLUMNS, *result.base],
        ["", "", "as it is", settings, "converged", "", *result.base.values()],
    ]
    for run in result.runs:
        values = [run.values.get(q) for q in result.base]
        head = [run.variation, run.side, run.set_to, " ".join(run.settings), run.status, run.reason]
        rows.append([*head, *values])
    return csv_text(rows)


def to_json(result: Sensitivity) -> str:
    """All of it."""
    content = {
        "format": FORMAT,
        "case": result.case,
        "settings": result.settings,
        "units": {q: unit_of(q) for q in result.base},
        "base": result.base,
        "runs": [vars(run) for run in result.runs],
    }
    return json_text(content) + "\n"


def variations(case: Case) -> tuple[Variation, ...]:
    """All that this study varies, in a fixed order; what does not apply to the case says why."""
    return (*KINDS[case.hood.kind].variations(case.hood), *_finger_variations(case))


def _finger_variations(case: Case) -> Iterator[Variation]:
    if not case.finger.is_native:
        yield no_variation("posture", "the finger is an FMU, which holds its posture")
        return
    finger = case.native_finger()
    held = "the bones are held" if finger.tip.kind == "posture" else ""
    stiff = {
        f"finger.passive.{joint}.stiffness": p.stiffness
        for joint, p in finger.passive.items()
        if p.stiffness
    }
    limit = finger.limit
    if held or not stiff:
        yield no_variation("joint stiffness", held or "no joint has a linear stiffness")
    else:
        yield scale("joint stiffness", stiff, (0.5, 1.5), units.JOINT_STIFFNESS)
    if held or limit is None:
        yield no_variation("limit law", held or "the finger has no limit")
    else:
        free, stiffness = limit.half_range, limit.stiffness
        key = "finger.limit"
        yield scale("limit's half range", {f"{key}.half_range": free}, (0.5, 2.0), units.ANGLE)
        slope = {f"{key}.stiffness": stiffness}
        yield scale("limit's stiffness", slope, (0.5, 2.0), units.LIMIT_STIFFNESS)
    for joint in ("MCP", "PIP", "DIP"):
        angle = finger.posture.angles()[joint]
        step = units.parse("5 deg", units.ANGLE)
        yield shift(f"posture, {joint}", {f"finger.posture.{joint}": angle}, step, units.ANGLE)
