"""What the process of the page does: solve one case after the other, with what they share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cosim.case.schema import Case
from cosim.pipeline import observe, run_case
from cosim.processes import Memory, tell_caller
from cosim.report.views import View, view_of
from cosim.results.result import Result
from cosim.solve.motion import SolvedMotion
from cosim.solve.session import Session

Start = Literal["nearby", "from rest"]
"""Where a solve begins: at the last equilibrium, or as `cosim run` begins."""


@dataclass(frozen=True)
class Answer:
    """A result, and what the page draws of it."""

    result: Result
    view: View


@dataclass(frozen=True)
class SoFar:
    """A motion on its way, as the page draws it."""

    view: View


def answer(memory: Memory, case: Case, start: Start) -> Answer:
    """The result of a case; its stages, and the frames of a motion as they come, are told to the
    caller.

    Raises what `run_case` does."""
    session = memory.get(start)
    if session is None:
        session = memory[start] = Session(warm=start == "nearby", watch=_tell_motion)
    return answer_of(run_case(case, session, tell_caller))


def answer_of(result: Result) -> Answer:
    """A result with what the page draws of it."""
    return Answer(result, view_of(result))


def _tell_motion(case: Case, so_far: SolvedMotion) -> None:
    tell_caller(motion_so_far(case, so_far))


def motion_so_far(case: Case, so_far: SolvedMotion) -> SoFar:
    """What there is to see of a motion on its way."""
    return SoFar(view_of(observe(case, so_far, 0.0)))
