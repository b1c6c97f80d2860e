"""A loaded equilibrium that is held while parts of hood and finger relax."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.coupling.excursion import ExcursionState
from cosim.errors import ConvergenceError, Progress
from cosim.models.build import Models, Relaxing, relaxing
from cosim.port import Array, PairState
from cosim.stopwatch import timed
from cosim.tendons.muscles import MusclePull

STEPS = 12
"""Equilibria from the first to the last, at times that grow evenly in their logarithm."""


class Loaded(NamedTuple):
    """A loaded equilibrium, and what pulls in it."""

    equilibrium: Equilibrium
    pull: MusclePull
    draw: ExcursionState | None = None
    """Of the tendons whose excursion is stated; None without any."""


@dataclass(frozen=True)
class Held:
    """What there was over the time that a load was held, at (n,) times from 0 on."""

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


class Solve(Protocol):
    """How an equilibrium is found from the states before it."""

    def __call__(
        self,
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
    """The equilibrium after the case's time, from that at once: the models in its last step, it,
    and what there was on the way.  Raises ConvergenceError."""
    from fe_solver.materials.prony import held_times

    stated, laws, at = case.relaxation, relaxing(case), first
    assert stated is not None
    assert stated.held is not None
    parts, now, rows = _parts(models, laws), models, [_row(models, 0.0, at)]
    memories = [
        p.law.after(p.law.start(p.borne(models, unloaded)), p.borne(models, at.equilibrium), 0.0)
        for p in parts
    ]
    shortest = min(float(law.times.min()) for law in laws if law is not None)
    for before, time in pairwise([0.0, *held_times(stated.held, shortest, STEPS)]):
        progress(f"held for {time:.4g} s of {stated.held:g} s")
        now, dt = models, time - before
        for part, memory in zip(parts, memories, strict=True):
            now = part.changed(now, *part.law.law(memory, dt))
        try:
            at = solve(now, start=_start(at, laws), progress=progress, draw=at.draw, time=time)
        except ConvergenceError as error:
            raise ConvergenceError(f"after {time:.4g} s under load: {error}") from error
        memories = [
            p.law.after(memory, p.borne(now, at.equilibrium), dt)
            for p, memory in zip(parts, memories, strict=True)
        ]
        rows.append(_row(now, time, at))
    return now, at, _held(rows)


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


def _row(models: Models, time: float, at: Loaded) -> dict[str, Any]:
    e = at.equilibrium
    return {
        "time": time,
        "tip_force": models.finger.tip_force(e.finger_state),
        "tension": np.concatenate([e.hood_tension, e.finger_tension]),
        "excursion": e.excursion,
        "angles": models.finger.angles(e.finger_state),
        "slips": models.slips_of(e) or {},
    }


def _held(rows: list[dict[str, Any]]) -> Held:
    slips = {name: np.array([row["slips"][name] for row in rows]) for name in rows[0]["slips"]}
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0] if name != "slips"}
    return Held(**columns, slips=slips)
