"""Steps in time that fail: halved down to the shortest, and what is left then."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from cosim.errors import ConvergenceError
from fe_solver.solver.continuation import Effort, TimeSteps


@dataclass
class Reluctant(TimeSteps):
    """Steps of which none longer than `longest` succeeds."""

    longest: float = 0.0
    tried: list[float] = field(default_factory=list)
    last: list[float] = field(default_factory=list)

    def solve_step(self, time: float, is_last: bool) -> None:
        self.tried.append(time - self.time)
        if self.tried[-1] > self.longest:
            raise ConvergenceError("too long")

    def solve_at_last(self, time: float, is_last: bool, error: ConvergenceError) -> None:
        self.last.append(time)

    def largest_turn(self, time: float) -> float:
        return 0.0

    def free_share(self, time: float) -> float:
        return 1.0

    def finish(self) -> None:
        pass

    def state(self, effort: Effort) -> float:
        return self.time


@pytest.mark.parametrize("span", [1.0, 2.0, 64.0])
def test_no_step_is_shorter_than_the_least_share_of_the_time_to_go(span):
    """Halved to an eighth, the last above a tenth, which what is left then takes eight times."""
    steps = Reluctant(shortest=0.1, most_turn=1.0, quick=10)
    assert steps.visit([span], [span]) == [span]
    assert steps.tried == [span, span / 2, span / 4, *[span / 8] * 8]
    assert steps.last == [span * k / 8 for k in range(1, 9)]
    assert (steps.effort.failures, steps.time) == (11, span)


def test_a_share_that_can_be_solved_needs_nothing_else():
    steps = Reluctant(shortest=0.1, most_turn=1.0, quick=-1, longest=0.5)
    assert steps.visit([2.0], [2.0]) == [2.0]
    assert steps.tried == [2.0, 1.0, 0.5, 0.5, 0.5, 0.5]
    assert steps.last == []
