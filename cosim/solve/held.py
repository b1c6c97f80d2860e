"""A loaded equilibrium that is held while parts of hood and finger relax."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from cosim.case.relaxation import CyclesConfig
from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.coupling.excursion import ExcursionState
from cosim.errors import ConvergenceError, Progress
from cosim.models.build import Models, Relaxing, relaxing
from cosim.port import Array, PairState
from cosim.solve.strength import scaled
from cosim.stopwatch import timed
from cosim.tendons.muscles import MusclePull

Memories = Sequence[Any]
"""What each part remembers, as of `fe_solver.materials.prony.Memory`."""
STEPS = 12
"""Equilibria from the first to the last, at times that grow evenly in their logarithm."""


class Loaded(NamedTuple):
    """A loaded equilibrium, and what pulls in it."""

    equilibrium: Equilibrium
    pull: MusclePull
    draw: ExcursionState | None = None
    """How the tendons with a stated excursion were drawn; None without any."""


@dataclass(frozen=True)
class Held:
    """What there was over the time that a load was held, at (n,) times from 0 on, or at the tops of
    (n,) cycles."""

    models: Models
    """At rest and at once."""
    time: Array
    """(n,) s."""
    tip_force: Array
    """(n, 3) N of the fingertip on the world."""
    tension: Array
    """(n, nt) N, of the hood's tendons, then the finger's own."""
    excursion: Array
    """(n, nh) m, of the hood's tendons."""
    angles: Array
    """(n, nq) rad."""
    slips: Mapping[str, Array]
    """(n,) N by slip; empty of a hood without."""
    repairs: Mapping[str, Array]
    """(n,) m by suture and graft, how much longer than at rest it is where it is most so."""


class Solve(Protocol):
    """How an equilibrium is found from the states before it."""

    def __call__(
        self,
        case: Case,
        models: Models,
        *,
        start: PairState,
        progress: Progress,
        draw: ExcursionState | None,
        time: float,
    ) -> Loaded:
        """Raises ConvergenceError."""
        ...


class _Part(NamedTuple):
    """What relaxes by one law."""

    law: Any
    """A `fe_solver.materials.prony.Prony`."""
    borne: Callable[[Models, Equilibrium], Array]
    """What it bears (n,) in an equilibrium of models."""
    changed: Callable[[Models, float, Array], Models]
    """Models in which its law is the elastic one times a factor, and (n,) is held besides."""


@timed("held")
def hold(
    case: Case,
    models: Models,
    unloaded: Equilibrium,
    first: Loaded,
    solve: Solve,
    progress: Progress,
) -> tuple[Models, Loaded, Held]:
    """The equilibrium after the case's time, or at the top of its last cycle, from that at once:
    the models in its last step, it, and what there was on the way.  Raises ConvergenceError."""
    stated, laws = case.relaxation, relaxing(case)
    assert stated is not None
    under = _UnderLoad(models, laws, _parts(models, laws), solve, progress)
    memories = under.loaded_at_once(unloaded, first)
    if stated.cycles is not None:
        return _cycle(case, stated.cycles, under, first, memories)
    assert stated.held is not None
    now, at, rows = models, first, [_row(models, models, 0.0, first)]
    shortest = min(float(law.times.min()) for law in laws if law is not None)
    for before, time in pairwise([0.0, *held_times(stated.held, shortest, STEPS)]):
        now, at, memories = under.step(case, at, memories, time - before, time)
        rows.append(_row(models, now, time, at))
    return now, at, _held(models, rows)


def held_times(longest: float, shortest: float, count: int) -> list[float]:
    """Times (s), `count` of them, from an instant that is short beside `shortest` s to `longest` s:
    evenly in their logarithm."""
    first = min(shortest / 10, longest / 10)
    times: list[float] = np.geomspace(first, longest, count).tolist()
    return times


def _cycle(
    case: Case, cycles: CyclesConfig, under: _UnderLoad, first: Loaded, top: Memories
) -> tuple[Models, Loaded, Held]:
    """The tops of the first and the last cycle and of some between, of which each comes from the
    foot before it; from foot to foot many cycles are one step, whose swing is the last one's."""
    least, half, models = scaled(case, cycles.least), cycles.period / 2, under.models
    now, at, rows = models, first, [_row(models, models, 0.0, first)]
    _, foot, memories = under.step(least, first, top, half, half)
    feet = 1
    numbers = np.geomspace(2, max(cycles.count, 2), STEPS).round().astype(int)
    for number in np.unique(numbers[numbers <= cycles.count]).tolist():
        swings = [down.swing_to(up, cycles.period) for down, up in zip(memories, top, strict=True)]
        more, time = (number - 1 - feet) * cycles.period, (number - 1) * cycles.period
        if more > 0:
            _, foot, memories = under.step(least, foot, memories, more, time - half, swings)
        now, at, top = under.step(case, foot, memories, half, time)
        rows.append(_row(models, now, time, at))
        feet = number - 1
    return now, at, _held(models, rows)


