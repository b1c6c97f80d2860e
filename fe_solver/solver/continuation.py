"""The way from one equilibrium to the next: several attempts, of which the first that converges
counts, and steps in time that grow where they are quick and are halved where they fail."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from typing import Generic, TypeVar

import numpy as np

from cosim.errors import ConvergenceError

S = TypeVar("S")
SAME_TIME = 1e-9
"""Share of the time to go; what differs by less is one time."""
GROWTH = 2.0
"""Of the step after a quick one."""


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
class TimeSteps(ABC):
    """Equilibria one after the other in time, each the start of the next."""

    shortest: float
    """Least share that a step has of the time to go."""
    most_turn: float
    """rad that a body turns at most in one step."""
    quick: int
    """Iterations up to which the next step is longer."""
    time: float = 0.0
    """Of the last equilibrium."""
    effort: Effort = Effort()
    """What was spent since the start."""
    stride: float = np.inf
    """Length of the next step, where nothing else makes it shorter."""

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

    def go_to(self, time: float) -> None:
        """Take the steps up to a time.  Raises ConvergenceError as `solve_at_last` does."""
        span = time - self.time
        while self.time < time - SAME_TIME * span:
            self._take_step(time, span)

    def _take_step(self, time: float, span: float) -> None:
        """One step towards `time`, or a shorter stride after it has failed."""
        turns = max(1, int(np.ceil(self.largest_turn(time) / self.most_turn)))
        step = min(self.stride, time - self.time, (time - self.time) / turns)
        is_last = self.time + step > time - SAME_TIME * span
        end, spent = time if is_last else self.time + step, self.effort.iterations
        try:
            self.solve_step(end, is_last)
        except ConvergenceError as error:
            self.effort, self.stride = self.effort.plus(failures=1), step / 2
            if self.stride >= self.shortest * span:
                return
            self.solve_at_last(end, is_last, error)
            self.stride = step
        else:
            if self.effort.iterations - spent <= self.quick:
                self.stride = GROWTH * step
        self.effort, self.time = self.effort.plus(steps=1), end
