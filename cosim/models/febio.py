"""The hood of a case as FEBio's format can say it, and what is lost by that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np

from cosim.case.schema import Case
from cosim.errors import ConvergenceError
from cosim.hoods.fe_supports import headed
from cosim.hoods.fe_view import slip_forces
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.models.build import Models, tensions
from cosim.port import Array, Motion, Triangles
from fe_solver.hood.as_febio import replacements
from fe_solver.hood.shell_hood import HoodState, ShellHood

MUCH = 5.0
"""%, from which on a change is told first."""
HEAD = "written in place of what the format cannot say, and what that changes:"
MIDDLE = (
    "springs, tendons and what holds their ends act in the middle of the hood: by linear "
    "constraints of both faces, and by loads on both"
)
LEAST_SHARE = 0.02
"""Share of all tensions that a force counts as at least, where a change is told in %."""


@dataclass(frozen=True)
class WrittenHood:
    """A hood with what FEBio's format can say in place of the rest."""

    hood: ShellHood
    motion: Motion
    """The pose that it is written for."""
    surfaces: Mapping[str, Triangles]
    """What it touches, by body and in its frame: vertices (nv, 3) m, triangles (nt, 3)."""
    remarks: Sequence[str]
    """What is written in place of what, and what it changes, the largest first."""


@dataclass(frozen=True)
class _Loss:
    words: str
    change: Mapping[str, float]
    """% by what changes; empty where no equilibrium was found."""
    failure: str = ""

    @property
    def largest(self) -> float:
        return max((abs(v) for v in self.change.values()), default=np.inf)

    def __str__(self) -> str:
        if self.failure:
            return f"{self.words}: its size is not known, no equilibrium was found: {self.failure}"
        told = ", ".join(f"{name} {value:+.2f} %" for name, value in self.change.items())
        much = f"MORE THAN {MUCH:g} %: " if self.largest > MUCH else ""
        return f"{much}{self.words}: {told}"


def written_hood(
    case: Case, models: Models, progress: Callable[[str], object] = lambda _: None
) -> WrittenHood:
    """The shell hood of a case at its posture under its tensions with the nearest that FEBio's
    format can say in place of what it cannot; each is solved alone, and all together, for what it
    changes.  A hood of which nothing is replaced is not solved.

    Raises ConvergenceError where the hood itself has no equilibrium there."""
    hood, pull = cast(ShellHood, models.hood), tensions(case, models)
    finger = models.finger.start(models.posture)
    motion = models.finger.motion(finger)

    def forces(hood: ShellHood, state: HoodState) -> dict[str, float]:
        """N, by name: in the slips, and on the fingertip where it is held."""
        answer, slope = hood.response(state), hood.jacobian(state).load_motion
        aim, _ = models.finger.settle(finger, answer.load, slope, pull[1], case.solve.tolerance)
        balance = models.finger.balance(aim, answer.load, pull[1])
        tip = 0.0 if balance is None else float(np.linalg.norm(balance.tip_force))
        slips = {f"{name} slip": f for name, f in slip_forces(hood, state).items()}
        return {**slips, **({"fingertip force": tip} if tip else {})}

    @cache
    def solved() -> HoodState:
        progress("solving the hood as it is")
        answer: HoodState = hood.advance(hood.start(motion), motion, pull[0], np.inf).state
        return answer

    contact = cast(ShellHoodConfig, case.hood).contact
    found = replacements(hood, solved, headed(contact))
    surfaces = {**models.bones, **found.surfaces}
    if not found.each:
        return WrittenHood(hood, motion, surfaces, ())
    state = solved()
    own, least = forces(hood, state), LEAST_SHARE * float(np.sum(pull[0]))

    def loss(words: str, other: ShellHood) -> _Loss:
        progress(f"solving with {words}")
        try:
            there = _solve(other, hood, state, motion, pull[0])
        except ConvergenceError as error:
            return _Loss(words, {}, str(error).split(".")[0])
        changed = forces(other, there)
        return _Loss(
            words, {k: 100 * (changed[k] - v) / max(abs(v), least) for k, v in own.items()}
        )

    losses = [loss(f"{r.setting}: {r.words}", r.apply(hood)) for r in found.each]
    losses.sort(key=lambda one: -one.largest)
    written = found.apply(hood)
    together = loss("all of these together", written)
    remarks = [HEAD, *map(str, losses), str(together), MIDDLE]
    return WrittenHood(written, motion, surfaces, remarks)


def _solve(
    hood: ShellHood, like: ShellHood, state: HoodState, motion: Motion, tension: Array
) -> HoodState:
    """The equilibrium of a hood from that of another; from where it was laid, if there is none.

    Raises ConvergenceError."""
    try:
        return hood.solve_from(like, state, tension)
    except ConvergenceError:
        answer: HoodState = hood.advance(hood.start(motion), motion, tension, np.inf).state
        return answer
