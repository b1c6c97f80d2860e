"""Muscle tensions that meet a demand, with any hood.

The least cost sum (T_i / w_i)^p within bounds, under the equations of a demand, whose torques are
those of hood and muscles.  With a hood of fixed shares they are linear in T, and one programme
solves the problem.  Other hoods are linearised at the last tensions, again and again (sequential
programmes: Nocedal and Wright 2006, Numerical Optimization, ch. 18), until the torques at the new
tensions are those that the programme predicted.  Then the optimality conditions of the programme
are those of the problem itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.analyses.estimate.demand import Demand
from cosim.analyses.estimate.held_finger import HeldFinger, Torques
from cosim.errors import ConvergenceError, InputError, Progress, quiet
from cosim.port import Array, State
from rigid.muscle.least_cost import Optimum, Power, Programme, least

MOST_ROUNDS = 40
WHOLE_ROUNDS = 6
"""Rounds of whole steps; then steps stay within a region round the best tensions so far, which
grows and shrinks by the part of its promise that a step makes, and only a gain counts."""
LEAST_PART = 2.0**-8
"""The least part of a step that is tried where the hood's own solve fails."""
LARGEST_STEP, LEAST_REGION = 0.5, 1e-4
"""Half width of the region at first, and below which the rounds end: of the largest tension."""
SLOW, STALLED = 1e-3, 5
"""Relative gain of the best miss that does not count, and rounds without one in a row after which
the best that was reached is taken for the nearest of a demand that the region cannot meet."""
REFUSED, POOR, GOOD = 0.05, 0.25, 0.75
"""Parts of the promise below which a step is not taken, and the region shrinks, and above which it
grows."""
AGREED = 1e-6
"""Relative difference of the hood's torques and the predicted ones, and of tensions between
rounds, at which the rounds end."""
NEGLIGIBLE = 1e-9
SHORT = 1e-6
"""Relative: a demand that is missed by more was out of reach."""


class Cost(NamedTuple):
    """sum (T / weight)^power, weight (n,)."""

    weight: Array
    power: Power

    @property
    def factors(self) -> Array:
        """The factors c (n,) of the same cost written as sum c T^power."""
        factors: Array = (1.0 / self.weight) ** self.power
        return factors


class Bounds(NamedTuple):
    """The least and the greatest tensions, (n,) N each."""

    least: Array
    most: Array


@dataclass(frozen=True)
class Estimate:
    """Tensions (n,) N in the order of `HeldFinger.names`, checked."""

    tension: Array
    components: Array
    """(d,) of the demand's components, by the hood's own answer."""
    at: Torques
    optimum: Optimum
    gap: float
    """Relative difference of the torques made and those asked for."""
    rounds: int
    """Hood solves."""


def estimate(
    held: HeldFinger,
    demand: Demand,
    wanted: Array,
    bounds: Bounds,
    cost: Cost,
    start: tuple[Array, State] | None = None,
    progress: Progress = quiet,
    reserve: float = 0.0,
) -> Estimate:
    """The cheapest tensions that make the components `wanted` (d,) of a demand, or where none do
    those nearest, if none of them is further off than `reserve`; `start`: tensions and a hood's
    state near by.

    Raises InputError where the wanted lies out of reach, ConvergenceError where hood and programme
    do not agree."""
    tension, state = (bounds.least, held.begin()) if start is None else start
    at = held.at(tension, state)
    reached = _Reached(tension, at, _miss(demand, wanted, at))
    best, region, merit, idle = reached, np.inf, Merit(cost), 0
    for rounds in range(1, MOST_ROUNDS + 1):
        if rounds == WHOLE_ROUNDS + 1:
            reached, region = best, LARGEST_STEP * float(best.tension.max())
        tension, at = reached.tension, reached.at
        box = Bounds(
            np.maximum(bounds.least, tension - region), np.minimum(bounds.most, tension + region)
        )
        asked, programme, solution = _aim(demand, wanted, reached, box, cost)
        gap, length = _gap(demand, asked, at), float(np.abs(solution.x - tension).max())
        moved = float(np.abs(solution.x - tension).max() / max(1.0, float(solution.x.max())))
        is_free = length < 0.999 * region
        progress(f"round {rounds}: torques off by {gap:.1e}, tensions by {moved:.1e}")
        is_nearest = idle >= STALLED and asked is not wanted
        if is_nearest:
            tension, at = best.tension, best.at
            asked = demand.component_values(at.torque)
            gap = _gap(demand, asked, at)
        if is_nearest or (gap <= AGREED and moved <= AGREED):
            if np.abs(asked - wanted).max() > max(SHORT * np.abs(wanted).max(), reserve, 1e-12):
                raise _out_of_reach(demand, wanted, asked, programme, tension, bounds, held)
            return Estimate(tension, demand.component_values(at.torque), at, solution, gap, rounds)
        trial, there = _take_step(held, tension, at, solution.x)
        new = _Reached(trial, there, _miss(demand, wanted, there))
        is_taken = True
        if rounds > WHOLE_ROUNDS:
            part = merit.part_made(reached, solution.x, new, demand, wanted)
            if part < POOR:
                region = (0.5 if part > REFUSED else 0.25) * length
            elif part > GOOD and not is_free:
                region *= 2.0
            if region < LEAST_REGION * max(1.0, float(tension.max())):
                if asked is wanted and gap <= AGREED:  # at a kink, which no step away gains from
                    kink = solution._replace(miss=max(solution.miss, moved))
                    made = demand.component_values(at.torque)
                    return Estimate(tension, made, at, kink, gap, rounds)
                break
            idle = 0 if new.miss < (1.0 - SLOW) * best.miss else idle + 1
            is_taken = part > REFUSED
        best = min(best, new, key=lambda r: r.miss)
        reached = new if is_taken else reached
    raise _not_converged(rounds, reached.miss)


