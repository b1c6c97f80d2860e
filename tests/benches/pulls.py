"""What one pull on a hood costs, over a table of hoods, postures and tendons.

Bones are held and one tendon is pulled in one step from rest: which contacts and springs act, and
where the sheet is slack, changes at once, and that is what costs.  `cases/data/pulls.csv` has the
pulls, and for each the linear solves that it once took.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from time import process_time
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, Progress, quiet
from cosim.models.build import build
from cosim.port import STATIC, Array, Hood, Motion, Response, State
from cosim.text_tables import packaged_rows
from fe_solver.hood.shell_hood import ShellHood

JOINTS = ("MCP", "PIP", "DIP")
REST = "rest"


class Pull(NamedTuple):
    """A hood, by its case and the settings (`--set`) on top of it, and the tendon that is drawn
    with a force (N); no tendon: the hood goes to rest from as it is laid out.  `solves_before`:
    linear solves that it once took."""

    case: str
    settings: tuple[str, ...]
    tendon: str
    force: float
    solves_before: int


class MeasuredPull(NamedTuple):
    """A pull on a hood with so many unknowns, the Newton iterations (0 if it failed) and linear
    solves that it took, the processor's time (s), and why it failed, if it did."""

    pull: Pull
    unknowns: int
    iterations: int
    solves: int
    cpu_s: float
    failure: str


def read_pulls() -> list[Pull]:
    """The pulls of the packaged table."""
    return [
        Pull(
            row["case"],
            _settings(row),
            row["tendon"],
            float(row["force_N"] or 0),
            int(row["solves_before"]),
        )
        for row in (row.cells for row in packaged_rows("pulls"))
    ]


def _settings(row: Mapping[str, str]) -> tuple[str, ...]:
    joints = zip(JOINTS, row["posture_deg"].split(), strict=False)
    held = [f"finger.posture.{joint}={angle} deg" for joint, angle in joints]
    if held:
        held.append("finger.tip.kind=posture")
    return tuple(held + [s.strip() for s in row["settings"].split(";") if s.strip()])


def measure_pulls(pulls: list[Pull], progress: Progress = quiet) -> Iterator[MeasuredPull]:
    """Solve each pull and count.  A hood that does not come to rest has no pulls measured.

    Raises InputError for a case or settings that are none."""
    for (name, settings), group in groupby(pulls, lambda pull: (pull.case, pull.settings)):
        progress(" ".join((name, *settings)))
        case = load_case(name, list(settings))
        models = build(case)
        motion = models.finger.motion(models.finger.start(models.posture))
        counted = _CountedHood.of(models.hood)
        idle = np.full(len(models.hood.tendons), models.resting)
        state = models.hood.start(motion)
        for pull in group:
            tension = idle.copy()
            if pull.tendon:
                tension[models.hood.tendons.index(pull.tendon)] = pull.force
            measured, response = counted.advance(pull, state, motion, tension)
            yield measured
            if pull.tendon:
                continue
            if response is None:
                break
            state = response.state


@dataclass
class CountingAnalysis:
    """An analysis of the linear solver that counts the solutions of its factors."""

    analysis: Any
    solves: int = 0
    dear: ClassVar[bool] = True

    def factor(self, data: Array) -> CountingFactor:
        """The factor of the analysis, its solutions counted."""
        return CountingFactor(self, self.analysis.factor(data))


@dataclass
class CountingFactor:
    """A factor whose solutions its analysis counts."""

    counter: CountingAnalysis
    factor: Any

    def solve(self, right: Array) -> Array:
        """The factor's solution."""
        self.counter.solves += 1
        return np.asarray(self.factor.solve(right))

    @property
    def negative(self) -> int:
        """The factor's negative pivots."""
        return int(self.factor.negative)


@dataclass
class _CountedHood:
    hood: Hood
    counters: tuple[CountingAnalysis, CountingAnalysis]

    @classmethod
    def of(cls, hood: Hood) -> _CountedHood:
        """The hood, the solutions with its sparsity's factors counted."""
        pattern = cast("ShellHood", hood).model.pattern
        counters = CountingAnalysis(pattern.analysis), CountingAnalysis(pattern.general)
        vars(pattern)["analysis"], vars(pattern)["general"] = counters
        return cls(hood, counters)

    def advance(
        self, pull: Pull, state: State, motion: Motion, tension: Array
    ) -> tuple[MeasuredPull, Response | None]:
        solves_before, start = sum(c.solves for c in self.counters), process_time()
        response, failure, iterations = None, "", 0
        try:
            response = self.hood.advance(state, motion, tension, STATIC)
            iterations = response.state.iterations - state.iterations
        except ConvergenceError as error:
            failure = str(error)
        cpu_s, unknowns = process_time() - start, self.counters[0].analysis.slots.shape[0]
        solves = sum(c.solves for c in self.counters) - solves_before
        return MeasuredPull(pull, unknowns, iterations, solves, cpu_s, failure), response
