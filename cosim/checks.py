"""The verification table of any part of the program: its rows, by the study that makes them.

Like the port, it imports nothing of ours but the port.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from cosim.errors import ConvergenceError, InputError


@dataclass(frozen=True)
class Row:
    """A computed quantity beside its target.

    `measure` says how the error is taken: relative to the target, as the absolute difference, or
    "bound" for a quantity that must not exceed its target.  A "comparison" with an experiment is
    absolute and never fails: its tolerance is the experiment's spread, and it says whether the
    model lies within.  A row that is only "shown", as every time that a clock took, has a relative
    error and no tolerance.
    `order` is the measured order of convergence where two meshes were solved; `source` says where
    the target is from.

    >>> row = Row("cantilever", "tip deflection, m", 0.10, 0.101, 0.02, "beam theory")
    >>> round(row.error, 3), row.verdict
    (0.01, 'pass')
    """

    name: str
    quantity: str
    target: float
    computed: float
    tolerance: float
    source: str
    measure: Literal["relative", "absolute", "bound", "comparison", "shown"] = "relative"
    order: float | None = None

    @property
    def error(self) -> float:
        """Relative or absolute error; of a bound, what exceeds it (0 where nothing does)."""
        difference = self.computed - self.target
        if self.measure == "bound":
            return max(difference, 0.0)
        scale = abs(self.target) if self.measure in ("relative", "shown") else 1.0
        return abs(difference) / scale

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; NaN never is.  A comparison, or a row that is
        only shown, needs only be computed."""
        if self.measure in ("comparison", "shown"):
            return isfinite(self.error)
        return self.error <= self.tolerance

    @property
    def verdict(self) -> str:
        """ "pass" or "FAIL"; "within" or "outside" for a comparison; "shown"."""
        if self.measure == "comparison" and self.passed:
            return "within" if self.error <= self.tolerance else "outside"
        if self.measure == "shown" and self.passed:
            return "shown"
        return "pass" if self.passed else "FAIL"


@dataclass(frozen=True)
class Study:
    """A named maker of rows; a slow one takes more than some twenty seconds."""

    name: str
    make: Callable[[], Iterator[Row]]
    slow: bool = False

    def rows(self) -> Iterator[Row]:
        """The rows; a solve that does not converge ends them with a failed one that says why."""
        try:
            yield from self.make()
        except ConvergenceError as error:
            nan = float("nan")
            yield Row(self.name, "did not converge", nan, nan, 0.0, str(error), "absolute")


def select_studies(only: str | None, slow: bool, studies: Sequence[Study]) -> list[Study]:
    """The studies whose name contains `only`, or all of them: the slow ones where `slow` asks for
    them or `only` names them.

    >>> studies = [Study("beam", lambda: iter(())), Study("hood", lambda: iter(()), slow=True)]
    >>> [study.name for study in select_studies(None, False, studies)]
    ['beam']
    >>> [study.name for study in select_studies("hood", False, studies)]
    ['hood']

    Raises InputError where no name contains `only`."""
    if only is None:
        return [s for s in studies if slow or not s.slow]
    selected = [s for s in studies if only.lower() in s.name.lower()]
    if not selected:
        names = "; ".join(s.name for s in studies)
        raise InputError(f"no study is named {only!r}; expected one of: {names}")
    return selected
