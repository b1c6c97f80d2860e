"""The ways from one equilibrium to the next: several attempts, the first that converges counts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from cosim.errors import ConvergenceError

S = TypeVar("S")


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