class _Reached(NamedTuple):
    """Tensions (n,) N, the hood's torques under them, and the relative miss of what is wanted."""

    tension: Array
    at: Torques
    miss: float


def _aim(
    demand: Demand, wanted: Array, reached: _Reached, box: Bounds, cost: Cost
) -> tuple[Array, Programme, Optimum]:
    """The components (d,) that tensions in the box make, the wanted ones or those nearest, with the
    programme of them and its solution, linearised at what was reached."""
    tension, at = reached.tension, reached.at
    programme = linearise(demand, wanted, tension, at, box)
    solution = least(programme, cost.factors, cost.power)
    if solution is not None:
        return wanted, programme, solution
    asked, nearby = _nearest(demand, wanted, tension, at, box)
    programme = linearise(demand, asked, tension, at, box)
    return asked, programme, least(programme, cost.factors, cost.power) or nearby


@dataclass
class Merit:
    """What a step is judged by: cost, relative to the largest seen, and the miss of what is wanted,
    at a weight that grows until a step that the linearised hood calls for counts as a gain
    (Nocedal and Wright 2006, sections 18.3 and 18.5)."""

    cost: Cost
    weight: float = 1.0
    scale: float = 0.0

    def part_made(
        self, reached: _Reached, aim: Array, new: _Reached, demand: Demand, wanted: Array
    ) -> float:
        """The gain of a step over the one that the linearised hood promised of the aim (n,) N."""
        at, begun = reached.at, reached.tension
        torque = at.torque + at.by_tension @ (aim - begun)
        miss = _miss(demand, wanted, at._replace(torque=torque))
        values = [float(self.cost.factors @ t**self.cost.power) for t in (begun, aim, new.tension)]
        self.scale = max(self.scale, *values[:2])
        before, promised, after = (value / (self.scale or 1.0) for value in values)
        if reached.miss > miss:
            self.weight = max(self.weight, 2.0 * (promised - before) / (reached.miss - miss))
        gain = before - promised + self.weight * (reached.miss - miss)
        if gain <= SHORT:
            return 1.0
        return (before - after + self.weight * (reached.miss - new.miss)) / gain


def least_beyond(programme: Programme, cost: Cost, kept: Array) -> Optimum | None:
    """The tensions that cost least, by squares, in what they have beyond those `kept` (n,) N."""
    A, b, lower, upper = programme
    found = least(Programme(A, b - A @ kept, lower - kept, upper - kept), cost.factors, 2)
    if found is None:
        return None
    return found._replace(x=np.clip(kept + found.x, lower, upper))


def linearise(
    demand: Demand, wanted: Array, tension: Array, at: Torques, bounds: Bounds
) -> Programme:
    """The demand's equations in the tensions, as the hood's tangent has them."""
    A = demand.rows @ at.by_tension
    offset = at.torque - at.by_tension @ tension + demand.beside
    return Programme(A, demand.spread @ wanted - demand.rows @ offset, *bounds)


def nearest(demand: Demand, wanted: Array, tension: Array, at: Torques, bounds: Bounds) -> Array:
    """The components (d,) nearest to those wanted that tensions within the bounds can make, as
    linearised.  Raises InputError where they balance none at all."""
    return _nearest(demand, wanted, tension, at, bounds)[0]


