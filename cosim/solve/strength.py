"""Which part of a loaded hood would give way first, and at how many times the loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.coupling.events import Bearing
from cosim.errors import ConvergenceError
from cosim.tendons.table import TendonConfig

MOST_SCALED, MOST_LOAD = 8, 20.0
"""Equilibria under other loads, and times the loads up to which it is looked for."""
SHARE_TOLERANCE = 1e-3
"""How far the first part may be off what it can bear, as a share of that, in the last equilibrium;
the answer is a secant further, which leaves the square of it."""


@dataclass(frozen=True)
class Strength:
    """What the parts bear for which a case states a strength, and which gives way first."""

    units: Sequence[Any]
    """(k,) as of `cosim.hoods.giving.Unit`."""
    bearing: Bearing
    """In the loaded state."""
    first: int
    """The number of the part that gives way first."""
    load: float | None
    """At how many times the stated tensions, activations and excursions; None if not found."""
    reason: str = ""
    """Why not."""


def scaled(case: Case, factor: float) -> Case:
    """The case with all stated tensions, activations and excursions times a factor."""

    def times(tendon: TendonConfig) -> TendonConfig:
        stated = {key: getattr(tendon, key) for key in ("tension", "activation", "excursion")}
        more = {key: factor * value for key, value in stated.items() if value is not None}
        return tendon.model_copy(update=more)

    tendons = {name: times(tendon) for name, tendon in case.tendons.items()}
    return case.model_copy(update={"tendons": tendons})


def first_to_give_way(
    case: Case,
    units: Sequence[Any],
    loaded: Equilibrium,
    bearing: Callable[[Equilibrium], Bearing],
    solve: Callable[[Case, Equilibrium], Equilibrium],
) -> Strength:
    """What the parts bear in the `loaded` state, and which gives way first as all loads grow, or
    shrink, together: by the secant method, each equilibrium solved from the last.  The first step
    takes what a part bears for proportional to the loads, and where none bears anything loads are
    tripled."""
    at, load, tried = loaded, 1.0, (0.0, 0.0)
    answer = partial(Strength, units, bearing(loaded))
    active = max((t.activation or 0.0 for t in case.tendons.values() if t.muscle), default=0.0)
    for _ in range(MOST_SCALED):
        share = bearing(at).share
        unit, now = int(share.argmax()), float(share.max())
        if now == tried[1] and now > 0.0:
            return answer(unit, None, "what it bears does not follow the loads")
        rise = (now - tried[1]) / (load - tried[0])
        wanted = load + (1.0 - now) / rise if rise else np.inf
        if abs(now - 1.0) <= (SHARE_TOLERANCE if tried[0] else SHARE_TOLERANCE**2):
            return answer(unit, wanted)
        tried, load = (load, now), float(np.clip(wanted, load / 3, 3 * load))
        if load > MOST_LOAD:
            why = f"not below {MOST_LOAD:g}" if now else f"they bear nothing at {tried[0]:g}"
            return answer(unit, None, f"{why} times the loads")
        if load * active > 1.0:
            return answer(unit, None, "not before a muscle is fully active")
        try:
            at = solve(scaled(case, load), at)
        except ConvergenceError:
            return answer(unit, None, f"no equilibrium was found at {load:.3g} times the loads")
    return answer(unit, None, f"not found in {MOST_SCALED} equilibria under other loads")
