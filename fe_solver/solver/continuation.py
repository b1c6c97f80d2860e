"""The way from one equilibrium to the next: several attempts, of which the first that converges
counts, and steps in time that grow where they are quick and are halved where they fail."""

from __future__ import annotations

import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import Generic, TypeVar

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array

S = TypeVar("S")
SAME_TIME = 1e-9
"""Share of the time to go; what differs by less is one time."""
GROWTH = 2.0
"""The factor of the step after a quick one."""
MOST_LOOKS = 400
"""Places on the way of a step at which it is looked whether anything is passed through."""


@dataclass(frozen=True)
class Attempt(Generic[S]):
    """One way to reach an equilibrium."""

    name: str
    solve: Callable[[], S]
    """Returns the state that it reaches, or raises ConvergenceError."""
    explains: bool = True
    """Whether its failure says more than that of the attempt before it; a last resort's does
    not."""


def first_success(attempts: Iterable[Attempt[S]]) -> tuple[str, S]:
    """Make the attempts in turn; return the name of the first that converges, and its state.

    Raises the ConvergenceError of the last attempt that explains why none does."""
    error = ConvergenceError("no attempt was made")
    for i, attempt in enumerate(attempts):
        try:
            return attempt.name, attempt.solve()
        except ConvergenceError as failure:
            if i == 0 or attempt.explains:
                error = failure
    raise error from None


@dataclass(frozen=True)
class Effort:
    """What a solve took."""

    cpu_s: float = 0.0
    """CPU seconds."""
    iterations: int = 0
    """Newton iterations."""
    solves: int = 0
    """Linear solves."""
    steps: int = 0
    """Accepted steps."""
    failures: int = 0
    """Steps that failed."""
    relaxations: int = 0
    """States that only a damped motion reached."""

    def plus(self, **more: float) -> Effort:
        """The effort with so much more of the named counts."""
        return replace(self, **{name: getattr(self, name) + n for name, n in more.items()})

    def since(self, before: Effort, cpu_s: float) -> Effort:
        """What was spent since an earlier count, in `cpu_s` seconds."""
        counts = {f.name: getattr(self, f.name) - getattr(before, f.name) for f in fields(self)}
        return Effort(**(counts | {"cpu_s": cpu_s}))


@dataclass
class TimeSteps(ABC, Generic[S]):
    """Equilibria one after the other in time, each the start of the next; what is kept of one is of
    type S."""

    shortest: float
    """Least share that a step has of the time to go."""
    most_turn: float
    """rad that a body turns at most in one step."""
    quick: int
    """Iterations up to which the next step is longer."""
    time: float = 0.0
    """The time of the last equilibrium."""
    effort: Effort = Effort()
    """What was spent since the start."""
    stride: float = np.inf
    """Length of the next step, where nothing else makes it shorter."""
    failed: bool = False
    """Whether the last step did."""
    aside: Effort = field(default_factory=Effort)
    """What was spent on states beside the way."""

    @abstractmethod
    def solve_step(self, time: float, is_last: bool) -> None:
        """Go from the last equilibrium to that of a time and count the effort; `is_last` at the
        time that is sought.  Raises ConvergenceError, and then stays where it was."""

    @abstractmethod
    def solve_at_last(self, time: float, is_last: bool, error: ConvergenceError) -> None:
        """Do as `solve_step` by what is left when the shortest step fails with `error`."""

    @abstractmethod
    def largest_turn(self, time: float) -> float:
        """Return the angle (rad) that a body turns at most from the last equilibrium to a time."""

    @abstractmethod
    def free_share(self, time: float) -> float:
        """Return the share (above 0, up to 1) of the way to a time up to which it is foreseen that
        nothing passes through what it may touch."""

    @abstractmethod
    def finish(self) -> None:
        """Do what is left to do at a time that is sought: contact that penetrates too deep, and the
        check of the supports.  Raises ConvergenceError and InputError."""

    @abstractmethod
    def state(self, effort: Effort) -> S:
        """Return what is kept of the equilibrium, which took that effort."""

    def visit(self, marks: Sequence[float], times: Sequence[float]) -> list[S]:
        """The states at `times`, of a way that goes by the `marks` alone (both ascend, no time is
        beyond the last mark): a time between them is reached aside, from the equilibrium before it,
        so that what is kept has no part in what is found.  Raises as `solve_at_last` and `finish`
        do."""
        out, left = [], list(times)
        for mark in marks:
            spent, began, span = self.effort, clock.process_time(), mark - self.time
            while self.time < mark - SAME_TIME * span:
                before = copy(self)
                self._take_step(mark, span)
                while left and left[0] < min(self.time, mark - SAME_TIME * span):
                    aside = copy(before)
                    out.append(aside._reach(left.pop(0)))
                    more = aside.effort.since(before.effort, 0.0)
                    self.aside = self.aside.plus(**vars(more))
            self.finish()
            if left and left[0] <= mark + SAME_TIME * span:
                left.pop(0)
                cpu = clock.process_time() - began
                out.append(self.state(self.effort.since(spent, cpu)))
        return out

    def total(self, cpu_s: float) -> Effort:
        """What the way and the states beside it took, in `cpu_s` seconds."""
        return replace(self.effort.plus(**vars(self.aside)), cpu_s=cpu_s)

    def _reach(self, time: float) -> S:
        """The state at a time."""
        spent, began, span = self.effort, clock.process_time(), time - self.time
        while self.time < time - SAME_TIME * span:
            self._take_step(time, span)
        self.finish()
        return self.state(self.effort.since(spent, clock.process_time() - began))

    def _take_step(self, time: float, span: float) -> None:
        """One step towards `time`, or a shorter stride after it has failed."""
        turns = max(1, int(np.ceil(self.largest_turn(time) / self.most_turn)))
        step = min(self.stride, time - self.time, (time - self.time) / turns)
        step *= self.free_share(self.time + step)
        is_last = self.time + step > time - SAME_TIME * span
        end, spent = time if is_last else self.time + step, self.effort.iterations
        try:
            self.solve_step(end, is_last)
        except ConvergenceError as error:
            self.effort, self.stride = self.effort.plus(failures=1), step / 2
            self.failed = True
            if self.stride >= self.shortest * span:
                return
            self.solve_at_last(end, is_last, error)
            self.stride = step
        else:
            # what failed at twice the length is not tried again at once
            if self.effort.iterations - spent <= self.quick and not self.failed:
                self.stride = GROWTH * step
            self.failed = False
        self.effort, self.time = self.effort.plus(steps=1), end


def free_share(gaps: Callable[[float], Array], way: float, reach: float) -> float:
    """The share of a step up to which no point goes deeper than `reach` (m) into what it may touch,
    nor deeper than it was by so much, where points go at most `way` (m) beside it; `gaps` are the
    points' (m,) m at a share of the step, negative inside.

    It is looked at every half of the reach, so that nothing is passed through between."""
    if way <= reach:
        return 1.0
    look = reach / 2 / way
    deepest = np.minimum(gaps(0.0), 0.0) - reach
    for i in range(1, MOST_LOOKS + 1):
        share = min(i * look, 1.0)
        if (gaps(share) < deepest).any():
            return max(i - 1, 1) * look
        if share == 1.0:
            break
    return share