@dataclass(frozen=True)
class _UnderLoad:
    """What relaxes under load, and how its equilibria are found."""

    models: Models
    """At once."""
    laws: Relaxing
    parts: Sequence[_Part]
    solve: Solve
    progress: Progress

    def loaded_at_once(self, unloaded: Equilibrium, first: Loaded) -> Memories:
        """What the parts remember as the load has just been put on."""
        at_rest = [p.law.start(p.borne(self.models, unloaded)) for p in self.parts]
        loaded = [p.borne(self.models, first.equilibrium) for p in self.parts]
        each = zip(self.parts, at_rest, loaded, strict=True)
        return [part.law.after(memory, borne, 0.0) for part, memory, borne in each]

    def step(
        self,
        load: Case,
        at: Loaded,
        memories: Memories,
        dt: float,
        time: float,
        swings: Sequence[Any] | None = None,
    ) -> tuple[Models, Loaded, Memories]:
        """The equilibrium under a load, `dt` s after what the parts remember, from one nearby, at
        `time` s: the models in it, it, and what they remember then.  Raises ConvergenceError."""
        self.progress(f"{time:.4g} s under load")
        swings = swings or [None] * len(self.parts)
        now, each = self.models, [*zip(self.parts, memories, swings, strict=True)]
        for part, memory, swing in each:
            now = part.changed(now, *part.law.law(memory, dt, swing))
        start, say = _start(at, self.laws), self.progress
        try:
            found = self.solve(load, now, start=start, progress=say, draw=at.draw, time=time)
        except ConvergenceError as error:
            left = 100 * min(float(law.modulus(time)) for law in self.laws if law is not None)
            raise ConvergenceError(
                f"after {time:.4g} s under load, when {left:.3g} % of what is borne at once is "
                f"left: {error} Or a shorter time under load, or less that relaxes."
            ) from error
        e = found.equilibrium
        return now, found, [p.law.after(m, p.borne(now, e), dt, swing) for p, m, swing in each]


def _parts(models: Models, laws: Relaxing) -> list[_Part]:
    """What relaxes besides the tendons, which `solve` sees to."""
    out = []
    if laws.hood is not None:
        from cosim.hoods.relaxing import borne, relaxed

        hood: Any = models.hood  # of finite elements, by the schema
        out.append(
            _Part(
                laws.hood,
                lambda now, e: borne(now.hood, e.response.state),  # type: ignore[arg-type]
                lambda now, factor, held: now.with_hood(relaxed(hood, factor, held)),
            )
        )
    if laws.joints is not None:
        finger: Any = models.finger  # of ours, by the schema

        def joints(now: Models, e: Equilibrium) -> Array:
            live: Any = now.finger
            torque: Array = live.law.passive(live.angles(e.finger_state))[0]
            return torque

        def relaxed_joints(now: Models, factor: float, held: Array) -> Models:
            other = copy(finger)
            other.law = finger.law.relaxed(factor, held)
            return replace(now, finger=other)

        out.append(_Part(laws.joints, joints, relaxed_joints))
    return out


def _start(at: Loaded, laws: Relaxing) -> PairState:
    """The states of an equilibrium for models with other laws: a hood's that relaxes without its
    tangent."""
    e = at.equilibrium
    state: Any = e.response.state
    if laws.hood is not None:
        state = replace(state, solution=None, course=None)
    return PairState(e.finger_state, state)


def _row(models: Models, now: Models, time: float, at: Loaded) -> dict[str, Any]:
    e = at.equilibrium
    return {
        "time": time,
        "tip_force": now.finger.tip_force(e.finger_state),
        "tension": np.concatenate([e.hood_tension, e.finger_tension]),
        "excursion": e.excursion,
        "angles": now.finger.angles(e.finger_state),
        "slips": now.slips_of(e),
        "repairs": _repairs(models, e),
    }


def _repairs(models: Models, e: Equilibrium) -> Mapping[str, float]:
    if models.built.around is None:  # not of finite elements
        return {}
    from cosim.hoods.fe_view import repair_stretches

    hood: Any = models.hood
    return repair_stretches(hood, e.response.state)


def _held(models: Models, rows: list[dict[str, Any]]) -> Held:
    """The rows as columns, and those that are by name each by its name."""
    out: dict[str, Any] = {}
    for key, first in rows[0].items():
        column = [row[key] for row in rows]
        by_name = key in ("slips", "repairs")
        each = {n: np.array([c[n] for c in column]) for n in first} if by_name else {}
        out[key] = each if by_name else np.array(column)
    return Held(models, **out)
