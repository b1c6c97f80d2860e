"""How one of many runs ended, in one list of words."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar, cast

from cosim.errors import CosimError, InputError, NoMemoryError

Status = Literal["converged", "failed", "refused", "timeout", "died"]
"""`failed`: without equilibrium; `refused`: the case does not allow it; `timeout`: over its time;
`died`: the process that solved was ended, from outside or by a fault, more than once."""
T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True)
class Outcome(Generic[T_co]):
    """How a run ended.

    >>> outcome_of(lambda: 2.0).value
    2.0
    """

    status: Status
    value: T_co | None = None
    """What was made of its result; None of a run without one."""
    error: CosimError | None = None
    """Why there is none."""
    seconds: float = 0.0

    def result(self) -> T_co:
        """What was made of its result.  Raises its error where there is none."""
        if self.error is not None:
            raise self.error
        return cast(T_co, self.value)

    @property
    def reason(self) -> str:
        """The error in one line; empty of a run that converged."""
        return "" if self.error is None else one_line(self.error)


def outcome_of(run: Callable[[], T_co]) -> Outcome[T_co]:
    """What a run returns, or the error that it ends with."""
    started = time.perf_counter()
    try:
        value = run()
    except CosimError as error:
        status: Status = "refused" if isinstance(error, InputError) else "failed"
        return Outcome(status, None, error, time.perf_counter() - started)
    except MemoryError as needed:
        return Outcome("failed", None, NoMemoryError.of(needed), time.perf_counter() - started)
    return Outcome("converged", value, None, time.perf_counter() - started)


def one_line(error: CosimError) -> str:
    """What is wrong, in one line."""
    return " ".join(str(error).split())