def _nearest(
    demand: Demand, wanted: Array, tension: Array, at: Torques, bounds: Bounds
) -> tuple[Array, Optimum]:
    """The components of `nearest`, and tensions that make them."""
    programme = linearise(demand, wanted, tension, at, bounds)
    d, n = len(wanted), len(tension)
    free = np.full(d, np.inf)
    # in units of what a unit of tension makes, so that the programme is well scaled
    unit = float(np.abs(programme.A).max(initial=0.0)) or 1.0
    wider = Programme(
        np.hstack([-unit * demand.spread, programme.A]),
        programme.b,
        np.append(-free, bounds.least),
        np.append(free, bounds.most),
    )
    solution = least(wider, np.append(np.ones(d), np.zeros(n)), 2)
    if solution is None:
        raise InputError(
            "no tensions within their bounds balance this posture, whatever the fingertip's force: "
            "some joint is left with a torque. Try another posture, wider bounds (max_force of a "
            'tendon), or a clamped fingertip (finger.tip.kind = "clamped")'
        )
    made = np.clip(solution.x[d:], *bounds)
    return wanted + unit * solution.x[:d], Optimum(made, np.zeros(d), solution.miss)


def reach(demand: Demand, wanted: Array, programme: Programme) -> tuple[float, float] | None:
    """The least and the largest multiple, none negative, of the wanted components that the bounds
    allow, as linearised; None where there is none.  `programme`: linearised at the wanted."""
    from scipy.optimize import linprog

    way = demand.spread @ wanted
    A = np.hstack([-way[:, None], programme.A])
    bounds = [(0.0, None), *zip(programme.lower, programme.upper, strict=True)]
    ends = []
    for sign in (1.0, -1.0):
        cost = np.append(sign, np.zeros(len(programme.lower)))
        solution = linprog(cost, A_eq=A, b_eq=programme.b - way, bounds=bounds, method="highs")
        if not solution.success:
            return None
        ends.append(float(solution.x[0]))
    return ends[0], ends[1]


def _take_step(held: HeldFinger, tension: Array, at: Torques, aim: Array) -> tuple[Array, Torques]:
    """The tensions aimed at, and the hood there; a part of the way where the hood's own solve
    fails, from its last state or from its start."""
    part = 1.0
    while True:
        trial = tension + part * (aim - tension)
        for state in (at.state, None):
            try:
                return trial, held.at(trial, held.begin() if state is None else state)
            except ConvergenceError as error:
                why = error
        part *= 0.5
        if part < LEAST_PART:
            raise ConvergenceError(f"the hood found no equilibrium on the way: {why}") from why


def _gap(demand: Demand, asked: Array, at: Torques) -> float:
    """The torques' largest miss, relative to the largest torque in play."""
    need = demand.spread @ asked
    scale = max(float(np.abs(at.torque).max()), float(np.abs(need).max()), 1e-6)
    return float(np.abs(demand.rows @ (at.torque + demand.beside) - need).max() / scale)


def _miss(demand: Demand, wanted: Array, at: Torques) -> float:
    """The torques' miss by squares, as `nearest` has it, relative to the wanted torques."""
    need = demand.spread @ wanted
    missed = demand.rows @ (at.torque + demand.beside) - need
    return float(np.linalg.norm(missed) / max(float(np.linalg.norm(need)), 1e-6))


def _out_of_reach(
    demand: Demand,
    wanted: Array,
    asked: Array,
    programme: Programme,
    tension: Array,
    bounds: Bounds,
    held: HeldFinger,
) -> InputError:
    """What to say where the components asked for are not those wanted."""
    shift = demand.spread @ (wanted - asked)
    ends = reach(demand, wanted, programme._replace(b=programme.b + shift))
    full = [n for n, t, m in zip(held.names, tension, bounds.most, strict=True) if t >= 0.999 * m]
    way = "nothing" if ends is None else f"{ends[0]:.3g} to {ends[1]:.3g} times what is wanted"
    return InputError(
        f"no tensions within their bounds make {format_components(demand, wanted)}. The nearest "
        f"that they make is {format_components(demand, asked)}; in the wanted direction they make "
        f"{way}. "
        + (f"At their greatest force there: {', '.join(full)}. " if full else "")
        + "Ask for less, or widen the bounds (max_force of a tendon)"
    )


def format_components(demand: Demand, values: Array) -> str:
    """The components with names and units."""
    factor, unit = (1e3, "N mm") if demand.unit == "N m" else (1.0, "N")
    seen = np.where(np.abs(values) > NEGLIGIBLE * np.abs(values).max(), factor * values, 0.0)
    parts = zip(demand.names, seen, strict=True)
    return ", ".join(f"{name} {value:.4g}" for name, value in parts) + f" {unit}"


def _not_converged(rounds: int, last: float) -> ConvergenceError:
    return ConvergenceError(
        f"estimate: hood and linearisation did not agree in {rounds} rounds; torques and tensions "
        f"are off by {last:.1e} (relative). Try a quadratic cost, whose solution has no jumps, a "
        "smaller target, or a hood without slack tendons"
    )
