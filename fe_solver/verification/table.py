"""The verification table: every row, by the study that makes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from cosim.port import ConvergenceError, InputError

from . import (
    benchmarks_linear,
    benchmarks_nonlinear,
    contact_rows,
    element_rows,
    hood_rows,
    material_rows,
    peers,
    tangent_rows,
    thread_rows,
)
from .row import Row


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


STUDIES = (
    Study("element", element_rows.rows),
    Study("tangents", tangent_rows.rows),
    Study("materials", material_rows.rows),
    Study("contact", contact_rows.rows),
    Study("hood", hood_rows.rows),
    Study("threads", thread_rows.rows),
    Study("plate", benchmarks_linear.plate_rows),
    Study("tapered cantilever", benchmarks_linear.taper_rows),
    Study("eccentric strip", benchmarks_linear.eccentric_rows),
    Study("folded cantilever", benchmarks_linear.bracket_rows),
    Study("roof", benchmarks_linear.roof_rows),
    Study("pinched cylinder", benchmarks_linear.pinched_cylinder_rows),
    Study("twisted beam", benchmarks_linear.twisted_beam_rows),
    Study("hemisphere, linear", benchmarks_linear.hemisphere_rows),
    Study("end shear", benchmarks_nonlinear.shear_rows),
    Study("end moment", benchmarks_nonlinear.moment_rows),
    Study("hemisphere, nonlinear", benchmarks_nonlinear.hemisphere_rows),
    Study("open cylinder", benchmarks_nonlinear.open_cylinder_rows),
    Study("slit ring", benchmarks_nonlinear.ring_rows),
    Study("half cylinder", benchmarks_nonlinear.half_cylinder_rows, slow=True),
    Study(peers.title(), peers.rows),
)


def chosen(only: str | None, slow: bool, studies: Iterable[Study] = STUDIES) -> list[Study]:
    """The studies whose name holds `only`, slow ones where they are asked for or named.

    Raises InputError where none is left."""
    studies = list(studies)
    if only is None:
        return [s for s in studies if slow or not s.slow]
    found = [s for s in studies if only.lower() in s.name.lower()]
    if not found:
        names = "; ".join(s.name for s in studies)
        raise InputError(f"no study is named {only!r}; expected one of: {names}")
    return found
